"""Tests that take too long for every commit: skipped, and listed as such, where ``make slow`` does not ask for them."""

from __future__ import annotations

import os

import pytest

ASKED = "SIMSPEC_SLOW"
"""Where this variable is ``all``, they run."""
EVERYTHING = os.environ.get(ASKED) == "all"
NIGHTLY = (pytest.mark.slow, pytest.mark.skipif(not EVERYTHING, reason="run by make slow"))
"""Marks of such a test."""


def nightly(test):
    """Such a test. Another one, which runs at every commit, must fail for the same faults."""
    for mark in NIGHTLY:
        test = mark(test)
    return test
