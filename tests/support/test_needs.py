"""The features that a world needs, with the places that need them."""

from __future__ import annotations

import pytest

import simspec
from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from tests import worlds


def test_needs_name_the_places():
    found = {need.feature: need.paths for need in needs(worlds.gripper())}
    assert found[Feature.COLLISION_GROUPS] == ("contact.groups",)
    assert found[Feature.EXCLUDED_PAIRS] == ("contact.exclude",)
    assert Feature.DAMPING not in found
    assert found[Feature.JOINT_SLIDE] == ("bodies.palm.joint", "bodies.left.joint", "bodies.right.joint")


def test_long_chains_and_large_trees_are_features():
    world = worlds.world(worlds.tree(["fixed"] + ["hinge"] * 401, 1))
    found = {need.feature: need.paths for need in needs(world)}
    assert found[Feature.TREE_SIZE] == ("bodies.link0",)
    assert found[Feature.TREE_DEPTH] == ("bodies.link400",)


def _felt(*balls: str, **more: object):
    """Balls whose material has torsional friction."""
    solid = {"shapes": [{"sphere": {"radius": 0.1}, "material": "felt"}], "mass": 1}
    inertia = {"inertia": {"principal": [0.01, 0.01, 0.01]}}
    bodies = {name: {**solid, **inertia, "pose": {"xyz": [index, 0, 1]}} for index, name in enumerate(balls)}
    felt = {"friction": 0.5, "torsional_friction": 0.005}
    physics = {"timestep": 0.001, "duration": 0.1}
    contact = {"friction_cone": "elliptic", "materials": {"felt": felt}, **more}
    return simspec.Spec.from_data(
        {"simspec": 1, "name": "felt", "physics": physics, "contact": contact, "bodies": bodies}
    ).resolve()


def test_a_law_is_needed_where_its_materials_can_meet():
    """A robot by itself needs nothing of the law of its feet with a floor; a file for other worlds keeps it."""
    lone, two = _felt("one"), _felt("one", "two")
    felt = _felt("one", "two", exclude=[["one", "two"]])
    law = {Feature.FRICTION, Feature.TORSIONAL_FRICTION}
    assert law <= {need.feature for need in needs(two)}
    for world in (lone, felt):
        assert not law & {need.feature for need in needs(world)}
        assert law <= {need.feature for need in needs(world, world.contact.pairs)}
        compile_world(world, ["dart"])
    with pytest.raises(UnsupportedError, match="torsional"):
        compile_world(two, ["dart"])
