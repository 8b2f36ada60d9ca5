"""What schemas beyond UsdPhysics say of one axis of a joint: its armature, a damper and a spring, dry friction, where it stands
and how fast it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from simspec.imports.draft import plain
from simspec.imports.usd.stage import Prim
from simspec.language.foreign import Fate

ARMATURES: Final = ("physxJoint:armature", "newton:armature", "mjc:armature")
"""Attributes for the armature of a joint, the first of which holds."""
APART: Final = 1e-3
"""rad or m that a joint may stand away from where the file says: in single precision, written by hand."""


@dataclass(frozen=True, slots=True)
class Units:
    """Of one axis, in SI: ``inertia`` (kg m² or kg), ``position`` (rad per degree, or m) and ``effort`` (N m or N)."""

    inertia: float
    position: float
    effort: float
    turns: bool


def armature(prim: Prim, units: Units) -> float:
    """The armature (kg m² or kg), 0 where none is said."""
    said = [prim.real(name, 0.0) * units.inertia for name in ARMATURES if prim.has(name)]
    return said[0] if said else 0.0


def passive(prim: Prim, data: dict[str, Any], units: Units, degrees: bool) -> None:
    """Add to a joint's words the damper, the spring and the dry friction that act beside its drive. Their numbers are of
    radians; ``degrees``: the rest position of the spring is not."""
    speed = units.effort if units.turns else units.effort / units.position
    damping = prim.real("mjc:damping", 0.0) * speed
    if damping > 0.0:
        data["damping"] = plain(float(data.get("damping", 0.0)) + damping)
    friction = prim.real("mjc:frictionloss", 0.0) * units.effort
    if friction > 0.0 and "dry_friction" not in data:
        data["dry_friction"] = plain(friction)
    stiffness = prim.real("mjc:stiffness", 0.0) * speed
    if stiffness <= 0.0:
        return
    if "spring" in data:
        prim.set_aside("mjc:stiffness", Fate.LOST, "a joint has one spring, which is its drive")
        return
    rest = prim.real("mjc:springref", 0.0)
    rest *= math.pi / 180.0 if units.turns and degrees else 1.0 if units.turns else units.position
    data["spring"] = {"stiffness": plain(stiffness), **({"rest": plain(rest)} if rest else {})}


def velocity(prim: Prim, instance: str, units: Units) -> float:
    """How fast an axis moves initially (rad/s or m/s), 0 where it is not said."""
    said = [prim.real(name, 0.0) for name in _names(instance, "velocity") if prim.has(name)]
    return said[0] * units.position if said else 0.0


def check_position(prim: Prim, instance: str, units: Units, start: float) -> None:
    """Tell where the file says that an axis stands elsewhere than its bodies do (``start``, rad or m)."""
    for name in _names(instance, "position"):
        if prim.has(name) and abs(prim.real(name, 0.0) * units.position - start) > APART:
            prim.set_aside(name, Fate.LOST, "the bodies stand elsewhere, and a joint begins where they do")


def _names(instance: str, word: str) -> tuple[str, str]:
    return f"state:{instance}:physics:{word}", f"newton:{instance}:{word}"
