"""The pairs of bodies that a filter excludes."""

from __future__ import annotations

from simspec.world.contact_pairs import excluded_pairs
from tests import worlds


def test_excluded_pairs_hold_rigid_groups_and_leave_out_the_shapeless():
    assert excluded_pairs(worlds.gripper()) == (("bar", "palm"), ("left", "palm"), ("palm", "right"))
    assert excluded_pairs(worlds.every_joint()) == ()
