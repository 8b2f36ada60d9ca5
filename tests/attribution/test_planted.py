"""Differences that were planted are named, and with nothing planted nothing is; docs/guide/explain.md has more of them."""

from __future__ import annotations

import dataclasses

import pytest

import simspec
from simspec.attribution import explanation as explaining
from simspec.attribution import measure as measuring
from simspec.attribution.configuration import Asking, Configuration, proof_of
from simspec.attribution.measure import SMALLEST_SHARE, acting
from simspec.attribution.sentences import verdict
from simspec.engines.kit.registry import find_engine
from tests.attribution.planted import CASES, FALL, STANDING, world

pytestmark = pytest.mark.usefixtures("warm_engines")

QUICK = ("gravity", "restitution", "timestep", "erp", "impratio", "gain", "initial-state", "drake-dissipation")
OF_ANOTHER = (
    "drake-stiction-of-another",
    "mass-in-drake",
    "gain-of-another",
    "pair-of-another",
    "impratio-of-another",
    "two-of-another",
)


@pytest.fixture(scope="module")
def asking(warm_processes):
    return Asking(warm_processes)


@pytest.mark.parametrize("name", QUICK)
def test_the_culprit_is_named_in_the_classes_in_which_it_acts(name, asking):
    case = CASES[name]
    explanation = case.explain(asking=asking)
    first = max(explanation.causes, key=lambda swap: swap.largest)
    assert first.name == case.culprit
    for kind in explanation.telling:
        if kind in case.classes:
            assert first.share[kind] > 0.95
    assert set(case.classes) <= set(explanation.telling)
    assert verdict(explanation)[0].lower().startswith(case.culprit.lower())
    assert all(abs(share) < SMALLEST_SHARE for share in explanation.unexplained.values())


@pytest.mark.parametrize("name", OF_ANOTHER)
def test_the_culprit_is_named_first_although_the_engines_differ_too(name, asking, monkeypatch):
    monkeypatch.setattr(explaining, "probes", lambda pair: [])
    case = CASES[name]
    explanation = case.explain(windows=40, asking=asking)
    first = acting(explanation.causes)[0]
    assert first.name == case.culprit
    assert set(case.classes) <= set(first.effect)
    assert verdict(explanation)[0].lower().startswith(case.culprit.lower())
    assert len(acting(explanation.causes)) == len(case.sets)
    for kind, (low, high) in first.interval.items():
        assert low <= 1.0 - first.gap[kind] / explanation.gap[kind] <= high


def test_windows_that_do_not_end_finite_are_left_out_and_counted(asking, monkeypatch):
    monkeypatch.setattr(explaining, "probes", lambda pair: [])
    poses_at_ends = measuring.poses_at_ends
    lost = []

    def some_not_finite(configuration, windows, answer):
        poses = poses_at_ends(configuration, windows, answer).copy()
        if configuration.engine == "pybullet" and not lost:
            lost.append(len(poses) - 3)
            poses[:3] = float("nan")
        return poses

    monkeypatch.setattr(measuring, "poses_at_ends", some_not_finite)
    explanation = CASES["gravity-of-another"].explain(windows=40, asking=asking)
    assert explanation.looked_at == lost[0]
    assert "3 windows are not looked at: a state at their end is not finite" in explanation.notes
    assert acting(explanation.causes)[0].name == "gravity"


def test_a_difference_that_acts_without_closing_anything_is_reported(asking, monkeypatch):
    monkeypatch.setattr(explaining, "probes", lambda pair: [])
    explanation = CASES["impratio-of-another"].explain(asking=asking)
    (cause,) = explanation.causes
    assert not cause.share
    assert 1e-4 < cause.effect["contact"] < 0.01
    assert "has an effect, but closes none of the difference" in verdict(explanation)[0]


def test_an_engine_begins_windows_with_the_contact_points_that_it_keeps(asking, monkeypatch):
    """The same question is put from the states of the other side, where much is unexplained."""
    monkeypatch.setattr(explaining, "MUCH", -1.0)
    sides = [Configuration(world(STANDING), engine) for engine in ("mujoco", "pybullet")]
    explanation = explaining.explain_sides(sides[0], sides[1], ("A", "B"), most=20, asking=asking)
    assert explanation.restart["A"]["contact"] < 1e-12
    assert explanation.restart["B"]["contact"] < 1e-9  # without these points 2.9e-6
    assert not any("does not repeat its own run" in line for line in verdict(explanation))
    exchanged = explanation.exchanged
    assert exchanged is not None
    assert (exchanged.first, exchanged.second) == ("B", "A")
    assert any(line.startswith("Begun in B's states instead: ") for line in verdict(explanation))
    part = 0.4 * explanation.gap["contact"]
    remembering = dataclasses.replace(explanation, restart={"A": {}, "B": {"contact": part}})
    (line,) = (line for line in verdict(remembering) if "does not repeat its own run" in line)
    assert line.startswith("B does not")
    assert "40 % in contact" in line


def test_a_non_default_setting_is_named_and_the_remainder_is_examined(asking, monkeypatch):
    monkeypatch.setattr(explaining, "MUCH", 2.0)  # not from the other side's states, too
    explanation = CASES["dart-erp-of-another"].explain(asking=asking)
    (cause,) = explanation.causes
    assert (cause.name, cause.values) == ("PyBullet's contact_erp", ("0.01", "0.2"))
    assert cause.share["contact"] > 0.2
    assert explanation.contact is not None
    assert explanation.contact.bodies == ("floor", "slider")
    without = next(swap for swap in explanation.probes if swap.name == "no contact")
    assert without.share["all"] > 0.99
    assert "free" not in explanation.telling
    assert explanation.unexplained["contact"] < 0.3


def test_nothing_is_explained_where_nothing_differs(asking):
    explanation = CASES["nothing"].explain(asking=asking)
    assert not explanation.causes
    assert not explanation.telling
    assert "Nothing differs" in verdict(explanation)[0]


@pytest.mark.skipif(find_engine("rapier").version() is None, reason="rapier3d is not installed")
def test_round_off_of_singles_is_no_difference_of_engines(asking):
    """Of a body that tumbles: the gap is 2.5e-8 m, the round-off of Rapier 5.8e-7, that of MuJoCo 1e-15. A planted gap of
    6.1e-6 m is found."""
    sides = [Configuration(world(FALL), engine) for engine in ("mujoco", "rapier")]
    explanation = explaining.explain_sides(sides[0], sides[1], ("A", "B"), asking=asking)
    assert not explanation.telling
    assert "to round-off, that of Rapier in single precision" in verdict(explanation)[0]
    later = Configuration(world(FALL, "physics.gravity=[0, 0, -9.7]"), "rapier")
    found = explaining.explain_sides(sides[0], later, ("A", "B"), asking=asking)
    assert [swap.name for swap in acting(found.causes)] == ["gravity"]
    assert found.causes[0].share["free"] > 0.9


def test_differences_without_effect_are_reported_as_such():
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


def test_a_proof_is_of_the_version_of_the_engine():
    side = Configuration(world(FALL), "mujoco")
    certificate = simspec.verify(side.world, ["mujoco"])
    version = certificate.engines["mujoco"].version
    for known in (version, None):
        assert proof_of(side, certificate, "there", known).valid
    assert proof_of(side, certificate, "there", "0.1").missing == f"there is of mujoco {version}, not 0.1"
