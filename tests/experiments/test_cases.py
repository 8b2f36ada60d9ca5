"""From a cell of a plan to its case."""

from __future__ import annotations

import math

import pytest

import simspec
from simspec.errors import SpecError
from simspec.experiments import cases
from simspec.experiments.cases import case_of, rounding_lines, roundings, world_of
from simspec.experiments.index import RunRow, Steps, costs
from simspec.experiments.plan import plan_sweep
from simspec.runner.run import Case
from simspec.world.canonical import sha256
from tests.experiments.swept import ENGINES, SWEEP, VERSIONS, spec


def plan(sweep, engines=ENGINES, **more):
    return plan_sweep(spec(sweep, **more), engines=engines, versions=VERSIONS)


def test_the_case_of_a_cell_is_that_of_the_same_values_set_by_hand(tmp_path):
    made = plan(SWEEP)
    path = tmp_path / "rod.yaml"
    path.write_text(made.spec.to_yaml(), encoding="utf-8")
    for cell in list(made)[::97]:
        sets = [f"{name}={value}" for name, value in cell.overrides]
        world = simspec.load(path, sets=sets).resolve()
        assert case_of(made, cell) == Case(world, cell.engine, perturb=cell.perturb, seed=cell.seed)


def test_the_sweep_changes_neither_the_world_nor_its_hash():
    plain = spec().resolve()
    swept = spec(SWEEP).resolve()
    assert swept == plain
    assert sha256(swept) == sha256(plain)
    assert world_of(plan(SWEEP), next(iter(plan(SWEEP)))).bodies[0].joint == plain.bodies[0].joint


def test_cells_with_the_same_values_share_a_world_and_few_are_kept(monkeypatch):
    monkeypatch.setattr(cases, "MOST_KEPT_CASES", 2)
    made = plan({"over": {"bodies.rod.mass": [1, 2, 3]}, "repeat": 2})
    cells = list(made)
    worlds = [world_of(made, cell) for cell in cells]
    assert len({id(world) for world in worlds}) == 3
    assert all(worlds[0] is world for world in worlds[:4])
    assert world_of(made, cells[0]) is not worlds[0], "the oldest is made anew"
    assert world_of(made, cells[0]) == worlds[0]


def test_ranges_mean_what_they_say():
    made = plan(
        {
            "over": {
                "bodies.rod.joint.position": {"from": "0 deg", "to": "90 deg", "count": 4},
                "bodies.rod.joint.damping": {"from": 0.001, "to": 1, "count": 4, "spacing": "logarithmic"},
            }
        },
        ["dart"],
    )
    joints = [world_of(made, cell).bodies[0].joint for cell in made]
    assert [joint.position[0] for joint in joints[::4]] == [0.0, math.pi / 6, math.pi / 3, math.pi / 2]
    assert [joint.damping for joint in joints[:4]] == [0.001, 0.01, 0.1, 1.0]


YAML = """\
simspec: 1
name: rod
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  rod: {mass: 2, inertia: {principal: [0.04, 0.04, 0.001]}}
sweep:
  over:
    physics.timestep: [1 ms, 3 ms]
  together:
    - {bodies.rod.mass: [1, 2], bodies.rod.inertia.principal: [[1, 1, 1], [1, 1, 3]]}
  cases:
    wrong: {physics.duration: 21 ms}
"""


def test_values_that_do_not_go_together_are_located_where_the_sweep_says_them(tmp_path):
    path = tmp_path / "rod.yaml"
    path.write_text(YAML, encoding="utf-8")
    made = plan_sweep(simspec.load(path), engines=["dart"], versions=VERSIONS)
    given = {}
    for cell in made:
        try:
            case_of(made, cell)
        except SpecError as error:
            given[cell.index] = {
                (problem.location.line, problem.location.column, problem.path) for problem in error.problems
            }
    # cells: case, timestep, row
    assert len(made) == 8
    too_long = (10, 75, "bodies.rod.inertia.principal")
    assert {index for index, places in given.items() if too_long in places} == {1, 3, 5, 7}
    duration = {index: [place for place in places if place[2] == "physics.duration"] for index, places in given.items()}
    assert duration[2] == duration[3] == [(3, 37, "physics.duration")], "the spec's own duration"
    assert 4 not in given, "21 ms are a whole number of 1 ms"
    assert 6 not in given, "and of 3 ms"


def test_the_spec_itself_stays_as_it_is():
    made = plan(SWEEP)
    before = made.spec.to_yaml()
    for cell in list(made)[:100:7]:
        case_of(made, cell)
    assert made.spec.to_yaml() == before


def test_times_are_rounded_up_only_where_the_sweep_requests_it():
    over = {"over": {"physics.timestep": ["1 ms", "3 ms"]}}
    exact, rounding = plan(over, ["dart"]), plan({**over, "times": "round_up"}, ["dart"])
    whole, unexpected = rounding
    assert roundings(rounding, whole) == ()
    assert world_of(rounding, whole) == world_of(exact, next(iter(exact)))
    world = world_of(rounding, unexpected)
    assert (world.physics.steps, world.record.every_steps) == (7, 4)
    assert dict(world.expectations[0].parameters)["at"] == 0.021
    given = {rounded.path: (rounded.written, rounded.taken) for rounded in roundings(rounding, unexpected)}
    assert given["physics.duration"] == (0.02, 0.021)
    assert given["record.every"] == (0.01, 0.012)
    assert rounding_lines(exact) == []
    (line,) = rounding_lines(rounding)
    assert line.startswith("times rounded up at physics.timestep=3 ms: physics.duration 0.02 s to 0.021 s")
    assert "a time of an expectation by up to 0.001 s" in line
    with pytest.raises(SpecError, match="whole number of timesteps"):
        world_of(exact, list(exact)[1])
    # a run of a rounded cell never counts for a cell that is an error without rounding
    assert {cell.key for cell in exact}.isdisjoint(cell.key for cell in rounding)


def test_the_steps_of_cells_with_rounded_times_are_counted_without_resolving():
    made = plan({"over": {"physics.timestep": ["1 ms", "3 ms", "7 ms"]}, "times": "round_up"}, ["dart"])
    assert (
        [Steps(made).of(cell) for cell in made] == [world_of(made, cell).physics.steps for cell in made] == [20, 7, 3]
    )


def test_the_steps_of_a_run_that_is_cut_short():
    moved = {"trajectory": {"until": "10 ms", "points": [{"at": 0, "positions": {"rod": 0}}]}}
    made = plan(
        {"over": {"physics.timestep": ["1 ms", "2 ms"], "trajectory.until": ["4 ms", "1 s"]}}, ["dart"], **moved
    )
    assert [Steps(made).of(cell) for cell in made] == [4, 20, 2, 10]
    assert [Steps(plan(None, ["dart"], **moved)).of(cell) for cell in plan(None, ["dart"], **moved)] == [10]


def test_costs_are_medians_of_the_runs_of_the_spec():
    def row(name, steps, step_seconds, process_seconds, failed=None):
        about = ("", "", "", "", "", "", name, "first", "1.0", failed, 0.001, steps)
        return RunRow(*about, step_seconds, None, process_seconds, 0.0, None, 0, "", 0, 0, 0, "{}")

    rows = [
        row("fall", 100, 0.2, 1.2),
        row("fall", 200, 0.8, 2.3),
        row("fall", 100, 0.6, 4.6),
        row("other", 1, 9.0, 9.0),
    ]
    rows += [row("fall", 100, 7.0, 7.0, failed="step 3"), row("fall", 100, None, 8.0)]
    (cost,) = costs(rows, "fall").values()
    assert (cost.start, cost.step, cost.runs) == pytest.approx((1.5, 0.004, 3))
    assert cost.seconds(1000) == pytest.approx(5.5)
    assert costs(rows, "none of that name")["first"].runs == 4
