"""A world is lowered to Rapier and raised again. Tests of tables of laws cover the shared parts."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import target_of
from simspec.dialects.rapier import RapierDialect
from simspec.engines.rapier.engine import Rapier
from simspec.proof.comparator import compare
from simspec.proof.selftest_worlds import WORLDS
from tests.planted import SHARED


def lowered(world):
    return RapierDialect().lower(world, target_of(world, Rapier))


def failures(world, model):
    checks = compare(world, model, Rapier.RULES, Rapier.LAYERS, text=True)
    assert len(checks) > 5
    return [(check.name, check.where, check.detail) for check in checks if not check.passed]


@pytest.mark.parametrize("world", SHARED.values())
def test_lower_and_raise_are_inverse(world):
    world = world("rapier")
    output = lowered(world)
    assert failures(world, RapierDialect().raise_(output.tree, output.sidecar)) == []


def test_a_table_that_differs_is_seen():
    world = WORLDS["surfaces"]("rapier")
    output = lowered(world)
    model = RapierDialect().raise_(output.tree, output.sidecar)
    rougher = dataclasses.replace(model.laws[0], friction=model.laws[0].friction + 1e-9)
    wrong = dataclasses.replace(model, laws=(rougher, *model.laws[1:]))
    assert {found for found, _, _ in failures(world, wrong)} == {"friction"}
