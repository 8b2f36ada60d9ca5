"""Probes of friction moments: against laws that hold, and by how much they show others."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.proof.contact import run
from simspec.proof.contact.probe import GRAVITY, TrialMotion
from simspec.support.features import Feature
from tests.declared import engines_with
from tests.proof.contact_probing import figures, law, world_of

pytestmark = pytest.mark.usefixtures("warm_engines")

TORSIONAL, ROLLING = run.PROBES["torsional"], run.PROBES["rolling"]
WITH_MOMENTS = []
for _name in engines_with(Feature.RESTITUTION):
    _law = law(torsional_friction=0.005, rolling_friction=0.005)
    try:
        compile_world(world_of(_law, TORSIONAL.trials(_law)[0]), [_name])
    except UnsupportedError:
        continue
    WITH_MOMENTS.append(_name)


def test_some_engines_have_friction_moments():
    assert "mujoco" in WITH_MOMENTS


@pytest.mark.parametrize("engine", WITH_MOMENTS)
@pytest.mark.parametrize("length", [0.001, 0.02])
def test_torsional_friction(engine, length, tmp_path):
    found = figures(engine, TORSIONAL, law(torsional_friction=length), tmp_path)
    assert [figure.quantity for figure in found] == ["deceleration", "spin"]
    # as large as lets it turn by 5 mrad in a step at first, after 300 steps of slowing down
    radius = max(0.1, math.sqrt(length * GRAVITY * 300 * 1e-3**2 / (0.4 * 0.005)))
    assert found[0].expected == pytest.approx(length * GRAVITY / (0.4 * radius**2))
    assert all(figure.passed for figure in found), found


@pytest.mark.parametrize("timestep", [5e-4, 0.016, 0.02])
def test_moments_are_measured_at_every_timestep(timestep):
    for length, measured in ((0.001, True), (0.02, True), (0.2, True), (0.21, False)):
        entry = dataclasses.replace(law(torsional_friction=length), timestep=timestep)
        assert TORSIONAL.applies(entry) is measured


@pytest.mark.parametrize("engine", WITH_MOMENTS)
@pytest.mark.parametrize(("friction", "length"), [(0.5, 0.001), (0.8, 0.02), (0.2, 0.005)])
def test_rolling_friction(engine, friction, length, tmp_path):
    found = figures(engine, ROLLING, law(friction=friction, rolling_friction=length), tmp_path)
    radius = max(0.1, 10.0 * length / friction)
    assert found[0].expected == pytest.approx(5.0 / 7.0 * length * GRAVITY / radius)
    assert all(figure.passed for figure in found), found


@pytest.mark.parametrize("engine", WITH_MOMENTS)
@pytest.mark.parametrize(
    ("probe", "quantity"), [(TORSIONAL, "torsional_friction"), (ROLLING, "rolling_friction")], ids=["spin", "roll"]
)
def test_another_length_is_measured_as_such(engine, probe, quantity, tmp_path):
    stated, compiled = (law(**{quantity: value}) for value in (0.004, 0.0045))
    slowing, left = figures(engine, probe, stated, tmp_path, compiled=compiled)
    assert slowing.measured == pytest.approx(slowing.expected * 0.0045 / 0.004, rel=0.02)
    assert not slowing.passed
    assert left.passed


@pytest.mark.parametrize("engine", engines_with(Feature.RESTITUTION))
def test_a_dropped_moment_is_caught(engine, tmp_path):
    slowing, left = figures(engine, TORSIONAL, law(torsional_friction=0.004), tmp_path, compiled=law())
    assert slowing.measured == pytest.approx(0.0, abs=1e-6)
    assert not slowing.passed
    assert not left.passed


def test_laws_that_need_a_huge_ball_or_slip_are_not_probed_by_rolling():
    assert ROLLING.applies(law(friction=0.5, rolling_friction=0.09))
    assert not ROLLING.applies(law(friction=0.5, rolling_friction=0.11))
    assert not ROLLING.applies(law(friction=0.0, rolling_friction=0.01))
    assert not ROLLING.applies(law())


@pytest.mark.parametrize("timestep", [0.0005, 0.016])
def test_balls_roll_without_slipping_at_the_start(timestep):
    for body in ROLLING.trials(law(timestep, rolling_friction=0.02))[0].bodies[1:]:
        velocity = np.array(body.joint.velocity)
        slip = velocity[:3] + np.cross(velocity[3:], [0.0, 0.0, -body.shapes[0].size[0]])
        assert np.abs(slip).max() <= 1e-12 * np.linalg.norm(velocity[:3])


def test_no_number_is_never_passed():
    wanted = law(torsional_friction=0.004)
    nothing = {body.name: np.full((601, 6), math.nan) for body in TORSIONAL.trials(wanted)[0].bodies}
    assert not any(figure.passed for figure in TORSIONAL.figures(wanted, [TrialMotion(np.zeros(601), {}, nothing)]))
