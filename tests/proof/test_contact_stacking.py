"""The probe of stacks: without friction sliding cubes are measured while they lie on each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.proof.contact import stacks
from simspec.proof.contact.probe import ProbeLaw, TrialMotion
from simspec.world.reach import MaterialReach
from simspec.world.types import PairContact

STACK = stacks.Stack()
SLIDES, FALLEN, SUNK = 30, 60, 7e-4
"""Sample after which the upper cube is adrift, and from which on it lies on the floor; how deep (m) it is before."""


def measured(friction: float, sideways: np.ndarray, down: np.ndarray) -> list[float]:
    """The figures of a stack of two whose upper cube moves so."""
    law = ProbeLaw(PairContact("a", "b", friction, 0.0), "elliptic", 1e-3, reach=MaterialReach(ratio=100.0, layers=2))
    rest = np.zeros((len(down), 7))
    rest[:, 2], rest[:, 3] = 0.05, 1.0
    upper = rest.copy()
    upper[:, 0], upper[:, 2] = sideways, 0.15 - down
    motion = TrialMotion(np.arange(len(down)) * 1e-3, {"two_0": rest, "two_1": upper}, {})
    return [figure.measured for figure in STACK.figures(law, [motion])]


def falling() -> tuple[np.ndarray, np.ndarray]:
    samples = np.arange(100)
    sideways = np.where(samples > SLIDES, 2.0 * stacks.ADRIFT, 0.0)
    return sideways, np.where(samples >= FALLEN, 0.1, np.minimum(SUNK, samples))


def test_without_friction_the_depth_is_that_before_it_is_adrift():
    assert measured(0.0, *falling()) == [pytest.approx(SUNK)]


def test_with_friction_the_last_state_counts():
    depth, way = measured(0.5, *falling())
    assert (depth, way) == (pytest.approx(0.1), pytest.approx(2.0 * stacks.ADRIFT))


def test_stacks_that_drift_immediately_are_measured():
    samples = np.arange(100)
    assert measured(0.0, np.where(samples > 0, 1.0, 0.0), np.where(samples > 0, 0.1, 0.0)) == [pytest.approx(0.1)]


@pytest.mark.parametrize("at", [5, 50])
def test_a_non_finite_drift_is_the_figure(at):
    """Also where cubes are adrift before, or after."""
    sideways, down = falling()
    sideways[at:], down[at:] = math.nan, math.nan
    (depth,) = measured(0.0, sideways, down)
    assert math.isnan(depth)


def test_a_stack_that_sinks_without_sliding_is_measured_at_the_end():
    down = np.linspace(0.0, 3.0, 100)
    assert measured(0.0, np.zeros(100), down) == [pytest.approx(3.0)]
