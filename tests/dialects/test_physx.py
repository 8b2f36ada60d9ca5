"""A world is lowered to PhysX and raised again. Tests of ``world.json`` cover the parts shared with other engines."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world, target_of
from simspec.dialects.physx import PhysxDialect, PhysxSidecar
from simspec.engines.physx.engine import PhysX
from simspec.errors import UnsupportedError
from simspec.proof.comparator import compare
from simspec.testing.worlds import ball_with_law, table
from tests.planted import SHARED


def lowered(world):
    return PhysxDialect().lower(world, target_of(world, PhysX))


@pytest.mark.parametrize("world", SHARED.values())
def test_lower_and_raise_are_inverse(world):
    world = world("physx")
    output = lowered(world)
    checks = compare(world, PhysxDialect().raise_(output.tree, output.sidecar), PhysX.RULES, PhysX.LAYERS, text=True)
    assert len(checks) > 5
    assert [(check.name, check.where, check.detail) for check in checks if not check.passed] == []


def test_a_single_restitution_threshold_is_written():
    world = ball_with_law(friction=0.3, restitution=0.5, restitution_threshold=0.25)
    assert lowered(world).sidecar.restitution_threshold == 0.25
    world = ball_with_law(friction=0.3, restitution=0.5)
    assert lowered(world).sidecar.restitution_threshold == pytest.approx(4 * 9.81 * world.physics.timestep)
    assert lowered(ball_with_law(friction=0.3)).sidecar.restitution_threshold == 0.0


def test_no_threshold_is_no_number():
    content = lowered(ball_with_law(friction=0.3)).sidecar.plain()
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="restitution_threshold"):
            PhysxSidecar.of({**content, "restitution_threshold": wrong})


def test_several_thresholds_are_refused_by_name():
    world = table({("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4})
    pairs = [dataclasses.replace(pair, restitution=0.5) for pair in world.contact.pairs]
    pairs[0] = dataclasses.replace(pairs[0], restitution_threshold=0.25)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=tuple(pairs)))
    with pytest.raises(
        UnsupportedError, match=r"one bounce threshold for each scene, and the pairs here have 0, 0\.25 m/s"
    ):
        compile_world(world, ["physx"])
