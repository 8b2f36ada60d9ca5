"""Which bodies may jam between two walls, as a drawer in its slot.

A body that fits between two surfaces and is longer than the distance between them may tilt until it touches both, at two
different heights. Friction there alone may then press it on, as it presses a clamp onto its post.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from simspec.world.kinematics import CollisionFilter, poses
from simspec.world.meeting import solid_shapes
from simspec.world.overlap import Solid, bounding_spheres_meet, separation, solid_at
from simspec.world.shapes import SHAPES, Round
from simspec.world.tuples import sorted_pair
from simspec.world.types import Body, Shape, World

MOST_WALLS = 500
"""Pairs of walls that are looked at, those first whose centres are nearest: half a second."""


@dataclasses.dataclass(frozen=True)
class _Slider:
    """A body that moves freely, and its greatest length (m)."""

    body: Body
    long: float

    def fits(self, distance: float) -> bool:
        """Whether it fits between walls at this distance (m), and may touch both."""
        return self.long > distance >= _least_width(solid_shapes(self.body))  # of meshes the costly half last


def jamming_materials(
    world: World, free: Iterable[Body], walls: Iterable[Sequence[Body]]
) -> frozenset[tuple[str, str]]:
    """The sorted pairs of materials of a ``free`` body and of two ``walls`` between which it may jam.

    Walls are the solid shapes of bodies that keep their places relative to each other. Height fields are none.
    """
    sliders, places = _sliders(world, free), poses(world)
    if not sliders:
        return frozenset()
    longest = max(slider.long for slider in sliders)
    allowed = CollisionFilter(world)
    found: set[tuple[str, str]] = set()
    for bodies in walls:
        solids = [
            solid_at(body, shape, places[body.name])
            for body in bodies
            for shape in solid_shapes(body)
            if not SHAPES[shape.kind].grid
        ]
        for one, other in _near(solids, longest):
            distance = separation(one, other)
            for slider in sliders:
                if not slider.fits(distance):
                    continue
                first, second = (_materials(allowed, slider.body, wall) for wall in (one, other))
                if first and second:
                    found |= first | second
    return frozenset(found)


def _materials(allowed: CollisionFilter, body: Body, wall: Solid) -> set[tuple[str, str]]:
    """The sorted pairs of materials in which a body may touch a wall."""
    if not allowed.may_touch(body.name, wall.body):
        return set()
    pairs = {sorted_pair(shape.material, wall.shape.material) for shape in solid_shapes(body)}
    return {pair for pair in pairs if allowed.may_materials_touch(*pair)}


def _sliders(world: World, free: Iterable[Body]) -> list[_Slider]:
    """One of all bodies that are alike."""
    special = {name for pair in world.contact.excluded_bodies for name in pair}
    found: dict[object, _Slider] = {}
    for body in free:
        shapes = solid_shapes(body)
        if not shapes or (len(shapes) == 1 and SHAPES[shapes[0].kind].round is Round.EVERY):
            continue  # a ball is as long as it is wide
        alike = (body.collision_group, shapes, body.name if body.name in special else "")
        if alike not in found:
            found[alike] = _Slider(body, _greatest_length(shapes))
    return list(found.values())


def _least_width(shapes: Sequence[Shape]) -> float:
    return 2.0 * min(SHAPES[shape.kind].inner_radius(shape.size) for shape in shapes)


def _greatest_length(shapes: Sequence[Shape]) -> float:
    outer = [SHAPES[shape.kind].outer_radius(shape.size) for shape in shapes]
    centres = [np.array(shape.pose.position) for shape in shapes]
    pairs = itertools.combinations(range(len(shapes)), 2)
    between = (float(np.linalg.norm(centres[i] - centres[j])) + outer[i] + outer[j] for i, j in pairs)
    return max((2.0 * max(outer), *between))


def _near(solids: Sequence[Solid], longest: float) -> Iterator[tuple[Solid, Solid]]:
    """Pairs that may be nearer to each other than ``longest`` (m)."""
    planes = [solid for solid in solids if solid.kind.endless]
    others = [solid for solid in solids if not solid.kind.endless]
    yield from itertools.islice(itertools.combinations(planes, 2), MOST_WALLS)
    yield from itertools.islice(itertools.product(planes, others), MOST_WALLS)
    if len(others) < 2:
        return
    centre = np.array([solid.centre for solid in others])
    pairs = bounding_spheres_meet(centre, np.array([solid.outer for solid in others]) + 0.5 * longest)
    apart = np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)
    for first, second in pairs[np.argsort(apart, kind="stable")[:MOST_WALLS]]:
        yield others[first], others[second]
