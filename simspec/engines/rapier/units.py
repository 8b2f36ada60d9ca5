"""The unit of length that Rapier is given, and the share of an overlap that a step takes back."""

from __future__ import annotations

from collections.abc import Iterable

from simspec.engines.kit.single import held_by

NAME = "rapier"
SCALE = 1024.0
"""Rapier is told lengths in 1/1024 m. Its search for nearest points ends by thresholds in its own unit: with the metre 12 % of
the overlaps of a ball and a hull of 100 corners were missed, half of those with 400, and 13 % of a capsule and a cylinder; from
four times that to a million times none (0.03 to 5 mm deep, shapes of 0.2 m; shallower ones of cylinders are still missed,
``cylinders.py``). Of 30 stacks of three boxes as hulls 9 fell with the metre, and some with 1/256 m and more; with 1/1024 m
none of 60 (measured). A power of two changes no digit of a number."""
SQUARE = SCALE * SCALE
"""Its unit of torque, inertia and energy in 1 N m, 1 kg m² and 1 J."""

ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""


def lengths(values: Iterable[float], what: str) -> tuple[float, ...]:
    """Lengths (m, m/s, m/s²) as Rapier is told them."""
    return held_by(NAME, (SCALE * value for value in values), what)
