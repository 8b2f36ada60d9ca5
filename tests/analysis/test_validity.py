"""Limits of validity of trials whose limit is known."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.analysis.validity import TimestepTrial, limit, trial
from simspec.errors import SpecError
from simspec.runner.expectations import Outcome
from tests.runner.synthetic import free_body, run, world

MS = 1e-3


def trials(valid: dict[float, list[bool]]):
    return [
        TimestepTrial(step * MS, seed, good, "" if good else f"cup off by {step:g} cm")
        for step, some in valid.items()
        for seed, good in enumerate(some, 1)
    ]


def test_the_limit_is_below_the_first_failure_and_not_above():
    """One seed of three fails at 4 ms; that all are valid at 8 ms again does not count."""
    given = limit(trials({8: [True] * 3, 1: [True] * 3, 4: [True, False, True], 2: [True] * 3}))
    assert given.timestep == 2 * MS
    assert given.first_invalid == 4 * MS
    assert given.later_valid == (8 * MS,)
    assert given.first_failure == "at 4 ms 1 of 3 runs not valid: seed 2: cup off by 4 cm"
    assert list(given.shares) == [1 * MS, 2 * MS, 4 * MS, 8 * MS]
    assert given.shares[4 * MS].value == pytest.approx(2 / 3)
    assert given.shares[2 * MS].lower == pytest.approx(0.025 ** (1 / 3))
    assert not given.fewer_seeds


def test_where_nothing_fails_the_limit_is_open():
    given = limit(trials({1: [True] * 10, 2: [True] * 10}))
    assert (given.timestep, given.first_invalid, given.first_failure) == (2 * MS, None, "")
    assert str(given) == "at least 2 ms (10 runs, share ≥ 0.69)"


def test_where_the_smallest_fails_there_is_no_limit():
    given = limit(trials({1: [False], 2: [True]}))
    assert given.timestep is None
    assert str(given).startswith("not valid at any timestep; at 1 ms 1 of 1 run not valid")


def test_missing_seeds_are_reported_and_duplicates_refused():
    assert limit(trials({1: [True] * 3, 2: [True] * 2})).fewer_seeds == (2 * MS,)
    with pytest.raises(SpecError, match="seed 1 was run more than once at 1 ms"):
        limit(trials({1: [True]}) * 2)
    with pytest.raises(SpecError, match="no runs"):
        limit([])


def test_a_run_is_valid_where_everything_expected_holds():
    of = run(world(free_body("ball")), seed=3)
    good = Outcome("position", True, 0.001, 0.01, "m", "cup at 8 s")
    bad = dataclasses.replace(good, passed=False, measured=0.012)
    assert trial(of, [good]) == TimestepTrial(0.01, 3, True, "")
    assert trial(of, [good, bad, bad]).reason == "position: 12 mm, bound 10 mm (cup at 8 s), and 1 more"
    unmeasured = Outcome("no_penetration", False, None, 0.01, "", "no contacts recorded")
    assert trial(of, [unmeasured]).reason == "no penetration: no contacts recorded"
    assert trial(dataclasses.replace(of, failed="it fell over"), []).reason == "failed: it fell over"


def test_nothing_expected_shows_nothing():
    with pytest.raises(SpecError, match="nothing is expected"):
        trial(run(world(free_body("ball"))), [])
