"""Annotations of a spec's lines, as GitHub Actions reads them from a step's output."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from simspec.errors import Location, Problem, visible
from simspec.report.tested import Suite, file_of, wrong

MOST = 10
"""Annotations of one kind that a step may have: further ones are dropped without a word."""
IN_TEXT = {"%": "%25", "\r": "%0D", "\n": "%0A"}
IN_PROPERTY = {**IN_TEXT, ":": "%3A", ",": "%2C"}


def annotation_lines(suites: Sequence[Suite], warnings: Sequence[Problem] = ()) -> list[str]:
    """The lines to print: what failed, worst first, then what looks like a slip in the spec; of each kind ten at most, the
    last of which counts the others."""
    errors = [
        (entry.location, f"{suite.engine}: {entry.name}", f"{suite.name}: {entry.name}: {entry.message}")
        for suite, entry in wrong(suites)
    ]
    slips = [(problem.location, problem.path or "spec", problem.message) for problem in warnings]
    return [*_lines("error", errors), *_lines("warning", slips)]


def _lines(kind: str, rows: Sequence[tuple[Location | None, str, str]]) -> Iterable[str]:
    shown = rows if len(rows) <= MOST else rows[: MOST - 1]
    for location, title, text in shown:
        properties = {} if location is None else {"file": file_of(location), "line": str(location.line)}
        if location is not None:
            properties["col"] = str(location.column)
        yield _line(kind, {**properties, "title": title}, text)
    if len(rows) > len(shown):
        yield _line(kind, {"title": "simspec"}, f"{len(rows) - len(shown)} more: see the test report or the output")


def _line(kind: str, properties: dict[str, str], text: str) -> str:
    told = ",".join(f"{name}={_escaped(visible(value), IN_PROPERTY)}" for name, value in properties.items())
    return f"::{kind} {told}::{_escaped(visible(text, lines=True), IN_TEXT)}"


def _escaped(text: str, table: dict[str, str]) -> str:
    return "".join(table.get(character, character) for character in text)
