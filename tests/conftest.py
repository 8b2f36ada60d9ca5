"""Settings of every test: hypothesis measures no time, which on a busy machine says nothing about the code; and no test
leaves anything to the tests that follow it in its process, which are others in every run."""

from __future__ import annotations

import os
import signal

import pytest
from hypothesis import settings

settings.register_profile("simspec", deadline=None)
settings.load_profile("simspec")

RUNNER_OWN = {"PYTEST_CURRENT_TEST"}
"""Variables that pytest itself changes from test to test."""


def surroundings() -> dict[str, object]:
    """What every test of a process shares: the working folder, the environment, who hears signals."""
    return {
        "folder": os.getcwd(),
        "environment": {name: value for name, value in os.environ.items() if name not in RUNNER_OWN},
        "signals": {
            name: signal.getsignal(name) for name in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM, signal.SIGPIPE)
        },
    }


@pytest.fixture(autouse=True)
def leaves_nothing_behind():
    before = surroundings()
    yield
    after = surroundings()
    if after != before:
        os.chdir(before["folder"])  # the tests that follow are not to fail for this one
    assert after == before
