"""Pairs of shapes for which DART's detector ``ode`` has one point of contact where they touch along a line or on a face.

A plane is a box in gz-physics, so that what touches a plane touches a box.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.support.declarations import Level, Refinement
from simspec.world.meeting import meeting_kinds
from simspec.world.types import World

_PORTAL = "by libccd, to 1 µm in depth (overlaps below that can be missed)"
_LINE = "along a line or on a face in one point, on which they rock"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): f"{_PORTAL}; {_LINE}",
    ("cylinder", "cylinder"): f"exact where one stands on the other; otherwise {_PORTAL}; {_LINE}",
}
"""Of cylinders, and what is lost."""
ON_BOXES = f"capsules touch boxes and planes {_LINE}"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    told = "; ".join(f"{one} and {other} touch {how}" for (one, other), how in pairs.items())
    others = " and ".join(f"{one}s" for one, _ in pairs)
    return Refinement(Level.APPROXIMATE, told, short=f"a cylinder and {others} touch in one point, also along a line")


def cylinders(world: World) -> Refinement | None:
    """What is approximate of cylinders in a world; None where nothing is."""
    met = {pair: how for pair, how in APPROXIMATE.items() if pair in meeting_kinds(world)}
    return _refinement(met) if met else None


def capsules(world: World) -> Refinement | None:
    """What there is to say of capsules in a world: points and depths are exact, but a line or a face has one of them."""
    met = {("box", "capsule"), ("capsule", "plane")} & set(meeting_kinds(world))
    return Refinement(note=ON_BOXES) if met else None


CASES = (_refinement(APPROXIMATE),)
"""Of cylinders, where all of these pairs may meet, for tables."""
