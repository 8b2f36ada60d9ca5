"""The table of what plain files of a format do not carry."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.table import Table

from simspec.errors import Location
from simspec.formats.kit.plain import Loss
from simspec.report.kit import table


def losses_table(format_name: str, losses: Sequence[Loss], locate: Callable[[str], Location | None]) -> Table:
    """One row for each loss; of its places the first, as file and line where the spec says it, else as the path."""
    rows = table(f"What {format_name} does not carry", "feature", "what happens", "how", "where", "places", right=(4,))
    for loss in losses:
        first = loss.paths[0]
        location = locate(first)
        where = first if location is None else f"{location.file}:{location.line}"
        rows.add_row(loss.feature, loss.fate.value, loss.how, where, str(len(loss.paths)))
    return rows
