"""Contact that Gazebo's DART 6.12 computes approximately.

``tools/deviations.py`` measures the tables of contact of several bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions
of 0 to 1, and ratios of masses of 1 to 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from simspec.engines.kit import deviations
from simspec.engines.kit.deviations import (
    DEEP,
    NEAR_LIMIT,
    PYRAMID,
    Deviation,
    Reason,
    coarse,
    read_deviations,
    unconverged,
)
from simspec.engines.kit.refinements import coupled
from simspec.support.declarations import Level, Refinement, Table
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.types import World

_PGS = "contact_solver=pgs"
_CREEPS = unconverged("DART's pgs solver")
_FEW = coarse("slip, clamp or spin")

_NOT_CONVERGED = (
    "With `contact_solver: pgs`, normal and friction forces of several bodies in contact do not converge. Use dantzig"
)
_PAGE = "see docs/engines/gazebo.md"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("rod-slips pile-slips slide-spin", PYRAMID, cone="elliptic"),
        Reason("stack*", deviations.SWEEPS, _PGS),
        Reason("stack-slides* stack-stays*", NEAR_LIMIT),
        Reason("stack*", DEEP),
        Reason("rod clamp jam* squeeze* pile", _CREEPS, _PGS),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "gazebo",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            f"{_NOT_CONVERGED} with a small timestep; {_PAGE}",
            "with pgs heavy bodies sink into light ones",
        ),
        Feature.EVEN_PRESSURE: (f"{_NOT_CONVERGED}; {_PAGE}", "with pgs boxes that slip between fingers turn"),
        Feature.SELF_LOCKING: (
            f"{_NOT_CONVERGED} with a small timestep; {_PAGE}",
            "with pgs a self-locking clamp slips",
        ),
    },
)
SWEEPS = Refinement(Level.APPROXIMATE, f"{_NOT_CONVERGED}; {_PAGE}", short="with pgs clamps creep")

# Shapes that DART's detector ``ode`` gives one point of contact where they touch along a line or on a face. gz-physics makes
# a box of a plane.

APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): "capsules",
    ("cylinder", "cylinder"): "cylinders",
}
"""Of cylinders, and the other shapes."""
ON_BOXES = "capsules have one contact point on boxes and planes, also along a line, on which they rock"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    others = " and ".join(pairs.values())
    text = (
        f"libccd computes contacts of cylinders with {others} to 1 µm in depth, may miss smaller overlaps, and has one "
        "point along a line or on a face, on which they rock"
    )
    standing = ". Cylinders that stand on each other are exact" if ("cylinder", "cylinder") in pairs else ""
    return Refinement(
        Level.APPROXIMATE,
        f"{text}{standing}; {_PAGE}",
        short=f"a cylinder and {others} touch in one point, also along a line",
    )


def cylinders(world: World) -> Refinement | None:
    """The approximations of cylinders in a world; None where there are none."""
    met = {pair: how for pair, how in APPROXIMATE.items() if pair in meeting_kinds(world)}
    return _refinement(met) if met else None


def capsules(world: World) -> Refinement | None:
    """The approximation of capsules in a world: points and depths are exact, but a line or a face has one of them."""
    met = {("box", "capsule"), ("capsule", "plane")} & set(meeting_kinds(world))
    return Refinement(note=ON_BOXES) if met else None


CASES = (_refinement(APPROXIMATE),)
"""Of cylinders, where all of these pairs may meet, for tables."""
