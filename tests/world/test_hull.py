"""Convex hulls and what triangles enclose: against formulas, against another reader, and against sampling."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.world import frames
from simspec.world.hull import (
    FlatError,
    centred,
    corners,
    hull,
    hull_of,
    mesh_size,
    mesh_triangles,
    mesh_vertices,
    principal,
    solid,
)
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose

CUBE = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
TURN = frames.normalise((0.8, 0.3, -0.4, 0.33))


def turned(points: np.ndarray) -> np.ndarray:
    return points @ np.array(frames.matrix(TURN)).T + (3.0, -2.0, 0.5)


def directions(count: int = 500) -> np.ndarray:
    made = np.random.default_rng(5).normal(size=(count, 3))
    return made / np.linalg.norm(made, axis=1, keepdims=True)


def test_of_a_box_of_points_its_corners_are_left():
    edges = np.array([0.3, 0.2, 0.1])
    inside = np.random.default_rng(1).uniform(0.1, 0.9, (200, 3))
    on_faces = np.array([[0.5, 0.5, 0.0], [0.5, 0.0, 0.0], [0.25, 0.0, 1.0]])
    points = np.concatenate([inside, on_faces, CUBE, CUBE]) * edges
    chosen = corners(points)
    assert chosen.tolist() == list(range(203, 211))  # of equal points the first, in the order of the file
    frame, vertices = centred(points[chosen])
    assert frame == Pose(tuple(edges / 2))  # the axes of a box are its own, to the last bit
    size = mesh_size(vertices)
    assert mesh_vertices(size).tolist() == vertices.tolist()
    assert SHAPES["mesh"].volume(size) == pytest.approx(0.006, rel=1e-15)
    assert SHAPES["mesh"].moments(size, 2.0) == pytest.approx(SHAPES["box"].moments(tuple(edges), 2.0), rel=1e-14)
    assert SHAPES["mesh"].inner_radius(size) == pytest.approx(0.05, rel=1e-14)
    assert SHAPES["mesh"].outer_radius(size) == pytest.approx(SHAPES["box"].outer_radius(tuple(edges)), rel=1e-15)
    local = directions()
    np.testing.assert_allclose(
        SHAPES["mesh"].support(size, local), SHAPES["box"].support(tuple(edges), local), rtol=1e-14
    )


def test_a_cube_has_body_axes_in_every_pose():
    """All its moments are equal: round-off alone would choose the axes."""
    frame, _ = centred(CUBE * 0.1 + (0.7, 0.3, -11.0))
    assert frame.quaternion == (1.0, 0.0, 0.0, 0.0)


def test_a_tetrahedron():
    """About its centre ∫x² is 3/480 and ∫xy −1/480: the tensor is 6/480 with products +1/480."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    solid = hull(points).solid
    assert solid.volume == pytest.approx(1 / 6, rel=1e-15)
    assert solid.frame.position == pytest.approx((0.25, 0.25, 0.25), rel=1e-15)
    assert sorted(solid.moments) == pytest.approx([5 / 480, 5 / 480, 8 / 480], rel=1e-14)


def l_profile() -> tuple[np.ndarray, np.ndarray]:
    """An L of 2 x 2 x 1 without its corner of 1 x 1 x 1: a closed surface that is not convex."""
    outline = [(0.0, 0.0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    points = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in outline])
    cap = [(0, 1, 3), (1, 2, 3), (0, 3, 5), (3, 4, 5)]
    sides = [t for i in range(6) for t in ((i, (i + 1) % 6, i + 6), ((i + 1) % 6, (i + 1) % 6 + 6, i + 6))]
    bottom = [(a, c, b) for a, b, c in cap]
    top = [(a + 6, b + 6, c + 6) for a, b, c in cap]
    return points, np.array([*bottom, *top, *sides])


def test_a_solid_that_is_not_convex():
    points, triangles = l_profile()
    local = solid(points, triangles)
    assert local.volume == pytest.approx(3.0, rel=1e-15)
    assert local.frame.position == pytest.approx((5 / 6, 5 / 6, 0.5), rel=1e-15)
    # about the centre of the three cubes ∫x² = ∫y² = 11/12, ∫z² = 1/4 and ∫xy = −1/3
    assert sorted(local.moments) == pytest.approx([7 / 6 - 1 / 3, 7 / 6 + 1 / 3, 11 / 6], rel=1e-14)
    assert hull(points).solid.volume == pytest.approx(3.5, rel=1e-15)
    assert solid(points, triangles[:, ::-1]).volume == pytest.approx(-3.0, rel=1e-15)


def test_many_faces_come_near_a_sphere():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    size = mesh_size(centred(np.asarray(ball.vertices))[1])
    assert SHAPES["mesh"].volume(size) == pytest.approx(SHAPES["sphere"].volume((0.3,)), rel=0.003)
    assert SHAPES["mesh"].moments(size, 1.0) == pytest.approx(SHAPES["sphere"].moments((0.3,), 1.0), rel=0.003)
    assert SHAPES["mesh"].inner_radius(size) == pytest.approx(0.3, rel=0.002)
    assert SHAPES["mesh"].outer_radius(size) == pytest.approx(0.3, rel=1e-12)


@pytest.mark.parametrize(
    "points",
    [
        CUBE[:3],
        CUBE * (1.0, 1.0, 0.0),
        np.zeros((9, 3)),
        np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]]),
        np.array([*CUBE, [math.nan, 0.0, 0.0]]),
        np.array([*CUBE, [math.inf, 0.0, 0.0]]),
        CUBE * (1.0, 1.0, 1e-17),
    ],
    ids=["three", "plane", "point", "line", "nan", "infinite", "thin"],
)
def test_points_without_volume_are_rejected(points):
    with pytest.raises(FlatError):
        corners(points)


def test_faces_are_closed_and_wound_outwards_in_a_fixed_order():
    points = turned(np.concatenate([CUBE, directions(60) * 0.4 + 0.5]))
    vertices = centred(points[corners(points)])[1]
    triangles = mesh_triangles(mesh_size(vertices))
    assert triangles.tolist() == sorted(triangles.tolist())
    assert (triangles[:, 0] == triangles.min(axis=1)).all()
    assert len(triangles) == 2 * len(vertices) - 4  # Euler
    edges = [(int(row[k]), int(row[(k + 1) % 3])) for row in triangles for k in range(3)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    made = hull_of(mesh_size(vertices))
    assert (np.einsum("ij,ij->i", made.normals, vertices[triangles[:, 0]]) > 0.0).all()
    assert hull_of(list(mesh_size(vertices))) is made


@settings(max_examples=60, deadline=None)
@given(
    count=st.integers(4, 60),
    seed=st.integers(0, 2**32 - 1),
    stretch=st.tuples(*(st.floats(0.01, 10.0) for _ in range(3))),
    place=st.tuples(*(st.floats(-5.0, 5.0) for _ in range(3))),
    snap=st.sampled_from([0.0, 0.25]),
)
def test_random_hulls_agree_with_another_reader(count, seed, stretch, place, snap):
    """Points on a lattice (``snap``) give faces of many corners, edges with points on them, and repeated points."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    if snap:
        points = np.round(points / snap) * snap
    points = points * stretch + place
    try:
        chosen = corners(points)
    except FlatError:
        assert np.linalg.matrix_rank(points - points[0], tol=1e-9) < 3
        return
    frame, vertices = centred(points[chosen])
    size = mesh_size(vertices)
    row = SHAPES["mesh"]
    other = trimesh.Trimesh(vertices, mesh_triangles(size), process=False)
    assert other.is_volume
    extent = float(np.abs(vertices).max())
    assert row.volume(size) == pytest.approx(other.volume, rel=1e-12)
    assert np.abs(other.center_mass).max() <= 1e-12 * extent
    tensor = other.moment_inertia * 2.0 / other.volume
    np.testing.assert_allclose(np.diag(row.moments(size, 2.0)), tensor, atol=1e-12 * np.abs(tensor).max())
    n = directions()
    axes = np.array(frames.matrix(frame.quaternion))
    reach = row.support(size, n @ axes) + n @ np.array(frame.position)
    assert np.abs(reach - (points @ n.T).max(axis=0)).max() <= 1e-13 * (extent + np.abs(points).max())
    assert row.inner_radius(size) <= reach.max() + 1e-12
    assert row.inner_radius(size) > 0.0


@settings(max_examples=100, deadline=None)
@given(
    moments=st.tuples(*(st.floats(1e-6, 1e3) for _ in range(3))),
    turn=st.tuples(*(st.floats(-1.0, 1.0) for _ in range(4))).filter(lambda q: math.hypot(*q) > 0.1),
)
def test_principal_axes_give_the_tensor_back(moments, turn):
    inertia = frames.rotate_inertia(frames.normalise(turn), (*moments, 0.0, 0.0, 0.0))
    xx, yy, zz, xy, xz, yz = inertia
    local, axes = principal([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    again = frames.rotate_inertia(frames.from_matrix(axes), (*local, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(again, inertia, atol=1e-13 * max(moments))
    assert np.linalg.det(np.array(axes)) == pytest.approx(1.0, rel=1e-12)
