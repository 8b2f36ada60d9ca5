"""Constraints outside the tree: in the world's text where there are some, and what they need."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world.canonical import canonical_json, from_plain, sha256, to_plain
from simspec.world.kinematics import initial_state
from simspec.world.types import ConnectConstraint, FollowConstraint, Pose, WeldConstraint, World
from tests import constrained

EVERY = (
    ConnectConstraint("rocker", "a", "b", (0.2, 0.0, 0.0), (0.0, 0.0, 0.1)),
    FollowConstraint("mirror", "finger_2", "finger_1", -1.0, 0.1),
    WeldConstraint("latch", "a", "b", Pose((0.0, 0.0, 0.1), (0.6, 0.8, 0.0, 0.0))),
)


def test_a_world_without_constraints_has_the_text_it_always_had():
    world = constrained.hinges()
    assert "constraints" not in json.loads(canonical_json(world))
    assert from_plain(World, to_plain(world)) == world


@pytest.mark.parametrize("constraints", [EVERY, EVERY[:1], EVERY[1:]])
def test_constraints_are_in_the_text_and_read_again(constraints):
    plain = constrained.hinges()
    world = dataclasses.replace(plain, constraints=constraints)
    assert sha256(world) != sha256(plain)
    again = from_plain(World, json.loads(canonical_json(world)))
    assert again == world
    assert [type(constraint) for constraint in again.constraints] == [type(constraint) for constraint in constraints]


@pytest.mark.parametrize(
    "change",
    [
        lambda constraint: constraint.update(kind="rope"),
        lambda constraint: constraint.pop("kind"),
        lambda constraint: constraint.update(kind="weld"),
        lambda constraint: constraint.pop("ratio"),
        lambda constraint: constraint.update(stiffness=1.0),
        lambda constraint: constraint.update(ratio="1"),
    ],
)
def test_damaged_constraints_are_found(change):
    content = to_plain(constrained.follower())
    change(content["constraints"][0])
    with pytest.raises((KeyError, TypeError)):
        from_plain(World, content)


def test_needs_name_the_constraint():
    world = dataclasses.replace(constrained.hinges(), constraints=EVERY)
    places = {need.feature: need.paths for need in needs(world)}
    assert places[Feature.CONSTRAINT_LOOP] == ("constraints.rocker", "constraints.latch")
    assert places[Feature.CONSTRAINT_COUPLING] == ("constraints.mirror",)


@pytest.mark.parametrize("world", [constrained.follower, constrained.closed_loop])
def test_worlds_of_tests_begin_where_their_constraint_holds(world):
    world = world()
    q, _ = initial_state(world)
    assert constrained.violation(world, q) < 1e-12
    q[-1] += 0.1
    q[1] += 0.2
    assert constrained.violation(world, q) > 1e-2
