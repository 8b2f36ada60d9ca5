"""Horizons and growth of noise whose rate is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.analysis.horizons import first_gap, floors_by_size, growth_rates, horizons, perturbation_of
from simspec.comparison.floor import measure_floor
from simspec.errors import SpecError
from simspec.world.types import Joint
from tests.runner.synthetic import column, free_body, run, world

WORLD = world(free_body("ball"), free_body("cube"), steps=1000)
"""101 records, one each 0.1 s: 10 s."""


def moved(size: float, rate: float, since: float = 0.0, body: str = "ball", **facts):
    """A run that departs from rest by ``size`` exp(``rate`` (t − since)) from ``since`` on, in one body."""
    return run(
        WORLD,
        lambda name, t: column(
            np.where((t > since - 1e-9) & (name == body), size * np.exp(rate * (t - since)), 0.0), 0.0, 0.0
        ),
        **facts,
    )


def rest(**facts):
    return moved(0.0, 0.0, **facts)


def test_the_first_gap_is_where_engines_part():
    gap = first_gap(rest(), moved(4e-5, 1.0, since=2.0, body="cube", engine="second"))
    assert gap is not None
    assert (gap.time, gap.body) == (pytest.approx(2.0), "cube")
    assert gap.size == pytest.approx(4e-5)


def test_round_off_and_noise_are_no_gap():
    assert first_gap(rest(), moved(1e-13, 0.5, engine="second")) is None
    noisy = measure_floor(rest(), [moved(1e-5, 0.0, body="cube", perturb=1e-15)])
    separate = moved(2e-5, 0.5, body="cube", engine="second")
    gap = first_gap(rest(), separate, [noisy])
    assert gap is not None
    assert gap.size == pytest.approx(3e-5, rel=0.06)
    assert first_gap(rest(), separate).time == 0.0


def test_a_gap_that_is_no_number_is_infinite():
    gap = first_gap(rest(), moved(math.nan, 0.0, since=3.0, engine="second"))
    assert gap is not None
    assert (gap.time, gap.size, gap.body) == (pytest.approx(3.0), math.inf, "ball")


def test_the_second_horizon_is_seen_where_the_noise_floor_misses_it():
    """Moved by 1e-15 it stays within 1e-12; moved by 1e-5 it grows as exp(2 t): 1 mm after ln(100)/2 = 2.3 s."""
    entry, other = rest(), moved(1e-5, 2.0, since=1.0, engine="second")
    floor = measure_floor(entry, [moved(1e-15, 0.0, perturb=1e-15)])
    second = measure_floor(entry, [moved(1e-5, 2.0, perturb=1e-5)])
    given = horizons(entry, other, [floor], [second])
    assert given.noise is None
    assert given.second == pytest.approx(2.4)
    assert given.comparable_until == given.second
    assert not given.notes
    missed = horizons(entry, other, [floor])
    assert (missed.second, missed.measured) == (None, False)
    assert "no repeats were moved" in missed.notes[0]


def test_noise_that_grows_has_a_horizon():
    """3 × 1e-6 exp(t) passes 1 mm after ln(333) = 5.8 s."""
    floor = measure_floor(rest(), [moved(1e-6, 1.0, perturb=1e-15)])
    given = horizons(rest(), rest(engine="second"), [floor])
    assert given.noise == pytest.approx(5.9)
    assert given.gap is None


def test_a_perturbation_of_another_size_is_reported():
    floor = measure_floor(rest(), [rest(perturb=1e-15)])
    large = measure_floor(rest(), [moved(1e-3, 0.1, perturb=1e-3)])
    given = horizons(rest(), moved(1e-5, 1.0, engine="second"), [floor], [large])
    assert "another size" in given.notes[0]


def test_floors_by_the_size_of_the_perturbation():
    repeats = [rest(), moved(1e-12, 0.0, perturb=1e-15), moved(1e-4, 0.0, perturb=1e-5)]
    floors = floors_by_size(rest(), repeats)
    assert {size: floor.largest for size, floor in floors.items()} == pytest.approx({1e-15: 1e-12, 1e-5: 1e-4})
    assert floors[1e-15].bitwise is True
    assert floors[1e-5].bitwise is None
    assert floors_by_size(rest(), []) == {}
    assert list(floors_by_size(rest(), [rest()])) == [0.0]


def test_the_perturbation_for_a_gap():
    """Positions of zero are moved by the amount itself; a coordinate of 4 by four times as much."""
    assert perturbation_of(WORLD, 1e-5) == 1e-5
    far = free_body("far")
    joint = Joint("j", "free", position=(4.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
    far = far.__class__(far.name, far.model, far.inertial, joint)
    assert perturbation_of(world(far), 1e-5) == pytest.approx(0.25e-5)
    with pytest.raises(SpecError, match="no body"):
        perturbation_of(world(), 1e-5)


def test_growth_rates_of_an_exponential():
    time = np.linspace(0.0, 10.0, 1001)
    rates = growth_rates(time, 1e-9 * np.exp(1.7 * time))
    assert [size for size, _ in rates] == pytest.approx([10.0**k for k in range(-9, -2)])
    assert [rate for _, rate in rates] == pytest.approx([1.7] * 7, rel=0.01)
    assert growth_rates(time, np.zeros(1001)) == []
