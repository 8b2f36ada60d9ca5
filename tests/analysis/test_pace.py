"""Speed over time from seconds that say what they are."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.analysis.speed import over_time, paced, step_cost
from simspec.engines.kit.arrays import SECONDS
from simspec.errors import SpecError
from tests.runner.synthetic import free_body, run, world

WORLD = world(free_body("a"), free_body("b"))
"""100 steps of 10 ms, a record every 10: 11 rows in 1 s."""


def spending(*steps: float, **more):
    """A run whose ten intervals between rows cost so many seconds of steps, and half of it processor time."""
    seconds = np.zeros((11, len(SECONDS)))
    seconds[1:, SECONDS.index("step")] = np.cumsum(steps)
    seconds[1:, SECONDS.index("step_cpu")] = 0.5 * np.cumsum(steps)
    return dataclasses.replace(run(WORLD, **more), seconds=seconds)


def pace(*runs, **more):
    return over_time([paced(run) for run in runs], **more)


def test_each_interval_has_a_cost():
    of = pace(spending(*[0.1] * 5, *[0.2] * 5))
    assert of.intervals == tuple((pytest.approx(k / 10), pytest.approx((k + 1) / 10)) for k in range(10))
    assert of.real_time_factors == pytest.approx([1.0] * 5 + [0.5] * 5)
    assert of.cpu_factors == pytest.approx([2.0] * 5 + [1.0] * 5)
    assert of.seconds["step"] == pytest.approx([0.1] * 5 + [0.2] * 5)
    assert of.seconds["control"] == (0.0,) * 10


def test_rows_are_put_together_and_the_rest_is_not_lost():
    of = pace(spending(*[0.1] * 10), intervals=4)
    assert of.intervals == tuple(pytest.approx(pair) for pair in ((0.0, 0.3), (0.3, 0.6), (0.6, 0.9), (0.9, 1.0)))
    assert of.seconds["step"] == pytest.approx([0.3, 0.3, 0.3, 0.1])
    assert of.real_time_factors == pytest.approx([1.0] * 4)


def test_a_disturbed_repeat_does_not_count():
    quiet, disturbed = spending(*[0.1] * 10), spending(*[0.1] * 3, 7.0, *[0.1] * 6)
    assert pace(quiet, disturbed, quiet).real_time_factors == pytest.approx([1.0] * 10)


def test_contacts_are_those_of_the_records_in_the_interval():
    contacts = [(0, 0, 1, -0.1, 1.0), (1, 0, 1, -0.1, 1.0), (2, 0, 1, -0.1, 1.0), (2, 0, 1, -0.1, 1.0)]
    of = pace(spending(*[0.1] * 10, contacts=contacts), intervals=5)
    assert of.contacts == (1.5, 0.0, 0.0, 0.0, 0.0)  # the initial state's are of no interval


def test_values_not_measured_in_every_run_are_none():
    silent = dataclasses.replace(spending(*[0.1] * 10), seconds=None)
    of = pace(spending(*[0.1] * 10), silent)
    assert of.real_time_factors == (None,) * 10
    assert of.seconds["record"] == (None,) * 10
    assert of.contacts == (0.0,) * 10
    unrecorded = dataclasses.replace(silent, arrays={k: v for k, v in silent.arrays.items() if k[:7] != "contact"})
    assert pace(unrecorded).contacts == (None,) * 10
    assert pace(spending(0.0, *[0.1] * 9)).real_time_factors[0] is None


def test_runs_that_cannot_be_put_together_are_refused():
    longer = dataclasses.replace(WORLD, physics=dataclasses.replace(WORLD.physics, steps=110))
    for runs in ((), (spending(*[0.1] * 10), run(WORLD, engine="other")), (spending(*[0.1] * 10), run(longer))):
        with pytest.raises(SpecError):
            pace(*runs)


def test_of_repeats_the_fastest_of_each_interval_counts():
    """Each repeat is disturbed at another time: together they say what the quiet machine takes."""
    runs = [spending(*[9.0 if k == disturbed else 0.1 for k in range(10)]) for disturbed in (2, 5, 7)]
    cost = step_cost([paced(run) for run in runs], 100)
    assert cost.quiet["step"] == pytest.approx(0.01)
    assert cost.quiet["step_cpu"] == pytest.approx(0.005)
    assert cost.quiet["control"] == 0.0
    assert cost.median["step"] == pytest.approx((9 * 0.1 + 9.0) / 100)
    alone = step_cost([paced(runs[0])], 100)
    assert alone.quiet == pytest.approx(alone.median)
    assert alone.median == pytest.approx(cost.median)


def test_a_cost_needs_measured_repeats_of_a_run():
    silent = dataclasses.replace(spending(*[0.1] * 10), seconds=None)
    assert step_cost([paced(spending(*[0.1] * 10)), paced(silent)], 100) is None
    assert step_cost([paced(spending(*[0.1] * 10))], 0) is None
    with pytest.raises(SpecError, match="no runs"):
        step_cost([], 100)
    with pytest.raises(SpecError, match="one engine"):
        step_cost([paced(spending(*[0.1] * 10)), paced(spending(*[0.1] * 10, engine="second"))], 100)
