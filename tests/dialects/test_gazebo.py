"""A world is lowered to Gazebo and raised again: nothing of the model is lost, and copies of shapes are in its layers."""

from __future__ import annotations

import pytest

from simspec.compiler import target_of
from simspec.dialects.gazebo import GazeboDialect
from simspec.engines.gazebo.engine import Gazebo
from simspec.proof.comparator import compare
from simspec.testing.worlds import accepting
from tests import worlds
from tests.planted import SHARED

NOT_STORED = ("rolling", "meshes", "ground")


@pytest.mark.parametrize(
    "world", [*(made for name, made in SHARED.items() if name not in NOT_STORED), lambda _: worlds.every_joint()]
)
def test_lower_and_raise_are_inverse(world):
    world = accepting(world("gazebo"), "gazebo")
    dialect = GazeboDialect()
    output = dialect.lower(world, target_of(world, Gazebo))
    checks = compare(world, dialect.raise_(output.tree, output.sidecar), Gazebo.RULES, Gazebo.LAYERS, text=True)
    assert len(checks) > 5
    assert [(check.name, check.where, check.detail) for check in checks if not check.passed] == []
