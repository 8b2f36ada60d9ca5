"""The robot scenario in every engine: one pick-and-place, the lift, and slippery fingers."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.analysis.validity import first_failure
from simspec.runner.execution import run
from simspec.runner.expectations import evaluate
from simspec.world.kinematics import poses
from simspec.world.types import Inertial
from tests.installed import INSTALLED
from tests.nightly import NIGHTLY

pytestmark = pytest.mark.usefixtures("warm_engines")

ROOT = Path(__file__).resolve().parent.parent
SPECS = ROOT / "specs"
SUPPORTED = json.loads((ROOT / "generated" / "stack-cylinders" / "certificate.json").read_text())["engines"]
"""The engines that support the scenario."""
ENGINES = [name for name in sorted(SUPPORTED) if name in INSTALLED]
SLOW = dict.fromkeys(("gazebo", "ode", "physx", "rapier"), NIGHTLY)
"""Engines in which the first placement takes 10 s and more, 2 to 3 in the others: ODE solves for all contacts of the grasp at
once, and contacts in PhysX and Rapier are swept 50 times."""
LIMIT = 0.01
GRASPED = 2500
"""Steps of 2 ms until the first cylinder is squeezed and lifted; a row is recorded then."""


@pytest.fixture(scope="module")
def world():
    return simspec.load(SPECS / "stack-cylinders.yaml").resolve()


@functools.cache
def part(*sets: str):
    return simspec.load(SPECS / "stack-cylinders.yaml", sets=["physics.timestep=2ms", *sets]).resolve()


def test_the_scenario_is_the_paper_s(world):
    """Körber et al. 2021: 21 cylinders of 0.125 kg, radius 20 mm, height 100 mm; 17 driven joints; 279 s."""
    assert world.physics.steps * world.physics.timestep == pytest.approx(279.0)
    assert world.trajectory.times[-1] == pytest.approx(279.0)
    cylinders = [body for body in world.bodies if body.name.startswith("cylinder")]
    assert len(cylinders) == 21
    across = 0.125 * (3 * 0.02**2 + 0.1**2) / 12
    for body in cylinders:
        assert body.inertial == Inertial(0.125, inertia=pytest.approx((across, across, 2.5e-5, 0, 0, 0)))
        assert body.joint.position[2] == 0.07
    assert len(world.controllers[0].joints) == 17
    assert None not in world.controllers[0].effort_limits
    at = poses(world)
    assert at["hand/palm"].position == pytest.approx((5e-5, 1.10011, 0.3775), abs=1e-5)


def test_every_cylinder_has_a_target_after_every_placement(world):
    expected = [dict(expectation.parameters) for expectation in world.expectations if expectation.kind == "at_target"]
    times = [target["at"] for target in expected]
    assert sorted(set(times)) == [13.0 * k for k in range(1, 9)] + [104.0 + 25.0 * k for k in range(1, 8)]
    whole = {target["at"]: dict(target["targets"]) for target in expected if len(target["targets"]) > 1}
    assert sorted(whole) == [104.0, 279.0]
    assert all(len(targets) == 21 and target["tolerance"] == LIMIT for targets in whole.values() for target in expected)
    # eight stacks of two at half time; in the end five, and a tower of seven
    for time, levels in ((104.0, {0.07: 13, 0.17: 8}), (279.0, {0.07: 10, 0.17: 6})):
        heights = [round(place[2], 3) for place in whole[time].values()]
        assert {level: heights.count(level) for level in levels} == levels
    tower = [place for place in whole[279.0].values() if place[:2] == (0.55, 0.45)]
    assert sorted(round(place[2], 3) for place in tower) == [0.07, 0.17, 0.27, 0.37, 0.47, 0.57, 0.67]


@functools.cache
def placement(engine: str):
    """The first of the fifteen, at 2 ms."""
    return run(part("trajectory.until=13s"), engine)


@pytest.mark.parametrize("engine", [pytest.param(name, marks=SLOW.get(name, ())) for name in ENGINES])
def test_a_single_pick_and_place(engine):
    """Within 1 cm, in fact within 2 mm, and nothing else is moved."""
    world = part("trajectory.until=13s")
    found = placement(engine)
    assert found.failed is None
    (outcome,) = evaluate(found)
    assert outcome.passed, outcome.detail
    assert outcome.measured < 0.002
    moved = dict(dict(world.expectations[0].parameters)["targets"])
    names = [body.name for body in world.bodies if body.name.startswith("cylinder") and body.name not in moved]
    assert len(names) == 20
    for name in names:
        path = found.arrays["pose"][:, found.index[name], :3]
        assert np.linalg.norm(path[-1] - path[0]) < 0.001, name
    assert max(found.provenance["control"]["error"]) < 0.05
    assert sum(found.provenance["control"]["clipped"]) == 0


@pytest.mark.parametrize("engine", ENGINES)
def test_slippery_fingers_fail_and_the_report_says_how(engine):
    world = part("trajectory.until=13s", "contact.pairs=[{between: [finger, wood], friction: 0.05}]")
    found = run(world, engine)
    (outcome,) = evaluate(found)
    assert not outcome.passed
    assert outcome.measured > LIMIT
    (name,) = dict(dict(world.expectations[0].parameters)["targets"])
    assert name in outcome.detail
    assert "13 s" in outcome.detail
    failure = first_failure(found, [outcome])
    assert failure.body == name
    assert failure.kind in ("not-moved", "not-lifted")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_lifted_and_shaken_cylinder_does_not_slip(engine):
    # 1 s of the 3.5 s for which it is held in the end
    world = simspec.load(SPECS / "gripper-lift.yaml", sets=["physics.duration=9.5 s"]).resolve()
    found = run(world, engine)
    for outcome in evaluate(found):
        assert outcome.passed, outcome.detail


@pytest.mark.parametrize("engine", ENGINES)
def test_the_same_run_twice_gives_the_same_bits(engine):
    """Until a cylinder is grasped."""
    world = part("trajectory.until=13s")
    begun = dataclasses.replace(world, physics=dataclasses.replace(world.physics, steps=GRASPED))
    first, second = run(begun, engine) if engine in SLOW else placement(engine), run(begun, engine)
    rows = len(second.arrays["step"])
    assert first.arrays["step"][rows - 1] == second.arrays["step"][-1] == GRASPED
    for channel in ("q", "v", "control.effort"):
        assert first.arrays[channel][:rows].tobytes() == second.arrays[channel].tobytes()
