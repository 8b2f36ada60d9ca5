"""Solver settings of the wrong kind are located errors before anything is written, whatever the engine and the setting."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

from simspec.compiler import compile_world
from simspec.engines.base import Setting, check_settings, engines, find_engine
from simspec.errors import Location, UnsupportedError
from simspec.world.types import EngineOptions
from tests import worlds

EVERY = [(name, setting) for name, engine in engines().items() for setting in engine.SETTINGS]
WRONG: list[Any] = [
    *(math.nan, math.inf, -math.inf, -1, -1.0, 0.5, 10**400, -(10**400), 2**31, 1e308, 5e-324),
    *(True, False, "", "Newton", "newton ", "1", "nan", "\x1b[31m", "x" * 100_000, None, (), (1,)),
]


def allowed(setting: Setting, value: Any) -> bool:
    """Whether a value is of the setting's kind and within its bounds, said once more and in another way."""
    kind = type(setting.default)
    if isinstance(value, bool) or kind is bool:
        return isinstance(value, bool) and kind is bool
    if kind is str:
        return isinstance(value, str) and (not setting.choices or value in setting.choices)
    if not isinstance(value, (int,) if kind is int else (int, float)) or not -(2.0**31) < value < 1e309:
        return False
    if isinstance(value, int) and value >= 2**31:
        return False
    low = -math.inf if setting.minimum is None else setting.minimum
    high = math.inf if setting.maximum is None else setting.maximum
    return math.isfinite(value) and low <= value <= high


@pytest.mark.parametrize(("engine", "name"), EVERY)
def test_wrong_values_are_located_errors_before_anything_is_written(engine, name):
    setting = find_engine(engine).SETTINGS[name]
    base = worlds.spheres(2)
    place = Location("spec.yaml", 7, 3)
    refused = 0
    for value in WRONG:
        options = EngineOptions(engine, ((name, value),))
        world = dataclasses.replace(base, engines=(options,))
        if allowed(setting, value):
            assert not check_settings(find_engine(engine), options.settings)
            continue
        with pytest.raises(UnsupportedError) as caught:
            compile_world(world, [engine], lambda path: place)
        assert all(problem.location == place for problem in caught.value.problems)
        assert caught.value.problems[0].path == f"engines.{engine}.settings.{name}"
        assert len(str(caught.value)) < 3000
        refused += 1
    assert refused >= 15


@pytest.mark.parametrize("engine", engines())
def test_all_wrong_settings_are_told_at_once(engine):
    given = tuple((name, (1,)) for name in find_engine(engine).SETTINGS)
    world = dataclasses.replace(worlds.spheres(2), engines=(EngineOptions(engine, (*given, ("solvr", 1))),))
    with pytest.raises(UnsupportedError) as caught:
        compile_world(world, [engine])
    assert len(caught.value.problems) == len(given) + 1
