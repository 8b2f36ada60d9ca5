"""Joints of URDF as joints of bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import Draft, angle, numbers, plain, pose, renamed
from simspec.imports.elements import NO_RATING, Element
from simspec.imports.urdf import planar
from simspec.imports.urdf.table import INFORMATION, LOST, UNUSED, attributes_unused
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Pose

TYPES: Final = {
    "fixed": "fixed",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
    "spherical": "ball",
    "floating": "free",
    "planar": "planar",
}
"""Types of URDF, and of the language; a planar joint is three of its joints (:mod:`simspec.imports.urdf.planar`)."""
AXIS: Final = (1.0, 0.0, 0.0)
"""The axis where the file says none."""


@dataclass
class Joint:
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
    """What the spec calls the three joints of a planar one."""

    def listed(self) -> list[dict[str, Any]]:
        """The joint as items of the word `joints`."""
        if self.parts:
            return planar.written(self.parts, self.data)
        return [{"name": self.name, "type": self.kind, **self.data}]

    def placed(self, body: str) -> dict[str, Any]:
        """The word of ``body`` that has the joint: `joint`, or `joints` where it is several."""
        return {"joints": self.listed()} if self.parts else {"joint": self.written(body)}

    def written(self, body: str) -> dict[str, Any]:
        """The joint of ``body`` as the spec says it."""
        name = {} if self.name == f"{body}_joint" else {"name": self.name}
        return {**name, "type": self.kind, **self.data}


def read_joint(element: Element, given: str, parts: Sequence[str], bodies: Mapping[str, str], draft: Draft) -> Joint:
    """A joint, called ``given`` in the spec, and if it is planar ``parts``; ``bodies``: what the spec calls the links. Raises
    SpecError for what is none; defects that rules repair are collected."""
    element.need("name")
    renamed(element, "name", given)
    word = element.need("type")
    if word not in TYPES:
        raise element.error("not a type of joint", word, ", ".join(TYPES))
    parent, child = _link(element, "parent"), _link(element, "child")
    joint = Joint(element, given, bodies.get(child, child), TYPES[word], parent, child)
    origin = element.child("origin")
    if origin is not None:
        xyz, rpy = origin.vector("xyz"), origin.vector("rpy")
        joint.origin = Pose(xyz, frames.from_rpy(*rpy))
        if where := pose(xyz, rpy):
            joint.data["origin"] = where
    if joint.kind in SCALAR_JOINTS:
        _moving(joint, word, draft)
    elif joint.kind == "planar":
        joint.parts = parts
        joint.data["axis"] = _axis(element)
        planar.set_aside(element, parts)
    else:
        for other in element.look("axis", "limit", "dynamics"):
            attributes_unused(other, f"a {word} joint has none")
        if joint.kind == "ball":
            _dynamics(joint)
    return joint


def _link(element: Element, tag: str) -> str:
    part = element.child(tag)
    if part is None:
        raise element.error(f"<joint> has no <{tag}>")
    return part.need("link")


def _moving(joint: Joint, word: str, draft: Draft) -> None:
    joint.data["axis"] = _axis(joint.element)
    limits = _limits(joint, word, draft)
    if limits:
        joint.data["limits"] = limits
    _dynamics(joint)


def _axis(element: Element) -> list[float]:
    axis = element.child("axis")
    along = axis.vector("xyz", AXIS) if axis is not None else AXIS
    if axis is not None and not any(along):
        raise axis.error("an axis of length 0", axis.attributes["xyz"])
    return numbers(along)


def _limits(joint: Joint, word: str, draft: Draft) -> dict[str, Any]:
    element = joint.element
    limit = element.child("limit")
    if limit is None:
        if word != "continuous":
            _without_limits(joint, word, draft)
        return {}
    limits: dict[str, Any] = {}
    if word == "continuous":
        for name in ("lower", "upper"):
            limit.set_aside(name, UNUSED, "a continuous joint has no limits", INFORMATION)
    elif not (limit.has("lower") or limit.has("upper")):
        _without_limits(joint, word, draft)
    else:
        lower, upper = limit.number("lower", 0.0) or 0.0, limit.number("upper", 0.0) or 0.0
        if lower > upper:
            lower, upper = _turned(limit, lower, upper, draft, joint)
        bounds = (lower, upper)
        limits["position"] = [angle(value) if joint.kind == "hinge" else plain(value) for value in bounds]
    for name in ("velocity", "effort"):
        value = limit.number(name)
        if value is not None and value < 0.0:
            raise limit.error(f"{name} of <limit> must not be below 0", f"{value:g}")
        if value == 0.0:
            limit.set_aside(name, LOST, NO_RATING, INFORMATION)
        elif value is not None:
            limits[name] = plain(value)
    return limits


def _without_limits(joint: Joint, word: str, draft: Draft) -> None:
    rule = "missing-limits"
    if not draft.repairing(rule):
        draft.defect(joint.element, f"a {word} joint needs a <limit> with lower and upper", rule, RULES[rule])
        return
    what = f"a {word} joint without lower and upper of <limit> has no limits"
    draft.repaired(rule, joint.element, what, ("model", "bodies", joint.body, "joint"))


def _turned(limit: Element, lower: float, upper: float, draft: Draft, joint: Joint) -> tuple[float, float]:
    rule = "turned-limits"
    if not draft.repairing(rule):
        draft.defect(limit, "the lower limit is above the upper", rule, RULES[rule], found=f"{lower:g} > {upper:g}")
    else:
        what = f"limits {lower:g}, {upper:g} became {upper:g}, {lower:g}"
        draft.repaired(rule, limit, what, ("model", "bodies", joint.body, "joint", "limits"))
    return upper, lower


def _dynamics(joint: Joint) -> None:
    dynamics = joint.element.child("dynamics")
    if dynamics is None:
        return
    words = {"damping": "damping"} if joint.kind == "ball" else {"damping": "damping", "friction": "dry_friction"}
    for name, word in words.items():
        value = dynamics.number(name)
        if value is not None and value < 0.0:
            raise dynamics.error(f"{name} of <dynamics> must not be below 0", f"{value:g}")
        if value:
            joint.data[word] = plain(value)


def reflect(root: Element, joints: Sequence[Joint]) -> None:
    """Give joints the inertia of their rotors, of Drake's words for actuators: at the joint it is I r², of a rotor of I
    (kg m²) and a gear of ratio r. Raises SpecError for what are no numbers."""
    known = {joint.element.attributes["name"].strip(): joint for joint in joints}
    for transmission in root.look("transmission"):
        names = [one.attributes.get("name", "").strip() for one in transmission.look("joint")]
        for actuator in transmission.look("actuator"):
            for inertia in actuator.look(ROTOR):
                gears = actuator.look(GEAR)[:1]
                rotor = inertia.number("value", 0.0) or 0.0
                ratio = gears[0].number("value", 1.0) or 0.0 if gears else 1.0
                if rotor < 0.0:
                    raise inertia.error("an inertia of a rotor below 0", f"{rotor:g}")
                joint = known.get(names[0]) if len(names) == 1 else None
                if joint is None or joint.kind not in SCALAR_JOINTS:
                    inertia.set_aside(None, LOST, "it is of no single hinge or slide")
                    continue
                actuator.set_aside(None, LOST, "describes actuators", INFORMATION)
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
