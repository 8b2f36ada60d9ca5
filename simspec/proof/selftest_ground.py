"""Solids without symmetries for the worlds into which defects are planted: height fields and meshes."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from simspec.world.hull import centred
from simspec.world.hull import mesh_size as hull_size
from simspec.world.shapes import heightfield_size
from simspec.world.types import Pose, Shape, World

ROUGH: Final = heightfield_size(
    *(3.0, 2.4, 0.4), np.array([[0.1, 0.0, 0.05, 0.2], [0.02, 0.12, 0.3, 0.06], [0.06, 0.25, 0.09, 0.0]])
)
"""Ground without symmetries."""
_WEDGE = (
    *((-0.06, -0.05, -0.04), (0.07, -0.05, -0.04), (-0.06, 0.06, -0.04), (0.07, 0.06, -0.04)),
    *((-0.05, 0.0, 0.08), (0.04, 0.01, 0.07)),
)
_GEM = (
    *((0.06, 0.0, 0.01), (-0.05, 0.01, 0.0), (0.0, 0.07, -0.01), (0.01, -0.06, 0.0)),
    *((0.0, 0.01, 0.09), (0.01, 0.0, -0.05)),
)
WEDGE, GEM = (hull_size(centred(np.array(points))[1]) for points in (_WEDGE, _GEM))
"""Hulls of points without symmetries (m)."""


def on_rough_ground(world: World) -> World:
    """A world whose first body, which is fixed, gets rough ground in place of its first shape."""
    floor, *others = world.bodies
    (shape, *more) = floor.shapes
    ground = Shape(shape.name, "heightfield", ROUGH, Pose((0.2, 0.1, -0.3), (0.8, 0.0, 0.0, 0.6)), shape.material)
    bodies = (dataclasses.replace(floor, shapes=(ground, *more)), *others)
    return dataclasses.replace(world, name="self-test-ground", bodies=bodies)
