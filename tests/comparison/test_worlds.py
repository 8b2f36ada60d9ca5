"""What changed between worlds: matched by name, reported where it is, nothing for equal ones."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.comparison.worlds import diff_worlds
from simspec.world.types import Contact, Expectation, PairContact, Physics
from tests import worlds

EVERY = (worlds.every_joint, worlds.damped_springs, worlds.shapes_world, worlds.gripper, worlds.spheres)


@pytest.mark.parametrize("make", EVERY)
def test_a_world_has_not_changed_from_itself(make):
    assert diff_worlds(make(), make()) == []


def changed(a, b):
    return {one.path: (one.kind, one.before, one.after) for one in diff_worlds(a, b)}


def test_a_number_in_a_body():
    one = worlds.spheres(2)
    ball = one.bodies[1]
    heavier = dataclasses.replace(ball, inertial=dataclasses.replace(ball.inertial, mass=11.0))
    other = dataclasses.replace(one, bodies=(one.bodies[0], heavier, one.bodies[2]))
    assert changed(one, other) == {"bodies.ball_0.inertial.mass": ("changed", 10.0, 11.0)}


def test_bodies_are_matched_by_name_not_by_place():
    one = worlds.spheres(3)
    other = dataclasses.replace(one, bodies=(one.bodies[0], *reversed(one.bodies[1:])))
    assert diff_worlds(one, other) == []


def test_added_and_removed_bodies_are_one_change_each():
    few, many = worlds.spheres(2), worlds.spheres(3)
    (added,) = diff_worlds(few, many)
    assert (added.path, added.kind, str(added)) == ("bodies.ball_2", "added", "+ bodies.ball_2")
    (removed,) = diff_worlds(many, few)
    assert (removed.path, removed.kind) == ("bodies.ball_2", "removed")


def test_everything_else_that_a_world_says():
    one = dataclasses.replace(worlds.gripper(), engines=(worlds.BULLET,))
    other = dataclasses.replace(
        one,
        physics=Physics((0.0, 0.0, -1.62), 0.001, 2000),
        contact=dataclasses.replace(
            one.contact, pairs=(PairContact("default", "default", 0.5, 0.0),), excluded_bodies=(("bar", "palm"),)
        ),
        expectations=(Expectation("comes_to_rest", (("speed", 0.1),)), Expectation("comes_to_rest", (("speed", 0.2),))),
    )
    other = worlds.with_options(other, "mujoco", settings=(("iterations", 7),))
    found = changed(one, other)
    assert found["physics.gravity"] == ("changed", [0.0, 0.0, -9.81], [0.0, 0.0, -1.62])
    assert found["contact.pairs.default+default.friction"] == ("changed", 0.4, 0.5)
    assert found["contact.excluded_bodies.left+palm"][0] == "removed"
    assert {"expectations.comes_to_rest", "expectations.comes_to_rest#2", "engines.mujoco"} < set(found)


def test_shapes_by_name():
    one = worlds.shapes_world()
    ball = one.bodies[1]
    bigger = dataclasses.replace(ball, shapes=(dataclasses.replace(ball.shapes[0], size=(0.06,)),))
    other = dataclasses.replace(one, bodies=(one.bodies[0], bigger, *one.bodies[2:]))
    assert changed(one, other) == {"bodies.sphere.shapes.sphere_0.size": ("changed", [0.05], [0.06])}


def test_an_empty_contact_law():
    one = worlds.spheres(2)
    found = changed(one, dataclasses.replace(one, contact=Contact()))
    assert found["contact.materials.slick"][0] == "removed"
