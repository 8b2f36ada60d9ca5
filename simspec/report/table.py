"""One value for every table, and its printers as Markdown, HTML, CSV and LaTeX; :mod:`simspec.report.screen` prints it on
terminals. Numbers and lists as cells have them."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from simspec.errors import clipped, length, visible

__all__ = ["Column", "Table", "TableCell", "length", "number"]

GOOD, WARNING, BAD, PLAIN, DIM, INFO = "good", "warning", "bad", "plain", "dim", "info"
"""Tones: the meaning of a cell or a sentence. Printers choose colours and marks by them; HTML has them as classes."""
MARKS = {BAD: "**", WARNING: "*"}
"""Marks of Markdown by tone."""
LONGEST_TEXT = 2000
"""Characters of a cell in HTML and Markdown: names in specs may have any length."""
LONGEST_LINE = 40
"""Characters of a line of a cell beyond which HTML wraps it."""
DIGITS = 4
"""Significant digits of numbers for reading; CSV has all."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of texts that spreadsheets read as formulas."""
LATEX_ESCAPES = {
    "\\": r"\textbackslash{}",
    **{character: rf"\{character}" for character in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "−": "$-$",
    "µ": r"\textmu{}",
}
"""Characters that LaTeX interprets, or that not every font has."""


@dataclass(frozen=True)
class TableCell:
    """A cell with a tone. ``more``: further lines, dim on a terminal."""

    text: str
    tone: str = ""
    more: str = ""

    def __str__(self) -> str:
        return f"{self.text}\n{self.more}" if self.more else self.text


@dataclass
class Column:
    """A column by its head. ``right``: aligned right, as numbers are; ``width``: at most so many characters on a terminal;
    ``wraps``: whether a terminal may wrap its cells."""

    name: str
    right: bool = False
    width: int | None = None
    wraps: bool = True


class Table:
    """Title, columns, rows and a note below. A row has a value for each column: a :class:`TableCell`, a text, a number, a truth
    value, or None where there is none; ``right`` lists the indices of columns of numbers. ``said``: its sentences on a page."""

    def __init__(
        self, title: str, *columns: str, right: Sequence[int] = (), rows: Iterable[Sequence[Any]] = (), note: str = ""
    ):
        self.title, self.note = title, note
        self.columns = [Column(name, index in right) for index, name in enumerate(columns)]
        self.rows: list[tuple[Any, ...]] = []
        self.said: tuple[str, ...] = ()
        for row in rows:
            self.add(*row)

    def add(self, *values: Any) -> None:
        """Add a row; columns without a value are empty."""
        self.rows.append((*values, *[""] * (len(self.columns) - len(values))))

    def column(self, index: int) -> list[str]:
        """The texts of a column."""
        return [str(cell_of(row[index])) for row in self.rows]


class Columns(Protocol):
    """Columns by name, as :class:`simspec.analysis.tables.ResultTable` has them."""

    @property
    def columns(self) -> Mapping[str, Sequence[Any]]: ...


def as_table(table: Table | Columns) -> Table:
    """Columns as a table; those whose values are numbers or intervals of numbers are aligned right."""
    if isinstance(table, Table):
        return table
    made = Table("", *table.columns, rows=zip(*table.columns.values(), strict=True))
    _align(made)
    return made


def records_table(title: str, records: Sequence[Mapping[str, Any]]) -> Table:
    """A row for each of some records with the same names."""
    made = Table(title, *(records[0] if records else ()), rows=[tuple(record.values()) for record in records])
    _align(made)
    return made


def _align(table: Table) -> None:
    for index, column in enumerate(table.columns):
        known = [row[index] for row in table.rows if row[index] is not None]
        column.right = bool(known) and not any(isinstance(value, str | bool) for value in known)


def number(value: float | None, unit: str = "") -> str:
    """A number for reading: four digits, ``–`` for none."""
    if value is None:
        return "–"
    if math.isnan(value):
        return "NaN"
    return f"{value:.{DIGITS}g} {unit}" if unit else f"{value:.{DIGITS}g}"


def two_digits(value: float) -> str:
    """Two significant digits and at most three decimal places, for numbers that are compared at a glance."""
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞"
    if abs(value) < 1e-3:
        return "0"
    return f"{value:.{min(max(0, 1 - math.floor(math.log10(abs(value)))), 3)}f}"


def shortened(text: str, limit: int = 200) -> str:
    """A text, or its beginning and "…" where it is longer."""
    return text if len(text) <= limit else text[: limit - 1] + "…"


def listed(names: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def passed_cell(passed: bool, good: str = "ok", bad: str = "FAILED") -> TableCell:
    """The cell of a verdict."""
    return TableCell(good, GOOD) if passed else TableCell(bad, BAD)


def cell_of(value: Any) -> TableCell:
    """A value of a row as a cell."""
    if isinstance(value, TableCell):
        return value
    if isinstance(value, bool):
        return TableCell("yes" if value else "no")
    return TableCell(number(value) if value is None or isinstance(value, float) else str(value))


def html_data(table: Table) -> dict[str, Any]:
    """A table as the template of pages and ``study.json`` have it: texts with the classes of their cells."""
    sides = ["right" if column.right else "" for column in table.columns]
    return {
        "title": _shown(table.title),
        "head": [
            {"text": _shown(column.name), "classes": side} for column, side in zip(table.columns, sides, strict=True)
        ],
        "rows": [[_html_cell(value, side) for value, side in zip(row, sides, strict=True)] for row in table.rows],
        "note": _shown(table.note),
        "said": list(table.said),
    }


def _shown(text: str) -> str:
    return visible(clipped(text, LONGEST_TEXT), lines=True)


def _html_cell(value: Any, side: str) -> dict[str, str]:
    cell = cell_of(value)
    text = _shown(str(cell))
    wrap = "wrap" if max(map(len, text.split("\n"))) > LONGEST_LINE else ""
    return {"text": text, "classes": " ".join(filter(None, (side, cell.tone, wrap)))}


def markdown(table: Table) -> str:
    """A table in Markdown, with its title above and its note below; bold is bad, italic is to be known."""
    heads = [escaped(_shown(column.name)) for column in table.columns]
    rows = [[_marked(cell_of(value)) for value in row] for row in table.rows]
    right = [index for index, column in enumerate(table.columns) if column.right]
    note = ["", escaped(_shown(table.note))] if table.note else []
    return "\n".join([f"**{escaped(_shown(table.title))}**", "", *markdown_rows(heads, rows, right), *note, ""])


def _marked(cell: TableCell) -> str:
    text = _shown(str(cell))
    mark = MARKS.get(cell.tone, "") if text else ""
    return f"{mark}{escaped(text)}{mark}"


def markdown_rows(heads: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """The lines of a table whose cells are Markdown already; ``right``: indices of columns aligned right."""
    rule = "|".join("---:" if index in right else "---" for index in range(len(heads)))
    return [f"| {' | '.join(heads)} |", f"|{rule}|", *(f"| {' | '.join(row)} |" for row in rows)]


def markdown_cell(text: str) -> str:
    """Text with markup for a cell in Markdown, on one line."""
    return " ".join(text.split()).replace("|", "\\|")


def escaped(text: str) -> str:
    """Text without markup for a cell in Markdown."""
    for character in "\\|<>`*_[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("\n", " ")


def csv_text(table: Table | Columns, newline: str = "\r\n", lines: bool = False) -> str:
    """A table as CSV (RFC 4180, UTF-8): numbers whole, nothing for None. Texts that a spreadsheet would run begin with an
    apostrophe. ``lines``: texts keep their ends of lines."""
    import csv  # spreadsheets alone need it

    written = io.StringIO()
    writer = csv.writer(written, lineterminator=newline)
    shown = as_table(table)
    writer.writerow([_field(column.name, lines) for column in shown.columns])
    writer.writerows([_field(value, lines) for value in row] for row in shown.rows)
    return written.getvalue()


def _field(value: Any, lines: bool) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    text = visible(str(value), lines)
    return f"'{text}" if text.startswith(FORMULA) else text


def latex_text(
    table: Table | Columns, caption: str = "", label: str = "", heads: Mapping[str, str] | None = None
) -> str:
    """A table in LaTeX (packages booktabs and textcomp). ``heads``: heads of columns in place of their names. Numbers have four
    significant digits; spreads are medians with their interval."""
    shown = as_table(table)
    names = [latex_escaped((heads or {}).get(column.name, column.name)) for column in shown.columns]
    lines = [r"\begin{table}", r"\centering"]
    lines += [rf"\caption{{{latex_escaped(caption or shown.title)}}}"] if caption or shown.title else []
    lines += [rf"\label{{{''.join(c for c in label if c.isalnum() or c in ':-.')}}}"] if label else []
    lines += [rf"\begin{{tabular}}{{{''.join('r' if column.right else 'l' for column in shown.columns)}}}", r"\toprule"]
    lines += [" & ".join(names) + r" \\", r"\midrule"]
    lines += [" & ".join(map(_latex_cell, row)) + r" \\" for row in shown.rows]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""])


def latex_escaped(text: str) -> str:
    """A text in which LaTeX interprets nothing."""
    return "".join(LATEX_ESCAPES.get(character, character) for character in visible(text))


def _latex_cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "--"
    if not isinstance(value, float):
        return latex_escaped(str(cell_of(value)))
    if math.isinf(value):
        return ("$" if value > 0 else "$-") + r"\infty$"
    mantissa, _, exponent = f"{value:.{DIGITS}g}".partition("e")
    if exponent:
        return rf"${mantissa} \cdot 10^{{{int(exponent)}}}$"
    return f"${mantissa}$" if value < 0 else mantissa
