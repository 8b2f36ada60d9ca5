"""Numbers that give the pairs, where there are such numbers, and other numbers where there are none."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.contact import Rules, _cross, _harmonic, _mean, combined
from simspec.world.types import Surface


@settings(max_examples=60, deadline=None)
@given(count=st.integers(2, 7), seed=st.integers(0, 10**6), ring=st.booleans())
def test_crossed_numbers_that_exist_are_found(count, seed, ring):
    """Materials that meet along a tree, or a tree and one pair more: any ρ ≥ 0 behind the values are numbers for them."""
    generator = random.Random(seed)
    names = [f"m{index}" for index in range(count)]
    friction = {name: generator.uniform(0.1, 1.0) for name in names}
    behind = {name: generator.choice((0.0, generator.uniform(0.0, 0.02))) for name in names}
    met = [(names[generator.randrange(index)], names[index]) for index in range(1, count)]
    generator.shuffle(met)
    if ring and count > 2:
        met.append((names[0], names[-1]))
    values = {
        (a, b): (behind[a] + behind[b]) * friction[a] * friction[b]
        for a, b in sorted({tuple(sorted(pair)) for pair in met})
    }
    found = _cross(names, values, friction)
    assert min(found.values()) >= 0.0
    for (a, b), value in values.items():
        assert found[a] * friction[b] + found[b] * friction[a] == pytest.approx(value, rel=1e-12, abs=1e-15)


def test_two_materials_that_meet_each_other_alone_have_half_each():
    found = _cross(["a", "b"], {("a", "b"): 0.004}, {"a": 0.5, "b": 0.25})
    # ρ₁ + ρ₂ = c/(μ₁ μ₂) = 0.032 m, half of it each, times μ
    assert found == {"a": pytest.approx(0.008), "b": pytest.approx(0.004)}


@pytest.mark.parametrize(
    "values",
    [
        {("a", "a"): 0.5},
        {("a", "b"): 0.3},
        {("a", "a"): 0.5, ("a", "b"): 0.3},
        {("a", "a"): 0.6, ("a", "b"): 0.4, ("b", "b"): 0.3},
        {("a", "a"): 0.0, ("a", "b"): 0.0, ("b", "b"): 0.7},
        {("a", "b"): 0.4, ("a", "c"): 0.5, ("b", "c"): 0.6},
    ],
)
def test_the_harmonic_mean_is_inverted(values):
    numbers = _harmonic(("a", "b", "c"), values, dict.fromkeys("abc", 0.2))
    rules = Rules("harmonic", "none")
    for (entry, other), value in values.items():
        pair = [Surface(numbers[name]) for name in (entry, other)]
        assert combined(rules, "friction", *pair) == pytest.approx(value, abs=1e-15)


@pytest.mark.parametrize(
    "values",
    [
        {("a", "a"): 0.5},
        {("a", "b"): 0.3},
        {("a", "a"): 0.2, ("a", "b"): 0.5},
        {("a", "a"): 0.2, ("a", "b"): 0.3, ("b", "b"): 0.4},
        {("a", "b"): 0.0, ("b", "c"): 0.7},
        {("a", "b"): 0.4, ("a", "c"): 0.5, ("b", "c"): 0.6},
    ],
)
def test_the_mean_is_inverted(values):
    numbers = _mean(("a", "b", "c", "d"), values, dict.fromkeys("abcd", 0.2), math.inf)
    for (entry, other), value in values.items():
        pair = [Surface(numbers[name]) for name in (entry, other)]
        assert combined(Rules("mean", "mean"), "friction", *pair) == pytest.approx(value, abs=1e-15)
    assert numbers["d"] == 0.2  # it meets nothing


def test_values_that_no_mean_gives_are_missed():
    """A number below zero, or above the largest that a shape can hold."""
    assert _mean("ab", {("a", "a"): 0.5, ("a", "b"): 0.2}, dict.fromkeys("ab", 0.2), math.inf)["b"] == 0.0
    assert _mean("ab", {("a", "a"): 0.1, ("a", "b"): 0.8}, dict.fromkeys("ab", 0.2), 1.0)["b"] == 1.0


def test_values_that_no_harmonic_mean_gives_are_missed():
    """Half of a number cannot be had: the mean of x and anything is more than that, up to 2 x."""
    numbers = _harmonic(("a", "b"), {("a", "a"): 0.2, ("a", "b"): 0.5}, {"a": 0.1, "b": 0.1})
    assert numbers["b"] == 0.0
