"""Contact that Gazebo's DART 6.12 computes approximately.

``tools/deviations.py`` measures the tables of contact of several bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions
of 0 to 1, and ratios of masses of 1 to 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.engines.kit.refinements import coupled
from simspec.support.declarations import Level, Refinement, Table
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.types import World

_PGS = "contact_solver=pgs"
_PYRAMID = "the circumscribed pyramid in place of the elliptic cone, as accepted"
_SWEEPS = (
    "pgs sweeps over one row after another: overlaps and wrong friction are left where heavy bodies lie on light ones"
)
_CREEPS = "pgs ends its sweeps before friction and normal forces fit each other"
_DEEP = "an overlap is taken back by a share in each step: heavy bodies rest deeper, with the square of the timestep"
_NEAR = (
    "a body that slides with a lighter one below or above needs friction within 0.1 % of its limit at a ratio of 1000"
)
_FEW = "steps of some ms are few for what slips, clamps or spins"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("rod-slips pile-slips slide-spin", _PYRAMID, cone="elliptic"),
        Reason("stack*", _SWEEPS, _PGS),
        Reason("stack-slides* stack-stays*", _NEAR),
        Reason("stack*", _DEEP),
        Reason("rod clamp jam* squeeze* pile", _CREEPS, _PGS),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "gazebo",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            "pgs leaves overlaps where heavy bodies lie on light ones: 0.3 mm at a ratio of 10 (1 ms), and 100 times the "
            "mass sinks through within 5 s; dantzig leaves 0.2 mm at a ratio of 1000 and 4 ms, 2.6 mm at 16 ms",
            "with pgs 100 times the mass sinks through within 5 s at 1 ms",
        ),
        Feature.EVEN_PRESSURE: (
            "by pgs a box between two fingers on slides turns by 0.15 rad as it slips by 0.1 m, and creeps by 26 mm at 16 ms "
            "where it is held; contact_solver: dantzig has both right",
            "by pgs boxes that slip between fingers turn by 0.15 rad in 0.3 s",
        ),
        Feature.SELF_LOCKING: (
            "by pgs a clamp that jams slips by 9 mm in 0.3 s at 1 ms and μ = 0.05, by 90 mm where a hundredth of the moment "
            "of its weight presses it on; by dantzig by less than 1 mm, from 16 ms on",
            "by pgs a clamp that jams slips by 9 to 90 mm in 0.3 s at 1 ms",
        ),
    },
)
SWEEPS = Refinement(
    Level.APPROXIMATE,
    "pgs, as the settings ask for, ends its sweeps before friction and normal forces fit each other: a clamp that should hold "
    "itself creeps by 1.3 mm in 0.3 s (1 ms), by 14 mm at 4 ms; contact_solver: dantzig",
    short="by pgs clamps creep by 1.3 mm in 0.3 s at 1 ms, 14 mm at 4 ms",
)

# Shapes that DART's detector ``ode`` gives one point of contact where they touch along a line or on a face. gz-physics makes
# a box of a plane.

_PORTAL = "by libccd, to 1 µm in depth (overlaps below that can be missed)"
_LINE = "along a line or on a face in one point, on which they rock"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): f"{_PORTAL}; {_LINE}",
    ("cylinder", "cylinder"): f"exact where one stands on the other; otherwise {_PORTAL}; {_LINE}",
}
"""Of cylinders, and what is lost."""
ON_BOXES = f"capsules touch boxes and planes {_LINE}"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    text = "; ".join(f"{name} and {other} touch {how}" for (name, other), how in pairs.items())
    others = " and ".join(f"{name}s" for name, _ in pairs)
    return Refinement(Level.APPROXIMATE, text, short=f"a cylinder and {others} touch in one point, also along a line")


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
