"""Balls in Rapier, whose normals are the direction from the surface that they touch to their centres, in single precision.

*Measured*, rapier3d 0.36.1: on planes and boxes a ball has the exact normal while its centre is outside, and any where round-
off puts the centre into the surface, where the overlap is the radius. Four balls as feet of a cube of 0.2 m, let go at 1 m/s,
tilted by 10 µrad to 1 mrad: with 1 µm of radius one in five jams at once (the cube stops after 0.04 m in place of 0.1, and
leaves the floor at up to 0.32 m/s), with 10 µm one in fifteen, with 30 µm one in thirty, from 0.1 mm on none of 540. On hulls
normals are off by 5e-7 m of the radius: 5e-3 rad at 0.1 mm, which is half a per cent of the force, 5e-5 rad at 10 mm.
"""

from __future__ import annotations

from simspec.support.declarations import Level, Refinement
from simspec.world.meeting import solid_shapes
from simspec.world.types import World

LEAST = 1e-4
"""m: the least radius of which none jammed."""
SMALL = Refinement(
    Level.APPROXIMATE,
    "balls of less than 0.1 mm have normals of round-off: on a plane or box any, once they are in it as deep as their radius "
    "(of bodies on four of 10 µm that slide at 1 m/s one in fifteen jams at once and is thrown up at 0.3 m/s), on hulls off "
    "by 5e-7 m of the radius",
    "balls of less than 0.1 mm of radius may jam as they slide",
)


def balls(world: World) -> Refinement | None:
    """Balls that are smaller than round-off lets them be."""
    small = any(
        shape.kind == "sphere" and shape.size[0] < LEAST for body in world.bodies for shape in solid_shapes(body)
    )
    return SMALL if small else None
