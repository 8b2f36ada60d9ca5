"""Bounds of support are compared with the version in use, which an interpreter of another environment reports."""

from __future__ import annotations

import dataclasses

import pytest

from simspec import selection
from simspec.comparison.study import missing_engines, study
from simspec.compiler import compile_world, missing_options, version_at_work
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.support.declarations import EXACT, Support
from simspec.support.features import Feature
from tests import worlds

NAME = "mujoco"
WORLD = worlds.spheres(1)
NEEDED = Feature.SHAPE_SPHERE


def without_bounds():
    rows = find_engine(NAME).SUPPORT.items()
    return {feature: dataclasses.replace(row, since="", until="", before=None) for feature, row in rows}


@pytest.fixture
def interpreter(tmp_path, monkeypatch):
    """The engine supports spheres from version 2 on, and all else in every version; makes an interpreter that gives a version,
    and notes each time."""
    unbounded = without_bounds()
    monkeypatch.setattr(find_engine(NAME), "SUPPORT", {**unbounded, NEEDED: Support(EXACT.level, since="2")})
    monkeypatch.setattr(find_engine(NAME), "OLDEST", "")

    def of(version: str, code: int = 0) -> str:
        path = tmp_path / f"python-{version}"
        answer = f'{{"version": "{version}"}}' if version else ""
        path.write_text(f"#!/bin/sh\necho queried >> '{tmp_path / 'queries'}'\necho '{answer}'\nexit {code}\n")
        path.chmod(0o755)
        return str(path)

    return of


def queries(tmp_path) -> int:
    path = tmp_path / "queries"
    return len(path.read_text().splitlines()) if path.exists() else 0


def test_the_version_of_the_other_interpreter_counts_and_is_queried_once(interpreter, tmp_path):
    pythons = {NAME: interpreter("1.5")}
    assert version_at_work(NAME, pythons) == "1.5"
    chosen = selection.Selection((NAME,), False, {}, pythons=pythons)
    for work in (
        lambda: compile_world(WORLD, [NAME], pythons=pythons),
        lambda: missing_options(WORLD, NAME, pythons),
        lambda: chosen.for_world(WORLD),
        lambda: study(WORLD, [NAME], pythons=pythons),
    ):
        with pytest.raises(UnsupportedError, match=r"has it from version 2 on, and 1\.5 is at work"):
            work()
    assert queries(tmp_path) == 1
    pythons = {NAME: interpreter("2.1")}
    assert list(compile_world(WORLD, [NAME], pythons=pythons)) == [NAME]
    assert compile_world(WORLD, [NAME])[NAME].sha256


def test_a_label_s_version_is_that_of_its_interpreter(interpreter):
    label = f"{NAME}@1"
    assert version_at_work(label) == "1"
    assert version_at_work(label, {label: interpreter("1.9.2")}) == "1.9.2"
    with pytest.raises(EngineError, match=rf"{NAME}@3: is version 1\.9, not 3"):
        version_at_work(f"{NAME}@3", {f"{NAME}@3": interpreter("1.9")})


@pytest.mark.parametrize(
    ("version", "code", "why"),
    [("", 3, "gave no version, exit code 3"), ("2.0", 1, "gave no version, exit code 1"), ("", 0, "gave no version")],
)
def test_an_interpreter_that_gives_no_version_is_an_error(interpreter, version, code, why):
    pythons = {NAME: interpreter(version, code)}
    with pytest.raises(EngineError, match=why):
        compile_world(WORLD, [NAME], pythons=pythons)
    reasons = missing_engines([NAME], pythons, WORLD)
    assert why in reasons[NAME]
    assert pythons[NAME] in reasons[NAME]


def test_an_interpreter_that_is_not_there_is_an_error(interpreter, tmp_path):
    pythons = {NAME: str(tmp_path / "nothing")}
    with pytest.raises(EngineError, match="cannot be started"):
        study(WORLD, [NAME], pythons=pythons)
    kept = study(WORLD, [NAME], pythons=pythons, keep_going=True)
    assert "cannot be started" in str(kept.runs[NAME].failed)


def test_without_bounds_no_interpreter_is_started(interpreter, tmp_path, monkeypatch):
    engine = find_engine(NAME)
    python = interpreter("1.5")
    monkeypatch.setattr(engine, "SUPPORT", without_bounds())
    assert list(compile_world(WORLD, [NAME], pythons={NAME: python})) == [NAME]
    assert queries(tmp_path) == 0
