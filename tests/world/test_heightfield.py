"""Height fields as the world has them: surface, boundary, volume, and what a size may say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.proof.checks import field_distance, surface
from simspec.world import overlap
from simspec.world.shapes import HEIGHTFIELD_HEAD, SHAPES, field_of, heightfield_fault, heightfield_size
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape, World

ROWS = np.array([[0.1, 0.0, 0.4], [0.3, 0.2, 0.1]])
ROUGH = heightfield_size(2.0, 1.0, 0.5, np.random.default_rng(5).uniform(0.0, 0.3, (5, 7)))


def test_a_cell_is_two_triangles_along_the_diagonal_from_its_least_corner():
    field = field_of(heightfield_size(4.0, 3.0, 0.5, ROWS))
    assert field.points[:3].tolist() == [[-2.0, -1.5, 0.1], [0.0, -1.5, 0.0], [2.0, -1.5, 0.4]]
    assert field.triangles.tolist()[:2] == [[0, 1, 4], [0, 4, 3]]
    assert (field.normals[:, 2] > 0.0).all()
    # in the middle of a cell the height is that of the diagonal, not of the other one
    assert surface(field, np.array([[0.25, 0.5]])) == pytest.approx([(0.1 + 0.2) / 2.0])


@pytest.mark.parametrize("size", [heightfield_size(4.0, 3.0, 0.5, ROWS), ROUGH], ids=["2x3", "5x7"])
def test_its_boundary_is_closed_and_holds_its_volume(size):
    field = field_of(size)
    points, triangles = field.closed()
    edges = [
        tuple(pair) for row in triangles.tolist() for pair in ((row[0], row[1]), (row[1], row[2]), (row[2], row[0]))
    ]
    assert sorted(edges) == sorted((b, a) for a, b in edges)  # each edge once each way: closed, and wound alike
    assert len(set(edges)) == len(edges)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    enclosed = float((a * np.cross(b, c)).sum() / 6.0)
    assert SHAPES["heightfield"].volume(size) == pytest.approx(enclosed, rel=1e-12)
    prisms = sum(float(np.ptp(field.prism(n)[[0, 3], 2])) for n in range(len(field.triangles)))
    assert prisms > 0.0
    row = SHAPES["heightfield"]
    assert row.outer_radius(size) == pytest.approx(float(np.linalg.norm(points, axis=1).max()))
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(row.support(size, axes), (points @ axes.T).max(axis=0))


def test_the_distance_of_two_fields_tells_diagonals_and_single_heights():
    rows, columns = 5, 7
    heights = np.array(ROUGH[HEIGHTFIELD_HEAD:]).reshape(rows, columns)
    assert field_distance(ROUGH, ROUGH) == 0.0
    values = heights.copy()
    values[2, 3] += 1e-5
    assert field_distance(ROUGH, heightfield_size(2.0, 1.0, 0.5, values)) == pytest.approx(1e-5 / 2.0, rel=1e-6)
    for changed in (
        heightfield_size(2.0 + 1e-4, 1.0, 0.5, heights),
        heightfield_size(2.0, 1.0, 0.5 + 1e-4, heights),
        heightfield_size(2.0, 1.0, 0.5, heights[::-1]),
        heightfield_size(2.0, 1.0, 0.5, heights[:, ::-1]),
        heightfield_size(2.0, 1.0, 0.5, heights * (1.0 + 1e-3)),
    ):
        assert field_distance(ROUGH, changed) > 4e-5
    # the same points, split along the other diagonal: a mirror image, looked at in a mirror
    bent = heightfield_size(1.0, 1.0, 0.5, np.array([[0.2, 0.0], [0.0, 0.2]]))
    mirrored = field_of(heightfield_size(1.0, 1.0, 0.5, np.array([[0.0, 0.2], [0.2, 0.0]])))
    inside = np.array([[2.0 / 3.0, 1.0 / 3.0]])
    other = surface(mirrored, np.array([[1.0 / 3.0, 1.0 / 3.0]]))
    assert abs(float(surface(field_of(bent), inside)[0] - other[0])) > 0.05


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ((2.0, 2.0), "entries"),
        ((1.0, 3.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0), "at least 2"),
        ((2.5, 2.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0), "at least 2"),
        ((2.0, 2.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0), "3 heights, should have 2 × 2"),
        ((2.0, 2.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0), "above zero"),
        ((2.0, 2.0, 1.0, 1.0, math.nan, 0.0, 0.0, 0.0, 0.0), "above zero"),
        ((2.0, 2.0, 1.0, 1.0, 1.0, 0.0, math.inf, 0.0, 0.0), "not finite"),
    ],
)
def test_an_invalid_size_is_reported(size, said):
    assert said in (heightfield_fault(size) or "")
    assert heightfield_fault(ROUGH) is None


def ball_over_ground(height: float) -> World:
    """A ball of 0.1 m, this high (m) above the middle of a V-shaped valley with walls at 45°."""
    valley = heightfield_size(2.0, 2.0, 0.5, np.array([[1.0, 0.0, 1.0]] * 3))
    fixed, free = (
        Joint("g", "fixed"),
        Joint("b", "free", position=(0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
    )
    bodies = (
        Body("ground", "ground", Inertial(0.0), fixed, (Shape("g0", "heightfield", valley, Pose(), "m"),)),
        Body(
            "ball",
            "ball",
            Inertial(1.0, inertia=(1.0, 1.0, 1.0, 0, 0, 0)),
            free,
            (Shape("b0", "sphere", (0.1,), Pose(), "m"),),
        ),
    )
    return World("valley", bodies, Contact(materials=(Material("m"),), pairs=(PairContact("m", "m", 0.0, 0.0),)))


def test_deep_overlaps_with_ground_are_with_the_solid_below_its_triangles():
    touching = 0.1 * math.sqrt(2.0)
    assert overlap.deep_overlaps(ball_over_ground(touching - 0.005)) == []  # its hull would hold it whole
    (found,) = overlap.deep_overlaps(ball_over_ground(touching - 0.05))
    assert found.depth == pytest.approx(0.05 / math.sqrt(2.0), rel=1e-3)
