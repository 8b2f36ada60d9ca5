"""Engines that may not be in one process with others (``Engine.CLASHES``): their tests, in a process of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simspec.engines.kit import contract
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import EngineError
from tests.conftest import ALONE
from tests.installed import INSTALLED

ROOT = Path(__file__).resolve().parents[2]
CLASHING = [name for name in INSTALLED if find_engine(name).CLASHES]
SHARED = ("tests/engines/test_control.py", "tests/engines/test_not_yet.py")
"""Tests of all engines that load them themselves."""
IN_ENGINE_PROCESSES = ("tests/engines/gazebo/test_contact.py",)
"""Tests in the folder of such an engine that load it in processes of its own anyway: they run with all others."""
TAKES = 300.0
"""s: ten times what they take."""


@pytest.mark.parametrize("name", CLASHING)
def test_its_tests_in_a_separate_process(name):
    files = [f"tests/engines/{name}", *SHARED]
    elsewhere = [f"--ignore={file}" for file in IN_ENGINE_PROCESSES]
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", name]
    words += [*elsewhere, *files]
    done = subprocess.run(
        words, cwd=ROOT, env={**os.environ, ALONE: name}, capture_output=True, text=True, timeout=TAKES, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:]
    assert "process of its own" not in done.stdout
    passed = re.search(r"(\d+) passed", done.stdout)
    assert passed is not None
    assert int(passed[1]) >= 10


def test_two_that_clash_are_refused_in_either_order(monkeypatch):
    """An engine whose package is loaded, or whose neighbour is, says so in place of a segmentation fault."""
    engine, other = (find_engine(name) for name in sorted(engines())[:2])
    monkeypatch.setattr(engine, "CLASHES", {"json": "of the test"})
    monkeypatch.setattr(contract, "_LOADED", {})
    with pytest.raises(EngineError, match="has json: of the test"):
        contract.enter(engine)
    monkeypatch.setattr(engine, "CLASHES", {"there_is_none": "of the test"})
    monkeypatch.setattr(other, "DISTRIBUTION", "there_is_none")
    contract.enter(engine)
    with pytest.raises(EngineError, match=f"has the engine {engine.NAME}: of the test"):
        contract.enter(other)
