"""Coordinates, poses, trees, rigid groups and the collision filter."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.world import kinematics
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Body, Contact, Inertial, Joint, Pose, Shape
from tests import worlds


def test_layout_counts_coordinates_in_the_order_of_the_bodies():
    found = kinematics.layout(worlds.every_joint().bodies)
    assert (found.nq, found.nv) == (7 + 1 + 0 + 1 + 4 + 1, 6 + 1 + 0 + 1 + 3 + 1)
    assert found.position[4] == slice(9, 13)
    assert found.velocity[4] == slice(8, 11)


def test_a_free_root_is_placed_by_its_centre_of_mass():
    quarter = math.sqrt(0.5)
    joint = Joint(
        "j", "free", position=(1.0, 2.0, 3.0, quarter, 0.0, 0.0, quarter), velocity=(0.0, 0.0, 0.0, 0.0, 0.0, 2.0)
    )
    body = Body("b", "b", Inertial(1.0, (0.5, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)), joint)
    q, v = kinematics.initial_state(worlds.world((body,)))
    # x of the body points along y of the world; spinning about z moves the centre of mass along −x
    np.testing.assert_allclose(q[:3], (1.0, 2.5, 3.0), atol=1e-15)
    np.testing.assert_allclose(v, (-1.0, 0.0, 0.0, 0.0, 0.0, 2.0), atol=1e-15)


def test_poses_of_a_planar_chain():
    z = (0.0, 0.0, 1.0)
    arm = Pose((1.0, 0.0, 0.0))
    bodies = (
        Body("a", "a", Inertial(1.0), Joint("a", "hinge", axis=z, position=(math.pi / 2,))),
        Body("b", "a", Inertial(1.0), Joint("b", "hinge", "a", arm, axis=z, position=(math.pi / 2,))),
        Body("c", "a", Inertial(1.0), Joint("c", "slide", "b", arm, axis=z, position=(0.5,))),
    )
    found = kinematics.poses(worlds.world(bodies))
    np.testing.assert_allclose(found["b"].position, (0.0, 1.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(found["c"].position, (-1.0, 1.0, 0.5), atol=1e-15)
    at_zero = kinematics.poses(worlds.world(bodies), at_zero=True)
    np.testing.assert_allclose(at_zero["c"].position, (2.0, 0.0, 0.0), atol=1e-15)


def test_rigid_groups_end_at_the_first_joint_that_moves():
    bodies = worlds.tree(["fixed", "fixed", "hinge", "fixed", "fixed"], 1)
    assert list(kinematics.rigid_groups(worlds.world(bodies)).values()) == ["world", "world", "link2", "link2", "link2"]


def test_trees_are_found_by_their_roots():
    bodies = worlds.tree(["free", "hinge"], 1) + worlds.tree(["fixed", "ball"], 2, prefix="other_")
    found = kinematics.trees(worlds.world(bodies))
    assert {root: [body.name for body in tree] for root, tree in found.items()} == {
        "link0": ["link0", "link1"],
        "other_link0": ["other_link0", "other_link1"],
    }


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("left", "right", False),  # their group ignores itself
        ("left", "palm", False),  # joined by a joint
        ("bar", "palm", False),  # excluded by name
        ("bar", "left", True),
        ("bar", "right", True),
        ("bar", "bar", False),
    ],
)
def test_the_collision_filter(first, second, expected):
    touching = CollisionFilter(worlds.gripper())
    assert touching.may_touch(first, second) is expected
    assert touching.may_touch(second, first) is expected


def test_bodies_without_shapes_and_rigidly_joined_bodies_never_touch():
    shape = (Shape("s", "sphere", (0.1,)),)
    bodies = tuple(
        dataclasses.replace(body, shapes=() if body.name == "link3" else shape)
        for body in worlds.tree(["free", "fixed", "fixed", "hinge"], 1)
    )
    touching = CollisionFilter(worlds.world(bodies, contact=Contact()))
    assert not touching.may_touch("link0", "link2")
    assert not touching.may_touch("link0", "link3")
