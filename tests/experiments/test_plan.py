"""The plan of a sweep: which runs, in which order, with which keys."""

from __future__ import annotations

import itertools
import tracemalloc

import pytest

from simspec.errors import SpecError
from simspec.experiments.plan import plan_sweep
from tests.experiments.swept import ENGINES, SWEEP, VERSIONS, spec


def plan(sweep=None, engines=ENGINES, versions=VERSIONS, **more):
    return plan_sweep(spec(sweep, **more), engines=engines, versions=versions)


def test_a_spec_without_a_sweep_is_run_once_in_each_engine():
    first, second = plan()
    assert (first.engine, second.engine) == ENGINES
    assert first.overrides == ()
    assert (first.case, first.sample, first.repeat, first.perturb, first.seed) == (None, None, 0, 0.0, None)


def test_the_number_of_runs_is_the_product_of_all_parts():
    made = plan(SWEEP)
    cells = list(made)
    assert len(made) == len(cells) == 2 * 3 * 2 * 2 * 2 * 3 * 2 * 2
    assert [cell.index for cell in cells] == list(range(len(cells)))
    assert len({cell.key for cell in cells}) == len(cells)
    assert made.worlds == len({cell.overrides for cell in cells}) == 48
    assert made.describe()["runs"] == len(cells)
    assert list(made) == cells, "a plan gives the same cells every time"


def test_engines_take_turns_and_the_rest_follows_in_the_stated_order():
    cells = list(plan(SWEEP))
    assert [cell.engine for cell in cells[:4]] == [*ENGINES, *ENGINES]
    assert [cell.repeat for cell in cells[:6]] == [0, 0, 1, 1, 0, 0]
    assert [cell.seed for cell in cells[:12:2]] == [None, None, 1, 1, 2, 2]
    assert [cell.perturb for cell in cells[:12:4]] == [0.0, 1e-9, 1e-9]
    order = [(cell.sample, cell.case) for cell in cells]
    assert [key for key, _ in itertools.groupby(order)] == [(0, None), (0, "heavy"), (1, None), (1, "heavy")]


def test_values_are_put_in_in_the_order_case_grid_together_samples():
    cell = list(plan(SWEEP))[-1]
    paths = [path for path, _ in cell.overrides]
    swept = ["physics.gravity.2", "physics.timestep", "bodies.rod.mass", "physics.duration", "record.every"]
    assert paths == [*swept, "bodies.ball.mass"]
    values = dict(cell.overrides)
    assert (values["physics.duration"], values["record.every"]) == ("40 ms", "20 ms")


def test_only_cases_leaves_the_plain_scenario_out():
    assert [cell.case for cell in plan({"cases": SWEEP["cases"], "only_cases": True}, ["dart"])] == ["heavy"]


def test_engines_of_the_sweep_those_of_the_call_and_those_that_are_not_known():
    made = plan({"engines": ["dart", "mujoco@3.8"]}, None)
    assert [cell.engine for cell in made] == ["dart", "mujoco@3.8"]
    assert [cell.engine for cell in plan({"engines": ["dart"]}, ["mujoco"])] == ["mujoco"]
    with pytest.raises(SpecError, match="no such engine"):
        plan({"engines": ["mujoco", "nosuch"]}, None)
    with pytest.raises(SpecError, match="names no engine"):
        plan({"repeat": 2}, None)
    with pytest.raises(ValueError, match="no versions given of dart"):
        plan(versions={"mujoco": {}})


def test_too_many_runs_once_the_engines_are_known():
    many = {"perturb": {"amount": 1e-9, "seeds": 4_999_999}, "repeat": 2}
    assert len(plan(many, ["dart"])) == 10_000_000
    with pytest.raises(SpecError, match="too many runs") as error:
        plan(many)
    assert "5,000,000" not in str(error.value)
    assert "20,000,000" in str(error.value)


def test_a_plan_of_many_runs_is_made_lazily():
    many = {"perturb": {"amount": 1e-9, "seeds": 1_000_000}, "samples": {**SWEEP["samples"], "count": 9}}
    made = plan(many, ["dart"])
    assert len(made) == 9_000_009
    tracemalloc.start()
    for _ in itertools.islice(made, 20_000):
        pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_000_000, "bytes: cells that were looked at are not kept"


def test_samples_follow_from_the_seed_and_their_path_alone():
    drawn = {"bodies.ball.mass": {"uniform": ["1 kg", "2 kg"]}}
    more = {"bodies.rod.mass": {"normal": [2, 0.1]}, **drawn, "physics.gravity.2": {"choice": [-9.81, -1.62]}}

    def masses(count, values, seed=7):
        cells = plan({"samples": {"count": count, "seed": seed, "values": values}}, ["dart"])
        return [dict(cell.overrides)["bodies.ball.mass"] for cell in cells]

    few = masses(5, drawn)
    assert few == masses(50, more)[:5]
    assert few != masses(5, drawn, seed=8)
    assert all(text.endswith(" kg") and 1.0 <= float(text[:-3]) <= 2.0 for text in masses(50, drawn))


def test_values_of_distributions_are_drawn():
    """Means and spreads of 2000 samples, within four standard errors of what they should be."""
    values = {
        "bodies.rod.mass": {"uniform": [1, 3]},
        "bodies.ball.mass": {"normal": [5, 0.5]},
        "bodies.rod.joint.damping": {"log_uniform": [1e-3, 1e1]},
        "physics.gravity.2": {"choice": [-9.81, -9.81, -1.62]},
    }
    cells = list(plan({"samples": {"count": 2000, "seed": 1, "values": values}}, ["dart"]))
    drawn = {path: [dict(cell.overrides)[path] for cell in cells] for path in values}
    error = 1.0 / 2000**0.5
    assert abs(sum(drawn["bodies.rod.mass"]) / 2000 - 2.0) < 4 * error * 2 / 12**0.5
    assert abs(sum(drawn["bodies.ball.mass"]) / 2000 - 5.0) < 4 * error * 0.5
    assert abs(sum(value < 0.1 for value in drawn["bodies.rod.joint.damping"]) / 2000 - 0.5) < 4 * error * 0.5
    assert abs(drawn["physics.gravity.2"].count(-1.62) / 2000 - 1 / 3) < 4 * error * (2 / 9) ** 0.5
    assert min(drawn["bodies.rod.joint.damping"]) >= 1e-3


@pytest.mark.parametrize(
    ("entries", "index", "name"),
    [
        ([{"above": "1 ms", "settings": {"iteration": 3}}], 0, "iteration"),
        ([{"above": "1 ms", "settings": {"iterations": 0}}], 0, "iterations"),
        ([{"above": "1 ms", "settings": {"iterations": 3}}, {"above": 1, "settings": {"solver": "none"}}], 1, "solver"),
        # a value that an entry switches off has no effect where the entry applies
        (
            [{"above": "1 ms", "settings": {"ls_iterations": 3}}, {"above": 1, "settings": {"solver": "pgs"}}],
            0,
            "ls_iterations",
        ),
    ],
)
def test_settings_by_timestep_are_checked_at_each_of_their_timesteps(entries, index, name):
    with pytest.raises(SpecError) as error:
        plan_sweep(spec(engines={"mujoco": {"at_timestep": entries}}), engines=["dart"], versions=VERSIONS)
    assert [problem.path for problem in error.value.problems] == [f"engines.mujoco.at_timestep.{index}.settings.{name}"]
