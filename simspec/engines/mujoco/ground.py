"""What MuJoCo's contact with height fields does not have, world by world."""

from __future__ import annotations

import functools
import math
from typing import Final

from simspec.support.declarations import Level, Refinement, Support
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import Shape, World

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
