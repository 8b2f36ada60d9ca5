"""docs/tour.md and the example in docs/concepts/proof.md are correct: their commands print the outputs of the pages."""

from __future__ import annotations

import re
import shlex

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.report.verdict import LABEL
from tests.docs.blocks import ROOT

pytestmark = pytest.mark.usefixtures("warm_engines")

OUTPUT = re.compile(
    r"<!-- output(?: (?P<lines>\d+))?: (?P<command>.*?) -->\n```\n\$ (?P=command)\n(?P<text>.*?)```", re.DOTALL
)
FOUND = list(OUTPUT.finditer((ROOT / "docs" / "tour.md").read_text(encoding="utf-8")))
DIFFERENT = ("contact law", "speed", "next")
"""Labels of a verdict that differ at each run, or with ``--quick``, which this test adds."""
VARIES = re.compile(r" \((?:noise|[\d,]+ comparisons).*?\)")


def verdict(text: str) -> dict[str, str]:
    """The parts of a verdict by label, without those that differ, and without noise and counts."""
    parts: dict[str, str] = {}
    label = ""
    for line in text.splitlines():
        label = line[:LABEL].strip() or label
        parts[label] = f"{parts.get(label, '')} {line[LABEL:]}".strip()
    return {label: VARIES.sub("", part) for label, part in parts.items() if label not in DIFFERENT}


def test_the_page_has_the_commands_of_a_tour():
    assert [found["command"].split()[1] for found in FOUND] == ["new", "check", "run", "run", "run", "explain"]


def test_the_commands_print_what_the_page_shows(tmp_path, monkeypatch):
    """Each command needs the files of those before it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    for found in FOUND:
        _, name, *words = shlex.split(found["command"])
        done = CliRunner().invoke(cli.app, [name, *words, *(["--quick"] if name == "run" else [])])
        assert done.exit_code == 0, done.output
        if name == "run":
            assert verdict(found["text"])
            assert verdict(done.stdout) == verdict(found["text"]), found["command"]
        else:
            lines = [line.rstrip() for line in done.stdout.splitlines()]
            assert lines[: int(found["lines"] or len(lines))] == found["text"].splitlines(), found["command"]


def test_the_worked_example_of_a_proof_is_current(tmp_path, monkeypatch):
    """The lines of its table, without the deviations, which are round-off."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    (found,) = OUTPUT.finditer((ROOT / "docs" / "concepts" / "proof.md").read_text(encoding="utf-8"))
    done = CliRunner().invoke(cli.app, shlex.split(found["command"])[1:])
    assert done.exit_code == 0, done.output
    printed = done.stdout.splitlines()[: int(found["lines"])]
    words = lambda line: re.sub(r"\d\.?\d*e-\d+|equal|exact|[\s─]+", " ", line).split()  # noqa: E731
    assert [words(line) for line in printed] == [words(line) for line in found["text"].splitlines()]
