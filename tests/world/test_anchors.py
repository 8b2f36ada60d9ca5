"""Where welds are held: the point at which the rows of a weld act least on each other."""

from __future__ import annotations

import dataclasses
from importlib.util import find_spec

import numpy as np
import pytest

import simspec
from simspec.dynamics.oracle import Oracle
from simspec.proof.verify import verify
from simspec.world import frames
from simspec.world.actions import Force
from simspec.world.constraints import Violation, anchors, least_moved, mass_matrix
from simspec.world.kinematics import initial_state, poses
from simspec.world.types import Pose
from tests.random_specs import spec

pytestmark = pytest.mark.usefixtures("warm_engines")

FAR = [0.9, -2.1, 1.7]
"""The initial place of a body with a weld given in the frame of the body that is fixed at the origin."""


def far_world(second="ground"):
    bodies = {
        "ground": {"fixed": True},
        "stone": {
            "mass": 2,
            "inertia": {"principal": [0.02, 0.03, 0.04]},
            "centre_of_mass": [0.05, -0.02, 0.03],
            "pose": {"xyz": FAR, "rpy": [0.3, -0.5, 1.1]},
        },
        "other": {"mass": 1, "inertia": {"principal": [0.01, 0.01, 0.01]}, "pose": {"xyz": [0, 4, 0]}},
    }
    data = {
        "simspec": 1,
        "name": "far",
        "bodies": bodies,
        "constraints": {"glue": {"weld": {"bodies": ["stone", second]}}},
    }
    return simspec.Spec.from_data(data).resolve()


def mobility(world):
    """A (6, 6) of the world's weld, as written."""
    oracle, (q, _) = Oracle(world), initial_state(world)
    jacobian = Violation(world.bodies, world.constraints).jacobian(oracle.body_poses(q))
    return jacobian @ np.linalg.solve(oracle.mass_matrix(q), jacobian.T)


def left_by_a_sweep(matrix):
    """The share of an error that a sweep through the rows leaves, after many: Gauss and Seidel's."""
    lower = np.tril(matrix)
    return max(abs(np.linalg.eigvals(np.linalg.solve(lower, matrix - lower))))


def moved(matrix, away):
    """A of the same weld, held at ``away`` from where it is."""
    x, y, z = away
    shift = np.eye(6)
    shift[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return shift @ matrix @ shift.T


def test_the_anchor_of_a_free_body_is_its_centre_of_mass():
    world = far_world()
    stone = next(body for body in world.bodies if body.name == "stone")
    centre = frames.compose(poses(world)["stone"], Pose(stone.inertial.centre_of_mass)).position
    np.testing.assert_allclose(anchors(world)["glue"], centre, rtol=1e-12)
    given = mobility(world)
    there = moved(given, centre)
    assert np.abs(there[:3, 3:]).max() < 1e-13 * np.abs(given).max()
    assert left_by_a_sweep(given) > 0.99, "thousands of sweeps"
    assert left_by_a_sweep(there) < 0.2, "a dozen"


def test_the_anchor_of_two_free_bodies_is_between_them():
    """At a point where forces move them less than at any other near it."""
    world = far_world("other")
    given = mobility(world)
    best = least_moved(given)
    least = np.trace(moved(given, best)[:3, :3])
    for step in np.concatenate([np.eye(3), -np.eye(3)]) * 0.1:
        assert np.trace(moved(given, best + step)[:3, :3]) > least
    assert anchors(world) == {}, "a rotating body has its anchor by the law"


def test_bodies_that_cannot_rotate_are_anchored_at_the_given_point():
    """On a slide T is zero; on a hinge the point is the nearest on its axis."""
    joint = {"origin": {"xyz": [0.4, 0.3, 1]}, "axis": [0, 0, 1]}
    for kind, wanted in (("slide", (0, 0, 0)), ("hinge", (0.4, 0.3, 0))):
        block = {"mass": 1, "inertia": {"principal": [1, 1, 1]}, "joint": {"type": kind, **joint}}
        data = {
            "simspec": 1,
            "name": "on-a-joint",
            "bodies": {"ground": {"fixed": True}, "block": block},
            "constraints": {"glue": {"weld": {"bodies": ["block", "ground"]}}},
        }
        np.testing.assert_allclose(anchors(simspec.Spec.from_data(data).resolve())["glue"], wanted, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_mass_matrix_is_the_oracles(seed):
    world = simspec.Spec.from_data(spec(seed)).resolve()
    places = poses(world)
    at = np.array([(*places[body.name].position, *places[body.name].quaternion) for body in world.bodies])
    expected = Oracle(world).mass_matrix(initial_state(world)[0])
    np.testing.assert_allclose(
        mass_matrix(world.bodies, at), expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max(initial=1)
    )


@pytest.mark.skipif(find_spec("pybullet") is None, reason="PyBullet has no wheel for this Python")
def test_a_weld_far_from_the_body_is_as_stiff_as_a_weld_inside_it():
    """Held at the ground's origin, PyBullet's 2,000 sweeps left 1e-6 of the same weld, MuJoCo's softness 1e-9 and more."""
    world = far_world()
    pushed = dataclasses.replace(world, forces=(Force("stone", (3.0, -2.0, 1.0), (0.1, 0.2, -0.3)),))
    found = verify(pushed, ["mujoco", "pybullet"], levels={"L0", "L2", "L7"})
    assert [str(check) for _, check in found.failures()] == []
