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

from simspec.dialects.mujoco.dialect import RESTITUTION
from simspec.dialects.mujoco.sidecar import COULOMB
from simspec.engines.kit.capabilities import (
    UNKNOWN,
    Deviation,
    Reason,
    coarse,
    named_reasons,
    read_deviations,
    unconverged,
)
from simspec.engines.kit.refinements import coupled, in_force
from simspec.support.declarations import EXACT, Level, Refinement, Support, approximate, exact, never
from simspec.support.features import Feature
from simspec.world.contact_pairs import CollisionFilter, meeting_kinds, meeting_laws, solid_shapes
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import Shape, World

BOXES = "3.4"
"""The first release in which two boxes touch with the depth of their overlap."""
NATIVE_FRICTION: Mapping[Feature, str] = {
    Feature.IMPACT_FRICTION: "MuJoCo's native friction lags where it changes within a step: most of it is missing in impacts, "
    "and leaning, clamped or spinning bodies slip too far",
    Feature.CARRIED_FRICTION: "MuJoCo's native friction lets a body on a turning or moving carrier slip at a / friction_rate, "
    "where a is the acceleration of the carrier there, at any timestep",
    Feature.SELF_LOCKING: "MuJoCo's native friction lets a jammed clamp slip, and fall where little but friction presses it on",
}
"""The deviation of MuJoCo's native friction in each feature for which MuJoCo's declaration names ``friction: coulomb``."""
USE_COULOMB = "Use engines.mujoco.settings: {friction: coulomb}, which costs time"

NO_CUSHION = "simspec adds no cushion to pairs with restitution"
_HOP = (
    "MuJoCo's friction cone is associated: it lifts sliding bodies, which leave their cushion and "
    "hop beyond a speed that decreases with μ and the timestep"
)
_DEEPER = (
    f"MuJoCo before {BOXES} computes half the overlap depth of two boxes: a box rests twice as deep on another one"
)
_DEEP = "MuJoCo's contact leaves 0.1 % of gravity, and removes 1 % of an overlap in each step"
_PYRAMID = "MuJoCo's pyramid has no separate reference for friction, and sliding bodies hop"
FRICTION_DEVIATIONS: tuple[Deviation, ...] = named_reasons(
    Path(__file__).with_name("friction_deviations.csv"),
    {
        "hop": _HOP,
        "late-hop": (
            "MuJoCo's friction removes slip at a rate of 100/s at most, so that the last μ g/100 of the "
            "speed decays. " + _HOP
        ),
        "missing": (
            "MuJoCo's friction removes slip at a rate of 100/s at most, and an impact lasts one step: "
            "most of its friction is missing, more at shorter timesteps (accepted by name: "
            "contact.friction.impact)"
        ),
        "thrown": "MuJoCo's friction cone is associated: the remaining friction of an impact lifts slipping bodies",
        "set-down": (
            "MuJoCo's contact of a slider that is set down begins one step later, with that step's "
            "friction in the next: a slide of few steps is off by up to one"
        ),
        "bouncing": f"{NO_CUSHION}. {_HOP}",
        "pyramid": _PYRAMID,
        "native": "MuJoCo's native contact has no separate reference for friction, and sliding bodies hop",
        "restless": "MuJoCo lets bodies with e near 1 bounce on without end, at a speed proportional to (1 + e) g dt",
        "cushion": "MuJoCo lets bodies sink into the cushion of frictional contact until the depth balances gravity",
        "deep": _DEEP,
        "threshold": "MuJoCo has no restitution threshold: bodies bounce in all impacts",
        "rocks": "MuJoCo's balls that stop within a step rock in their contact",
        "half-depth": _DEEPER,
        "half-depth-slower": f"{_DEEPER}, and takes longer to come to rest there",
        "half-depth-hop": f"{_DEEPER}, and sliding bodies hop at other moments",
    },
)

# Contact of several bodies.

_LEANS = (
    "MuJoCo's friction removes slip at a rate of 100/s, so that leaning bodies settle by millimetres and slip too far"
)
_TOGETHER = "MuJoCo's impacts lack most of their friction (accepted by name: contact.friction.impact)"
_ROW = (
    "MuJoCo's contacts with restitution are springs that last several steps and act one after the "
    "other: the last ball of a row leaves alone"
)
_HEAVY = f"{_DEEP}: heavy bodies rest deeper, with the square of the timestep"
_CARRIED = (
    "MuJoCo's friction lets turning bodies slip outwards at their acceleration divided by the "
    "friction rate of 100/s, at any timestep"
)
_SPINS = "MuJoCo's friction lags behind normal forces that change as a body tilts or spins"
_FEW = coarse("slip, clamp, spin or rest on crossing edges")
_LOOP = unconverged("simspec's loop around MuJoCo's solver")
_LIFTED = "MuJoCo's friction cone is associated: it lifts sliding bodies, which load the body below intermittently"
_CREEPS = "MuJoCo's friction creeps near its limit, faster under heavier bodies that push"
_BOUNCES = (
    "MuJoCo has no restitution threshold: bodies with restitution bounce on at rest and as they slide, and lose friction in "
    "between"
)
_NATIVE, _INSCRIBED = "friction=native", "pyramid-inscribed"

COUPLED_DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("row*", _ROW),
        Reason("rod* clamp* jam* squeeze* pile* cross* carrier slide-spin", _BOUNCES, "friction=coulomb", bounces=True),
        Reason(
            "rod* clamp* jam* squeeze* pile* slide-spin", f"{NO_CUSHION}. {_HOP}", _NATIVE, "elliptic", bounces=True
        ),
        Reason("rod clamp carrier", _BOUNCES, _NATIVE, _INSCRIBED, bounces=True),
        Reason("strike* edge*", _TOGETHER),
        Reason("stack-slides*", _LIFTED, _NATIVE),
        Reason("stack-stays*", _CREEPS),
        Reason("stack-slides*", _LOOP),
        Reason("stack-sideways", UNKNOWN),
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

COULOMB_COSTS = (
    "simspec applies De Saxcé's correction around MuJoCo's solver at every step (friction: coulomb), for "
    "Coulomb's law in impacts and slides. See docs/engines/mujoco.md for its cost and convergence"
)


BY_COULOMB = Refinement(
    Level.OUTSIDE,
    COULOMB_COSTS,
    "simspec solves friction in impacts in a loop around MuJoCo's solver (friction: coulomb)",
    requested=True,
)


def coulomb_requested(world: World) -> Refinement | None:
    """Friction is computed outside MuJoCo where the spec sets that."""
    return BY_COULOMB if dict(world.options("mujoco").settings).get("friction") == COULOMB else None


UNLISTED = Refinement(
    Level.APPROXIMATE,
    "More pairs of shapes with friction may touch than explicit_pairs_limit allows: simspec writes none of "
    f"them, sliding bodies are lifted, and level L5 fails. {USE_COULOMB}",
    "beyond explicit_pairs_limit sliding bodies hop, and L5 fails; use friction: coulomb",
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
    f"{_DEEPER}, and recovers at half the rate",
    f"before {BOXES} a box rests twice as deep on another box, and recovers half as fast",
)


def boxes_before(world: World) -> Refinement | None:
    """Two boxes that may touch have half the depth in earlier releases."""
    return HALF_DEPTH if ("box", "box") in meeting_kinds(world) else None


_BY_COULOMB_CARRIED = dataclasses.replace(
    BY_COULOMB, short="simspec solves friction on carriers in a loop around MuJoCo's solver (friction: coulomb)"
)
COUPLED_SUPPORT: Mapping[Feature, Support] = {
    Feature.CARRIED_FRICTION: approximate(
        f"{NATIVE_FRICTION[Feature.CARRIED_FRICTION]}. {USE_COULOMB}",
        short="a body on a turning carrier slips at a / friction_rate: 8 mm/s at 0.8 m and 1 rad/s",
        refine=lambda world: _BY_COULOMB_CARRIED if coulomb_requested(world) else None,
        cases=(_BY_COULOMB_CARRIED,),
    ),
    **coupled(
        "mujoco",
        COUPLED_DEVIATIONS,
        {
            Feature.SELF_LOCKING: (
                f"{NATIVE_FRICTION[Feature.SELF_LOCKING]}. With engines.mujoco.settings: {{friction: coulomb}} it creeps, and "
                "falls under the pyramid",
                "a jammed clamp slips by 20 mm in 0.3 s, or falls where little but friction presses it on",
            ),
            Feature.EVEN_PRESSURE: (
                "MuJoCo's bodies between two fingers slip too slowly under the pyramid; from 4 ms on they slip "
                "too far, turn and creep",
                "from 4 ms on boxes between fingers creep by 0.5 mm, and turn as they slip",
            ),
            Feature.MASS_RATIO: (
                "MuJoCo lets heavy bodies sink into light ones, with the square of the timestep. Bodies below "
                "sliding ones are dragged along, and with friction: coulomb bodies that slide under a load "
                "stop too early",
                "a body of 1000 times the mass rests 0.25 mm deep at 1 ms, 50 mm at 16 ms",
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
    "MuJoCo computes one contact point for each triangle of a height field, so that faces and edges rock. "
    "Spheres and ellipsoids are exact",
    "faces and edges rock on height fields: each triangle gives one point of contact",
)
FEW: Final = Refinement(
    Level.APPROXIMATE,
    "MuJoCo computes one contact point for each triangle of a height field, and drops those beyond "
    f"{MOST_CONTACTS} of a shape without a warning, so that faces rock. Spheres and ellipsoids are exact",
    "faces rock on height fields, and shapes over more than 25 cells stand on some of them only",
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
    "MuJoCo stores heights to 3e-8 of their range and computes one contact point for each triangle, as spheres "
    "and ellipsoids have",
    refine=ground_supported,
    cases=(ROCKS, FEW),
)


_PAIRS = exact("simspec writes explicit pairs of shapes")
_COMMON_CONE = (
    "MuJoCo bounds sliding, spinning and rolling friction by one cone, (f/μ)² + (τ/c)² ≤ N²: where they occur "
    "together, each reduces the others"
)
CONTACT_SUPPORT: Mapping[Feature, Support] = {
    Feature.SHAPE_BOX: exact(
        f"MuJoCo before {BOXES} computes half the overlap depth of two boxes, so that a box rests twice as deep "
        "on another one. There boxes that may meet must be accepted",
        cases=(HALF_DEPTH,),
        since=BOXES,
        before=boxes_before,
    ),
    Feature.SHAPE_CYLINDER: exact(
        "MuJoCo's contacts of a flat face are points on its rim, and lean on the soft first layer of friction: "
        "upright cylinders tip too early (see docs/engines/mujoco.md)"
    ),
    Feature.FRICTION_PAIRS: _PAIRS,
    Feature.RESTITUTION: approximate(
        RESTITUTION,
        short="e is off by up to 0.03 at 1 ms, 0.05 at 2 ms and 0.11 at 4 ms",
    ),
    Feature.RESTITUTION_PAIRS: _PAIRS,
    Feature.RESTITUTION_THRESHOLD: approximate(
        (
            "MuJoCo has no restitution threshold: bodies bounce after slow impacts, too, at up to e times the "
            "threshold speed"
        ),
        short="there is no threshold: bodies bounce on after slow impacts",
    ),
    Feature.TORSIONAL_FRICTION: approximate(
        _COMMON_CONE,
        short="slides with spin have 0.55 of μ and 0.74 of c at worst measured",
    ),
    Feature.ROLLING_FRICTION: approximate(
        _COMMON_CONE,
        short="rolling is braked too little where c is large: by 1.3 % at c = 0.4 μ r, 17 % at c = μ r",
    ),
    Feature.HARDNESS_COMMON: exact(
        "simspec adds a soft layer, the setting friction_cushion, to contacts with native friction and "
        "without restitution"
    ),
    Feature.HARDNESS_TIME_CONSTANT: approximate(
        "MuJoCo's time constant is that of each contact point: the n points of a face act as n springs, so "
        "that a box rests less deep",
        short="right for one contact point; a face is as stiff as its n points: a box rests 1/4 as deep",
    ),
    Feature.HARDNESS_STIFFNESS: exact(
        "MuJoCo's contact constraint acts on accelerations: simspec converts the stiffness for free single "
        "bodies and static ones, and rejects mechanisms"
    ),
    Feature.HARDNESS_PAIRS: _PAIRS,
    Feature.SURFACE_VELOCITY: exact("simspec sets the surfacevel of a geom", since="3.11"),
    Feature.MARGIN_PAIRS: _PAIRS,
    Feature.HARDNESS_NATIVE: approximate(
        "MuJoCo's default solref and solimp make contact soft, and sliding bodies hop; impratio remains that "
        "of the world",
        short="MuJoCo's soft contact: a box rests 0.1 mm deep, a sphere 0.4 mm, a slider hops 3 mm",
    ),
    Feature.PASSING_PAIRS: exact("simspec writes collision masks of shapes, or excluded pairs of bodies"),
    Feature.IMPACT_FRICTION: approximate(
        f"{NATIVE_FRICTION[Feature.IMPACT_FRICTION]}. {USE_COULOMB}",
        short="80 to 90 % of the friction in impacts is missing at 1 ms; leaning bodies settle by up to 5 mm",
        refine=impact_friction,
        cases=(BY_COULOMB, UNLISTED),
    ),
    **COUPLED_SUPPORT,
    Feature.CONE_ELLIPTIC: EXACT,
    Feature.CONE_PYRAMID_INSCRIBED: approximate(
        "MuJoCo's pyramidal cone throws sliding bodies up, and with restitution slip rebounds, too; the force "
        "remains within the pyramid",
        short="sliding bodies are thrown up: by 4 to 13 mm at 1 m/s, 100 to 320 mm at 5 m/s",
    ),
    Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("MuJoCo has the elliptic cone and the inscribed pyramid only"),
}
