"""MuJoCo's approximation of the contact law, and the deviations: data, measured with MuJoCo 4.0.1 at the default settings, and
where stated with ``friction: coulomb``.

Boxes of 20 x 20 x 4 cm (oblong ones: 40 x 10 x 2 cm) and spheres of radius 10 cm, of 1 kg, on a fixed box; timestep 1 ms
where none is said.

``friction_deviations.csv`` has one or two bodies on a fixed one, at 0.5 to 16 ms, μ of 0.05 to 1.5 and e of 0 to 1, with a
margin of 5 to 15 %; MuJoCo before 3.4 was measured with 3.3.7. ``contact_deviations.csv`` (``tools/deviations.py``) has
contact of several bodies. MuJoCo's friction takes slip back at 100/s (setting ``friction_rate``) instead of within a step, so
that it lags where normal forces change quickly or the direction of slip turns. Coulomb's law around the solver
(``friction: coulomb``) has none of that up to 4 ms.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from simspec.dialects.mujoco.sidecar import COULOMB
from simspec.engines.kit.deviations import Deviation, Reason, named_reasons, read_deviations
from simspec.engines.kit.refinements import coupled, in_force
from simspec.support.declarations import Level, Refinement, Support, approximate, exact, never
from simspec.support.features import Feature
from simspec.world.contact_pairs import CollisionFilter, meeting_kinds, meeting_laws, solid_shapes
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import Shape, World

_HOP = (
    "MuJoCo's friction cone is associated: what slides is lifted, and beyond a speed that falls with μ and the "
    "timestep it leaves its cushion and hops"
)
_DEEPER = (
    "the points of two boxes have half the depth of their overlap, so that a box lies twice as deep on another one"
)
FRICTION_DEVIATIONS: tuple[Deviation, ...] = named_reasons(
    Path(__file__).with_name("friction_deviations.csv"),
    {
        "hop": _HOP,
        "late-hop": (
            "friction takes back slip at a rate of 100/s at most, so the last μ g/100 of speed fades instead of stopping; "
            + _HOP
        ),
        "missing": (
            "friction takes back slip at a rate of 100/s at most, and an impact lasts one step: most of its friction is "
            "missing, the more the shorter the step (accepted by name: contact.friction.impact)"
        ),
        "thrown": "what is left of an impact's friction lifts what slips, its cone being associated",
        "set-down": (
            "a slider that is set down touches one step later, and has that step's friction in the next: of a slide of few "
            "steps, up to one of them"
        ),
        "bouncing": f"a pair that bounces has no cushion. {_HOP}",
        "pyramid": "under the pyramid friction has no reference of its own, and what slides hops",
        "native": "MuJoCo's own contact has no reference of its own for friction, and what slides hops",
        "restless": "with e near 1 a body never comes to rest; it bounces on at up to 1.6 times (1 + e) g dt",
        "cushion": "on the cushion of frictional contact gravity acts until the depth balances it",
        "deep": "taken back is 1 % of an overlap in a step, after 0.1 % of gravity",
        "threshold": "MuJoCo has no threshold: all impacts bounce",
        "rocks": "a ball that stops within a step rocks in its contact",
        "half-depth": _DEEPER,
        "half-depth-slower": f"{_DEEPER}, and takes longer to come to rest there",
        "half-depth-hop": f"{_DEEPER}: what slides hops at other moments",
    },
)

# Contact of several bodies.

_LEANS = "friction takes slip back at a rate of 100/s, so that what leans settles by millimetres, and slips too far"
_PYRAMID = "under the pyramid what slides hops, and friction has no reference of its own"
_TOGETHER = "most of the friction of an impact is missing (accepted by name: contact.friction.impact)"
_ROW = "contacts with restitution are springs of some steps, which act one after the other: the last ball of a row leaves alone"
_HEAVY = "1 % of an overlap is taken back in a step, after 0.1 % of gravity: heavy bodies rest deeper, with dt squared"
_CARRIED = "what turns slips outwards at its acceleration over the friction rate of 100/s, whatever the timestep"
_SPINS = "friction lags behind normal forces that change as a body tilts or spins"
_FEW = "steps of some ms are few for what slips, clamps, spins or lies on crossing edges"
_LOOP = "the loop around MuJoCo's solver ends before friction and normal forces fit each other"
_LIFTED = "what slides is lifted, the cone being associated, so that it weighs on what is below it by turns"
_CREEPS = "friction near its limit creeps, the more the heavier the body that pushes"
_UNKNOWN = "measured; the cause is not known"
_NATIVE, _INSCRIBED = "friction=native", "pyramid-inscribed"

COUPLED_DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("row*", _ROW),
        Reason("strike* edge*", _TOGETHER),
        Reason("stack-slides*", _LIFTED, _NATIVE),
        Reason("stack-stays*", _CREEPS),
        Reason("stack-slides*", _LOOP),
        Reason("stack-sideways", _UNKNOWN),
        Reason("stack", _HEAVY),
        Reason("carrier", _CARRIED),
        Reason("rod* clamp* jam* squeeze* pile* slide-spin", _PYRAMID, _NATIVE, _INSCRIBED),
        Reason("rod* clamp* jam* squeeze* pile*", _LEANS, _NATIVE),
        Reason("slide-spin", _SPINS, _NATIVE),
        Reason("jam*", _LOOP),
        Reason("*", _FEW),
    ),
)


CONTACT_DEVIATIONS: tuple[Deviation, ...] = (*FRICTION_DEVIATIONS, *COUPLED_DEVIATIONS)

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


def coulomb_requested(world: World) -> Refinement | None:
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
    return coulomb_requested(world) or (UNLISTED if _too_many_to_list(world) else None)


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


_BY_COULOMB_CARRIED = dataclasses.replace(
    BY_COULOMB, short="friction of what is carried by a loop around MuJoCo's solver at every step (friction: coulomb)"
)
COUPLED_SUPPORT: Mapping[Feature, Support] = {
    Feature.CARRIED_FRICTION: approximate(
        "a body at rest on something that turns, or on a surface that moves, slips at a / friction_rate, a the "
        "acceleration by which its carrier's velocity turns or changes there, whatever the timestep: at 100/s and 1 rad/s "
        "by 8 mm/s at 0.8 m from the axis, without end; engines.mujoco.settings: {friction: coulomb} holds it at 1.3 to "
        "1.6 times the time of a step",
        short="what is carried around slips at a / friction_rate: 8 mm/s at 0.8 m and 1 rad/s",
        refine=lambda world: _BY_COULOMB_CARRIED if coulomb_requested(world) else None,
        cases=(_BY_COULOMB_CARRIED,),
    ),
    **coupled(
        "mujoco",
        COUPLED_DEVIATIONS,
        {
            Feature.SELF_LOCKING: (
                "a clamp that jams slips by 20 mm in 0.3 s at 1 ms, and falls where a hundredth of the moment of its weight "
                "presses it on; by friction: coulomb it creeps by 0.5 mm at μ = 0.05 under the elliptic cone and 1 ms, and by "
                "5 mm at 4 ms, and falls under the pyramid at μ = 0.4 and 0.5 ms",
                "a clamp that jams slips by 20 mm in 0.3 s, or falls where little but friction presses it on",
            ),
            Feature.EVEN_PRESSURE: (
                "what slips between fingers falls 6 % too slowly under the pyramid, and from 4 ms on 7 to 15 % too far, "
                "turning by up to 0.14 rad; what they hold creeps by 0.5 mm at 4 ms, and falls at 16 ms",
                "from 4 ms on boxes between fingers creep by 0.5 mm, and turn as they slip",
            ),
            Feature.MASS_RATIO: (
                "heavy bodies sink into light ones: by 0.25 mm at a ratio of 1000 and 1 ms, with the square of the timestep; "
                "what stands under one that slides is taken along at 1000, from 2 ms on. By friction: coulomb what slides "
                "with 1000 times its mass on it stops 10 % short at 1 ms, with 100 times 7 % at 4 ms",
                "1000 times the mass rests 0.25 mm deep at 1 ms, 50 mm at 16 ms",
            ),
        },
        # how native friction slides is accepted as contact.friction.impact
        stacks=lambda row: row.setting != ("friction", "native") or not row.probe.startswith("stack-slides"),
    ),
}
# Unsupported contacts of MuJoCo with height fields, world by world.

POINT_SHAPES: Final = ("sphere", "ellipsoid")
"""Kinds of shapes that touch a triangle in one point."""
MOST_CONTACTS: Final = 50
"""Contacts of one shape with one height field (mjMAXCONPAIR); of more MuJoCo keeps the first, those of the least y and x, and
says nothing: a box on 1,000 triangles stands on one of its edges (measured)."""
ROCKS: Final = Refinement(
    Level.APPROXIMATE,
    "one point of contact for each triangle, so that faces and edges have too few to stand on: a cube on one large triangle "
    "rocks, at up to 2 rad/s (measured); exact for spheres and ellipsoids",
    "faces and edges rock on height fields: each triangle gives one point of contact",
)
FEW: Final = Refinement(
    Level.APPROXIMATE,
    f"one point of contact for each triangle, and of one shape at most {MOST_CONTACTS} of them: those beyond are left out "
    "unsaid, so that what covers more triangles stands on some of them; exact for spheres and ellipsoids",
    "faces rock on height fields, and what covers more than 25 cells stands on some of them only",
)


@functools.lru_cache(maxsize=8)
def ground_supported(world: World) -> Refinement | None:
    """The missing contacts where shapes with faces or edges may meet a height field."""
    allowed = CollisionFilter(world)
    solid = [(body.name, shape) for body in world.bodies for shape in body.shapes if shape.collision]
    fields = [(name, shape) for name, shape in solid if SHAPES[shape.kind].grid]
    met = [
        (field, shape)
        for ground, field in fields
        for name, shape in solid
        if shape.kind not in POINT_SHAPES
        and name != ground
        and allowed.may_touch(ground, name)
        and allowed.may_materials_touch(field.material, shape.material)
    ]
    if not met:
        return None
    return FEW if any(_covered(field, shape) > MOST_CONTACTS for field, shape in met) else ROCKS


def _covered(field: Shape, shape: Shape) -> float:
    """How many triangles a shape may be over at once, by its bounding sphere."""
    ground = field_of(field.size)
    rows, columns = ground.shape
    wide = 2.0 * SHAPES[shape.kind].outer_radius(shape.size)
    along = min(math.ceil(wide * (columns - 1) / ground.x) + 1, columns - 1)
    across = min(math.ceil(wide * (rows - 1) / ground.y) + 1, rows - 1)
    return 2 * along * across


HEIGHT_FIELDS: Final = Support(
    Level.EXACT,
    "an hfield, with heights to 3e-8 of their range; one point of contact for each triangle, which is what spheres and "
    "ellipsoids have",
    refine=ground_supported,
    cases=(ROCKS, FEW),
)


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
    **COUPLED_SUPPORT,
    Feature.CONE_ELLIPTIC: exact("cone=elliptic"),
    Feature.CONE_PYRAMID_INSCRIBED: approximate(
        "the force keeps to the pyramid, but MuJoCo's pyramid throws sliding bodies up, by 4 to 13 mm at 1 m/s and 100 to "
        "320 mm at 5 m/s (μ 0.3 to 1), and with restitution slip bounces back too",
        short="what slides is thrown up: by 4 to 13 mm at 1 m/s, 100 to 320 mm at 5 m/s",
    ),
    Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("MuJoCo has the elliptic cone and the inscribed pyramid only"),
}
