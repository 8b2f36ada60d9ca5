"""Differences that were planted are named, and with nothing planted nothing is; docs/explain.md has more of them."""

from __future__ import annotations

import dataclasses

import pytest

import simspec
from simspec.attribution.judge import SMALLEST_SHARE
from simspec.attribution.verdict import verdict
from tests.attribution.planted import CASES, FALL, world

QUICK = ("gravity", "restitution", "timestep", "erp", "impratio", "gain", "initial-state")


@pytest.mark.parametrize("name", QUICK)
def test_the_culprit_is_named_in_the_classes_in_which_it_acts(name):
    case = CASES[name]
    explanation = case.explain()
    first = max(explanation.causes, key=lambda swap: swap.largest)
    assert first.name == case.culprit
    for kind in explanation.telling:
        if kind in case.classes:
            assert first.share[kind] > 0.95
    assert set(case.classes) <= set(explanation.telling)
    assert verdict(explanation)[0].lower().startswith(case.culprit.lower())
    assert all(abs(share) < SMALLEST_SHARE for share in explanation.unexplained.values())


def test_another_engine_away_from_its_default_is_named_and_the_rest_is_asked_about():
    explanation = CASES["dart-erp-of-another"].explain()
    (cause,) = explanation.causes
    assert (cause.name, cause.values) == ("PyBullet's contact_erp", ("0.01", "0.2"))
    assert cause.share["contact"] > 0.2
    assert explanation.contact is not None
    assert explanation.contact.bodies == ("floor", "slider")
    without = next(swap for swap in explanation.probes if swap.name == "no contact")
    assert without.share["all"] > 0.99
    assert "free" not in explanation.telling
    assert explanation.unexplained["contact"] < 0.3


def test_nothing_is_explained_where_nothing_differs():
    explanation = CASES["nothing"].explain()
    assert not explanation.causes
    assert not explanation.telling
    assert "Nothing differs" in verdict(explanation)[0]


def test_what_differs_and_does_not_act_is_told_as_such():
    world_a, world_b = world(FALL), world(FALL, "engines.pybullet.settings.contact_erp=0.2")
    sides = [simspec.Configuration(each, "pybullet") for each in (world_a, world_b)]
    explanation = simspec.explain(sides[0], sides[1])
    assert [swap.name for swap in explanation.causes] == ["PyBullet's contact_erp"]
    assert not explanation.causes[0].share
    assert "without effect" in verdict(explanation)[1]


def test_two_causes_that_hide_each_other_are_both_named():
    world_b = world(FALL, "physics.gravity=[0,0,-9.7]", "bodies.box.velocity.linear=[2,0,0]")
    explanation = simspec.explain(
        simspec.Configuration(world(FALL), "mujoco"), simspec.Configuration(world_b, "mujoco")
    )
    assert set(explanation.caused.names) == {"gravity", "initial state of box"}
    assert all(share > 0.999 for share in explanation.caused.share.values())


def test_bodies_in_another_order_are_the_same_bodies():
    here = world()
    moving = [body for body in here.bodies if body.name in ("ball", "slider")]
    turned = iter(reversed(moving))
    bodies = tuple(next(turned) if body in moving else body for body in here.bodies)
    other = dataclasses.replace(here, bodies=bodies)
    explanation = simspec.explain(simspec.Configuration(here, "mujoco"), simspec.Configuration(other, "mujoco"))
    assert max(explanation.gap.values()) < 1e-3
    assert not explanation.causes
