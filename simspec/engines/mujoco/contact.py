"""What MuJoCo has of the contact law, and how far it is from it: data, all measured with MuJoCo 4.0.1 at the default settings,
and where that is said with ``friction: coulomb``.

Boxes of 20 x 20 x 4 cm (oblong ones: 40 x 10 x 2 cm) and spheres of radius 10 cm, of 1 kg, on a fixed box; timestep 1 ms
where none is said.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from simspec.dialects.mujoco.sidecar import COULOMB, NATIVE
from simspec.engines.kit.coupled import in_force
from simspec.engines.kit.deviations import Deviation
from simspec.engines.mujoco.coupled import DEVIATIONS, coupled_support
from simspec.support.declarations import Level, Refinement, Support, approximate, exact, never
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds, meeting_laws, solid_shapes
from simspec.world.types import World

# How far MuJoCo's own friction is off where pairs bounce well: pushes and slides of pairs with e from 0.35 on.
#
# Measured with MuJoCo 4.0.1 at e = 0.8, 0.5, 1, 2, 4 and 8 ms and frictions of 0.05 to 1.45 in steps of 0.05, with a margin of
# 5 to 15 %. A pair that bounces has no cushion, so that what slides leaves its floor, and the further the livelier it is.

LEAST = 0.35
"""Least restitution of these; below it the rows of e = 0.3 hold."""
Sizes = Mapping[float, Mapping[float, float]]
"""By timestep (s), by least friction, the largest share of the expected value."""
_PUSHED: Sizes = {
    0.0005: {0.04: 0.065, 0.17: 0.11, 0.57: 0.18, 0.77: 0.26, 1.17: 0.32},
    0.004: {0.37: 0.19, 0.57: 0.28, 0.97: 0.37, 1.37: 0.43},
}
_SLID: Sizes = {
    0.0005: {0.04: 0.026, 0.17: 0.045, 0.57: 0.056, 0.77: 0.11, 0.97: 0.23, 1.17: 0.49, 1.37: 0.62},
    0.004: {0.37: 0.096, 0.57: 0.22, 0.77: 0.33, 0.97: 0.37, 1.17: 0.61},
}
_PUSHED_UNDER_PYRAMID: Sizes = {0.0005: {0.04: 0.12, 0.17: 0.53, 0.37: 1.3, 0.77: 1.6, 0.97: 2.3, 1.37: 2.8}}
_SLID_UNDER_PYRAMID: Sizes = {
    0.0005: {0.17: 0.17, 0.37: 0.34, 0.57: 0.71, 0.97: 1.4, 1.17: 2.1, 1.37: 2.5},
    0.004: {0.77: 0.89},
}
ELLIPTIC: Mapping[str, Sizes] = {"push": _PUSHED, "push-oblong": _PUSHED, "stop": _SLID, "stop-oblong": _SLID}
"""By probe."""
PYRAMID: Mapping[str, Sizes] = {
    "push": _PUSHED_UNDER_PYRAMID,
    "push-oblong": _PUSHED_UNDER_PYRAMID,
    "stop": _SLID_UNDER_PYRAMID,
    "stop-oblong": _SLID_UNDER_PYRAMID,
}
"""The same under the inscribed pyramid."""

BOXES = "3.4"
"""The first release in which two boxes touch with the depth of their overlap."""

COULOMB_COSTS = (
    "De Saxcé's correction, computed around MuJoCo's solver at every step (setting friction: coulomb): impacts within 2 %, "
    "slides within 0.1 %, no hops; 16 µs a step of a body at rest, 29 of one that slides, 1.5 to 2.2 times MuJoCo's own time "
    "in towers, 3.4 to 4.6 times in a pile of 216 spheres, of whose steps 5 % end unconverged at μ = 0.5 and 35 % at 1 "
    "(measured, 1 ms)"
)


BY_COULOMB = Refinement(
    Level.OUTSIDE,
    COULOMB_COSTS,
    "friction in impacts by a loop around MuJoCo's solver at every step (friction: coulomb)",
    asked=True,
)


def coulomb_asked(world: World) -> Refinement | None:
    """Friction is computed outside MuJoCo where the spec sets that."""
    return BY_COULOMB if dict(world.options("mujoco").settings).get("friction") == COULOMB else None


UNLISTED = Refinement(
    Level.APPROXIMATE,
    "more pairs of shapes with friction may touch than explicit_pairs_limit allows to list (5,000: 100 bodies), and no "
    "pair has friction of its own: a body that slides is lifted, by 8 mm at 1 m/s (μ = 0.5, 1 ms), and clamps slip half as "
    "far as they should. Level L5 fails; engines.mujoco.settings: {friction: coulomb} needs no list and is right, at a price",
    "with more pairs than explicit_pairs_limit what slides hops, and L5 fails; use friction: coulomb",
)


def impact_friction(world: World) -> Refinement | None:
    """Coulomb's law where the spec sets it; otherwise whether all pairs with friction can be listed."""
    return coulomb_asked(world) or (UNLISTED if _too_many_to_list(world) else None)


def _too_many_to_list(world: World) -> bool:
    if world.contact.friction_cone != "elliptic":
        return False
    counts = Counter(shape.material for body in world.bodies for shape in solid_shapes(body))
    pairs = [pair for pair, law in meeting_laws(world).items() if law.friction and law.hardness.kind != "native"]
    most = sum(counts[first] * counts[second] / (1 + (first == second)) for first, second in pairs)
    return most > int(in_force("mujoco")(world)["explicit_pairs_limit"])


HALF_DEPTH = Refinement(
    Level.APPROXIMATE,
    f"before {BOXES} the points of two boxes have half the depth of their overlap: a box lies twice as deep on another one "
    "(0.2155 mm for 0.1078 mm with MuJoCo's native hardness), and their overlaps are taken back at half the rate; other shapes "
    "are not affected (measured, 3.3.7)",
    f"before {BOXES}: a box lies twice as deep on another box, and rises out of it half as fast",
)


def boxes_before(world: World) -> Refinement | None:
    """Two boxes that may touch have half the depth in earlier releases."""
    return HALF_DEPTH if ("box", "box") in meeting_kinds(world) else None


CONTACT_SUPPORT: Mapping[Feature, Support] = {
    Feature.SHAPE_BOX: exact(
        f"before {BOXES} two boxes that may meet are approximate, and accepted by name: they touch with half the depth of "
        "their overlap, so that a box lies twice as deep on another one",
        cases=(HALF_DEPTH,),
        since=BOXES,
        before=boxes_before,
    ),
    Feature.SHAPE_CYLINDER: exact(
        "flat faces touch at points on their rim; on the soft first layer of friction they lean: an upright cylinder that "
        "should tip where its weight points 1.00 R beside the axis tips at 0.94 to 0.98 R (R = 5 cm)"
    ),
    Feature.FRICTION_PAIRS: exact("as explicit pairs of shapes"),
    Feature.RESTITUTION: approximate(
        "a reference velocity of −e times the approach speed: within 0.03 of e for spheres from 1 m/s at 1 ms, 0.05 at 2 ms, "
        "0.11 at 4 ms, where gravity acts on during the steps out of the overlap; impacts on several bodies pass from one to "
        "the next, so that the last of a row leaves alone",
        short="what bounces leaves with e off by up to 0.03 at 1 ms, 0.05 at 2 ms and 0.11 at 4 ms",
    ),
    Feature.RESTITUTION_PAIRS: exact("as explicit pairs of shapes"),
    Feature.RESTITUTION_THRESHOLD: approximate(
        "MuJoCo has none: what should rest after a slow impact bounces at up to e times the threshold speed",
        short="there is no threshold: what should rest after a slow impact bounces on",
    ),
    Feature.TORSIONAL_FRICTION: approximate(
        "spin alone decays at c N within 0.01 % at 1 ms; but slip and spin share one cone, (f/μ)² + (τ/c)² ≤ N²: a sphere that "
        "slides at 1 m/s and spins at 50 rad/s feels 0.55 of μ and 0.74 of c (c = 1 cm, μ = 0.5)",
        short="what slides and spins at once feels too little of both: 0.55 of μ, 0.74 of c at worst measured",
    ),
    Feature.ROLLING_FRICTION: approximate(
        "rolling decays within 0.1 % at 1 ms while c is below a tenth of μ r; rolling, spinning and sliding share one cone, "
        "which costs 1.3 % at c = 0.4 μ r and 17 % at c = μ r",
        short="what rolls is braked too little where c is large: by 1.3 % at c = 0.4 μ r, 17 % at c = μ r",
    ),
    Feature.HARDNESS_COMMON: exact(
        "with friction of MuJoCo's own and without restitution on a cushion of 0.1 mm (setting friction_cushion)"
    ),
    Feature.HARDNESS_TIME_CONSTANT: approximate(
        "for one point of contact: rest depth g T² ζ² within 0.01 %, oscillation within 0.3 % at T ζ = 15 steps, rebound "
        "within 0.04; the n points of a face act as n springs, so a box lies a quarter as deep",
        short="right for one point of contact; a face is as stiff as its n points: a box lies 1/4 as deep",
    ),
    Feature.HARDNESS_STIFFNESS: exact(
        "between free single bodies and what cannot move: rest depth within 1e-5, at any number of points; mechanisms are "
        "refused, since MuJoCo's numbers are accelerations"
    ),
    Feature.HARDNESS_PAIRS: exact("as explicit pairs of shapes"),
    Feature.SURFACE_VELOCITY: exact("surfacevel of a geom", since="3.11"),
    Feature.MARGIN_PAIRS: exact("as explicit pairs of shapes"),
    Feature.HARDNESS_NATIVE: approximate(
        "solref 0.02 1, solimp 0.9 0.95 0.001: a 1 kg box rests 0.11 mm deep, a sphere 0.37 mm; a slider hops 3 mm at 5 m/s "
        "and μ = 0.5; impratio stays the world's",
        short="MuJoCo's own soft contact: a box rests 0.1 mm deep, a sphere 0.4 mm, a slider hops 3 mm",
    ),
    Feature.PASSING_PAIRS: exact("by masks of shapes, or excluded pairs of bodies"),
    Feature.IMPACT_FRICTION: approximate(
        "friction lags where it changes within steps. Most of that in impacts is missing: of the speed along the surface that "
        "one should take away 80 to 90 % stays at 1 ms. What leans or clamps settles by up to 5 mm before it is held, what "
        "slips there goes up to 38 % too far, what spins as it slides is braked up to 17 % wrongly, and what slides with "
        "another body on it stops 9 % off, 38 % below one of 100 times its mass (measured, 1 ms); engines.mujoco.settings: "
        "{friction: coulomb} has it right, at a price",
        short="80 to 90 % of the friction in impacts is missing at 1 ms, and what leans settles by up to 5 mm",
        refine=impact_friction,
        cases=(BY_COULOMB, UNLISTED),
    ),
    **coupled_support(BY_COULOMB, coulomb_asked),
    Feature.CONE_ELLIPTIC: exact("cone=elliptic"),
    Feature.CONE_PYRAMID_INSCRIBED: approximate(
        "the force keeps to the pyramid, but MuJoCo's pyramid throws sliding bodies up, by 4 to 13 mm at 1 m/s and 100 to "
        "320 mm at 5 m/s (μ 0.3 to 1), and with restitution slip bounces back too",
        short="what slides is thrown up: by 4 to 13 mm at 1 m/s, 100 to 320 mm at 5 m/s",
    ),
    Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("MuJoCo has the elliptic cone and the inscribed pyramid only"),
}

_HOP = (
    "MuJoCo's friction cone is associated: what slides is lifted, and beyond a speed that falls with μ and the timestep it "
    "leaves its cushion and hops"
)
_LATE = "friction takes back slip at a rate of 100/s at most, so the last μ g/100 of speed fades instead of stopping"
_MISSING = (
    "friction takes back slip at a rate of 100/s at most, and an impact lasts one step: most of its friction is missing, the "
    "more the shorter the step (accepted by name: contact.friction.impact)"
)
_THROWN = "what is left of an impact's friction lifts what slips, its cone being associated"
_SET_DOWN = (
    "a slider that is set down touches one step later, and has that step's friction in the next: of a slide of few steps, up "
    "to one of them"
)
_BOUNCING = f"a pair that bounces has no cushion. {_HOP}"
_PYRAMID = "under the pyramid friction has no reference of its own, and what slides hops"
_NATIVE = "MuJoCo's own contact has no reference of its own for friction, and what slides hops"
_RESTLESS = "with e near 1 a body never comes to rest; it bounces on at up to 1.6 times (1 + e) g dt"
_CUSHION = "on the cushion of frictional contact gravity acts until the depth balances it"
_STEPS = tuple((0.0 if step < 1 else 5.25e-4 * 2.0 ** ((step - 1) / 3), 5e-4 * 2.0 ** (step / 3)) for step in range(17))
"""Ranges of timesteps (s) up to 20 ms in which deviations that grow with the timestep are those of the second: a row counts
from the first on, which is 1.05 times the second of the range before."""
_LIVELY = 0.9
"""Least restitution of what does not come to rest."""


def _rows(probe: str, why: str, table: Mapping[float, Mapping[float, float]], **more: Any) -> tuple[Deviation, ...]:
    """``table``: by timestep (s), by least friction, the largest share of the expected value. A row counts from 0.9 of its
    timestep on, those of 0.5 ms below it, too."""
    return tuple(
        Deviation(probe, size, why, friction=friction, timestep=0.9 * timestep if timestep > 5e-4 else 0.0, **more)
        for timestep, sizes in table.items()
        for friction, size in sizes.items()
    )


_RISING = {0.6: 0.08, 1.05: 0.1, 1.15: 0.12, 1.2: 0.145, 1.25: 0.165, 1.3: 0.19, 1.35: 0.215, 1.4: 0.24, 1.45: 0.27}
"""By least friction, how far a slide under the pyramid is off, at every timestep."""
_HOPPING = {0.1: 0.065, 0.2: 0.15, 0.3: 0.33, 0.45: 0.5, 0.55: 0.7, 0.7: 1.22, 1.4: 1.55}
_LASTING = {0.5: 0.06, 0.7: 0.15, 0.8: 0.2, 0.9: 0.24, 1.0: 0.3, 1.1: 0.42, 1.2: 0.52, 1.3: 0.63, 1.4: 0.77}
"""The same of pushes and slides of pairs that bounce, which have no cushion (e of 0.3)."""
_SUNK = 9.81 * (1.0 - 0.999) / (0.999 * 0.01)
"""m/s²: times dt² the depth at which a body rests that touches in one point, g (1 − d) / (d β): d the impedance and β what is
taken back of an overlap in a step. Measured from 8 to 32 ms, to 0.2 % of it; above what is promised from 10 ms on."""
_DEEP = "taken back is 1 % of an overlap in a step, after 0.1 % of gravity"

_OWN: tuple[Deviation, ...] = (
    *_rows(
        "push",
        _HOP,
        {
            0.001: {0.9: 0.03},
            0.002: {0.4: 0.02, 0.7: 0.06, 0.9: 0.12},
            0.004: {0.2: 0.04, 0.4: 0.12, 0.9: 0.2, 1.25: 0.3},
            0.008: {0.15: 0.05, 0.3: 0.09, 0.5: 0.16, 0.8: 0.2, 0.9: 0.29, 1.2: 0.38, 1.3: 0.43},
        },
    ),
    *_rows(
        "push",
        _BOUNCING,
        {
            0.0005: {0.15: 0.04, 0.4: 0.1},
            0.001: {1.2: 0.12},
            0.002: {0.4: 0.13, 0.7: 0.17, 1.4: 0.29},
            0.004: {0.3: 0.09, 0.6: 0.18, 0.8: 0.29, 1.2: 0.43, 1.35: 0.57},
            0.008: {0.9: 0.37},
        },
        restitution=0.01,
    ),
    *_rows("push", _PYRAMID, {0.0005: _HOPPING}, restitution=0.01, friction_cone="pyramid-inscribed"),
    *_rows("push", _BOUNCING, {0.0005: {0.15: 0.25}}, restitution=_LIVELY),
    *_rows(
        "push",
        _PYRAMID,
        {
            0.0005: {0.0: 0.09, 0.3: 0.25, 0.6: 0.65, 1.4: 0.81},
            0.001: {0.9: 0.95, 1.3: 1.15},
            0.002: {0.2: 0.17, 0.4: 0.3, 0.8: 0.81},
            0.004: {0.5: 0.4, 1.1: 1.15},
        },
        friction_cone="pyramid-inscribed",
    ),
    *_rows(
        "stop",
        f"{_LATE}; {_HOP}",
        {
            0.0005: {1.25: 0.03},
            0.002: {0.6: 0.03, 0.9: 0.04, 1.15: 0.05, 1.25: 0.08},
            0.008: {0.5: 0.022, 0.7: 0.04, 0.8: 0.055, 0.9: 0.1, 1.0: 0.14, 1.1: 0.16, 1.2: 0.19, 1.25: 0.25},
            0.016: {0.4: 0.09, 0.7: 0.2, 0.9: 0.3, 1.25: 1.05},
        },
    ),
    *_rows(
        "stop",
        _BOUNCING,
        {
            0.0005: {0.4: 0.02, 0.9: 0.08, 1.3: 0.1},
            0.001: {1.3: 0.115},
            0.002: {1.2: 0.12},
            0.004: {0.4: 0.06, 1.2: 0.135},
            0.008: {0.7: 0.075, 1.0: 0.15, 1.1: 0.27, 1.4: 0.3},
            0.016: {0.4: 0.11},
        },
        restitution=0.01,
    ),
    *_rows("stop", _PYRAMID, {0.0005: _LASTING}, restitution=0.01, friction_cone="pyramid-inscribed"),
    *_rows("stop", _BOUNCING, {0.0005: {0.0: 0.7}}, restitution=_LIVELY),
    *_rows("stop", _PYRAMID, {0.0005: _RISING}, friction_cone="pyramid-inscribed"),
    *_rows(
        "push-oblong",
        _HOP,
        {
            0.002: {0.7: 0.14, 1.15: 0.2, 1.4: 0.23},
            0.004: {0.2: 0.03, 0.3: 0.06, 0.4: 0.11, 0.5: 0.14, 0.65: 0.185, 0.85: 0.21, 1.3: 0.27, 1.4: 0.32},
            0.008: {0.15: 0.06, 0.3: 0.09, 0.4: 0.13, 0.5: 0.16, 0.6: 0.2, 0.9: 0.29, 1.2: 0.38, 1.35: 0.43},
        },
    ),
    *_rows(
        "push-oblong",
        _BOUNCING,
        {
            0.0005: {0.15: 0.04, 0.4: 0.22},
            0.001: {1.25: 0.23},
            0.002: {1.4: 0.29},
            0.004: {0.15: 0.11, 0.8: 0.29, 1.2: 0.43, 1.35: 0.57},
            0.008: {0.9: 0.37},
        },
        restitution=0.01,
    ),
    *_rows("push-oblong", _PYRAMID, {0.0005: _HOPPING}, restitution=0.01, friction_cone="pyramid-inscribed"),
    *_rows("push-oblong", _BOUNCING, {0.0005: {0.0: 0.06, 0.15: 0.25}}, restitution=_LIVELY),
    *_rows(
        "push-oblong",
        _PYRAMID,
        {
            0.0005: {0.0: 0.04, 0.15: 0.08, 0.3: 0.14, 0.4: 0.26, 0.6: 0.55, 0.9: 0.69, 1.25: 1.2},
            0.001: {0.3: 0.17, 0.9: 0.95},
            0.002: {0.1: 0.055, 0.2: 0.17, 0.8: 0.81},
            0.004: {0.3: 0.2, 0.5: 0.4, 1.2: 1.2},
            0.008: {0.35: 0.25},
        },
        friction_cone="pyramid-inscribed",
    ),
    *_rows(
        "stop-oblong",
        f"{_LATE}; {_HOP}",
        {
            0.0005: {1.25: 0.03},
            0.001: {1.2: 0.02},
            0.002: {0.4: 0.022, 0.6: 0.045, 0.8: 0.056, 1.2: 0.07, 1.25: 0.125},
            0.008: {0.9: 0.11, 1.0: 0.14, 1.1: 0.16, 1.2: 0.19, 1.25: 0.26},
            0.016: {0.4: 0.08, 0.9: 0.31, 1.25: 1.15},
        },
    ),
    *_rows(
        "stop-oblong",
        _BOUNCING,
        {
            0.0005: {0.4: 0.03, 0.6: 0.04, 0.9: 0.07, 1.25: 0.33},
            0.001: {0.8: 0.045},
            0.002: {0.9: 0.09, 1.25: 0.4},
            0.004: {0.4: 0.055, 0.9: 0.3, 1.25: 0.45},
            0.008: {0.7: 0.075, 0.9: 0.32, 1.25: 0.69},
            0.016: {0.4: 0.12, 0.9: 0.8, 1.25: 1.85},
        },
        restitution=0.01,
    ),
    *_rows(
        "stop-oblong",
        _BOUNCING,
        {0.0005: {0.0: 0.17, 0.15: 0.49, 0.4: 0.76, 0.9: 0.99, 1.25: 1.25}, 0.016: {0.9: 1.95, 1.25: 3.7}},
        restitution=_LIVELY,
    ),
    *_rows("stop-oblong", _PYRAMID, {0.0005: _RISING | {1.25: 0.28}}, friction_cone="pyramid-inscribed"),
    *_rows("stop-oblong", _PYRAMID, {0.0005: _LASTING}, restitution=0.01, friction_cone="pyramid-inscribed"),
    *(
        row
        for cone, why, tables in (("elliptic", _BOUNCING, ELLIPTIC), ("pyramid-inscribed", _PYRAMID, PYRAMID))
        for probe, table in tables.items()
        for row in _rows(probe, why, table, restitution=LEAST, friction_cone=cone)
    ),
    Deviation("oblique", 0.99, _MISSING, friction_cone="elliptic"),
    *_rows(
        "oblique-separation",
        _THROWN,
        {
            0.0005: {0.05: 0.07, 0.2: 0.15, 0.5: 0.3, 0.8: 0.4, 1.0: 0.5},
            0.001: {0.05: 0.1, 0.2: 0.25, 0.5: 0.45, 0.8: 0.5, 1.0: 0.6},
            0.002: {0.05: 0.1, 0.2: 0.32, 0.5: 0.52, 0.8: 0.6, 1.0: 0.72},
            0.004: {0.05: 0.14, 0.2: 0.37, 0.5: 0.58, 0.8: 0.65, 1.0: 0.8},
        },
        relative=False,
        friction_cone="elliptic",
    ),
    *_rows(
        "oblique",
        _PYRAMID,
        {0.0005: {0.0: 0.83, 0.2: 1.2, 0.5: 1.95, 0.8: 2.35, 1.0: 2.9}},
        friction_cone="pyramid-inscribed",
    ),
    *_rows(
        "oblique-separation",
        _PYRAMID,
        {0.0005: {0.05: 0.63, 0.2: 2.5, 0.5: 4.1, 0.8: 4.9, 1.0: 6.2}},
        relative=False,
        friction_cone="pyramid-inscribed",
    ),
    # a step's gravity, and the recovery that is missing; some friction is any friction
    *(Deviation("overlap", 10.5 * dt, _CUSHION, False, 1e-9, start) for start, dt in _STEPS),
)
"""Of MuJoCo's own friction: the largest of what the contact probes show at 0.5, 1, 2, 4, 8 and 16 ms, for μ of 0.05 to 1.45 in
steps of 0.05 with e of 0, 0.3 and 0.8 (up to 8 ms), and for some of them with e up to 1; of oblique impacts in each row what
the next friction and timestep show, since it grows with both."""
_EITHER: tuple[Deviation, ...] = (
    *_rows("push", _NATIVE, {0.0005: {0.0: 0.11}}, hardness="native"),
    *_rows(
        "push-oblong",
        _NATIVE,
        {
            0.0005: {0.15: 0.04, 0.4: 0.14, 0.9: 0.18, 1.25: 0.24},
            0.004: {0.4: 0.19, 0.9: 0.29, 1.25: 0.39},
            0.008: {0.9: 0.43, 1.25: 0.94},
            0.016: {0.15: 0.1, 0.9: 1.0},
        },
        hardness="native",
    ),
    *_rows("stop-oblong", _NATIVE, {0.0005: {0.9: 0.05, 1.25: 0.075}}, hardness="native"),
    Deviation("stick", 0.5, _RESTLESS, relative=False, restitution=_LIVELY),
    *(Deviation("steady", 31.0 * dt, _RESTLESS, False, timestep=start, restitution=_LIVELY) for start, dt in _STEPS),
    *(Deviation("rest", 41.0 * dt * dt, _RESTLESS, False, timestep=start, restitution=_LIVELY) for start, dt in _STEPS),
    *(
        Deviation("rest", 1.1 * _SUNK * longest**2, _DEEP, False, timestep=shortest)
        for shortest, longest in pairwise((0.01, 0.0125, 0.016, 0.02, 0.025, 0.033))
    ),
    Deviation("threshold", 1.02, "MuJoCo has no threshold: all impacts bounce", relative=False),
    Deviation("rolling", 2e-3, "a ball that stops within a step rocks in its contact", False, timestep=0.0144),
)
"""The same of either friction; native hardness stays out of Coulomb's law."""
_COULOMB: tuple[Deviation, ...] = (
    *(
        row
        for probe in ("push", "push-oblong")
        for row in _rows(
            probe, _RESTLESS, {0.0005: {0.0: 0.08, 1.25: 0.11}, 0.008: {0.0: 0.08, 0.4: 0.11}}, restitution=_LIVELY
        )
    ),
    *(
        row
        for probe in ("stop", "stop-oblong")
        for row in _rows(probe, _SET_DOWN, {0.008: {1.25: 0.033}, 0.016: {0.7: 0.04, 0.9: 0.062, 1.25: 0.2}})
    ),
    Deviation("steady", 0.022, _RESTLESS, False, timestep=0.00045, restitution=_LIVELY),
    *(Deviation("rest", 50.0 * dt * dt, _RESTLESS, False, timestep=start, restitution=_LIVELY) for start, dt in _STEPS),
)
"""The same of Coulomb's law, with which nothing hops, and impacts are within 1.4 % from 0.5 to 16 ms."""
_CARRIED = tuple(dataclasses.replace(one, probe="carry") for one in _OWN if one.probe == "stop")
"""What a moving surface carries slides on it."""
CONTACT_DEVIATIONS: tuple[Deviation, ...] = (
    *(dataclasses.replace(one, setting=("friction", NATIVE)) for one in (*_OWN, *_CARRIED)),
    *(dataclasses.replace(one, setting=("friction", COULOMB)) for one in _COULOMB),
    *_EITHER,
    *DEVIATIONS,
)
