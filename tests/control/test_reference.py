"""Trajectories as polynomials: the promises of each interpolation, and derivatives that are derivatives."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.control.reference import driven_joints, efforts, fed_forward, positions, reference
from simspec.world.actions import JointController, JointTrajectory
from tests import worlds

TIMES = (0.5, 1.0, 2.0, 2.25)
ROWS = ((0.0, 1.0), (1.0, -1.0), (0.5, -2.0), (0.0, 0.0))


def made(interpolation: str, **more) -> JointTrajectory:
    return JointTrajectory(("a", "b"), TIMES, ROWS, interpolation=interpolation, **more)


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic", "quintic"])
def test_it_goes_through_its_points_and_is_at_rest_outside(interpolation):
    found = positions(made(interpolation))
    q, v, a = found.at(np.array([0.0, 0.5, 1.0, 2.0, 2.25, 9.0]), 2)
    np.testing.assert_allclose(q, np.array(ROWS)[[0, 0, 1, 2, 3, 3]], atol=1e-15)
    assert not v[[0, -1]].any()
    assert not a[[0, -1]].any()


@given(
    st.lists(st.floats(0.05, 1.0), min_size=2, max_size=8),
    st.sampled_from(["linear", "cubic", "quintic"]),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_velocity_and_acceleration_are_the_derivatives(gaps, interpolation, seed):
    times = tuple(np.cumsum(gaps).tolist())
    rows = np.random.default_rng(seed).uniform(-1, 1, (len(times), 2))
    found = positions(JointTrajectory(("a", "b"), times, tuple(map(tuple, rows)), interpolation=interpolation))
    step = 1e-6
    inside = np.array([t + 0.37 * (u - t) for t, u in itertools.pairwise(times)])
    q_before, v_before = found.at(inside - step, 1)
    q_after, v_after = found.at(inside + step, 1)
    _, v, a = found.at(inside, 2)
    scale = 1.0 + np.abs(v).max() + np.abs(a).max()
    np.testing.assert_allclose((q_after - q_before) / (2 * step), v, atol=1e-7 * scale)
    np.testing.assert_allclose((v_after - v_before) / (2 * step), a, atol=1e-6 * scale)


@pytest.mark.parametrize(("interpolation", "smooth"), [("linear", 0), ("cubic", 2), ("quintic", 3)])
def test_as_many_derivatives_are_continuous_as_promised(interpolation, smooth):
    found = positions(made(interpolation))
    knots = np.array(TIMES[1:-1])
    before, after = found.at(knots - 1e-9, 3), found.at(knots + 1e-9, 3)
    for order in range(smooth + 1):
        np.testing.assert_allclose(before[order], after[order], atol=1e-6 * (1 + np.abs(after[order]).max()))
    if smooth < 3:
        assert np.abs(before[smooth + 1] - after[smooth + 1]).max() > 1e-3


def test_splines_begin_and_end_at_rest():
    for interpolation, rest in (("cubic", 1), ("quintic", 2)):
        found = positions(made(interpolation))
        ends = found.at(np.array([TIMES[0] + 1e-12, TIMES[-1] - 1e-12]), rest)
        for order in range(1, rest + 1):
            np.testing.assert_allclose(ends[order], 0.0, atol=1e-8)


def test_two_points_of_a_quintic_are_the_minimum_jerk_motion():
    found = positions(JointTrajectory(("a",), (0.0, 2.0), ((0.0,), (3.0,)), interpolation="quintic"))
    u = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(found.at(2.0 * u)[0][:, 0], 3.0 * (10 * u**3 - 15 * u**4 + 6 * u**5), atol=1e-14)


def test_given_derivatives_are_kept():
    speeds = ((0.0, 0.0), (1.0, 2.0), (-1.0, 0.5), (0.0, 0.0))
    cubic = positions(made("cubic", velocities=speeds))
    np.testing.assert_allclose(cubic.at(np.array(TIMES[:-1]), 1)[1], np.array(speeds)[:-1], atol=1e-13)
    quintic = positions(made("quintic", velocities=speeds, accelerations=ROWS))
    _, v, a = quintic.at(np.array(TIMES[:-1]) + 1e-13, 2)
    np.testing.assert_allclose(v, np.array(speeds)[:-1], atol=1e-10)
    np.testing.assert_allclose(a, np.array(ROWS)[:-1], atol=1e-9)


def test_feed_forward_is_straight_between_points_and_zero_without():
    given = tuple((float(k), -float(k)) for k in range(4))
    found = efforts(made("cubic", efforts=given))
    np.testing.assert_allclose(found.at(np.array([0.75, 1.5, 9.0]))[0], [[0.5, -0.5], [1.5, -1.5], [3.0, -3.0]])
    assert not efforts(made("cubic")).at(np.array([1.0]))[0].any()
    piecewise = efforts(made("hold", efforts=given))
    np.testing.assert_allclose(piecewise.at(np.array([0.75, 1.5]))[0], [[0.0, 0.0], [1.0, -1.0]])


def test_driven_joints_without_a_column_stay_where_they_begin():
    world = worlds.world(worlds.tree(["hinge", "slide", "hinge"], 3))
    names = tuple(body.joint.name for body in world.bodies if body.joint.kind in ("hinge", "slide"))
    start = {body.joint.name: body.joint.position for body in world.bodies}
    zero = (0.0,) * len(names)
    world = dataclasses.replace(
        world,
        controllers=(JointController("all", names, kp=zero, kd=zero, effort_limits=(None,) * len(names)),),
        trajectory=JointTrajectory((names[1],), (0.0, 1.0), ((0.0,), (1.0,))),
    )
    assert driven_joints(world) == names
    found = reference(world)
    (q,) = found.position.at(np.array([0.0, 1.0]))
    assert q[:, 1].tolist() == [0.0, 1.0]
    assert q[:, 0].tolist() == [start[names[0]][0]] * 2
    assert q[:, 2].tolist() == [start[names[2]][0]] * 2


def test_only_natively_driven_joints_with_efforts_are_fed_forward():
    bodies = worlds.tree(["hinge", "hinge", "hinge"], 1)
    joints = tuple(body.joint.name for body in bodies)
    controllers = tuple(
        JointController(name, (joint,), law, kp=(1.0,), kd=(1.0,), effort_limits=(None,))
        for name, law, joint in zip(("first", "second", "law"), ("native", "native", "pd"), joints, strict=True)
    )
    efforts = ((0.1, 0.0, 0.1), (0.0, 0.0, 0.0))
    trajectory = JointTrajectory(joints, (0.0, 1.0), ((0.0,) * 3,) * 2, efforts=efforts)
    world = dataclasses.replace(worlds.world(bodies), controllers=controllers, trajectory=trajectory)
    assert list(fed_forward(world)) == [("first", joints[0])]
    assert list(fed_forward(dataclasses.replace(world, trajectory=None))) == []
