"""Whether the trees that a sidecar lists fit its bodies: for dialects whose files hold one tree each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from simspec.formats.kit.forms import check_distinct
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE

UNIT: Final = 1e-9
"""How far a quaternion may be from unit length: numbers are printed to round-trip, and normalised before."""


def check_every_body(trees: Iterable[Sequence[str]], kinds: Mapping[str, str]) -> None:
    """Raise ValueError unless each body of ``kinds`` (joint kind by name) is in one of the ``trees``, once."""
    named = [name for bodies in trees for name in bodies]
    check_distinct(named, "sidecar.instances")
    if set(named) != set(kinds):
        raise ValueError(f"sidecar.instances and sidecar.bodies differ in {sorted(set(named) ^ set(kinds))}")


def check_by_body(bodies: Sequence[str], lists: Mapping[str, Sequence[object]], at: str) -> None:
    """Raise ValueError where a tree has no bodies, or one of its lists has not one entry for each."""
    if not bodies:
        raise ValueError(f"{at} has no bodies")
    for name, entries in lists.items():
        if len(entries) != len(bodies):
            raise ValueError(f"{at}.{name} has {len(entries)} entries for {len(bodies)} bodies")


def check_coordinates(kinds: Sequence[str], position: Sequence[float], velocity: Sequence[float], at: str) -> None:
    """Raise ValueError where positions or velocities are not as many as joints of these ``kinds`` have."""
    for name, sizes, numbers in (("position", POSITION_SIZE, position), ("velocity", VELOCITY_SIZE, velocity)):
        size = sum(sizes[kind] for kind in kinds)
        if len(numbers) != size:
            raise ValueError(f"{at}.{name} has {len(numbers)} numbers, should have {size}")


def check_unit(quaternions: Iterable[Sequence[float]], at: str) -> None:
    """Raise ValueError where a quaternion is not of unit length."""
    if any(abs(math.hypot(*quaternion) - 1.0) > UNIT for quaternion in quaternions):
        raise ValueError(f"{at} has a quaternion that is not of unit length")
