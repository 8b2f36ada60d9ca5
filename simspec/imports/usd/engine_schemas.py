"""Properties of joints by schemas beyond UsdPhysics: armature, dampers and springs, dry friction, largest velocity and effort,
where an axis stands and how fast it moves, which joint follows another, and which joints move one body one after the other.

Angular numbers of ``newton:`` and ``physx:`` attributes are per degree, of ``mjc:`` attributes per radian: so their schemas.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from simspec.imports.draft import plain
from simspec.imports.elements import INFORMATION
from simspec.imports.usd.stage import PrimRead

ARMATURES: Final = ("physxJoint:armature", "newton:armature", "mjc:armature")
"""Attributes for the armature of a joint, the first of which holds."""
UNBOUNDED: Final = 1e9
"""Degrees or units of length beyond which a limit is none: files write the largest number that they have."""
COMPLIANCE: Final = "how hard a constraint is: those of the spec are rigid"
LARGEST_GAP: Final = 1e-3
"""rad or m that a joint may stand away from where the file says: in single precision, written by hand."""


@dataclass(frozen=True, slots=True)
class Units:
    """Of one axis, in SI: ``inertia`` (kg m² or kg), ``position`` (rad per degree, or m) and ``effort`` (N m or N)."""

    inertia: float
    position: float
    effort: float
    turns: bool


AXIS: Final = "PhysxJointAxisAPI"
"""A schema of words for one axis of a joint, which go before those of the joint."""


def armature(prim: PrimRead, units: Units, instance: str = "") -> float:
    """The armature (kg m² or kg), 0 where none is stated. ``instance``: the name of the axis in its attributes."""
    return first_of(prim, dict.fromkeys((f"physxJointAxis:{instance}:armature", *ARMATURES), units.inertia))


def _axis_friction(prim: PrimRead, instance: str) -> str:
    """The attribute of an axis for dry friction, where one number is that of rest and of motion; "" where none is said. Two
    numbers are lost."""
    prim.instances(AXIS)
    rest, motion = (f"physxJointAxis:{instance}:{word}FrictionEffort" for word in ("static", "dynamic"))
    if prim.real(rest, 0.0) == prim.real(motion, 0.0):
        return motion if prim.has(motion) else ""
    for name in (rest, motion):
        prim.lose(name, "dry friction is one number")
    return ""


def passive(prim: PrimRead, data: dict[str, Any], units: Units, degrees: bool, instance: str) -> None:
    """Add to a joint's words the damper, the spring and the dry friction that act in addition to its drive. ``degrees``: the
    unit of the rest position of ``mjc:springref``."""
    speed = units.effort if units.turns else units.effort / units.position
    damping = first_of(prim, {"newton:damping": units.effort / units.position, "mjc:damping": speed})
    if damping > 0.0:
        data["damping"] = plain(float(data.get("damping", 0.0)) + damping)
    names = (_axis_friction(prim, instance), "newton:friction", "mjc:frictionloss")
    friction = first_of(prim, dict.fromkeys(names, units.effort))
    if friction > 0.0 and "dry_friction" not in data:
        data["dry_friction"] = plain(friction)
    stiffness = prim.real("mjc:stiffness", 0.0) * speed
    if stiffness <= 0.0:
        return
    if "spring" in data:
        prim.lose("mjc:stiffness", "a joint has one spring, which is its drive")
        return
    rest = prim.real("mjc:springref", 0.0)
    rest *= math.pi / 180.0 if units.turns and degrees else 1.0 if units.turns else units.position
    data["spring"] = {"stiffness": plain(stiffness), **({"rest": plain(rest)} if rest else {})}


def first_of(prim: PrimRead, names: dict[str, float]) -> float:
    """The number (in SI) of the first of several attributes that the file has, all of which are taken; ``names``: with their
    units. The later ones are deprecated words of the same."""
    said = [prim.real(name, 0.0) * unit for name, unit in names.items() if prim.has(name)]
    return said[0] if said else 0.0


def of_ball(prim: PrimRead, data: dict[str, Any], units: Units) -> None:
    """Add to a ball's words its damper and armature. A ball has no dry friction and no largest velocity in the language."""
    damping = first_of(prim, {"newton:damping": units.effort / units.position, "mjc:damping": units.effort})
    if damping > 0.0 and "damping" not in data:
        data["damping"] = plain(damping)
    if said := armature(prim, units):
        data["armature"] = plain(said)
    for name in ("newton:friction", "mjc:frictionloss", "mjc:stiffness", "newton:velocityLimit"):
        none = math.inf if name == "newton:velocityLimit" else 0.0
        if prim.real(name, none, infinite=True) != none:
            prim.lose(name, "only hinges and slides have it in the language")


def ratings(prim: PrimRead, limits: dict[str, Any], units: Units, si: bool, instance: str) -> None:
    """Add to a joint's limits the largest velocity (rad/s or m/s) and effort (N m or N), where they have none. ``si``: whether
    the stage is in metres and kilograms, as the text of a URDF is."""
    axis = f"physxJointAxis:{instance}:maxJointVelocity"
    for name in (axis, "newton:velocityLimit", "physxJoint:maxJointVelocity"):
        most = prim.real(name, math.inf, infinite=True)
        if "velocity" not in limits and 0.0 < most < UNBOUNDED:
            limits["velocity"] = plain(most * units.position)
    effort = prim.real("urdf:limit:effort", 0.0) if si else 0.0
    if effort > 0.0 and "effort" not in limits:
        limits["effort"] = plain(effort)
    _actuator_range(prim, limits, units)


def _actuator_range(prim: PrimRead, limits: dict[str, Any], units: Units) -> None:
    """The range of the actuators' force at a joint, which is its largest effort where it is symmetric."""
    low, high = (f"mjc:actuatorfrcrange:{end}" for end in ("min", "max"))
    if not (prim.has(low) or prim.has(high)):
        return
    least, most = (prim.real(name, 0.0) * units.effort for name in (low, high))
    limited = prim.token("mjc:actuatorfrclimited", "auto")
    if limited == "false" or (limited == "auto" and least == most == 0.0):
        return
    if least == -most and most > 0.0:
        limits.setdefault("effort", plain(most))
        return
    for name in (low, high):
        prim.lose(name, "limits of effort are symmetric in the language")


@dataclass(frozen=True, slots=True)
class UsdMimic:
    """A joint that follows another: its position is ``ratio`` times that of the joint at the path ``leader``, plus ``offset``
    (rad or m)."""

    leader: str
    ratio: float
    offset: float


def mimic(prim: PrimRead, units: Units) -> UsdMimic | None:
    """The leader of a joint of one axis; None where it follows nothing, or in a way that the language does not have, which is
    then lost. ``newton:`` says q = c0 + c1 q', ``physx``  q + g q' + c = 0."""
    if prim.applies("NewtonMimicAPI") or prim.has("newton:mimicCoef1"):
        targets = prim.targets("newton:mimicJoint")
        offset, ratio = prim.real("newton:mimicCoef0", 0.0), prim.real("newton:mimicCoef1", 1.0)
        if not prim.flag("newton:mimicEnabled", True) or not targets:
            return None
        for name in ("mjc:coef2", "mjc:coef3", "mjc:coef4"):
            if prim.real(name, 0.0):
                prim.lose(name, "joints follow others linearly in the language")
        if ratio == 0.0:
            prim.lose("newton:mimicCoef1", "a joint that follows with a ratio of 0 stands still")
            return None
        return UsdMimic(targets[0], ratio, offset * units.position)
    for instance in prim.instances("PhysxMimicJointAPI"):
        start = f"physxMimicJoint:{instance}:"
        targets = prim.targets(f"{start}referenceJoint")
        gearing, offset = prim.real(f"{start}gearing", 1.0), prim.real(f"{start}offset", 0.0)
        prim.token(f"{start}referenceJointAxis")
        for name in ("naturalFrequency", "dampingRatio"):
            prim.lose(f"{start}{name}", COMPLIANCE, INFORMATION)
        if targets and gearing:
            return UsdMimic(targets[0], -gearing, -offset * units.position)
    return None


def velocity(prim: PrimRead, instance: str, units: Units) -> float:
    """How fast an axis moves initially (rad/s or m/s), 0 where it is not said."""
    return first_of(prim, dict.fromkeys(_names(instance, "velocity"), units.position))


def check_position(prim: PrimRead, instance: str, units: Units, start: float) -> None:
    """Tell where the file says that an axis stands elsewhere than its bodies do (``start``, rad or m)."""
    for name in _names(instance, "position"):
        if prim.has(name) and abs(prim.real(name, 0.0) * units.position - start) > LARGEST_GAP:
            prim.lose(name, "the bodies stand elsewhere, and a joint begins where they do")


def _names(instance: str, word: str) -> tuple[str, str]:
    return f"state:{instance}:physics:{word}", f"newton:{instance}:{word}"
