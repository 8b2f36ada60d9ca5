"""The tables of the terminal as data of a page: the same cells, by construction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rich.table import Table
from rich.text import Text

from simspec.errors import clipped, visible
from simspec.report.page.words import BAD, GOOD, WARNING

TONES = {"green": GOOD, "red": BAD, "yellow": WARNING, "dim": "dim"}
"""Words of a style, and what they mean."""
LONGEST_TEXT = 2000
"""Characters of a cell: names come from strangers."""
LONGEST_LINE = 40
"""Characters of a cell's line beyond which it is wrapped."""


@dataclass(frozen=True)
class Cell:
    """A cell: its text, and its classes."""

    text: str
    classes: str = ""


@dataclass(frozen=True)
class Sheet:
    """A table of a page; ``said``: what it says, in sentences."""

    title: str
    head: tuple[Cell, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    said: tuple[str, ...] = ()


def sheet(table: Table) -> Sheet:
    """A table of texts as a page has it."""
    right = ["right" if column.justify == "right" else "" for column in table.columns]
    head = tuple(Cell(_plain(column.header), side) for column, side in zip(table.columns, right, strict=True))
    columns = [[_cell(item, side) for item in column.cells] for column, side in zip(table.columns, right, strict=True)]
    return Sheet(_plain(table.title), head, tuple(zip(*columns, strict=True)), _plain(table.caption))


def sheets(tables: Iterable[Table | None]) -> tuple[Sheet, ...]:
    """Those that there are."""
    return tuple(sheet(table) for table in tables if table is not None)


def _plain(item: object) -> str:
    if item is None:
        return ""
    if isinstance(item, (Text, str)):
        return visible(clipped(item.plain if isinstance(item, Text) else item, LONGEST_TEXT), lines=True)
    raise TypeError(f"a cell of a table is text, not {type(item).__name__}")


def _cell(item: object, side: str) -> Cell:
    styles = [str(item.style), *(str(span.style) for span in item.spans[:1])] if isinstance(item, Text) else []
    words = {word for style in styles[:1] if style for word in style.split()} or {
        word for style in styles[1:] for word in style.split()
    }
    tone = next((tone for word, tone in TONES.items() if word in words), "")
    text = _plain(item)
    wrap = "wrap" if max(map(len, text.split("\n"))) > LONGEST_LINE else ""
    return Cell(text, " ".join(filter(None, (side, tone, wrap))))
