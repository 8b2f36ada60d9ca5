"""How far free bodies are moved from where they began: sideways, down, and whether one has left its place.

For what is to stay where it is: towers, piles, boxes on a slope. Down is along gravity; without gravity nothing is down, and
every way is sideways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simspec.errors import Problem, SpecError
from simspec.runner.run import Run
from simspec.world.contact_pairs import solid_shapes
from simspec.world.shapes import SHAPES
from simspec.world.types import Body

LEFT = 1.0
"""Of its size that a body is moved sideways by when it has left its place: the centre is then beyond the edge of an equal body
below. Size: the radius of the largest sphere inside its largest shape, half the width of a cube."""


@dataclass(frozen=True)
class Displacement:
    """How far the free bodies with collision shapes are moved.

    sideways  the largest distance (m) across gravity of any body from where it began, over all records
    down      how far (m) along gravity the body that is lowest beside its beginning is at the end; 0 where none is lower
    whose     the body that is moved sideways furthest
    left      when (s) a body had first left its place; None: none did
    bodies    how many bodies these are
    """

    sideways: float
    down: float
    whose: str
    left: float | None
    bodies: int


def displacement(run: Run) -> Displacement:
    """How far the free bodies of a run are moved. Raises SpecError for a run without records, and where no free body has a
    collision shape. A place that is not a number is infinitely far away."""
    places = {index: body for index, body in enumerate(run.world.bodies) if body.joint.kind == "free" and _size(body)}
    if not places:
        raise SpecError([Problem(f"{run.world.name}: no free body has a collision shape")])
    if "pose" not in run.arrays or not len(run.time):
        raise SpecError([Problem(f"{run.world.name} in {run.engine}: poses were not recorded")])
    gravity = np.asarray(run.world.physics.gravity, dtype=float)
    size = float(np.linalg.norm(gravity))
    along = gravity / size if size else np.zeros(3)
    furthest, lowest, whose = -1.0, 0.0, ""
    first = len(run.time)
    for index, body in places.items():
        moved = np.asarray(run.arrays["pose"][:, index, :3]) - np.asarray(run.arrays["pose"][0, index, :3])
        down = moved @ along
        sideways = np.linalg.norm(moved - down[:, None] * along, axis=1)
        down, sideways = (np.where(np.isfinite(one), one, np.inf) for one in (down, sideways))
        if sideways.max() > furthest:
            furthest, whose = float(sideways.max()), body.name
        lowest = max(lowest, float(down[-1]))
        away = sideways > LEFT * _size(body)
        first = min(first, int(np.argmax(away)) if away.any() else first)
    left = float(run.time[first]) if first < len(run.time) else None
    return Displacement(furthest, lowest, whose, left, len(places))


def _size(body: Body) -> float:
    """The size (m) of a body's largest collision shape; 0 where it has none."""
    shapes = solid_shapes(body)
    return max((SHAPES[shape.kind].inner_radius(shape.size) for shape in shapes), default=0.0)
