"""Armature of a ball joint: the same inertia about every axis, added to M."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dynamics.oracle import Oracle
from simspec.errors import UnsupportedError
from simspec.testing import worlds
from simspec.world.kinematics import initial_state
from simspec.world.types import World

ARMATURE = 0.07


def with_armature(armature: float) -> World:
    """A ball on a hinge, and a hinge without armature on it."""
    base, ball, hinge = worlds.tree(["hinge", "ball", "hinge"], 6)
    ball = dataclasses.replace(ball, joint=dataclasses.replace(ball.joint, armature=armature))
    return worlds.world((base, ball, hinge), "ball")


def test_it_is_in_the_mass_matrix_and_in_the_acceleration():
    bare, armed = (with_armature(armature) for armature in (0.0, ARMATURE))
    q, v = initial_state(bare)
    v = v + np.linspace(0.3, -0.4, len(v))
    without, having = Oracle(bare), Oracle(armed)
    mass = having.mass_matrix(q)
    np.testing.assert_allclose(mass - without.mass_matrix(q), ARMATURE * np.diag([0, 1, 1, 1, 0]), atol=1e-14)
    effort = np.zeros(len(v))
    expected = np.linalg.solve(mass, -without.bias_force(q, v))
    np.testing.assert_allclose(having.acceleration(q, v, effort), expected, rtol=1e-10)


@pytest.mark.parametrize("engine", ["pybullet", "ode", "drake"])
def test_engines_without_it_refuse_it_by_name(engine):
    with pytest.raises(UnsupportedError, match=r"does not support joint\.ball\.armature"):
        compile_world(with_armature(ARMATURE), [engine])
