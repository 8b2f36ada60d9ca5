"""Distances of distributions with known values, and tests that reject as often as they say."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from simspec.analysis.distributions import (
    SUMMARY,
    energy_distance,
    median_distance,
    mmd,
    paired,
    permutation_test,
    run_summary,
    sign_flip_test,
    summary_scales,
)
from simspec.errors import SpecError
from tests.runner.synthetic import column, free_body, run, world


def column_of(*values: float):
    return np.array(values, dtype=float)[:, None]


def test_the_energy_distance_of_points():
    """2·3 − 0 − 0 of {0} and {3}; of {0, 2} and {1}: 2·1 − 1 − 0."""
    assert energy_distance(column_of(0.0), column_of(3.0)) == 6.0
    assert energy_distance(column_of(0.0, 2.0), column_of(1.0)) == 1.0
    assert energy_distance(column_of(0.0, 2.0), column_of(2.0, 0.0)) == 0.0


def test_mmd_of_points():
    """2 − 2 exp(−d²/2h²) of two points at the distance d."""
    assert mmd(column_of(0.0), column_of(3.0), 1.5) == pytest.approx(2.0 - 2.0 * math.exp(-2.0))
    assert median_distance(column_of(0.0, 1.0), column_of(3.0)) == 2.0
    with pytest.raises(ValueError, match="positive"):
        mmd(column_of(0.0), column_of(3.0), 0.0)


@pytest.mark.parametrize("bandwidth", [None, 0.7])
def test_all_permutations_at_once_are_each_alone(bandwidth):
    generator = np.random.default_rng(2)
    x, y = generator.normal(size=(3, 2)), generator.normal(0.5, 1.0, size=(4, 2))
    test = permutation_test(x, y, bandwidth)
    both = np.concatenate([x, y])
    of = energy_distance if bandwidth is None else lambda a, b: mmd(a, b, bandwidth)
    every = []
    for chosen in itertools.combinations(range(7), 3):
        rest = [k for k in range(7) if k not in chosen]
        every.append(of(both[list(chosen)], both[rest]))
    assert test.exact
    assert test.permutations == 35
    assert test.statistic == pytest.approx(of(x, y))
    assert test.p == pytest.approx(np.mean(np.array(every) >= every[0] - 1e-12))
    assert test.smallest == pytest.approx(1 / 35)


def test_few_runs_cannot_reject():
    """3 and 3 runs at any distance: p = 2/20."""
    test = permutation_test(column_of(0.0, 0.1, 0.2), column_of(1e6, 1e6 + 1, 1e6 + 2))
    assert (test.p, test.smallest) == (0.1, 0.1)
    assert not test.can_reject
    assert not test.rejects
    assert str(test).startswith("cannot reject")
    assert permutation_test(column_of(0, 0.1, 0.2, 0.3), column_of(9.0, 8.0, 7.0, 6.0)).rejects  # 2/70


def test_many_runs_are_drawn():
    generator = np.random.default_rng(3)
    x = generator.normal(size=(20, 1))
    test = permutation_test(x, x + 5.0)
    assert (test.exact, test.permutations, test.p) == (False, 10_000, 1e-4)
    assert permutation_test(x, x[::-1]).p == 1.0
    assert permutation_test(x, x + 0.5, seed=1) == permutation_test(x, x + 0.5, seed=1)


def test_a_test_of_equal_distributions_rejects_as_often_as_its_level():
    generator = np.random.default_rng(4)
    rejected = sum(
        permutation_test(generator.normal(size=(5, 2)), generator.normal(size=(5, 2))).rejects for _ in range(400)
    )
    assert rejected / 400 <= 0.075


@pytest.mark.parametrize(("pairs", "smallest"), [(3, 0.25), (4, 0.125), (6, 0.03125)])
def test_the_smallest_p_of_pairs(pairs, smallest):
    test = sign_flip_test(np.arange(1.0, pairs + 1.0))
    assert (test.p, test.smallest, test.exact) == (smallest, smallest, True)
    assert test.can_reject == test.rejects == (pairs >= 6)


def test_sign_flips_have_the_p_of_the_sums():
    """Of ±1 ±2 ±4 the sums are −7, −5, ..., 7: |1 + 2 − 4| = 1 is reached by all 8."""
    assert sign_flip_test(np.array([1.0, 2.0, -4.0])).p == 1.0
    assert sign_flip_test(np.array([1.0, -2.0, 4.0])).p == 0.75
    two = sign_flip_test(np.array([[1.0, 0.0], [2.0, 0.0], [4.0, 100.0]]))
    assert two.statistic == pytest.approx(100.0 / 3.0)
    many = sign_flip_test(np.full(30, 1.0))
    assert (many.exact, many.p) == (False, 1e-4)


def test_nothing_is_no_sample():
    with pytest.raises(ValueError, match="pairs"):
        sign_flip_test(np.zeros((0, 2)))
    with pytest.raises(ValueError, match="both"):
        permutation_test(np.zeros((0, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="finite"):
        sign_flip_test(np.array([1.0, np.nan]))


def test_pairs_need_the_same_seeds():
    values = {2: np.array([2.0]), 1: np.array([1.0])}
    x, y = paired(values, {1: np.array([3.0]), 2: np.array([4.0])})
    assert (x[:, 0].tolist(), y[:, 0].tolist()) == ([1.0, 2.0], [3.0, 4.0])
    with pytest.raises(SpecError, match="same seeds"):
        paired(values, {1: np.array([3.0])})
    with pytest.raises(SpecError, match="same seeds"):
        paired({}, {})


PLACES = {"a": 3.0, "b": -3.0, "c": 0.0}


def spread_run(gravity: float = -10.0):
    """Three bodies at x = 3, −3, 0, height 1, that move with 2 m/s; mass 2 kg, sum of the moments 1.2 kg m²."""
    return run(
        world(*(free_body(name) for name in PLACES), gravity=gravity),
        lambda name, t: column(np.full_like(t, PLACES[name]), 0.0, 1.0),
        lambda name, t: column(np.full_like(t, 2.0), 0.0, 0.0),
    )


def test_a_summary_of_a_run():
    given = dict(zip(SUMMARY, run_summary(spread_run()).tolist(), strict=True))
    assert given == pytest.approx(
        {
            "rms_radius": math.sqrt(6.0),
            "median_radius": 3.0,
            "mean_height": 1.0,
            "mean_speed": 2.0,
            "kinetic_energy": 12.0,
        }
    )


def test_the_scales_are_physical():
    """Size 2 √(1.2 / 4); √(g d); 3 m g d. Without gravity: the speed and energy of the beginning."""
    size = 2.0 * math.sqrt(0.3)
    assert summary_scales(spread_run()) == pytest.approx([size, size, size, math.sqrt(10 * size), 60.0 * size])
    assert summary_scales(spread_run(gravity=0.0)) == pytest.approx([size, size, size, 2.0, 12.0])


def test_a_failed_run_has_no_summary():
    with pytest.raises(SpecError, match="no whole result"):
        run_summary(dataclasses.replace(spread_run(), failed="it fell over"))
