"""The balls in the hulls of meshes: within, on at least three faces each, as those of boxes are."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.engines.drake.approximations import MOST_CORNERS, RADIUS, corners
from simspec.testing.worlds import SIZES
from simspec.world.hull import centred, hull_of, mesh_size
from simspec.world.hull import corners as extremes


def ball_shaped(points: int) -> tuple[float, ...]:
    """A hull of points all over an ellipsoid."""
    spread = np.random.default_rng(4).normal(size=(points, 3))
    spread *= np.array([0.1, 0.07, 0.04]) / np.linalg.norm(spread, axis=1, keepdims=True)
    return mesh_size(centred(spread[extremes(spread)])[1])


@pytest.mark.parametrize(
    ("size", "count"),
    [(ball_shaped(6), 12), (SIZES["mesh"], 42), (ball_shaped(300), MOST_CORNERS)],
    ids=["six corners", "fourteen", "three hundred"],
)
def test_each_ball_is_within_and_touches_three_faces(size, count):
    hull = hull_of(size)
    balls = corners("mesh", size)
    assert len(balls) == count
    for kind, (radius,), centre in balls:
        assert (kind, radius) == ("sphere", RADIUS)
        inside = hull.offsets - hull.normals @ np.array(centre) - radius
        assert inside.min() > -1e-11
        assert np.sum(inside < 1e-11) >= 3


def test_a_box_that_is_a_hull_has_the_balls_of_the_box():
    sides = (0.1, 0.2, 0.3)
    signs = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    size = tuple(sign * side for row in signs for sign, side in zip(row, sides, strict=True))
    of_hull = {tuple(np.round(place, 9)) for _, _, place in corners("mesh", size)}
    of_box = {tuple(np.round(place, 9)) for _, _, place in corners("box", sides)}
    assert of_hull == of_box


def test_a_small_hull_has_small_balls():
    size = tuple(1e-3 * value for value in SIZES["mesh"])
    assert corners("mesh", size)[0][1][0] == pytest.approx(0.1 * hull_of(size).offsets.min())
