"""Versions of engines in other interpreters: a broken interpreter is a row with its reason."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from simspec.engines.kit import registry
from simspec.engines.kit.registry import auditors, engines, find_engine, format_of, instances


def program(folder: Path, text: str) -> str:
    """An executable script."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def row(label: str, python: str):
    return next(instance for instance in instances({label: python}) if instance.label == label)


def test_without_interpreters_these_are_the_known_engines():
    rows = instances({})
    assert [instance.label for instance in rows] == [*engines(), *auditors()]
    for entry in rows:
        engine = find_engine(entry.engine)
        assert (entry.version, entry.python, entry.dialect, entry.format) == (
            *(engine.version(), None),
            *(engine.DIALECT, format_of(engine)),
        )
        assert (entry.problem is None) == (entry.version is not None)


@pytest.mark.parametrize("name", list(engines()))
def test_versions_are_listed_after_their_engine(name):
    version = engines()[name].version()
    if version is None:
        pytest.skip("this interpreter has no version to find")
    first = version.split(".")[0]
    rows = [
        instance
        for instance in instances({f"{name}@{first}": sys.executable}, [name, f"{name}@999"])
        if instance.engine == name
    ]
    assert [(instance.label, instance.version, instance.python) for instance in rows] == [
        (name, version, None),
        (f"{name}@{first}", version, sys.executable),
        (f"{name}@999", version, None),
    ]
    assert [instance.problem is None for instance in rows] == [True, True, False]
    assert f"is version {version}, not 999" in str(rows[2].problem)


def test_a_named_interpreter_replaces_the_present_interpreter(tmp_path):
    rows = [instance for instance in instances({"dart": program(tmp_path, "exit 3")}) if instance.engine == "dart"]
    assert [(instance.label, instance.version) for instance in rows] == [("dart", None)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("exit 3", "gave no version, exit code 3"),
        ("echo no such thing >&2; exit 1", "exit code 1: no such thing"),
        ("echo not json", "exit code 0: not json"),
        ("echo '[1]'", "gave no version"),
        ("echo '{}'", "gave no version"),
        ("""echo '{"version": 3}'""", "gave no version"),
        ("""echo '{"version": "6.20.0"}'; exit 1""", "gave no version"),
        ("""echo '{"version": null}'""", "does not have dartpy"),
        ("""echo '{"version": "ok"}'""", "gave no version: ok"),
        ("""echo '{"version": "1.0 \\u202e"}'""", "gave no version: 1.0 "),
        ("""echo '{"version": "1.'$(head -c 100 /dev/zero | tr '\\0' 0)'"}'""", "gave no version: 1.000"),
        ("kill -9 $$", "exit code -9"),
        ("yes", "wrote more than"),
        ("head -c 60000 /dev/zero | tr '\\0' '['", "gave no version"),
    ],
)
def test_a_broken_interpreter_is_a_row_with_its_reason(tmp_path, text, words):
    entry = row("dart@6", program(tmp_path, text))
    assert entry.version is None
    assert words in str(entry.problem)


def test_an_interpreter_that_is_none(tmp_path):
    assert "cannot be started: No such file" in str(row("dart", str(tmp_path / "nothing")).problem)
    assert "cannot be started: Permission denied" in str(row("dart", str(tmp_path)).problem)


def test_an_interpreter_that_does_not_end(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "PATIENCE", 0.3)
    for text in ("sleep 600", "sleep 600 & exit 0", "exec >&- 2>&-; sleep 600"):
        assert "no version within 0.3 s" in str(
            row("dart@6", program(tmp_path, f"echo $$ > {tmp_path}/pid\n{text}")).problem
        )
        group = int((tmp_path / "pid").read_text())
        assert not Path(f"/proc/{group}").exists(), "it is ended"
