"""Planar joints as joints of the language: two slides across the axis, and a hinge about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from simspec.imports.draft import numbers
from simspec.imports.elements import Element
from simspec.imports.urdf.table import CARRIED, INFORMATION, LOST, PHYSICS, UNUSED
from simspec.language.foreign import Fate, Severity
from simspec.world.types import Vector3

PARTS: Final = ("x", "y", "yaw")
"""What follows the joint's name, and ``_``, in the names of the three."""
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


def written(names: Sequence[str], data: dict[str, Any]) -> list[dict[str, Any]]:
    """The three joints of a body, of these names; ``data`` has the `axis` and the `origin` of the planar joint."""
    axis = data["axis"]
    x, y = across((axis[0], axis[1], axis[2]))
    kinds = (("slide", x), ("slide", y), ("hinge", axis))
    joints = [
        {"name": name, "type": kind, "axis": numbers(along)} for name, (kind, along) in zip(names, kinds, strict=True)
    ]
    if "origin" in data:
        joints[0]["origin"] = data["origin"]
    return joints


def set_aside(element: Element, names: Sequence[str]) -> None:
    """Say what of a planar joint is not carried: limits and dynamics have no meaning for three motions at once.
    Raises SpecError for damping or friction that is no number."""
    element.set_aside("name", CARRIED, f"called {', '.join(names)} in the spec", INFORMATION)
    for part in element.look("limit"):
        _aside(part, LOST, INFORMATION)
    for part in element.look("dynamics"):
        acts = [part.number(name) for name in ("damping", "friction")]
        _aside(part, *((LOST, PHYSICS) if any(acts) else (UNUSED, INFORMATION)))


def _aside(element: Element, fate: Fate, severity: Severity) -> None:
    element.set_aside(None, fate, SENSELESS, severity)
    for name in element.attributes:
        element.set_aside(name, fate, SENSELESS, severity)
