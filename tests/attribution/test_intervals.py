"""Intervals of shares: their quantities, their dependencies, and the claims made with them."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from simspec.attribution.measure import FEWEST, Draws, above
from simspec.attribution.windows import ALL, Windows
from tests.attribution.planted import world


def draws(kinds, quiet=None):
    kinds = np.array(kinds)
    nothing = np.zeros((len(kinds), 0))
    counts = {name: int((kinds == index).sum()) for index, name in enumerate(("free", "impact", "contact"))}
    windows = Windows(
        world(), Fraction(1, 100), np.arange(len(kinds)), nothing, nothing, kinds, counts, (nothing, nothing)
    )
    return Draws(windows, np.ones(len(kinds), dtype=bool) if quiet is None else np.array(quiet))


def test_equal_shares_in_every_window_give_an_interval_of_zero_width():
    whole = np.linspace(1.0, 2.0, 40)
    for low, high in draws([2] * 40).share(0.25 * whole, whole).values():
        assert low == pytest.approx(0.75)
        assert high == pytest.approx(0.75)


def test_the_interval_contains_the_share_and_is_wide_where_windows_disagree():
    generator = np.random.default_rng(1)
    whole = np.ones(120)
    gap = generator.uniform(0.0, 1.0, 120)
    low, high = draws([2] * 120).share(gap, whole)["contact"]
    assert low < 1.0 - gap.mean() < high
    fewer = draws([2] * 12).share(gap[:12], whole[:12])["contact"]
    assert fewer[1] - fewer[0] > high - low


def test_neighbours_that_repeat_each_other_widen_it():
    generator = np.random.default_rng(2)
    alone = generator.uniform(0.0, 1.0, 128)
    repeated = np.repeat(alone[:32], 4)
    widths = [np.ptp(draws([2] * 128).share(gap, np.ones(128))["contact"]) for gap in (alone, repeated)]
    assert widths[1] > 1.4 * widths[0]


def test_few_windows_have_no_interval_nor_has_a_mean_over_them():
    kinds = [1] * (FEWEST - 1) + [2] * 20
    intervals = draws(kinds).share(np.ones(len(kinds)), np.ones(len(kinds)))
    assert set(intervals) == {"contact"}
    assert set(draws([2] * 20).share(np.ones(20), np.ones(20))) == {"contact", ALL}


def test_windows_that_do_not_count_are_not_drawn():
    quiet = [True] * 10 + [False] * 10
    gap = np.where(quiet, 0.5, 1e6)
    low, high = draws([2] * 20, quiet).share(gap, np.ones(20))["contact"]
    assert (low, high) == (pytest.approx(0.5), pytest.approx(0.5))


def test_the_same_windows_give_the_same_interval():
    gap = np.linspace(0.0, 1.0, 30)
    entry, other = (draws([2] * 30).share(gap, np.ones(30)) for _ in range(2))
    assert entry == other


def test_a_share_of_either_sign_is_not_claimed():
    assert above(None)
    assert above((0.1, 0.4))
    assert above((-0.4, -0.1))
    assert not above((-0.1, 0.4))
