"""Foreign text is text: not markup, not an emoji's name, not an order to the terminal, and not another line."""

from __future__ import annotations

import io
import json

import pytest

from simspec.errors import EngineError, Location, Problem, SpecError, visible
from simspec.report.console import Screen
from simspec.report.problems import show_error
from simspec.report.screen import error_data, say, text
from simspec.report.table import BAD, Table, TableCell

FOREIGN = ["x[/red]y", "[bold]b", "pip install 'simspec-physics[dart]'", ":smile:", "a\nerror: b", "a\x1b[31mb", "a\x9b31mb",
           "\x07\x08\r", "a\u2028b", "\u202eabc", "\ud800", "\x00", "[link=file:///x]y"]  # fmt: skip


def shown(*objects, terminal: bool = True) -> str:
    stream = io.StringIO()
    screen = Screen(file=stream, width=100, force_terminal=terminal, no_color=True)
    for renderable in objects:
        screen.print(renderable)
    return stream.getvalue()


@pytest.mark.parametrize("foreign", FOREIGN)
def test_printed_text_is_a_single_line_without_control_characters(foreign, capsys):
    assert shown(foreign).rstrip("\n") == visible(foreign)
    assert "\n" not in visible(foreign)
    assert visible(foreign).isprintable()
    say(foreign)
    assert capsys.readouterr().out == visible(foreign) + "\n"


@pytest.mark.parametrize("foreign", FOREIGN)
def test_a_table_shows_it_whole_and_does_not_obey_it(foreign):
    found = Table(foreign, foreign, "b")
    found.add(foreign, TableCell(foreign, BAD))
    given = shown(found, terminal=False)
    lines = given.replace("─", "").replace("━", "")
    assert all(character == "\n" or character.isprintable() for character in lines)
    for part in visible(foreign, lines=True).split("\n"):
        assert part.strip() in given


@pytest.mark.parametrize("foreign", FOREIGN)
def test_errors_keep_to_their_lines(foreign, capsys):
    problem = Problem(foreign, foreign, Location(foreign, 1, 2), foreign, foreign, foreign)
    show_error(SpecError([problem]))
    said = capsys.readouterr().err
    assert said.count("\n") == 5
    assert said.count(visible(foreign)) == 6
    show_error(EngineError("mujoco", foreign))
    for line in capsys.readouterr().err.splitlines()[1:]:
        assert line.startswith("  | ")
    written = text(error_data(SpecError([problem])))
    assert all(character == "\n" or character.isprintable() for character in written)
    assert json.loads(written)["error"]["problems"][0]["found"] == foreign


def test_very_many_problems_are_counted(capsys):
    error = SpecError([Problem("wrong " * 10_000, "x" * 100_000, found="f" * 10**6)] * 100_000)
    show_error(error)
    said = capsys.readouterr().err
    assert len(str(error)) < 200_000
    assert len(said) < 200_000
    assert "and 99,950 more problems" in said
    assert "100000 problems" in said
    found = error_data(error)["error"]
    assert len(found["problems"]) == 50
    assert found["problem_count"] == 100_000
