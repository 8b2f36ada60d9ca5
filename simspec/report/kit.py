"""What every table and message is made with: progress, numbers for reading, empty tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from simspec.markup import length

__all__ = ["length", "number", "table", "verdict"]


def number(value: float | None, unit: str = "") -> str:
    """A number for reading: four digits, ``–`` for none."""
    if value is None:
        return "–"
    if math.isnan(value):
        return "NaN"
    text = f"{value:.4g}"
    return f"{text} {unit}" if unit else text


def table(title: str, *columns: str, right: Sequence[int] = ()) -> Table:
    """An empty table in the house's form; ``right`` lists the columns of numbers."""
    made = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for index, column in enumerate(columns):
        made.add_column(column, justify="right" if index in right else "left", overflow="fold")
    return made


def verdict(passed: bool, good: str = "ok", bad: str = "FAILED") -> Text:
    return Text(good, style="green") if passed else Text(bad, style="bold red")
