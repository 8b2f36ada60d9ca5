"""Joints of URDF as joints of bodies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import Draft, angle, follow, numbers, plain, pose
from simspec.imports.elements import (
    CARRIED,
    INFORMATION,
    LOCKED,
    LOST,
    NO_RATING,
    PHYSICS,
    UNUSED,
    Element,
    names,
    renamed,
)
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Pose, Vector3

# Planar joints: two slides across the axis, and a hinge about it.

PARTS: Final = ("x", "y", "yaw")
"""Suffixes of the names of the three joints, after the joint's name and ``_``."""
SENSELESS: Final = "URDF does not say which of the three motions of a planar joint is meant"


def across(axis: Vector3) -> tuple[Vector3, Vector3]:
    """Two directions that are right-handed with ``axis``: x and y, turned as little as turns z into the axis."""
    length = math.hypot(*axis)
    x, y, z = (value / length for value in axis)
    if z < 0.0:  # the least turn from -z, after half a turn about x; no division by nearly 0
        first, second = across((x, y, -z))
        return (first[0], first[1], -first[2]), (-second[0], -second[1], second[2])
    share = 1.0 / (1.0 + z)
    return (1.0 - x * x * share, -x * y * share, -x), (-x * y * share, 1.0 - y * y * share, -y)


def planar_joints(names: Sequence[str], data: dict[str, Any]) -> list[dict[str, Any]]:
    """The three joints of a body, of these names; ``data`` has the `axis` and the `origin` of the planar joint."""
    axis = data["axis"]
    x, y = across(frames.vector3(axis))
    kinds = (("slide", x), ("slide", y), ("hinge", axis))
    called = zip(names, kinds, strict=True)
    joints = [{"name": name, "type": kind, "axis": numbers(along)} for name, (kind, along) in called]
    if "origin" in data:
        joints[0]["origin"] = data["origin"]
    return joints


def set_aside(element: Element, names: Sequence[str]) -> None:
    """Say what of a planar joint is not carried: limits and dynamics have no meaning for three motions at once.
    Raises SpecError for damping or friction that is not finite."""
    element.set_aside("name", CARRIED, f"called {', '.join(names)} in the spec", INFORMATION)
    for part in element.look("limit"):
        part.set_aside_whole(LOST, SENSELESS, INFORMATION)
    for part in element.look("dynamics"):
        acts = [part.number(name) for name in ("damping", "friction")]
        fate, severity = (LOST, PHYSICS) if any(acts) else (UNUSED, INFORMATION)
        part.set_aside_whole(fate, SENSELESS, severity)


TYPES: Final = {
    "fixed": "fixed",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
    "spherical": "ball",
    "floating": "free",
    "planar": "planar",
}
"""Types of URDF, and of the language; a planar joint is three of its joints (:mod:`simspec.imports.urdf.joints`)."""
AXIS: Final = (1.0, 0.0, 0.0)
"""The axis where the file says none."""


@dataclass
class UrdfJointRead:
    """A joint of the file. ``data`` has the words of the language but ``name`` and ``type``."""

    element: Element
    name: str
    """As the spec calls it."""
    body: str
    """The child's body, as the spec calls it."""
    kind: str
    """Of the language."""
    parent: str
    child: str
    """Links, as the file calls them."""
    data: dict[str, Any] = field(default_factory=dict)
    origin: Pose = field(default_factory=Pose)
    """The joint's frame in the parent link's."""
    parts: Sequence[str] = ()
    """The names of the three joints of a planar one in the spec."""

    def listed(self) -> list[dict[str, Any]]:
        """The joint as items of the word `joints`."""
        if self.parts:
            return planar_joints(self.parts, self.data)
        return [{"name": self.name, "type": self.kind, **self.data}]

    def placed(self, body: str) -> dict[str, Any]:
        """The word of ``body`` that has the joint: `joint`, or `joints` where it is several."""
        return {"joints": self.listed()} if self.parts else {"joint": self.written(body)}

    def written(self, body: str) -> dict[str, Any]:
        """The joint of ``body`` as the spec says it."""
        name = {} if self.name == f"{body}_joint" else {"name": self.name}
        return {**name, "type": self.kind, **self.data}


def read_joint(
    element: Element, given: str, parts: Sequence[str], bodies: Mapping[str, str], draft: Draft
) -> UrdfJointRead:
    """A joint, called ``given`` in the spec, and if it is planar ``parts``; ``bodies``: the names of the links in the spec.
    Raises SpecError for what is none; defects that rules repair are collected."""
    element.need("name")
    renamed(element, "name", given)
    word = element.need("type")
    if word not in TYPES:
        raise element.error("not a type of joint", word, ", ".join(TYPES), code="I101")
    parent, child = _link(element, "parent"), _link(element, "child")
    joint = UrdfJointRead(element, given, bodies.get(child, child), TYPES[word], parent, child)
    origin = element.child("origin")
    if origin is not None:
        xyz, rpy = origin.vector("xyz"), origin.vector("rpy")
        joint.origin = Pose(xyz, frames.from_rpy(*rpy))
        if where := pose(xyz, rpy):
            joint.data["origin"] = where
    if joint.kind in SCALAR_JOINTS:
        joint.data["axis"] = _axis(joint.element)
        limits = _limits(joint, word, draft)
        if limits:
            joint.data["limits"] = limits
        _dynamics(joint)
    elif joint.kind == "planar":
        joint.parts = parts
        joint.data["axis"] = _axis(element)
        set_aside(element, parts)
    else:
        for other in element.look("axis", "limit", "dynamics"):
            other.set_aside_whole(UNUSED, f"a {word} joint has none", INFORMATION)
        if joint.kind == "ball":
            _dynamics(joint)
    return joint


def names_of(elements: Sequence[Element], *reserved: str) -> list[str]:
    """The names of elements as the spec has them."""
    return names([element.attributes.get("name", "").strip() for element in elements], reserved)


def names_of_joints(elements: Sequence[Element]) -> tuple[list[str], dict[int, list[str]]]:
    """The names of joints as the spec has them, and of the planar ones, by their places in the file, those of their parts."""
    wanted = [element.attributes.get("name", "").strip() for element in elements]
    several = [
        index for index, element in enumerate(elements) if element.attributes.get("type", "").strip() == "planar"
    ]
    more = [f"{wanted[index]}_{part}" for index in several for part in PARTS]
    given = names([*wanted, *more])
    count = len(PARTS)
    starts = range(len(wanted), len(given), count)
    return given[: len(wanted)], {index: given[at : at + count] for index, at in zip(several, starts, strict=True)}


def _link(element: Element, tag: str) -> str:
    part = element.child(tag)
    if part is None:
        raise element.error(f"<joint> has no <{tag}>", code="I101")
    return part.need("link")


def _axis(element: Element) -> list[float]:
    axis = element.child("axis")
    along = axis.vector("xyz", AXIS) if axis is not None else AXIS
    if axis is not None and not any(along):
        raise axis.error("an axis of length 0", axis.attributes["xyz"], code="I102")
    return numbers(along)


def _limits(joint: UrdfJointRead, word: str, draft: Draft) -> dict[str, Any]:
    element = joint.element
    limit, path = element.child("limit"), ("model", "bodies", joint.body, "joint")
    bounded = limit is not None and (limit.has("lower") or limit.has("upper"))
    if word != "continuous" and not bounded:
        message = f"a {word} joint needs a <limit> with lower and upper"
        repair = f"a {word} joint without lower and upper of <limit> has no limits"
        draft.mend("missing-limits", element, message, repair, path)
    if limit is None:
        return {}
    limits: dict[str, Any] = {}
    if word == "continuous":
        for name in ("lower", "upper"):
            limit.ignore(name, "a continuous joint has no limits")
    elif bounded:
        lower, upper = limit.number("lower", 0.0) or 0.0, limit.number("upper", 0.0) or 0.0
        if lower > upper:
            repair = f"limits {lower:g}, {upper:g} became {upper:g}, {lower:g}"
            message, found = "the lower limit is above the upper", f"{lower:g} > {upper:g}"
            draft.mend("turned-limits", limit, message, repair, (*path, "limits"), found)
            lower, upper = upper, lower
        limits["position"] = [angle(value) if joint.kind == "hinge" else plain(value) for value in (lower, upper)]
    for name in ("velocity", "effort"):
        value = _not_negative(limit, name)
        if value == 0.0:
            limit.lose(name, NO_RATING, INFORMATION)
        elif value is not None:
            limits[name] = plain(value)
    return limits


def _dynamics(joint: UrdfJointRead) -> None:
    dynamics = joint.element.child("dynamics")
    if dynamics is None:
        return
    words = {"damping": "damping"} if joint.kind == "ball" else {"damping": "damping", "friction": "dry_friction"}
    for name, word in words.items():
        if value := _not_negative(dynamics, name):
            joint.data[word] = plain(value)


def _not_negative(element: Element, name: str) -> float | None:
    value = element.number(name)
    if value is not None and value < 0.0:
        raise element.error(f"{name} of <{element.tag}> must not be below 0", f"{value:g}", code="I102")
    return value


def reflect(root: Element, joints: Sequence[UrdfJointRead]) -> None:
    """Give joints the inertia of their rotors, of Drake's words for actuators: at the joint it is I r², of a rotor of I
    (kg m²) and a gear of ratio r. Raises SpecError for values that are not finite."""
    known = {joint.element.attributes["name"].strip(): joint for joint in joints}
    for transmission in root.look("transmission"):
        names = [element.attributes.get("name", "").strip() for element in transmission.look("joint")]
        for actuator in transmission.look("actuator"):
            for inertia in actuator.look(ROTOR):
                gears = actuator.look(GEAR)[:1]
                rotor = inertia.number("value", 0.0) or 0.0
                ratio = gears[0].number("value", 1.0) or 0.0 if gears else 1.0
                if rotor < 0.0:
                    raise inertia.error("an inertia of a rotor below 0", f"{rotor:g}", code="I102")
                joint = known.get(names[0]) if len(names) == 1 else None
                if joint is None or joint.kind not in SCALAR_JOINTS:
                    inertia.lose(None, "it is of no single hinge or slide")
                    continue
                actuator.lose(None, "describes actuators", INFORMATION)
                for part in (inertia, *gears):
                    part.take()
                if rotor and ratio:
                    joint.data["armature"] = plain(rotor * ratio * ratio)


ROTOR: Final = "drake:rotor_inertia"
GEAR: Final = "drake:gear_ratio"
RULES: Final = {
    "missing-limits": "a revolute or prismatic joint without <limit>, or with neither lower nor upper in it, has no limits",
    "turned-limits": "a lower limit above the upper is the upper, and the upper the lower",
}

# Joints whose lower limit is their upper one: fixed joints of the language.
# Engines would keep such a joint at a limit by forces, or refuse it. A joint that follows another, or that another follows, is
# kept.


def lock(joints: Sequence[UrdfJointRead]) -> None:
    """Make joints fixed whose limits leave them one position, at that position."""
    led = {mimic.attributes.get("joint", "").strip() for joint in joints for mimic in joint.element.look("mimic")}
    for joint in joints:
        name = joint.element.attributes["name"].strip()
        if joint.kind not in SCALAR_JOINTS or name in led or joint.element.look("mimic"):
            continue
        for limit in joint.element.look("limit"):
            at = limit.number("lower", 0.0) or 0.0
            if "position" in joint.data.get("limits", {}) and at == (limit.number("upper", 0.0) or 0.0):
                _fix(joint, at)


def _fix(joint: UrdfJointRead, at: float) -> None:
    reason = f"the joint is fixed at {at:g}: {LOCKED}"
    for element in joint.element.look("axis", "limit", "dynamics"):
        for name in element.attributes:
            fate = CARRIED if name in ("lower", "upper", "xyz") else UNUSED
            element.set_aside(name, fate, reason, INFORMATION)
    if at:
        moved = _moved(joint.kind, frames.vector3(joint.data["axis"]), at)
        joint.origin = frames.compose(joint.origin, moved)
    joint.data = _origin(joint, at)
    joint.kind = "fixed"


def _moved(kind: str, axis: Vector3, at: float) -> Pose:
    length = frames.dot(axis, axis) ** 0.5
    x, y, z = (value / length for value in axis)
    if kind == "hinge":
        return Pose(quaternion=frames.from_axis_angle((x, y, z), at))
    return Pose((x * at, y * at, z * at))


def _origin(joint: UrdfJointRead, at: float) -> dict[str, object]:
    """The word `origin`: as it was where the joint is held at 0, else where it is held."""
    if not at:
        return {"origin": joint.data["origin"]} if "origin" in joint.data else {}
    position = {"xyz": numbers(joint.origin.position)} if any(joint.origin.position) else {}
    return {"origin": {"quat": numbers(joint.origin.quaternion), **position}}


LEADERS: Final = "missing-leaders"
MIMIC_RULES: Final = {LEADERS: "a joint that is to follow one that is not there moves on its own"}


def constraints(joints: Sequence[UrdfJointRead], draft: Draft) -> dict[str, Any]:
    """The constraints of all joints that follow others, by the name of the joint that follows."""
    by_name = {joint.element.attributes["name"].strip(): joint for joint in joints}
    follows = {joint.name: _follow(joint, by_name, draft) for joint in joints}
    return {name: words for name, words in follows.items() if words is not None}


def _follow(joint: UrdfJointRead, by_name: Mapping[str, UrdfJointRead], draft: Draft) -> dict[str, Any] | None:
    """The words of a joint's leader; None for one that follows none, which is reported."""
    found = joint.element.look("mimic")
    if not found:
        return None
    mimic = found[0]
    if joint.kind not in SCALAR_JOINTS:
        mimic.set_aside_whole(UNUSED, f"a {joint.kind} joint has no position to follow with", INFORMATION)
        return None
    with draft.collecting():
        name = mimic.need("joint")
        ratio, offset = mimic.number("multiplier", 1.0) or 0.0, mimic.number("offset", 0.0) or 0.0
        leader = by_name.get(name)
        why = ""
        if leader is None:
            repair = f"{joint.name} moves on its own: there is no joint {name[:80]}"
            if draft.mend(LEADERS, mimic, f"there is no joint {name[:80]!r}", repair, ("model", "bodies"), name):
                why = f"there is no joint {name[:80]}: this one moves on its own, by the rule {LEADERS}"
        elif leader is joint:
            draft.defect(mimic, "a joint cannot follow itself", found=name)
        elif leader.kind not in SCALAR_JOINTS:
            why = f"the joint {leader.name} is {leader.kind}, and has no position to be followed: this one moves on its own"
        elif ratio == 0.0:
            why = "with a multiplier of 0 the joint follows nothing: it moves on its own"
        else:
            mimic.take()
            draft.place(("model", "constraints", joint.name), mimic)
            return follow(joint.name, leader.name, ratio, offset)
        if why:
            mimic.lose(None, why, PHYSICS, "make the joint fixed" if ratio == 0.0 else "")
            for attribute in mimic.attributes:
                mimic.lose(attribute, why, INFORMATION)
    return None
