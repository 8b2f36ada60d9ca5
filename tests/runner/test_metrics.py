"""Metrics against closed forms, and against an engine's own energy where it says one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.runner import metrics
from simspec.world import frames
from simspec.world.rotations import logarithm
from simspec.world.types import Inertial, Joint, Pose
from tests.runner.synthetic import column, free_body, run, world


def falling(name: str, t: np.ndarray) -> np.ndarray:
    return column(0 * t, 0 * t, 5.0 - 5.0 * t**2)


def fall_speed(name: str, t: np.ndarray) -> np.ndarray:
    return column(0 * t, 0 * t, -10.0 * t)


def test_a_falling_body_trades_potential_for_kinetic_energy():
    entry = run(world(free_body("ball")), falling, fall_speed)
    kinetic, potential = metrics.energy(entry.world, entry.arrays)
    assert kinetic[-1] == pytest.approx(0.5 * 2.0 * 100.0)
    assert potential[0] == pytest.approx(2.0 * 10.0 * 5.0)
    assert np.ptp(kinetic + potential) < 1e-12


def test_rotation_uses_the_tensor_in_world_axes():
    # a body turned by 90° about x: its own z axis lies along −y of the world
    body = free_body("top", inertia=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
    turn = frames.from_axis_angle((1.0, 0.0, 0.0), math.pi / 2)
    spin = np.array([0.0, 4.0, 0.0])
    entry = run(world(body), lambda n, t: column(0 * t, 0, 0, *turn), lambda n, t: column(0 * t, 0, 0, *spin))
    kinetic, _ = metrics.energy(entry.world, entry.arrays)
    assert kinetic[0] == pytest.approx(0.5 * 3.0 * 16.0)
    linear, angular = metrics.momentum(entry.world, entry.arrays)
    assert np.allclose(linear, 0.0)
    assert np.allclose(angular, [0.0, 12.0, 0.0])


def test_products_of_inertia_keep_their_sign():
    body = free_body("odd", inertia=(1.0, 1.0, 1.0, 0.5, 0.0, 0.0))
    entry = run(world(body), None, lambda n, t: column(0 * t, 0, 0, 1.0, 1.0, 0.0))
    assert metrics.energy(entry.world, entry.arrays)[0][0] == pytest.approx(0.5 * (1 + 1 + 2 * 0.5))


def test_the_centre_of_mass_moves_with_the_lever():
    # the origin stands still, the centre of mass circles about it: v = ω × c
    body = free_body("hammer", mass=3.0, centre=(2.0, 0.0, 0.0), inertia=SMALL)
    entry = run(world(body), lambda n, t: column(0 * t, 1.0, 0), lambda n, t: column(0 * t, 0, 0, 0, 0, 5.0))
    linear, angular = metrics.momentum(entry.world, entry.arrays)
    assert np.allclose(linear[0], [0.0, 3.0 * 10.0, 0.0])
    # c × m v about the world's origin, c = (2, 1, 0), and the spin of the body itself
    assert np.allclose(angular[0], [0.0, 0.0, 2.0 * 30.0 + 0.1 * 5.0])
    assert metrics.speeds(entry.world, entry.arrays)[0, 0] == pytest.approx(10.0)


SMALL = (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)


def test_springs_and_armature():
    hinge = Joint(
        "j", "hinge", axis=(0.0, 0.0, 1.0), armature=0.5, spring_stiffness=8.0, spring_rest=0.25, position=(0.0,),
        velocity=(0.0,),
    )  # fmt: skip
    body = dataclasses.replace(free_body("arm"), joint=hinge)
    entry = run(world(body, gravity=0.0))
    entry.arrays["q"][:] = 1.25
    entry.arrays["v"][:] = 2.0
    kinetic, potential = metrics.energy(entry.world, entry.arrays)
    assert kinetic[0] == pytest.approx(0.5 * 0.5 * 4.0)
    assert potential[0] == pytest.approx(0.5 * 8.0 * 1.0)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0])
def test_a_ball_spring_stores_the_square_of_its_angle(angle):
    ball = Joint("j", "ball", spring_stiffness=8.0, position=(1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 3)
    entry = run(world(dataclasses.replace(free_body("bob"), joint=ball), gravity=0.0))
    axis = (0.6, 0.0, 0.8)
    # the same turn written with the other sign of the quaternion stores the same energy
    entry.arrays["q"][:] = -np.array(frames.from_axis_angle(axis, angle))
    assert metrics.energy(entry.world, entry.arrays)[1][0] == pytest.approx(4.0 * angle**2, rel=1e-12)


def test_scales_do_not_depend_on_where_the_origin_is():
    high = run(world(free_body("ball")), lambda n, t: falling(n, t) + np.array([0, 0, 1e3]), fall_speed)
    low = run(world(free_body("ball")), falling, fall_speed)
    scales = [metrics.energy_scale(*metrics.energy(entry.world, entry.arrays)) for entry in (high, low)]
    assert scales[0] == pytest.approx(scales[1])
    assert scales[0] == pytest.approx(100.0)


def test_contacts():
    contacts = [(1, 0, 1, -0.002, 3.0), (1, 1, 0, 0.001, 0.0), (4, 0, 1, -0.005, 7.0)]
    entry = run(world(free_body("a"), free_body("b")), contacts=contacts)
    deepest = metrics.deepest_penetration(entry.world, entry.arrays)
    assert (deepest.depth, deepest.bodies) == (0.005, ("a", "b"))
    assert deepest.time == pytest.approx(0.4)
    assert metrics.contact_counts(entry.arrays).tolist() == [0, 2, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    assert metrics.contact_force(entry.arrays)[[1, 4]].tolist() == [3.0, 7.0]


def test_a_gap_is_no_penetration():
    entry = run(world(free_body("a"), free_body("b")), contacts=[(1, 0, 1, 0.002, 0.0)])
    assert metrics.deepest_penetration(entry.world, entry.arrays) == metrics.Penetration(0.0, 0.0, None)


def test_the_spread_omits_fixed_bodies():
    far = dataclasses.replace(free_body("wall"), joint=Joint("w", "fixed", origin=Pose((100.0, 0.0, 0.0))))
    places = {"wall": 100.0, "a": 0.0, "b": 2.0}
    entry = run(world(far, free_body("a"), free_body("b")), lambda n, t: column(0 * t + places[n], 0, 0))
    assert metrics.spread(entry.world, entry.arrays)[0] == pytest.approx(1.0)


def test_spread_of_a_world_without_moving_bodies_is_zero():
    wall = dataclasses.replace(free_body("wall"), joint=Joint("w", "fixed"), inertial=Inertial(0.0))
    entry = run(world(wall))
    assert not metrics.spread(entry.world, entry.arrays).any()


def test_rotation_vectors_keep_small_angles():
    for angle in (1e-12, 1e-6, 1.0, math.pi - 1e-9):
        turn = np.array(frames.from_axis_angle((0.0, 0.6, 0.8), angle))
        assert np.allclose(logarithm(turn), angle * np.array([0.0, 0.6, 0.8]), rtol=1e-9, atol=0)
