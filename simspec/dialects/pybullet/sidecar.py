"""The form of a URDF folder's sidecar, and whether its lists fit together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from simspec.formats.kit.forms import COMMON, ListOf, check_common, check_distinct, check_fields, check_known
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE

UNIT = 1e-9
"""How far a quaternion may be from unit length: numbers are printed to round-trip, and normalised before."""
ROOTS = ("free", "fixed", "world link")
"""What the base of a tree is: its free root, its fixed root, or a link that stands for the world."""

FORM: Mapping[str, Any] = {
    **COMMON,
    "gravity": ListOf(float, 3),
    "timestep": float,
    "instances": ListOf(
        {
            "file": str,
            "model": str,
            "root": str,
            "base": {"position": ListOf(float, 3), "quaternion": ListOf(float, 4)},
            "bodies": ListOf(str),
            "joints": ListOf(str),
            "shapes": ListOf(ListOf(str, distinct=True)),
            "visual_only": ListOf(ListOf(int, distinct=True)),
            "copies": ListOf({"link": str, "body": str, "layer": int, "shapes": ListOf(str, distinct=True)}),
            "layers": ListOf(int),
            "position": ListOf(float),
            "velocity": ListOf(float),
        }
    ),
    "springs": ListOf({"body": str, "stiffness": float, "rest": float}),
    "armature": ListOf({"body": str, "armature": float}),
    "collision_filter": {
        "classes": ListOf({"group": int, "mask": int, "links": ListOf(str)}),
        "excluded": ListOf(ListOf(str, 2), distinct=True),
    },
    "restitution_threshold": float,
    "native_contact": bool,
    "sleepers?": ListOf(str, distinct=True),
}


def check_sidecar(content: Mapping[str, Any]) -> None:
    """Raise ValueError where a sidecar is not of the form, or its lists do not fit together."""
    check_fields(content, dict(FORM))
    bodies = check_common(content)
    kinds = {body["name"]: body["kind"] for body in content["bodies"]}
    named = [name for instance in content["instances"] for name in instance["bodies"]]
    check_distinct(named, "sidecar.instances")
    if set(named) != set(kinds):
        raise ValueError(f"sidecar.instances and sidecar.bodies differ in {sorted(set(named) ^ set(kinds))}")
    solid: set[str] = set()
    for index, instance in enumerate(content["instances"]):
        at = f"sidecar.instances.{index}"
        _check_instance(instance, kinds, at)
        solid.update(copy["link"] for copy in instance["copies"])
        solid.update(
            body
            for body, names, places in zip(instance["bodies"], instance["shapes"], instance["visual_only"], strict=True)
            if len(names) > len(places)
        )
    for name in ("springs", "armature"):
        check_distinct((entry["body"] for entry in content[name]), f"sidecar.{name}")
        check_known((entry["body"] for entry in content[name]), bodies, f"sidecar.{name}")
    _check_classes(content["collision_filter"]["classes"], solid)
    pairs = {name for pair in content["collision_filter"]["excluded"] for name in pair}
    check_known(pairs, solid, "sidecar.collision_filter.excluded")
    check_known(content.get("sleepers", ()), bodies, "sidecar.sleepers")
    if ("sleepers" in content) != bool(content["settings"].get("sleeping", False)):
        raise ValueError("sidecar.sleepers are those of the setting sleeping: both or none")


def _check_classes(classes: Sequence[Mapping[str, Any]], solid: set[str]) -> None:
    """Every link with collision shapes is in one class, every class has a bit of its own and asks for such bits alone."""
    at = "sidecar.collision_filter.classes"
    held = [name for one in classes for name in one["links"]]
    check_distinct(held, at)
    if set(held) != solid or not all(one["links"] for one in classes):
        raise ValueError(f"{at} do not hold each link with collision shapes: {sorted(set(held) ^ solid)}")
    bits = [one["group"] for one in classes]
    check_distinct(bits, f"{at}, groups")
    if not all(0 < bit < 1 << 31 and bit & (bit - 1) == 0 for bit in bits):
        raise ValueError(f"{at} have the groups {bits}, should each be one bit")
    if any(one["mask"] < 0 or one["mask"] & ~sum(bits) for one in classes):
        raise ValueError(f"{at} have masks with bits that are of no class")


def _check_instance(instance: Mapping[str, Any], kinds: Mapping[str, str], at: str) -> None:
    bodies = instance["bodies"]
    if instance["root"] not in ROOTS:
        raise ValueError(f"{at}.root is {instance['root']!r}, should be one of {', '.join(ROOTS)}")
    for name in ("joints", "shapes", "visual_only", "layers"):
        if len(instance[name]) != len(bodies):
            raise ValueError(f"{at}.{name} has {len(instance[name])} entries for {len(bodies)} bodies")
    for names, places in zip(instance["shapes"], instance["visual_only"], strict=True):
        if not set(places) <= set(range(len(names))):
            raise ValueError(f"{at}.visual_only names shapes {places} of {len(names)}")
    for name, sizes in (("position", POSITION_SIZE), ("velocity", VELOCITY_SIZE)):
        size = sum(sizes[kinds[body]] for body in bodies)
        if len(instance[name]) != size:
            raise ValueError(f"{at}.{name} has {len(instance[name])} numbers, should have {size}")
    _check_placed(instance, kinds, at)
    check_known({copy["body"] for copy in instance["copies"]}, set(bodies), f"{at}.copies")
    shapes = dict(zip(bodies, instance["shapes"], strict=True))
    for copy in instance["copies"]:
        check_known(set(copy["shapes"]), set(shapes[copy["body"]]), f"{at}.copies, link {copy['link']!r}")
    check_distinct((copy["link"] for copy in instance["copies"]), f"{at}.copies")


def _check_placed(instance: Mapping[str, Any], kinds: Mapping[str, str], at: str) -> None:
    """The base stands where its free root does, and rotations are of unit length."""
    base, numbers = instance["base"], list(instance["position"])
    if instance["root"] == "free" and [*base["position"], *base["quaternion"]] != numbers[:7]:
        raise ValueError(f"{at}.base is not where {at}.position puts it")
    turns = [base["quaternion"]]
    for body in instance["bodies"]:
        own = [numbers.pop(0) for _ in range(POSITION_SIZE[kinds[body]])]
        if kinds[body] in ("ball", "free"):
            turns.append(own[-4:])
    if any(abs(math.hypot(*turn) - 1.0) > UNIT for turn in turns):
        raise ValueError(f"{at} has a quaternion that is not of unit length")
