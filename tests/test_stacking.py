"""The robot scenario in every engine: one pick-and-place, the lift, slippery fingers, and the tool that sweeps it."""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.runner.execution import run
from simspec.runner.expectations import evaluate
from simspec.world.kinematics import poses
from simspec.world.types import Inertial

ROOT = Path(__file__).resolve().parent.parent
SPECS = ROOT / "specs"
SUPPORTED = json.loads((ROOT / "generated" / "stack-cylinders" / "certificate.json").read_text())["engines"]
"""The engines that support the scenario."""
ENGINES = sorted(SUPPORTED)
LIMIT = 0.01


def tool():
    spec = importlib.util.spec_from_file_location("stacking", ROOT / "tools" / "stacking.py")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(ROOT / "tools"))  # as it is for a script that is called
    sys.modules["stacking"] = module
    spec.loader.exec_module(module)
    return module


stacking = tool()
stacking_page = sys.modules["stacking_page"]


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
    asked = [dict(one.parameters) for one in world.expectations if one.kind == "at_target"]
    times = [given["at"] for given in asked]
    assert sorted(set(times)) == [13.0 * k for k in range(1, 9)] + [104.0 + 25.0 * k for k in range(1, 8)]
    whole = {given["at"]: dict(given["targets"]) for given in asked if len(given["targets"]) > 1}
    assert sorted(whole) == [104.0, 279.0]
    assert all(len(targets) == 21 and given["tolerance"] == LIMIT for targets in whole.values() for given in asked)
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


@pytest.mark.parametrize("engine", ENGINES)
def test_one_pick_and_place(engine):
    """Within 1 cm, in fact within 2 mm, and nothing else is moved."""
    world = part("trajectory.until=13s")
    found = placement(engine)
    assert found.failed is None
    (outcome,) = evaluate(found)
    assert outcome.passed, outcome.detail
    assert outcome.measured < 0.002
    moved = dict(dict(world.expectations[0].parameters)["targets"])
    still = [body.name for body in world.bodies if body.name.startswith("cylinder") and body.name not in moved]
    assert len(still) == 20
    for name in still:
        path = found.arrays["pose"][:, found.index[name], :3]
        assert np.linalg.norm(path[-1] - path[0]) < 0.001, name
    assert max(found.provenance["control"]["error"]) < 0.05
    assert sum(found.provenance["control"]["clipped"]) == 0


@pytest.mark.parametrize("engine", ENGINES)
def test_slippery_fingers_fail_and_the_report_says_how(engine):
    world = stacking._slippery(part("trajectory.until=13s"))
    found = run(world, engine)
    (outcome,) = evaluate(found)
    assert not outcome.passed
    assert outcome.measured > LIMIT
    (name,) = dict(dict(world.expectations[0].parameters)["targets"])
    assert name in outcome.detail
    assert "13 s" in outcome.detail
    said = stacking.result_of(found).failure
    assert said.startswith(f"{name} ")
    assert "slip" in said


@pytest.mark.parametrize("engine", ENGINES)
def test_what_is_lifted_and_shaken_does_not_slip(engine):
    world = simspec.load(SPECS / "gripper-lift.yaml").resolve()
    found = run(world, engine)
    for outcome in evaluate(found):
        assert outcome.passed, outcome.detail


@pytest.mark.parametrize("engine", ENGINES)
def test_the_same_run_twice_gives_the_same_bits(engine):
    one, two = placement(engine), run(part("trajectory.until=13s"), engine)
    for channel in ("q", "v", "control.effort"):
        assert one.arrays[channel].tobytes() == two.arrays[channel].tobytes()


# --- the tool ------------------------------------------------------------------------------------------------------


def test_a_timestep_of_the_sweep_asks_the_same_at_the_nearest_times():
    world = stacking.scenario(7e-3, 0)
    assert world.physics.timestep == 7e-3
    assert 279.0 <= world.physics.steps * 7e-3 < 279.007
    times = [dict(one.parameters)["at"] for one in world.expectations]
    every = world.record.every_steps
    for time, meant in zip(sorted(set(times))[:8], range(13, 105, 13), strict=True):
        assert abs(time - meant) <= every * 7e-3 / 2 + 1e-9
        assert round(time / 7e-3) % every == 0


def test_seeds_move_cylinders_a_little_and_nothing_else():
    plain, one, again = (stacking.scenario(4e-3, seed) for seed in (0, 1, 1))
    assert one == again
    for before, after in zip(plain.bodies, one.bodies, strict=True):
        if not before.name.startswith("cylinder"):
            assert before == after
            continue
        away = np.subtract(after.joint.position, before.joint.position)
        assert 0.0 < np.abs(away[:2]).max() <= stacking.JITTER
        assert not away[2:].any()
    assert plain.trajectory == one.trajectory


def test_the_page_is_made_of_the_results():
    row = {"worst": 0.0012, "failure": "", "step_us": 60.0, "real_time_factor": 16.0, "cpu_factor": 16.5}
    row |= {"control_us": 11.0, "record_us": 0.5}
    lost = row | {"worst": None, "failure": "cylinder_3_1 100 mm off at 13 s: slip: not lifted"}
    name = ENGINES[0]
    known = {stacking_page.key(name, 4, seed): row for seed in (0, 1)}
    known[stacking_page.key(name, 4, 2)] = row | {"worst": 0.0034}
    known |= {stacking_page.key(name, 16, 0): row, stacking_page.key(name, 16, 1): lost}
    pace = {
        "quiet": {"step": 50.0, "control": 11.0, "record": 0.5},
        "median": {"step": 80.0, "control": 14.0, "record": 0.6},
    }
    known[stacking_page.key(name, 1, 0, "speed")] = pace
    known[stacking_page.key(name, 4, 0, "asleep")] = lost
    made = stacking_page.tables(known)
    assert f"| {name} | 20.0 | 12.5 | 50.0 µs | 11.0 µs | 0.5 µs |" in made["speed"]
    asleep = next(line for line in made["asleep"].splitlines() if line.startswith(f"| {name}, 4 ms"))
    assert asleep.split(" | ")[2] == lost["failure"]
    lines = made["limits"].splitlines()
    assert next(line for line in lines if line.startswith("| 4 ms")).strip(" |").split(" | ")[1] == "3.4"
    assert "fails** (1 of 2)" in next(line for line in lines if line.startswith("| 16 ms"))
    assert "slip: not lifted" in made["failures"]
    text = "".join(f"x <!-- {part} -->old<!-- /{part} --> y\n" for part in made)
    page = stacking_page.page(known, text)
    assert "old" not in page
    assert stacking_page.page(known, page) == page
    with pytest.raises(ValueError, match="limits"):
        stacking_page.page(known, "no marks")


def test_results_without_a_number_are_kept_as_nothing():
    found = stacking.Result(math.inf, "no result: x", 0.0, 0.0, 0.0, 0.0, 0.0)
    assert stacking.as_data(found)["worst"] is None
    assert dataclasses.asdict(found)["failure"]


def test_the_pace_of_a_scenario_is_that_of_its_fastest_rounds(world):
    """Of every second and part the fastest round, so never more than the median one."""
    pace = sys.modules["pace"]
    short = dataclasses.replace(
        part("trajectory.until=2s"),
        expectations=(),
        physics=dataclasses.replace(world.physics, timestep=2e-3, steps=1000),
    )
    found = pace.measure(short, ["mujoco"], 2)["mujoco"]
    assert found.timestep == 2e-3
    assert all(0.0 < found.quiet[name] <= found.median[name] for name in pace.PARTS)
    assert found.real_time_factor() >= found.real_time_factor("median") > 0.0
    slow = pace.with_settings(short, "dart", {"sleeping": True})
    assert dict(slow.options("dart").settings)["sleeping"] is True
    assert slow.options("mujoco") == short.options("mujoco")
