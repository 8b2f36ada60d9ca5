"""The table of what plain files of a format do not carry."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from rich.table import Table

from simspec.audit.exported import ReaderLoss, readers
from simspec.engines.kit.foreign import REFUSED
from simspec.errors import Location
from simspec.formats.kit.contract import Loss
from simspec.report.kit import table

WIDTH: Final = 80
"""Columns of the lines about readers."""


def losses_table(format_name: str, losses: Sequence[Loss], locate: Callable[[str], Location | None]) -> Table:
    """One row for each loss; of its places the first, as file and line where the spec says it, else as the path."""
    rows = table(f"What {format_name} does not carry", "feature", "what happens", "how", "where", "places", right=(4,))
    for loss in losses:
        first = loss.paths[0]
        location = locate(first)
        where = first if location is None else f"{location.file}:{location.line}"
        rows.add_row(loss.feature, loss.fate.value, loss.how, where, str(len(loss.paths)))
    return rows


def reader_lines(format_name: str, losses: Sequence[ReaderLoss]) -> Iterator[str]:
    """Which of the known readers of a format have the world's model, which another (with the number of its differences), and
    which refuse a file."""
    counts: dict[str, int] = {reader.short: 0 for reader in readers(format_name)}
    refused = {loss.reader.short for loss in losses if loss.element == REFUSED}
    for loss in losses:
        counts[loss.reader.short] += 1
    same = [name for name, count in counts.items() if not count]
    changed = [f"{name} ({count})" for name, count in counts.items() if count and name not in refused]
    for title, names in (
        ("read as the spec by", same),
        ("read with differences (listed in losses.json) by", changed),
        ("refused by", sorted(refused)),
    ):
        if names:
            yield from textwrap.wrap(f"{title}: {', '.join(names)}", WIDTH, subsequent_indent="  ")
