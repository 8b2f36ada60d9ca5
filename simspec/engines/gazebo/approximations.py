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

_NOT_CONVERGED = (
    "With `contact_solver: pgs`, normal and friction forces of several bodies in contact do not converge. Use dantzig"
)
_PAGE = "see docs/engines/gazebo.md"

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

_PORTAL = "by libccd, to 1 µm in depth (overlaps below that can be missed)"
_LINE = "along a line or on a face in one point, on which they rock"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): f"{_PORTAL}; {_LINE}",
    ("cylinder", "cylinder"): f"exact where one stands on the other; otherwise {_PORTAL}; {_LINE}",
}
"""Of cylinders, and what is lost."""
ON_BOXES = "capsules have one contact point on boxes and planes, also along a line, on which they rock"


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
