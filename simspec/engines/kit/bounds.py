"""Largest and least values of solver settings that follow from a world: beyond them contact is no longer that of its shapes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from simspec.world.contact_pairs import heaviest, thinnest
from simspec.world.types import World


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound of a setting in a world, and what it follows from."""

    value: float
    why: str


Bound = Callable[[World], Limit | None]
"""The bound in a world; None where it has none."""

SHARE = 0.1
"""Of the inner radius of the smallest shape: a length of contact beyond it is a different shape. A slop of that much lets a box
of 10 cm rest 5 mm deep; a margin of its whole inner radius throws a cylinder 25 mm (measured in one engine)."""
COARSE = 0.5
"""The same of an engine's margin around shapes, which it takes off their size: up to this a box of 10 cm and a cylinder of 3 cm
rest and slide as without (6 µm, measured in one engine)."""


def of_thinnest(share: float) -> Bound:
    """A length (m) of at most a share of the inner radius of the smallest shape."""

    def bound(world: World) -> Limit | None:
        least = thinnest(world)
        if least is None:
            return None
        why = f"{share:.0%} of the inner radius of the smallest collision shape, of {least.body}"
        return Limit(share * least.inner, why)

    return bound


def of_mobility(world: World) -> Limit | None:
    """A compliance (m/(N s)) of at most dt / m of the heaviest body: beyond it a contact takes less than half of an approach
    away in a step. At that bound 1 kg at 1 ms rests 0.25 mm deep, at ten times as much 2.4 mm, at a thousand times it falls
    through (measured in one engine)."""
    most = heaviest(world)
    if most is None:
        return None
    return Limit(world.physics.timestep / most[1], f"the timestep over the mass of the heaviest body, {most[0]}")


def under_weight(world: World) -> Limit | None:
    """A stiffness (N/m) of at least that with which the heaviest body's weight presses it ``SHARE`` of the smallest shape's
    inner radius deep."""
    most, least, gravity = heaviest(world), thinnest(world), math.hypot(*world.physics.gravity)
    if most is None or least is None or not gravity:
        return None
    why = (
        f"the weight of {most[0]} over {SHARE:.0%} of the inner radius of the smallest collision shape, of {least.body}"
    )
    return Limit(most[1] * gravity / (SHARE * least.inner), why)
