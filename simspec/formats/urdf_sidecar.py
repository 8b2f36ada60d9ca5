"""The form of a URDF folder's sidecar, and whether its lists fit together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.formats.sidecar_fields import COMMON, ListOf, check_common, check_distinct, check_fields, check_known
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE

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
    links = set(named)
    for index, instance in enumerate(content["instances"]):
        at = f"sidecar.instances.{index}"
        _check_instance(instance, kinds, at)
        links.update(copy["link"] for copy in instance["copies"])
    for name in ("springs", "armature"):
        check_distinct((entry["body"] for entry in content[name]), f"sidecar.{name}")
        check_known((entry["body"] for entry in content[name]), bodies, f"sidecar.{name}")
    held = [name for one in content["collision_filter"]["classes"] for name in one["links"]]
    check_distinct(held, "sidecar.collision_filter.classes")
    check_known(set(held), links, "sidecar.collision_filter.classes")
    pairs = {name for pair in content["collision_filter"]["excluded"] for name in pair}
    check_known(pairs, links, "sidecar.collision_filter.excluded")
    check_known(set(content.get("sleepers", ())), bodies, "sidecar.sleepers")


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
    check_known({copy["body"] for copy in instance["copies"]}, set(bodies), f"{at}.copies")
    shapes = dict(zip(bodies, instance["shapes"], strict=True))
    for copy in instance["copies"]:
        check_known(set(copy["shapes"]), set(shapes[copy["body"]]), f"{at}.copies, link {copy['link']!r}")
    check_distinct((copy["link"] for copy in instance["copies"]), f"{at}.copies")
