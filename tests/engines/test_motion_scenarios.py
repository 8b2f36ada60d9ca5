"""The scenarios in specs/motion: each has its closed form in `expect`, and every engine that supports it keeps it."""

from __future__ import annotations

from pathlib import Path

import pytest

import simspec
from simspec.runner.execution import run
from simspec.runner.expectations import evaluate
from simspec.selection import supporting
from tests.installed import INSTALLED, JOINTED

pytestmark = pytest.mark.usefixtures("warm_engines")
ROOT = Path(__file__).resolve().parent.parent.parent
SPECS = sorted((ROOT / "specs" / "motion").glob("*.yaml"))
ENGINES = {
    "pushed-box": INSTALLED,
    "slow-control": JOINTED,
    "moving-platform": INSTALLED,
    "conveyor": ("mujoco",),
    "falling-in-air": INSTALLED,
    "rough-ground": ("mujoco", "pybullet"),
}
"""The engines that support each: a scenario that an engine no longer supports is not left out in silence."""


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_every_engine_keeps_the_closed_form(path):
    spec = simspec.load(path)
    world = spec.resolve()
    able, _ = supporting(world, INSTALLED, spec.locate)
    assert sorted(able) == sorted(ENGINES[path.stem])
    assert world.name == path.stem
    for engine in able:
        outcomes = evaluate(run(world, engine))
        assert outcomes
        assert all(outcome.passed for outcome in outcomes), (engine, outcomes)
