"""Read a folder of the format ``world`` (proof level L0), and its parsed content for engines.

What is shared with the emitter is the names of the files. :func:`read_content` is for engines too: it checks the form, and that
the names fit together, so that an engine need not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simspec.dialects.kit.sidecar import read_sidecar
from simspec.errors import SpecError
from simspec.formats.kit.forms import (
    COMMON,
    ListOf,
    check_common,
    check_distinct,
    check_fields,
    check_known,
)
from simspec.formats.kit.passes import restore_frames
from simspec.outputs.reading import read_text
from simspec.reading import NotReadableError, parse_json
from simspec.world import frames
from simspec.world.types import (
    FRICTION_CONES,
    SHAPE_SIZE_NAMES,
    Body,
    Hardness,
    Inertial,
    Joint,
    Pose,
    ReadBack,
    Shape,
    Surface,
)

WORLD = "world.json"
SCHEMA = 1

VECTOR = ListOf(float, 3)
POSE = {"position": VECTOR, "quaternion": ListOf(float, 4)}
HARDNESS = {"kind": str, "time_constant": float, "damping_ratio": float, "stiffness": float, "damping": float}
SURFACE = ("friction", "torsional_friction", "rolling_friction", "restitution")
COPY = {"layer": int, **dict.fromkeys(SURFACE, float), "hardness?": HARDNESS}
SHAPE = {
    "name": str,
    "kind": str,
    "size": ListOf(float),
    "pose": POSE,
    "material": str,
    "colour": object,
    "copies": ListOf(COPY),
}
PAIRS = ListOf(ListOf(str, 2), distinct=True)
FORM: Mapping[str, Any] = {
    "schema": int,
    "gravity": VECTOR,
    "timestep": float,
    "friction_cone": str,
    "bodies": ListOf(
        {
            "name": str,
            "model": str,
            "group": str,
            "mass": float,
            "centre_of_mass": VECTOR,
            "inertia": ListOf(float, 6),
            "joint": object,
            "shapes": ListOf(SHAPE),
        }
    ),
    "meets": ListOf(ListOf(object, 3)),
    "apart": {"bodies": PAIRS, "groups": PAIRS},
}
ONE, LOSSES = ListOf(float, 1), {"damping": float, "spring_stiffness": float}
HELD = {"name": str, "kind": str, "parent": object, "origin": POSE}
DRIVEN = {
    **HELD,
    **LOSSES,
    **dict.fromkeys(("position_limits", "velocity_limit", "effort_limit"), object),
    **dict.fromkeys(("spring_rest", "dry_friction", "armature"), float),
    "axis": VECTOR,
    "position": ONE,
    "velocity": ONE,
}
JOINTS: Mapping[str, Any] = {
    "fixed": HELD,
    "hinge": DRIVEN,
    "slide": DRIVEN,
    "ball": {**HELD, **LOSSES, "position": ListOf(float, 4), "velocity": VECTOR},
    "free": {"name": str, "kind": str, "position": ListOf(float, 7), "velocity": ListOf(float, 6)},
}
UNIT = 1e-12
"""How far an axis or a quaternion may be from unit length: the tolerance of text."""
UNREADABLE = {"control.native": "the engine's own controllers are switched on when a run begins"}


def read_content(folder: Path) -> dict[str, Any]:
    """The content of ``world.json``. Raises ValueError, which names the place, where it is not of the form, or where its names
    do not fit together."""
    path = folder / WORLD
    try:
        content = parse_json(read_text(path))
    except (SpecError, NotReadableError) as error:
        raise ValueError(f"{WORLD}: {error}") from None
    check_fields(content, dict(FORM), WORLD)
    if content["schema"] != SCHEMA:
        raise ValueError(f"{WORLD}: schema {content['schema']!r}, this simspec reads {SCHEMA}")
    check_known((content["friction_cone"],), FRICTION_CONES, f"{WORLD}.friction_cone")
    if not content["timestep"] > 0.0:
        raise ValueError(f"{WORLD}.timestep is {content['timestep']}, should be above zero")
    above: set[str] = set()
    for index, body in enumerate(content["bodies"]):
        at = f"{WORLD}.bodies.{index}"
        _check_joint(body["joint"], above, f"{at}.joint")
        for number, shape in enumerate(body["shapes"]):
            _check_shape(shape, f"{at}.shapes.{number}")
        check_distinct([*above, body["name"]], f"{WORLD}.bodies")
        above.add(body["name"])
    check_distinct((shape["name"] for body in content["bodies"] for shape in body["shapes"]), f"{WORLD} (shapes)")
    check_distinct((body["joint"]["name"] for body in content["bodies"]), f"{WORLD} (joints)")
    for one, other in content["apart"]["bodies"]:
        check_distinct((one, other), f"{WORLD}.apart.bodies")
    check_known((name for pair in content["apart"]["bodies"] for name in pair), above, f"{WORLD}.apart.bodies")
    groups = {body["group"] for body in content["bodies"] if any(shape["copies"] for shape in body["shapes"])}
    check_known((name for pair in content["apart"]["groups"] for name in pair), groups, f"{WORLD}.apart.groups")
    _check_meetings(content)
    return content


def _check_meetings(content: Mapping[str, Any]) -> None:
    """Two materials meet in one layer, in which both have copies."""
    at = f"{WORLD}.meets"
    layers = {
        (shape["material"], copy["layer"])
        for body in content["bodies"]
        for shape in body["shapes"]
        for copy in shape["copies"]
    }
    for one, other, layer in content["meets"]:
        if type(layer) is not int or not {(one, layer), (other, layer)} <= layers:
            raise ValueError(f"{at} has {[one, other, layer]!r}, and both materials have no copy in that layer")
    check_distinct((tuple(sorted(entry[:2])) for entry in content["meets"]), at)


def _check_joint(joint: Any, above: set[str], at: str) -> None:
    kind = joint.get("kind") if isinstance(joint, dict) else None
    check_known((kind,), JOINTS, at) if isinstance(kind, str) else check_fields(joint, {"kind": str}, at)
    check_fields(joint, JOINTS[kind], at)
    if (parent := joint.get("parent")) is not None and parent not in above:
        raise ValueError(f"{at}.parent is {parent!r}, which is no body before it")
    if "origin" in joint:
        _check_unit(joint["origin"]["quaternion"], f"{at}.origin.quaternion")
    if "axis" in joint:
        _check_unit(joint["axis"], f"{at}.axis")
    if kind in ("ball", "free"):
        _check_unit(joint["position"][-4:], f"{at}.position")
    limits = joint.get("position_limits")
    if limits is not None:
        check_fields(limits, ListOf(float, 2), f"{at}.position_limits")
    for name in ("velocity_limit", "effort_limit"):
        if joint.get(name) is not None:
            check_fields(joint[name], float, f"{at}.{name}")


def _check_shape(shape: Mapping[str, Any], at: str) -> None:
    check_known((shape["kind"],), SHAPE_SIZE_NAMES, f"{at}.kind")
    check_fields(shape["size"], ListOf(float, len(SHAPE_SIZE_NAMES[shape["kind"]])), f"{at}.size")
    _check_unit(shape["pose"]["quaternion"], f"{at}.pose.quaternion")
    if shape["colour"] is not None:
        check_fields(shape["colour"], ListOf(float, 4), f"{at}.colour")
    elif not shape["copies"]:
        raise ValueError(f"{at} is neither visual nor collision")
    if shape["material"] and not shape["copies"]:
        raise ValueError(f"{at} has the material {shape['material']!r} and is no collision shape")
    layers = [copy["layer"] for copy in shape["copies"]]
    if layers != sorted(set(layers)):
        raise ValueError(f"{at}.copies are not in the order of their layers, each once")


def _check_unit(values: Any, at: str) -> None:
    length = sum(value * value for value in values)
    if abs(length - 1.0) > 2.0 * UNIT:
        raise ValueError(f"{at} is {values}, should be of length 1")


def check_sidecar(sidecar: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    """Raise ValueError where a sidecar is not of the form, or speaks of another world."""
    check_fields(sidecar, dict(COMMON))
    check_common(sidecar)
    told = [(body["name"], body["kind"]) for body in sidecar["bodies"]]
    if told != [(body["name"], body["joint"]["kind"]) for body in content["bodies"]]:
        raise ValueError(f"the bodies of {WORLD} are not those that the sidecar names")
    if sidecar["friction_cone"] != content["friction_cone"]:
        raise ValueError(f"the friction cone of {WORLD} is not the sidecar's")
    for body in sidecar["bodies"]:
        if body["kind"] != "free" and any(body["frame_offset"]):
            raise ValueError(f"the sidecar moves the frame of {body['name']!r}, which is no free root")


def read_folder(folder: Path) -> ReadBack:
    """The model in ``folder``, in the world's frames. Raises ValueError where the files are not as they should be."""
    content, sidecar = read_content(folder), read_sidecar(folder)
    check_sidecar(sidecar, content)
    offsets = {one["name"]: tuple(one["frame_offset"]) for one in sidecar["bodies"] if any(one["frame_offset"])}
    bodies = tuple(_body(body) for body in content["bodies"])
    return ReadBack(
        restore_frames(bodies, offsets),
        tuple(content["gravity"]),
        content["timestep"],
        content["friction_cone"],
        dict(UNREADABLE),
    )


def pose_of(plain: Mapping[str, Any]) -> Pose:
    """A pose from its plain form."""
    return Pose(tuple(map(float, plain["position"])), tuple(map(float, plain["quaternion"])))  # type: ignore[arg-type]


def _body(body: Mapping[str, Any]) -> Body:
    inertial = Inertial(body["mass"], tuple(body["centre_of_mass"]), tuple(body["inertia"]))  # type: ignore[arg-type]
    shapes = tuple(_shape(shape) for shape in body["shapes"])
    return Body(body["name"], body["model"], inertial, _joint(body["joint"]), shapes, body["group"])


def _joint(joint: Mapping[str, Any]) -> Joint:
    known = {field.name for field in dataclasses.fields(Joint)}
    told = {name: tuple(value) if isinstance(value, list) else value for name, value in joint.items() if name in known}
    if "origin" in told:
        told["origin"] = pose_of(joint["origin"])
    if told["kind"] in ("ball", "free"):
        told["position"] = (*told["position"][:-4], *frames.normalise(told["position"][-4:]))
    return Joint(**told)


def _shape(shape: Mapping[str, Any]) -> Shape:
    return Shape(
        shape["name"],
        shape["kind"],
        tuple(shape["size"]),
        pose_of(shape["pose"]),
        collision=bool(shape["copies"]),
        visual=shape["colour"] is not None,
        colour=tuple(shape["colour"]) if shape["colour"] is not None else Shape("", "plane", ()).colour,  # type: ignore[arg-type]
        surfaces=tuple(surface_of(copy) for copy in shape["copies"]),
    )


def surface_of(copy: Mapping[str, Any]) -> Surface:
    """The numbers of one copy of a shape."""
    hardness = Hardness(**copy["hardness"]) if "hardness" in copy else None
    return Surface(**{name: copy[name] for name in SURFACE}, hardness=hardness)
