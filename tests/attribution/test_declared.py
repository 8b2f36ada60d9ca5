"""Declared deviations are candidates of an explanation: laws of recovery predict, others are located, and words say so."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import simspec
from simspec.attribution import explanation as explaining
from simspec.attribution.configuration import Asking, Configuration
from simspec.attribution.declared import DeclaredDeviation, _carry, _of_both, _overlaps, located
from simspec.attribution.explanation import Explanation, explain_sides
from simspec.attribution.measure import CombinedSwap, Swap
from simspec.attribution.sentences import verdict
from simspec.engines.dart.engine import Dart
from simspec.engines.kit.capabilities import COMMON, Recovery
from simspec.testing.bench import native, wheel, with_targets
from tests.attribution.planted import world

pytestmark = pytest.mark.usefixtures("warm_engines")

COULOMB = "MuJoCo's friction: coulomb"
PYRAMID, HALF = "friction cone: pyramid-circumscribed", "timestep halved"
DROP = """
simspec: 1
name: drop
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 0.7 s}
contact: {friction_cone: elliptic, materials: {slick: {friction: 0, restitution: 0}}}
bodies:
  floor: {fixed: true, shapes: [{box: {size: [4, 4, 0.2]}, pose: {xyz: [0, 0, -0.1]}, material: slick}]}
  ball: {pose: {xyz: [1, 0, HEIGHT]}, mass: 0.5 kg, shapes: [{sphere: {radius: 50 mm}, material: slick}]}
"""


def dropped(tmp_path, height):
    (tmp_path / "drop.yaml").write_text(DROP.replace("HEIGHT", str(height)))
    return simspec.load(tmp_path / "drop.yaml").resolve()


@pytest.fixture(scope="module")
def asking(warm_processes):
    return Asking(warm_processes)


@pytest.mark.parametrize(("engines", "height"), [(("mujoco", "dart"), 0.5), (("dart", "pybullet"), 0.3)])
def test_a_declared_law_of_recovery_accounts_for_its_effects(engines, height, asking, tmp_path):
    sides = [Configuration(dropped(tmp_path, height), engine) for engine in engines]
    found = explain_sides(sides[0], sides[1], engines, asking=asking)
    (declared,) = [declared for declared in found.declared if declared.predicted]
    assert (declared.engine, declared.acts) == ("DART", "recovery of overlaps")
    assert declared.share["impact"] > 0.98
    assert declared.share["contact"] > 0.9
    assert all(share < 0.1 for share in found.unexplained.values())
    lines = verdict(found)
    assert any(line.startswith("Declared: DART takes overlaps back at 1 mm/s at most") for line in lines)
    assert not any("Unexplained: 100 %" in line for line in lines)


def test_a_law_that_is_not_declared_accounts_for_nothing(asking, tmp_path, monkeypatch):
    monkeypatch.setattr(Dart, "recovery", classmethod(lambda cls, settings, law: COMMON))
    monkeypatch.setattr(explaining, "probes", lambda pair: [])
    monkeypatch.setattr(explaining, "MUCH", 2.0)
    sides = [Configuration(dropped(tmp_path, 0.5), engine) for engine in ("mujoco", "dart")]
    found = explain_sides(sides[0], sides[1], ("A", "B"), asking=asking)
    assert not found.declared
    assert found.unexplained["impact"] > 0.99


def test_a_wrong_law_is_not_claimed(asking, tmp_path, monkeypatch):
    backwards = Recovery(speed=-1e-3, why="throws bodies into each other")
    monkeypatch.setattr(Dart, "recovery", classmethod(lambda cls, settings, law: backwards))
    monkeypatch.setattr(explaining, "probes", lambda pair: [])
    monkeypatch.setattr(explaining, "MUCH", 2.0)
    sides = [Configuration(dropped(tmp_path, 0.5), engine) for engine in ("dart", "dart")]
    other = dataclasses.replace(sides[1], engine="mujoco")
    found = explain_sides(sides[0], other, ("A", "B"), asking=asking)
    assert all(declared.share.get("contact", 0.0) < 0.95 for declared in found.declared)


def test_deviations_of_friction_are_located_where_the_difference_goes_with_friction(asking, monkeypatch):
    monkeypatch.setattr(explaining, "MUCH", 2.0)
    probes = explaining.probes
    monkeypatch.setattr(
        explaining,
        "probes",
        lambda pair: [
            candidate for candidate in probes(pair) if candidate.group == "friction" or candidate.name == COULOMB
        ],
    )
    sides = [Configuration(world(), engine) for engine in ("mujoco", "dart")]
    found = explain_sides(sides[0], sides[1], ("A", "B"), most=60, asking=asking)
    mine = [entry for entry in found.declared if entry.engine == "MuJoCo" and entry.acts == "friction"]
    assert mine
    assert not mine[0].predicted
    assert max(mine[0].share.values()) > 0.2
    lines = verdict(found)
    assert any(line.startswith("Declared of friction: ") for line in lines)
    assert any(line.startswith("Unexplained, and not within friction") for line in lines)
    # the setting with which MuJoCo has the friction of impacts was tried: the deviation accounts for what that closes
    assert COULOMB in {declared.swap for declared in mine}
    assert any("removes this deviation of MuJoCo and closes" in line for line in lines)


@given(st.floats(0.0, 1e-2), st.integers(0, 300), st.floats(1e-5, 1e-2), st.floats(0.0, 0.5), st.floats(1e-5, 10.0))
def test_recovery_is_bounded_by_both_of_its_laws(overlap, steps, dt, share, speed):
    taken = Recovery(share, speed).taken_back(overlap, steps, dt)
    by_share = overlap * (1.0 - (1.0 - share) ** steps)
    assert -1e-15 <= taken <= min(by_share, steps * speed * dt) * (1.0 + 1e-9) + 1e-15
    assert Recovery(share).taken_back(overlap, steps, dt) == pytest.approx(by_share, abs=1e-12)


def test_resting_bodies_move_with_their_support():
    up = np.array([0.0, 0.0, 1.0])
    bodies = world().bodies[:4]
    actual = dataclasses.replace(world(), bodies=bodies)
    shift = np.zeros((4, 3))
    # 0 is static; 1 lies on 0, 2 on 1; normals point from the second body to the first
    _carry(shift, {(0, 1): -1e-3 * up, (1, 2): -2e-3 * up}, [True, False, False, False], actual)
    assert shift.tolist() == [[0, 0, 0], [0, 0, 1e-3], [0, 0, 3e-3], [0, 0, 0]]


def test_the_deepest_point_of_the_first_row_counts():
    arrays = {"contact.distance": np.array([-1.0, -3.0, -9.0, -2.0]), "contact.normal": np.array([[0, 0, 1.0]] * 4)}
    rows, bodies = np.array([4, 4, 5, 6]), np.array([[0, 1], [1, 0], [0, 1], [2, 1]])
    found = _overlaps(arrays, rows, bodies, np.arange(4))
    assert found[0, 1][0] == 3.0
    assert found[0, 1][1].tolist() == [0, 0, -1]
    assert found[0, 1][2] == 2
    assert found[1, 2][2] == 1


def explanation_of(**changes):
    """An explanation of made-up figures."""
    nothing = CombinedSwap((), {}, {})
    gap = {"contact": 1e-3, "all": 1e-3}
    plain = Explanation(
        "A",
        "B",
        False,
        True,
        (),
        0.01,
        {"free": 0, "impact": 0, "contact": 9},
        9,
        0,
        gap,
        {},
        None,
        (),
        nothing,
        (),
        nothing,
        {"contact": 1.0, "all": 1.0},
    )
    return verdict(dataclasses.replace(plain, **changes))


def test_a_negative_share_says_that_the_gap_grows():
    swap = Swap("timestep halved", "refinement", "timestep", ("", ""), share={"contact": -0.4, "all": 0.1})
    assert any("none: the gap grows by 40 % in contact" in line for line in explanation_of(probes=(swap,)))
    causes = tuple(
        Swap(name, "difference", "g", ("1", "2"), share={"contact": 0.5}, effect={"contact": 1.0}) for name in "ab"
    )
    joint = CombinedSwap(("a", "b"), {}, {"contact": -0.3, "all": -0.3})
    lines = explanation_of(causes=causes, caused=joint)
    assert any("account for none of the difference: the gap grows by 30 % in contact" in line for line in lines)


def test_more_than_all_unexplained_has_a_reason():
    lines = explanation_of(unexplained={"contact": 1.5})
    assert any(line.startswith("Unexplained: 150 % in contact") for line in lines)
    assert any(line.startswith("More than 100 %: ") for line in lines)


def test_differences_within_a_located_deviation_are_explained():
    declared = DeclaredDeviation("ONE", "slides aside", "friction", False, {"contact": 0.5, "all": 0.5})
    other = dataclasses.replace(declared, engine="OTHER", what="hops")
    lines = explanation_of(declared=(declared, other))
    assert "Declared of friction: ONE: slides aside; OTHER: hops." in lines
    gone = "Without friction, 50 % in contact of the rest is gone: the cause lies there; it need not be the declared deviation."
    assert gone in lines
    only = (
        "Within friction, explained only if the declared deviation is the cause, which no swap shows: 50 % in contact."
    )
    assert only in lines
    assert lines[-1] == "Unexplained, and not within friction: 50 % in contact, 50 % in all windows."


@pytest.mark.parametrize(
    ("closed", "made", "words"),
    [
        ({"contact": 0.15, "all": 0.15}, False, "85 % in contact"),
        ({}, False, "100 % in contact"),
        ({"contact": 0.15, "all": 0.15}, True, "100 % in contact"),
    ],
)
def test_a_deviation_accounts_for_no_more_than_the_swap_that_takes_it_away(closed, made, words):
    """All of it goes without friction, and a seventh with the cone that the engine has: the cone is not the cause of the
    rest; where that swap was made already, what is left is none of it."""
    declared = DeclaredDeviation(
        "ONE", "has a pyramid", "friction", False, {"contact": 1.0, "all": 1.0}, {}, "the cone: pyramid", closed
    )
    lines = explanation_of(declared=(declared,), probed=CombinedSwap(("the cone: pyramid",) if made else (), {}, {}))
    share = "15 % in contact" if closed else "nothing"
    assert (
        f"The cone: pyramid removes this deviation of ONE and closes {share}: the deviation accounts for no more."
        in lines
    )
    assert f"Within friction, not explained: {words}." in lines
    assert lines[-1] == "Unexplained, and not within friction: less than 1.0 %."


def test_a_declared_cone_is_measured_by_the_cone_that_the_engine_has():
    """The statement of a swap about a deviation follows from the declarations, not from names; a swap that removes one
    deviation away and brings another of its kind measures neither."""
    sides = (Configuration(world(), "ode"), Configuration(world(), "gazebo"))
    tried = [
        (probe, Swap(probe.name, probe.kind.value, probe.group, probe.values, share=shares[probe.name]))
        for probe in explaining.probes(sides)
        if probe.name
        in (shares := {"no friction": {"contact": 0.98}, PYRAMID: {"contact": 0.15}, HALF: {"contact": 0.4}})
    ]
    touching = {(a.name, b.name) for a, b in itertools.combinations(sides[0].world.bodies, 2)}
    found = {entry.what: entry for entry in located(sides, touching, tried) if entry.engine == "Gazebo"}
    cone = next(declared for what, declared in found.items() if "circumscribed pyramid" in what)
    assert (cone.swap, cone.closed) == (PYRAMID, {"contact": 0.15})
    assert cone.share == {"contact": 0.98}


def test_without_contact_nothing_is_predicted(asking, tmp_path, monkeypatch):
    """A probe that takes contact away leaves nothing of the gap, whatever the laws of recovery are."""
    probes = explaining.probes
    monkeypatch.setattr(
        explaining, "probes", lambda pair: [candidate for candidate in probes(pair) if candidate.name == "no contact"]
    )
    sides = [Configuration(dropped(tmp_path, 0.5), engine) for engine in ("mujoco", "dart")]
    found = explain_sides(sides[0], sides[1], ("A", "B"), asking=asking)
    assert any(declared.predicted for declared in found.declared)
    (probe,) = found.probes
    assert probe.share["all"] > 0.99


def test_different_laws_of_native_controllers_are_declared():
    """Of a spring and a motor; nothing of two springs of the same law."""
    world = with_targets(native(wheel(0.02)), [0.5])
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, steps=100))
    sides = [Configuration(world, engine) for engine in ("mujoco", "pybullet")]
    lines = verdict(explain_sides(sides[0], sides[1], ("A", "B"), most=20))
    (line,) = (line for line in lines if line.startswith("Declared of controllers: "))
    assert "MuJoCo: its own controllers are springs with dampers, by the state before each step" in line
    assert "PyBullet: its own controllers are motors" in line
    assert "Unexplained, and not within controllers: less than 1.0 %." in lines
    assert _of_both((sides[0], sides[0]), set()) == [[], []]
