"""Contact and motion that ODE 0.16.2 computes approximately.

``tools/deviations.py`` measures the tables of contact of several bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions
of 0 to 1, and ratios of masses of 1 to 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.engines.kit.refinements import coupled
from simspec.support.declarations import Level, Refinement, Support, Table
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.types import World

_STEP, _QUICK = "solver=step", "solver=quick-step"
_SWEEPS = (
    "quick-step sweeps over one contact after another: overlaps and wrong friction are left where heavy bodies lie on light "
    "ones"
)
_CREEPS = "quick-step ends its sweeps before friction and normal forces fit each other"
_FEW = "steps of some ms are few for what slips, clamps or spins"
_PASSES = (
    "passes end when friction is within 0.1 % of its law, which is up to 100 % for a body that has a thousandth of the mass; "
    "more of them do not settle it"
)
_UNKNOWN = "measured; the cause is not known"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("stack*", _SWEEPS, _QUICK),
        Reason("stack-slides* stack-stays*", _PASSES),
        Reason("stack*", _UNKNOWN),
        Reason("rod clamp jam* squeeze* pile*", _CREEPS, _QUICK),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "ode",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            "quick-step leaves overlaps where heavy bodies lie on light ones: 0.5 mm at a ratio of 100 (1 ms), and 1000 "
            "times the mass sinks through within 5 s; step moves stacks sideways by up to 1.4 mm, from 4 ms on. By step under "
            "the elliptic cone what slides with ten times its mass on it stops 4 % off at 1 ms, with 100 times 34 %",
            "with quick-step 100 times the mass sinks 0.5 mm in at 1 ms, 1000 times through",
        ),
        Feature.EVEN_PRESSURE: (
            "by quick-step a box between two fingers on slides turns by 0.4 to 1.6 rad as it slips by 0.1 m; by step it falls "
            "straight",
            "by quick-step boxes that slip between fingers turn by up to 1.6 rad in 0.3 s",
        ),
        Feature.SELF_LOCKING: (
            "by quick-step a clamp that jams creeps: by 3 mm in 0.3 s at 1 ms and μ = 0.05, 5 mm where a hundredth of the "
            "moment of its weight presses it on, 140 mm at 4 ms; by step it stands",
            "by quick-step a clamp that jams creeps by 3 to 5 mm in 0.3 s at 1 ms",
        ),
    },
)
SWEEPS = Refinement(
    Level.APPROXIMATE,
    "quick-step, as the settings ask for, ends its sweeps before friction and normal forces fit each other: three balls on "
    "each other that should stand creep by 0.6 mm in 0.3 s at 1 ms, and below their threshold slip 38 % too little",
    short="by quick-step piles creep by 0.6 mm, and slip up to 38 % too little",
)

# Shapes with one point of contact along a line or on a face. ODE's cylinders touch cylinders and capsules by libccd's portal
# refinement, to 1 µm: smaller overlaps may be missed. In 60 random poses of each pair (0.003 to 3 m), depths are off by 1 µm
# at overlaps of 1e-4 of the size and by 20 % (median 0.4 %) at 1e-3, normals by 0.015 and 0.2 rad (median 6e-4). Cylinders
# that stand on each other have eight points, exact. Of parallel cylinders side by side the normal is 6 mrad off.

_PORTAL = (
    "by libccd, to 1 µm in depth (overlaps below that can be missed), with normals off by up to 0.015 rad where the overlap is "
    "1e-4 of the size and 0.2 rad at 1e-3"
)
_LINE = "along a line or on a face in one point, on which they rock: what is let down so sinks in by 1 mm"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): f"{_PORTAL}; {_LINE}, a flat end on a capsule by 18 mm",
    ("cylinder", "cylinder"): f"exact, in eight points, where one stands on the other; otherwise {_PORTAL}; {_LINE}",
}
"""Of cylinders, and what is lost."""
OVERLOOKED: Mapping[tuple[str, str], str] = {
    (
        "box",
        "cylinder",
    ): "of 100 random overlaps of a tenth to a half of the smaller one's inner radius it overlooks 4 (of 144 "
    "six, in six draws of sizes; of spheres, capsules and other cylinders with cylinders none)",
}
"""Pairs of which ODE's own code misses some overlaps, as the same code in another engine does."""
BOX_AND_CAPSULE = f"box and capsule touch {_LINE}, a box on a capsule by 26 mm"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    text = "; ".join(f"{name} and {other} touch {how}" for (name, other), how in pairs.items())
    others = " and ".join(f"{name}s" for name, _ in pairs)
    return Refinement(Level.APPROXIMATE, text, short=f"cylinders touch {others} in one point, also along a line")


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
FIRST_ORDER = (
    "by ODE's own steps in the bodies' coordinates, which are of first order and let joints drift: after 2,000 steps of "
    "1 ms a tumbling body is 2e-4 rad off, two hinges 0.02, a ball and a hinge 0.15, seven hinges 0.65 (L6, measured)"
)
SHORT = {
    Feature.JOINT_HINGE: "hinges drift by ODE's own steps, of first order; L6 measures the distance from the exact motion",
    Feature.JOINT_SLIDE: "slides drift by ODE's own steps, of first order; L6 measures the distance from the exact motion",
    Feature.JOINT_BALL: "balls drift by ODE's own steps, of first order; L6 measures the distance from the exact motion",
    Feature.JOINT_FREE: "free bodies turn by ODE's own steps, of first order: L6 says how far from the exact motion",
}


def _by_native_steps(short: str) -> Support:
    case = Refinement(Level.APPROXIMATE, FIRST_ORDER, short=short)

    def refine(world: World) -> Refinement | None:
        return case if dict(world.options("ode").settings).get(SWITCH) is True else None

    return Support(Level.EXACT, "bodies are laid on their joints before every step", refine=refine, cases=(case,))


JOINTS = {feature: _by_native_steps(short) for feature, short in SHORT.items()}
"""Joints: exact, or approximate where a spec selects ODE's own motion."""
