"""Contact and motion that ODE 0.16.2 computes approximately.

``tools/deviations.py`` measures the tables of contact of several bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions
of 0 to 1, and ratios of masses of 1 to 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from simspec.engines.kit import deviations
from simspec.engines.kit.deviations import UNKNOWN, Deviation, Reason, coarse, read_deviations, unconverged
from simspec.engines.kit.refinements import coupled
from simspec.support.declarations import Level, Refinement, Table, exact, for_each
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.types import World

_STEP, _QUICK = "solver=step", "solver=quick-step"
_CREEPS = unconverged("ODE's quick-step")
_FEW = coarse("slip, clamp or spin")
_PASSES = (
    "simspec ends its passes when friction is within 0.1 % of its law, which is up to 100 % for a "
    "body of a thousandth of the mass. More passes do not reduce it"
)

_NOT_CONVERGED = (
    "With `solver: quick-step`, normal and friction forces do not converge where several bodies are in contact. Use step; see "
    "docs/engines/ode.md"
)

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("stack*", deviations.SWEEPS, _QUICK),
        Reason("stack-slides* stack-stays*", _PASSES),
        Reason("stack*", UNKNOWN),
        Reason("rod clamp jam* squeeze* pile*", _CREEPS, _QUICK),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "ode",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            "With quick-step heavy bodies sink into light ones. With step, stacks move sideways at large "
            "timesteps, and bodies that slide under a load stop at a wrong distance; see "
            "docs/engines/ode.md",
            "with quick-step heavy bodies sink into light ones",
        ),
        Feature.EVEN_PRESSURE: (_NOT_CONVERGED, "with quick-step boxes that slip between fingers turn"),
        Feature.SELF_LOCKING: (_NOT_CONVERGED, "with quick-step a self-locking clamp creeps"),
    },
)
SWEEPS = Refinement(
    Level.APPROXIMATE, _NOT_CONVERGED, short="with quick-step piles creep, and slip too little where they should slip"
)

# Shapes with one point of contact along a line or on a face. ODE's cylinders touch cylinders and capsules by libccd's portal
# refinement, to 1 µm: smaller overlaps may be missed. In 60 random poses of each pair (0.003 to 3 m), depths are off by 1 µm
# at overlaps of 1e-4 of the size and by 20 % (median 0.4 %) at 1e-3, normals by 0.015 and 0.2 rad (median 6e-4). Cylinders
# that stand on each other have eight points, exact. Of parallel cylinders side by side the normal is 6 mrad off.

APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): "capsules",
    ("cylinder", "cylinder"): "cylinders",
}
"""Of cylinders, and the other shapes."""
OVERLOOKED: Mapping[tuple[str, str], str] = {
    (
        "box",
        "cylinder",
    ): "of 100 random overlaps of a tenth to a half of the smaller one's inner radius it overlooks 4 (of 144 "
    "six, in six draws of sizes; of spheres, capsules and other cylinders with cylinders none)",
}
"""Pairs of which ODE's own code misses some overlaps, as the same code in another engine does."""
BOX_AND_CAPSULE = "ODE computes one contact point of a box and a capsule along a line or on a face, on which they rock"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    others = " and ".join(pairs.values())
    text = (
        f"libccd computes contacts of cylinders with {others} to 1 µm in depth and with inaccurate normals, may miss "
        "smaller overlaps, and has one point along a line or on a face, on which they rock"
    )
    standing = ". Cylinders that stand on each other are exact" if ("cylinder", "cylinder") in pairs else ""
    return Refinement(
        Level.APPROXIMATE,
        f"{text}{standing}; see docs/engines/ode.md",
        short=f"cylinders touch {others} in one point, also along a line",
    )


def cylinders(world: World) -> Refinement | None:
    """The approximations of cylinders in a world; None without any."""
    met = {pair: how for pair, how in APPROXIMATE.items() if pair in meeting_kinds(world)}
    return _refinement(met) if met else None


def capsules(world: World) -> Refinement | None:
    """A note on capsules in a world: points and depths are exact, but a line or a face has one of them."""
    return Refinement(note=BOX_AND_CAPSULE) if ("box", "capsule") in meeting_kinds(world) else None


CASES = (_refinement(APPROXIMATE),)
"""Of cylinders, where all of these pairs may meet, for tables."""

# Motion by ODE's own steps, where a spec sets ``engines.ode.settings.native_motion``.

SWITCH = "native_motion"
FIRST_ORDER = Refinement(
    Level.APPROXIMATE,
    "With `native_motion`, ODE integrates in maximal coordinates to first order, in which joints drift; see "
    "docs/engines/ode.md",
    short="ODE's native integration is of first order: joints drift, which L6 measures",
)


def _by_native_steps(world: World) -> Refinement | None:
    return FIRST_ORDER if dict(world.options("ode").settings).get(SWITCH) is True else None


JOINTS = for_each(
    exact("simspec moves bodies onto their joints before every step", refine=_by_native_steps, cases=(FIRST_ORDER,)),
    *(Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_FREE),
)
"""Joints: exact, or approximate where a spec selects ODE's own motion."""
