"""Joints that constraints keep from sliding are not compared as they slide."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.proof.forces import SLIDES, DryFriction, ForceTrial

STRENGTH = np.array([2.0, 3.0])
PLACES = np.array([1, 2])


@pytest.mark.parametrize(
    ("along", "slides", "compared"),
    [
        ([9.0, 1.0, -1.5], True, [True, True]),
        ([9.0, 0.5 * SLIDES * 2.0, -1.5], True, [False, True]),
        ([9.0, 0.0, 0.0], True, [True, True]),  # constraints hold all: nothing else would be compared
        ([0.0, 0.0, 0.0], False, [True, True]),
    ],
)
def test_joints_that_do_not_slide(along, slides, compared):
    state = np.zeros(3)
    trial = ForceTrial("t", state, state, state, 1, state, 1e-8, slides, np.array(along))
    assert DryFriction((trial,), PLACES, STRENGTH).compared(trial).tolist() == compared
