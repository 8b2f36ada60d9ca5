"""Repeats that differ where they were made to."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.analysis.horizons import determinism
from simspec.errors import SpecError
from tests.runner.synthetic import column, free_body, run, world

WORLD = world(free_body("ball"), steps=200)


def falling(**facts):
    return run(WORLD, lambda name, t: column(0.0, 0.0, -5.0 * t**2), **facts)


def changed(row: int, name: str, by: float):
    repeat = falling()
    values = np.array(repeat.arrays[name])
    values[row].flat[0] = values[row].flat[0] + by if by else -0.0
    return dataclasses.replace(repeat, arrays={**repeat.arrays, name: values})


def test_equal_bits():
    given = determinism([falling(), falling(), falling()])
    assert given.bitwise
    assert str(given) == "3 runs, bitwise equal"


def test_the_first_difference_is_named():
    given = determinism([falling(), falling(), changed(12, "pose", 1e-12), changed(7, "velocity", 0.5)])
    assert not given.bitwise
    assert [(departure.repeat, departure.array, departure.time) for departure in given.departures] == [
        (2, "pose", pytest.approx(1.2)),
        (3, "velocity", pytest.approx(0.7)),
    ]
    assert given.departures[0].size == pytest.approx(1e-12)
    assert str(given) == "2 of 3 repeats differ, the first from 1.2 s on, in pose"


def test_of_several_arrays_the_earliest_counts():
    early, late = changed(3, "q", 0.1), changed(12, "velocity", 0.5)
    both = dataclasses.replace(early, arrays={**early.arrays, "velocity": late.arrays["velocity"]})
    (only,) = determinism([falling(), both]).departures
    assert (only.array, only.time) == ("q", pytest.approx(0.3))


def test_another_bit_of_the_same_number_is_a_difference():
    """−0.0 is 0.0, and not its bits."""
    (only,) = determinism([falling(), changed(3, "v", 0.0)]).departures
    assert (only.array, only.size) == ("v", 0.0)


def test_fewer_rows_are_a_difference():
    short = falling()
    short = dataclasses.replace(short, arrays={name: values[:5] for name, values in short.arrays.items()})
    (only,) = determinism([falling(), short]).departures
    assert (only.time, only.size) == (None, None)


def test_runs_that_are_no_repeats_are_refused():
    with pytest.raises(SpecError, match="at least two"):
        determinism([falling()])
    with pytest.raises(SpecError, match="not repeats") as refused:
        determinism([falling(), falling(perturb=1e-15)])
    assert refused.value.problems[0].found == "other perturb"
    with pytest.raises(SpecError, match="not repeats"):
        determinism([falling(), falling(engine="second")])
    with pytest.raises(SpecError, match="recorded nothing"):
        determinism([falling(), dataclasses.replace(falling(), arrays={}, failed="it fell over")])
