"""Hulls of fewer vertices: which are kept, and the distance of the two hulls."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from simspec.meshes import hulls as module
from simspec.meshes.hulls import EQUAL, reduced
from simspec.world.hull import corners

pytestmark = pytest.mark.usefixtures("warm_readers")


def greedy(vertices, most):
    """The same choice, every distance anew."""
    extent = np.ptp(vertices, axis=0).max()
    chosen = module._tetrahedron(vertices, extent)
    while len(chosen) < most:
        equations = ConvexHull(vertices[chosen]).equations
        beyond = (vertices @ equations[:, :3].T + equations[:, 3]).max(axis=1)
        if beyond.max() <= EQUAL * extent:
            break
        chosen.append(int(np.flatnonzero(beyond >= beyond.max() - EQUAL * extent)[0]))
    return vertices[np.sort(chosen)]


@pytest.mark.parametrize("seed", range(4))
def test_kept_vertices_are_the_greedy_choice(seed):
    numbers = np.random.default_rng(seed)
    vertices = numbers.normal(size=(150, 3)) * [0.1, 0.3, 1.0]
    vertices = vertices / np.linalg.norm(vertices, axis=1)[:, None] if seed % 2 else vertices[corners(vertices)]
    kept, error = reduced(vertices, 20)
    expected = greedy(vertices, 20)
    assert np.array_equal(kept, expected[corners(expected)])
    a, b, c = (kept[ConvexHull(kept).simplices[:, k]] for k in range(3))
    outside = [point for point in vertices if not any((kept == point).all(axis=1))]
    separate = max(np.sqrt(module._square_to_triangles(point, a, b, c).min()) for point in outside)
    assert error == pytest.approx(separate, rel=1e-12)


def test_the_choice_does_not_depend_on_the_unit_of_length():
    """By a power of two, which scales every number exactly."""
    vertices = np.random.default_rng(0).normal(size=(150, 3))
    kept, error = reduced(vertices, 20)
    small, small_error = reduced(np.ldexp(vertices, -20), 20)
    assert np.array_equal(np.ldexp(small, 20), kept)
    assert np.ldexp(small_error, 20) == pytest.approx(error, rel=1e-12)
