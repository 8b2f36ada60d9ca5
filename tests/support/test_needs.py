"""What a world needs, with the places that need it."""

from __future__ import annotations

from simspec.support.features import Feature
from simspec.support.needs import needs
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
