"""How far MuJoCo before 3.4 is from the contact law beyond what later releases are: the points of two boxes have half the depth
of their overlap. Data, measured with MuJoCo 3.3.7 at 0.5, 1, 2, 4, 8 and 16 ms, for μ of 0.05 to 1.5 and e of 0 to 0.8.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, Final

from simspec.engines.kit.deviations import Deviation
from simspec.engines.mujoco.contact import BOXES
from simspec.support.declarations import Level, Refinement, Support
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import Shape, World

_DEEPER = (
    "the points of two boxes have half the depth of their overlap, so that a box lies twice as deep on another one"
)
_SLOWER = f"{_DEEPER}, and takes longer to come to rest there"
_OTHERWISE = f"{_DEEPER}: what slides hops at other moments"
_BOUNCES = {"restitution": 0.01}
_PYRAMID = {"friction_cone": "pyramid-inscribed"}
_NATIVE = {"hardness": "native"}
_SPRINGS = {"hardness": "stiffness"}


def _rows(
    probe: str, why: str, table: Mapping[float, Mapping[float, float]], more: Mapping[str, Any]
) -> tuple[Deviation, ...]:
    """``table``: by timestep (s), by least friction, the largest share of the expected value."""
    return tuple(
        Deviation(probe, size, why, friction=friction, timestep=0.9 * timestep, until=BOXES, **more)
        for timestep, sizes in table.items()
        for friction, size in sizes.items()
    )


DEVIATIONS: tuple[Deviation, ...] = (
    Deviation("rest", 2.1e-4, _DEEPER, relative=False, until=BOXES),
    Deviation("stick", 2.5e-3, _SLOWER, relative=False, until=BOXES),
    *_rows(
        "push",
        _OTHERWISE,
        {0.0005: {0.0: 0.03}, 0.001: {0.0: 0.07, 0.4: 0.1}, 0.002: {0.4: 0.16}, 0.008: {0.9: 0.36}},
        {},
    ),
    *_rows("push", _OTHERWISE, {0.001: {0.4: 0.15}, 0.004: {0.4: 0.22}}, _BOUNCES),
    *_rows("push", _OTHERWISE, {0.0005: {0.3: 0.28}}, _PYRAMID),
    *_rows("push", _OTHERWISE, {0.0005: {0.0: 0.13}}, _NATIVE),
    *_rows(
        "push-oblong",
        _OTHERWISE,
        {
            0.0005: {0.0: 0.031},
            0.001: {0.0: 0.053, 0.4: 0.08},
            0.002: {0.4: 0.2},
            0.004: {0.4: 0.23},
            0.008: {0.9: 0.36},
            0.016: {0.4: 0.31},
        },
        {},
    ),
    *_rows("push-oblong", _OTHERWISE, {0.002: {0.9: 0.27}, 0.008: {0.15: 0.085}}, _NATIVE),
    *_rows("stop", _OTHERWISE, {0.002: {0.4: 0.04}, 0.004: {0.0: 0.021}}, {}),
    *_rows("stop", _OTHERWISE, {0.008: {0.4: 0.12}}, _BOUNCES),
    *_rows("stop", _OTHERWISE, {0.0005: {0.0: 0.02}, 0.008: {0.9: 0.061}}, _NATIVE),
    *_rows("stop-oblong", _OTHERWISE, {0.002: {0.4: 0.115}, 0.016: {0.4: 0.16}}, {}),
    *_rows("stop-oblong", _OTHERWISE, {0.0005: {0.4: 0.035}}, _BOUNCES),
    *(row for probe in ("stop", "stop-oblong") for row in _rows(probe, _SLOWER, {0.004: {0.0: 0.027}}, _SPRINGS)),
    Deviation("stick", 0.03, _SLOWER, relative=False, timestep=0.0036, hardness="stiffness", until=BOXES),
)
"""The largest of what exceeds the rows of later releases, and a tenth more."""

# What MuJoCo's contact with height fields does not have, world by world.

ONE_POINT: Final = ("sphere", "ellipsoid")
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
def ground_held(world: World) -> Refinement | None:
    """What is missing where shapes with faces or edges may meet a height field."""
    allowed = CollisionFilter(world)
    solid = [(body.name, shape) for body in world.bodies for shape in body.shapes if shape.collision]
    fields = [(name, shape) for name, shape in solid if SHAPES[shape.kind].grid]
    met = [
        (field, shape)
        for ground, field in fields
        for name, shape in solid
        if shape.kind not in ONE_POINT
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
    refine=ground_held,
    cases=(ROCKS, FEW),
)
