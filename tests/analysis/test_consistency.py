"""An engine against itself at other timesteps: free fall by semi-implicit Euler, whose deviations are known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.analysis.horizons import consistency, convergence
from simspec.errors import SpecError
from tests.runner.synthetic import free_body, run, world


def falling(timestep: float, order: int = 1, **facts):
    """Free fall with the error that an integrator of some order makes: z = −½ g t² − ½ g t dtᵖ (p = 1: semi-implicit Euler)."""
    of = world(free_body("ball"), free_body("cube"))
    steps = round(1.0 / timestep)
    of = dataclasses.replace(of, physics=dataclasses.replace(of.physics, timestep=timestep, steps=steps))
    return run(of, lambda name, t: _fall(t, timestep**order), **facts)


def _fall(t, error):
    place = np.zeros((len(t), 3))
    place[:, 2] = -5.0 * t**2 - 5.0 * t * error
    return place


def test_free_fall_departs_by_the_drift():
    given = consistency(falling(0.004), falling(0.002))
    assert len(given.time) == 26  # in steps of 40 ms in one, of 20 ms in the other
    assert given.drift == pytest.approx(5.0 * given.time * 0.002)
    assert given.rms == pytest.approx(given.drift)
    assert given.largest == pytest.approx(given.drift)
    assert given.time[given.row(0.3)] == pytest.approx(0.28)


@pytest.mark.parametrize("order", [1, 2])
def test_the_order_is_observed(order):
    given = convergence([falling(0.002, order), falling(0.004, order), falling(0.001, order)])
    assert given.timesteps == (0.004, 0.002, 0.001)
    assert np.isnan(given.order[0])  # at the beginning nothing differs
    assert given.order[1:] == pytest.approx(order)
    assert given.error[1:] == pytest.approx(5.0 * given.time[1:] * 0.001**order)


def recorded_at(first, times):
    """A run whose rows, but the first, are said to be of other times."""
    return dataclasses.replace(first, arrays={**first.arrays, "time": np.concatenate([first.time[:1], times])})


def test_records_that_never_meet_are_no_consistency():
    coarse, middle, fine = falling(0.004), falling(0.002), falling(0.001)
    # as of a sweep that rounds times up: every record of one lies between two steps of the other
    separate = recorded_at(middle, middle.time[1:] + 0.0013)
    with pytest.raises(SpecError, match="no recorded time in common but the beginning"):
        consistency(coarse, separate)
    with pytest.raises(SpecError, match="no recorded time in common but the beginning"):
        convergence([coarse, separate, fine])
    # each pair meets, and never all three
    some = recorded_at(fine, np.where(np.arange(1, len(fine.time)) % 4 == 0, fine.time[1:] + 0.0006, fine.time[1:]))
    assert len(consistency(middle, some).time) > 1
    with pytest.raises(SpecError, match="the three runs have no recorded time in common but the beginning"):
        convergence([coarse, middle, some])


def test_runs_of_several_scenarios_are_refused():
    with pytest.raises(SpecError, match="smaller timestep"):
        consistency(falling(0.002), falling(0.002))
    with pytest.raises(SpecError, match="not one scenario"):
        consistency(falling(0.004), falling(0.002, engine="second"))
    other = falling(0.002)
    lighter = dataclasses.replace(
        other.world, physics=dataclasses.replace(other.world.physics, gravity=(0.0, 0.0, -1.0))
    )
    with pytest.raises(SpecError, match="not one scenario"):
        consistency(falling(0.004), dataclasses.replace(other, world=lighter))
    with pytest.raises(SpecError, match="one ratio"):
        convergence([falling(0.004), falling(0.002), falling(0.0005)])
    with pytest.raises(SpecError, match="one ratio"):
        convergence([falling(0.004), falling(0.002)])
