"""``simspec engines`` reports a broken entry point of a foreign package; all other commands ignore it."""

from __future__ import annotations

import importlib.metadata
import sys
import types

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.contact import Rules
from simspec.dialects.kit import contract as dialects_base
from simspec.engines.kit import registry as base
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import EngineError
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature

INSTALLED = list(engines())


def an_engine(**more):
    words = {"NAME": "odd", "DIALECT": "mujoco", "DISTRIBUTION": "numpy", "EXTRA": "odd", "RULES": Rules("max", "max")}
    support = dict.fromkeys(Feature, EXACT) | {Feature.CONTROL_NATIVE: never("odd")}
    settings = dialects_base.dialects()["mujoco"].SETTINGS  # its dialect needs the same settings
    words |= {
        "LAYERS": False,
        "SUPPORT": support,
        "SETTINGS": settings,
        "LACKS": dict.fromkeys(Capability, "odd"),
    } | more
    return type("Odd", (Engine,), {name: value for name, value in words.items() if value is not None})


@pytest.fixture
def offer(monkeypatch):
    """Offers more engines; everything is looked for anew before and after."""
    genuine = importlib.metadata.entry_points
    more: list[importlib.metadata.EntryPoint] = []
    module = types.ModuleType("strange_engines")
    monkeypatch.setitem(sys.modules, "strange_engines", module)

    def points(*, group):
        found = list(genuine(group=group))
        return found + (more if group == "simspec.engines" else [])

    monkeypatch.setattr(importlib.metadata, "entry_points", points)

    def offered(name, value, attribute="it"):
        setattr(module, attribute, value)
        place = f"strange_engines:{attribute}" if value is not None else "nowhere_at_all:it"
        more.append(importlib.metadata.EntryPoint(name, place, "simspec.engines"))
        base.engines.cache_clear()

    yield offered
    base.engines.cache_clear()
    dialects_base.dialects.cache_clear()


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (None, "No module named 'nowhere_at_all'"),
        (17, "it is not an Engine"),
        (Engine, "it does not define NAME"),
        (an_engine(NAME="other"), "its NAME is 'other'"),
        (an_engine(DIALECT="word"), "its DIALECT is 'word', which is not a dialect"),
        (an_engine(SETTINGS=None), "it does not define SETTINGS"),
        (an_engine(SETTINGS={}), "it lacks the settings solver, "),
        (an_engine(version=classmethod(lambda cls: sys.exit(3))), "SystemExit"),
    ],
)
def test_a_broken_engine_is_reported_and_ignored(offer, value, why):
    offer("odd", value)
    assert list(engines()) == INSTALLED
    assert why in engines().broken()["odd"]
    with pytest.raises(EngineError, match="cannot be used"):
        find_engine("odd")
    done = CliRunner().invoke(cli.app, ["engines"])
    assert done.exit_code == 0
    assert why in done.output
    assert CliRunner().invoke(cli.app, ["check", "bouncing-ball"]).exit_code == 0


def test_a_plugin_cannot_replace_an_engine_of_simspec(offer):
    offer("mujoco", an_engine(NAME="mujoco"))
    assert find_engine("mujoco").__module__ == "simspec.engines.mujoco.engine"
    assert any("the name is already used" in why for why in engines().broken().values())


def test_a_sound_engine_is_used(offer):
    offer("odd", an_engine())
    assert list(engines()) == sorted([*INSTALLED, "odd"])
    assert not engines().broken()
