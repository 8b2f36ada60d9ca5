"""Engines that a Python cannot have are named, and the others run; every engine's extra is complete."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from simspec import cli, selection
from simspec.commands import run
from simspec.engines.kit import registry
from simspec.engines.kit.registry import engines
from tests.installed import INSTALLED, PROJECT, requirements

ROOT = Path(__file__).parents[3]
NEWER = {"python_version": "3.12", "python_full_version": "3.12.4"}


def test_every_engine_can_be_installed_on_the_oldest_python_that_is_supported():
    assert registry.left_out({"python_version": "3.11", "python_full_version": "3.11.9"}) == {}
    assert all(registry.why_not(engine, {"python_version": "3.11"}) is None for engine in engines().values())


def test_an_engine_without_wheels_for_a_python_says_so():
    found = {name: why for name, engine in engines().items() if (why := registry.why_not(engine, NEWER)) is not None}
    assert list(found) == ["pybullet"]
    assert found["pybullet"] == (
        'cannot be installed on Python 3.12: pybullet has no wheels but for python_version < "3.12"'
    )


def test_all_engines_are_those_that_this_python_can_have(monkeypatch, tmp_path):
    requested = []
    pybullet = engines()["pybullet"]
    monkeypatch.setattr(pybullet, "version", classmethod(lambda cls: None))
    monkeypatch.setattr(selection, "left_out", lambda: {"pybullet": "cannot be installed on Python 3.12"})
    monkeypatch.setattr(run, "run_world", lambda options, world, chosen, *_: requested.append(chosen) or 0)
    words = ["run", "bouncing-ball", "--all-engines", "--out", str(tmp_path)]
    assert cli.main(words) == 0
    # those that compile for each model run where they are named alone
    quick = [name for name in INSTALLED if not engines()[name].COMPILING]
    assert requested[0].engines == tuple(name for name in quick if name != "pybullet")
    assert str(requested[0].not_taken["pybullet"]) == (
        "cannot be installed on Python 3.12; --python pybullet=PATH runs it in another Python"
    )
    # an interpreter given for it adds it again; naming it returns it, or the error
    assert cli.main([*words, "--python", "pybullet=/some/python"]) == 0
    assert cli.main(["run", "bouncing-ball", "--engine", "pybullet", "--out", str(tmp_path)]) == 0
    assert [entry.engines for entry in requested[1:]] == [tuple(quick), ("pybullet",)]
    assert [entry.named for entry in requested] == [False, False, True]


@pytest.mark.parametrize("name", sorted({engine.EXTRA for engine in engines().values()} - {""}))
def test_an_engines_extra_pulls_what_verify_and_run_need(name):
    [engine] = [engine for engine in engines().values() if name == engine.EXTRA]
    assert requirements(name)[0] >= {engine.DISTRIBUTION, "pin"}


def test_the_package_is_typed():
    assert (ROOT / "simspec" / "py.typed").is_file()
    assert json.dumps(PROJECT["classifiers"]).count("Typing :: Typed") == 1
