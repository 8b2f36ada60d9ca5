"""Probes across the normal: they pass where the law holds, and show another law's size where another was compiled."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.proof.contact import normal, run
from simspec.proof.contact.normal import Oscillator, bounce_ratio
from simspec.proof.contact.probe import GRAVITY, TrialMotion
from simspec.support.features import Feature
from simspec.world.types import Hardness
from tests.declared import engines_with
from tests.proof.contact_probing import figures, law

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = engines_with(Feature.RESTITUTION)
DT = 0.001
RESTITUTION, REST, OVERLAP = (run.PROBES[name] for name in ("restitution", "rest", "overlap"))
COMPLIANCE = run.PROBES["compliance"]


# --- what a motion is read as -------------------------------------------------------------------------------------


def test_a_bounce_within_a_single_step():
    speed = np.array([-0.99, -1.0, 0.5, 0.49, 0.48])
    assert bounce_ratio(speed, DT) == pytest.approx(0.5)


def test_a_bounce_over_several_steps_recovers_the_loss_to_gravity():
    after = [-1.0, -0.4, 0.1, 0.7 - 2 * GRAVITY * DT, 0.7 - 3 * GRAVITY * DT, 0.7 - 4 * GRAVITY * DT]
    assert bounce_ratio(np.array([-0.99, *after]), DT) == pytest.approx(0.7)


def test_slow_recovery_from_an_overlap_is_no_bounce():
    speed = np.array([-0.99, -1.0, 0.009, 0.0095, 0.01, 0.01])
    assert bounce_ratio(speed, DT) == pytest.approx(0.009)


def test_a_body_brought_to_rest_in_several_steps_has_not_bounced():
    """Of one that lies gravity takes nothing, which is not to be given back."""
    speed = np.array([-0.14, -0.15, -0.12, -0.03, -0.001, 0.0, 0.0, 1e-7, 0.0])
    assert bounce_ratio(speed, DT) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("speed", [[0.0, 0.1, 0.2], [-0.98, -0.99, -1.0], [-0.1, -0.2, np.nan, np.nan]])
def test_without_an_impact_there_is_no_ratio(speed):
    assert math.isnan(bounce_ratio(np.array(speed), DT))


def test_no_number_is_never_passed():
    wanted = law(restitution=0.5)
    trial = RESTITUTION.trials(wanted)[0]
    nothing = np.full((3, 6), np.nan)
    motion = TrialMotion(np.zeros(3), {}, {body.name: nothing for body in trial.bodies})
    assert not any(figure.passed for figure in RESTITUTION.figures(wanted, [motion]))


def test_lowest_point_of_a_tilted_cube():
    turn = (math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0, 0.0)  # 45° about x: it stands on an edge
    height = normal.CUBE / 2 * math.sqrt(2.0)
    assert normal.lowest_point("cube", np.array([0.0, 0.0, height, *turn])) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("timestep", [0.0005, 0.004, 0.016])
def test_balls_arrive_with_the_requested_speed_and_phase(timestep):
    """Against stepping each ball by hand."""
    wanted = law(timestep, restitution=0.5)
    balls = iter(RESTITUTION.trials(wanted)[0].bodies[1:])
    for speed in RESTITUTION.speeds(wanted):
        for phase in normal.STEP_PHASES:
            body = next(balls)
            height, fall = body.joint.position[2] - body.shapes[0].size[0], body.joint.velocity[2]
            while True:
                fall -= GRAVITY * timestep
                if height + fall * timestep <= 0.0:
                    break
                height += fall * timestep
            assert fall == pytest.approx(-speed)
            assert height == pytest.approx(phase * speed * timestep)
            assert speed * timestep < body.shapes[0].size[0]  # the centre stays above the floor


# --- in engines ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8])
def test_restitution(engine, restitution, tmp_path):
    found = figures(engine, RESTITUTION, law(restitution=restitution), tmp_path)
    assert len(found) == len(normal.RESTITUTION_SPEEDS)
    assert all(figure.passed for figure in found)


@pytest.mark.parametrize("engine", ENGINES)
def test_another_restitution_is_measured_as_such(engine, tmp_path):
    found = figures(engine, RESTITUTION, law(restitution=0.3), tmp_path, compiled=law(restitution=0.6))
    assert not any(figure.passed for figure in found)
    assert [figure.measured for figure in found] == pytest.approx([0.6] * len(found), abs=0.03)


def test_below_the_threshold_nothing_is_to_bounce():
    speeds = RESTITUTION.speeds(law(restitution=0.5, restitution_threshold=1.5))
    assert speeds == {0.75: 0.0, 2.0: 0.5, 3.0: 0.5, 5.0: 0.5}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_rest(engine, restitution, tmp_path):
    found = figures(engine, REST, law(restitution=restitution), tmp_path)
    assert {figure.probe for figure in found} == {"rest", "steady"}
    assert len(found) == 8
    assert all(figure.passed for figure in found), found


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.4, 0.5, 0.8])
@pytest.mark.parametrize("start", [0.0, 0.3, 1.0, 2.9])
def test_a_hop_at_rest_stays_below_its_bound(restitution, start):
    """The law stepped by itself, in units of g dt and dt: v' = −e v where it touches, after gravity was added."""
    gap, speed, fastest = 0.0, start, 0.0
    for step in range(2000):
        touching = gap <= 0.0
        speed -= 1.0
        if touching and speed < 0.0:
            speed = max(-restitution * speed, -0.01 * gap)
        gap += speed
        fastest = max(fastest, abs(speed)) if step > 1000 else fastest
    bound = normal.hop(law(timestep=0.002, restitution=restitution)) / (0.002 * GRAVITY)
    assert bound == pytest.approx((1.0 + restitution) / (1.0 - restitution))
    assert 0.0 < fastest < bound


def test_without_restitution_nothing_hops():
    assert normal.hop(law(restitution=0.0)) == 0.0
    assert normal.hop(law(restitution=1.0)) == normal.hop(law(restitution=0.8)), "beyond 0.8 deviations are declared"


@pytest.mark.parametrize("engine", ENGINES)
def test_rest_at_a_restitution_between_those_that_deviations_were_measured_at(engine, tmp_path):
    found = figures(engine, normal.Rest(), law(friction=0.8, restitution=0.4), tmp_path)
    assert all(entry.passed for entry in found if entry.probe == "steady")


def test_a_soft_floor_is_measured_as_deep(tmp_path):
    """A ball lies g T² ζ² deep on a floor of a stated compliance: 0.98 mm."""
    soft = law(hardness=Hardness("time-constant", 0.01, 1.0))
    found = figures("mujoco", REST, law(), tmp_path, compiled=soft)
    depths = [figure.measured for figure in found if figure.probe == "rest" and figure.case == "ball put down"]
    assert depths == pytest.approx([GRAVITY * 1e-4], rel=0.01)
    assert not any(figure.passed for figure in found if figure.probe == "rest")


# PhysX leaves no speed, as it declares; its own tests look at the overlap
@pytest.mark.parametrize("engine", [name for name in ENGINES if name != "physx"])
def test_overlap(engine, tmp_path):
    found = figures(engine, OVERLAP, law(friction=0.0), tmp_path)
    assert [figure.expected for figure in found] == pytest.approx([1e-4, 5e-4])
    assert all(figure.passed for figure in found)


def test_another_error_reduction_is_measured_as_such(tmp_path):
    """A spring-damper of T = 2 ms and ζ = 1: v' = dt r/(T ζ)² less a step's gravity, in the engine that steps explicitly."""
    soft = law(friction=0.0, hardness=Hardness("time-constant", 0.002, 1.0))
    found = figures("mujoco", OVERLAP, law(friction=0.0), tmp_path, compiled=soft)
    expected = [overlap * DT / 0.002**2 - GRAVITY * DT for overlap in normal.OVERLAPS]
    assert [figure.measured for figure in found] == pytest.approx(expected, rel=0.01)
    assert not any(figure.passed for figure in found)


# --- compliance ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "oscillator",
    [
        Oscillator(2500.0, 100.0, 9.81),
        Oscillator(2500.0, 10.0, 9.81),
        Oscillator(2500.0, 1000.0, 9.81),
        Oscillator(900.0, 0.0, 3.0),
    ],
    ids=["critical", "light", "heavy", "undamped"],
)
def test_the_deepest_point_against_stepping(oscillator):
    """Small semi-implicit steps, whose error is of the first order: a thousandth of what is found."""
    step = 1e-6
    depth, rate, time = 0.0, oscillator.arrival, 0.0
    while rate > 0.0:
        rate += step * (oscillator.load - oscillator.damping * rate - oscillator.stiffness * depth)
        depth += step * rate
        time += step
        assert time < 1.0
    found_time, found_depth = oscillator.deepest()
    assert found_depth > 1.05 * oscillator.rest
    assert found_depth == pytest.approx(depth, rel=1e-3)
    assert found_time == pytest.approx(time, rel=1e-3)


SPRINGS = [
    Hardness("time-constant", 0.02, 1.0),
    Hardness("time-constant", 0.1, 0.2),
    Hardness("time-constant", 0.5, 1.5),
    Hardness("stiffness", stiffness=1e4, damping=50.0),
]


@pytest.mark.parametrize("hardness", SPRINGS, ids=lambda hardness: f"{hardness.kind}-{hardness.time_constant:g}")
def test_compliance(hardness, tmp_path):
    found = figures("mujoco", COMPLIANCE, law(hardness=hardness), tmp_path)
    assert len(found) == 2
    assert all(figure.passed for figure in found)


def test_another_compliance_is_measured_as_such(tmp_path):
    stated, compiled = (law(hardness=Hardness("time-constant", value, 1.0)) for value in (0.02, 0.03))
    rest, dip = figures("mujoco", COMPLIANCE, stated, tmp_path, compiled=compiled)
    assert rest.measured == pytest.approx(rest.expected * (0.03 / 0.02) ** 2, rel=0.05)
    assert not rest.passed
    assert not dip.passed
