"""Intervals of known width."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.analysis.tables import ratio, share, spread


def test_a_share_has_the_interval_of_clopper_and_pearson():
    """The textbook's: of n successes in n trials the interval begins at (α/2)^(1/n); the others solve the binomial sums."""
    whole = share(10, 10)
    assert whole.lower == pytest.approx(0.025**0.1)
    assert (whole.value, whole.upper) == (1.0, 1.0)
    none = share(0, 3)
    assert none.upper == pytest.approx(1.0 - 0.025 ** (1 / 3))
    assert none.lower == 0.0
    some = share(7, 10, level=0.9)
    tail = lambda p, ks: sum(math.comb(10, k) * p**k * (1 - p) ** (10 - k) for k in ks)  # noqa: E731
    assert tail(some.lower, range(7, 11)) == pytest.approx(0.05)
    assert tail(some.upper, range(8)) == pytest.approx(0.05)


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (4, 3), (-1, 3)])
def test_a_share_of_nothing_is_refused(successes, trials):
    with pytest.raises(ValueError, match="trials"):
        share(successes, trials)


def test_a_spread_is_students_interval_of_the_logarithms():
    given = spread([math.exp(1), math.exp(2), math.exp(3)])
    half = 4.302652730 / math.sqrt(3.0)  # t of 2 degrees of freedom, 0.975
    assert given.mean is not None
    assert math.log(given.mean.lower) == pytest.approx(2.0 - half)
    assert math.log(given.mean.upper) == pytest.approx(2.0 + half)
    assert (given.processes, given.median, given.least, given.most) == (3, math.exp(2), math.exp(1), math.exp(3))
    assert "3 processes" in str(given)


def test_a_single_process_has_no_spread():
    alone = spread([2.0])
    assert alone.mean is None
    assert alone.median == 2.0
    assert "1 process, spread unknown" in str(alone)
    assert ratio(alone, spread([1.0, 2.0])) is None


@pytest.mark.parametrize("values", [[], [1.0, 0.0], [1.0, float("nan")], [-1.0, 2.0]])
def test_values_that_are_not_positive_have_no_spread(values):
    with pytest.raises(ValueError, match="positive"):
        spread(values)


def test_the_interval_of_a_mean_holds_what_it_says():
    generator = np.random.default_rng(1)
    number = 0
    for _ in range(400):
        interval = spread(np.exp(generator.normal(1.0, 0.3, 5)).tolist()).mean
        assert interval is not None
        number += interval.lower <= math.e <= interval.upper
    assert 0.92 <= number / 400 <= 0.98


def test_a_ratio_is_welchs_interval():
    from scipy.stats import ttest_ind

    first, second = [2.0, 2.2, 2.4], [1.0, 1.1, 0.9, 1.05]
    interval = ratio(spread(first), spread(second))
    assert interval is not None
    theirs = ttest_ind(np.log(first), np.log(second), equal_var=False).confidence_interval(0.95)
    assert math.log(interval.lower) == pytest.approx(theirs.low)
    assert math.log(interval.upper) == pytest.approx(theirs.high)
    same = ratio(spread([2.0, 2.0]), spread([1.0, 1.0]))
    assert same is not None
    assert (same.lower, same.value, same.upper) == (2.0, 2.0, 2.0)
