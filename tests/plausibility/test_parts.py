"""Geometry of parts against closed forms, and bounds of inertia that no mass within the shapes exceeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from simspec.plausibility.examine import largest_share
from simspec.plausibility.parts import axis_distance, box, extent, gap, lump_of, outside, pose_of
from simspec.world.frames import from_rpy
from simspec.world.types import Inertial, Pose, Shape

CUBE = lump_of("body", Shape("cube", "box", (2.0, 2.0, 2.0)))
BALL = lump_of("body", Shape("ball", "sphere", (1.0,)))


def at(lump, x: float, y: float = 0.0, z: float = 0.0):
    """The same shape elsewhere."""
    return lump.at(Pose((x, y, z)))


@pytest.mark.parametrize(
    ("point", "away"),
    [
        ((3.0, 0.0, 0.0), 2.0),
        ((2.0, 2.0, 0.0), math.sqrt(2.0)),
        ((2.0, 2.0, 2.0), math.sqrt(3.0)),
        ((0.4, 0.0, 0.0), -0.6),
    ],
)
def test_how_far_a_point_is_outside(point, away):
    assert outside([CUBE], np.array(point)) == pytest.approx(away, rel=2e-3)


@given(arrays(float, 3, elements=st.floats(-4.0, 4.0)))
@settings(max_examples=80, deadline=None)
def test_a_point_is_never_said_to_be_further_outside_than_it_is(point):
    true = float(np.linalg.norm(np.maximum(np.abs(point) - 1.0, 0.0)))
    assert outside([CUBE], point) <= true + 1e-12
    if true > 0.1:
        assert outside([CUBE], point) == pytest.approx(true, abs=0.01)


def test_axes_and_gaps():
    z = np.array([0.0, 0.0, 1.0])
    assert axis_distance([CUBE], np.array([3.0, 0.0, 7.0]), z) == pytest.approx(2.0)
    assert axis_distance([CUBE], np.array([0.5, 0.5, 7.0]), z) == 0.0
    assert axis_distance([CUBE, at(BALL, 5.0)], np.array([3.0, 0.0, 7.0]), z) == pytest.approx(1.0, rel=1e-3)
    assert gap([CUBE], [at(BALL, 4.0)]) == pytest.approx(2.0, rel=1e-3)
    assert gap([CUBE], [at(BALL, 1.5)]) == 0.0
    assert gap([CUBE, at(CUBE, 10.0)], [at(BALL, 14.0)]) == pytest.approx(2.0, rel=1e-3)
    assert extent([CUBE, at(CUBE, 2.0)]) == pytest.approx(math.sqrt(16.0 + 4.0 + 4.0), rel=0.02)
    low, high = box([CUBE, at(BALL, 3.0)])
    assert low.tolist() == [-1.0, -1.0, -1.0]
    assert high.tolist() == [4.0, 1.0, 1.0]


def test_the_pose_of_a_shape():
    pose = Pose((1.0, 2.0, 3.0), from_rpy(0.3, -0.2, 0.9))
    back = pose_of(lump_of("body", Shape("cube", "box", (1.0, 2.0, 3.0), pose)))
    assert back.position == pose.position
    assert back.quaternion == pytest.approx(pose.quaternion, abs=1e-12)


def test_meshes_of_many_vertices_are_made_smaller_by_little():
    index = np.arange(2000) + 0.5
    z = 1.0 - index / 1000.0
    turn = math.pi * (1.0 + math.sqrt(5.0)) * index
    points = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    lump = lump_of("body", Shape("ball", "mesh", tuple(points.ravel().tolist())))
    assert lump.points is not None
    assert len(lump.points) <= 128
    directions = points[::7]
    reaches = lump.local(directions)
    assert reaches.max() <= 1.0 + 1e-12
    assert reaches.min() > 1.0 - 1.0 / 40.0
    assert np.mean(reaches) > 1.0 - 1.0 / 100.0


MASSES = arrays(float, (5, 3), elements=st.floats(-1.0, 1.0))


@given(MASSES, arrays(float, 5, elements=st.floats(0.01, 10.0)))
@settings(max_examples=100, deadline=None)
def test_no_masses_within_the_shapes_exceed_the_bound(places, masses):
    """Points of mass anywhere in a cube: their inertia is always possible for the cube."""
    total = float(masses.sum())
    centre = (masses @ places) / total
    arms = places - centre
    tensor = np.einsum("n,nij->ij", masses, np.einsum("nk,nk->n", arms, arms)[:, None, None] * np.eye(3))
    tensor -= np.einsum("n,ni,nj->ij", masses, arms, arms)
    six = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
    share = largest_share(Inertial(total, tuple(centre.tolist()), tuple(map(float, six))), (CUBE,))
    assert share <= 1.0 + 1e-6


def test_the_bound_is_reached():
    # half of the mass on two opposite faces: the second moment is m a b with a = b = 1
    assert largest_share(Inertial(2.0, (0.0, 0.0, 0.0), (0.0, 2.0, 2.0, 0.0, 0.0, 0.0)), (CUBE,)) == pytest.approx(1.0)
    # a homogeneous cube has a third of it
    solid = Inertial(1.0, (0.0, 0.0, 0.0), (2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 0.0, 0.0, 0.0))
    assert largest_share(solid, (CUBE,)) == pytest.approx(1.0 / 3.0)
