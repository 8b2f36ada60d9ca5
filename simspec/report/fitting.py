"""Tables that fit the columns of a terminal: no word is broken where a table can be split into several instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.cells import cell_len

from simspec.errors import visible
from simspec.report.table import Table, cell_of

GAP = 3
"""Characters between two columns."""
EDGES = 2
"""Characters left and right of a table."""
KEPT = 24
"""Characters up to which a line of a cell is not wrapped: a number with its unit, a position."""
NARROW = 12
"""Characters that remain for a column whose words are too long for any table."""


@dataclass(frozen=True, slots=True)
class FittedPart:
    """Columns of a table that stand side by side: their indices, and the width of each in characters."""

    columns: tuple[int, ...]
    widths: tuple[int, ...]


def fit(table: Table, width: int) -> list[FittedPart]:
    """The parts in which a table is printed on ``width`` characters: one where each column has room for its longest word;
    else several, each of which begins with the first column."""
    least, most = zip(*(_needs(table, index) for index in range(len(table.columns))), strict=True)
    room = width - EDGES
    groups: list[list[int]] = [[0]]
    for index in range(1, len(least)):
        group = [*groups[-1], index]
        if sum(least[k] for k in group) + GAP * (len(group) - 1) > room and len(groups[-1]) > 1:
            group = [0, index]
            groups.append(group)
        else:
            groups[-1] = group
    return [FittedPart(tuple(group), tuple(_shared(group, least, most, room))) for group in groups]


def _needs(table: Table, index: int) -> tuple[int, int]:
    """The characters that a column needs: for its longest word, and whole lines of up to ``KEPT``; and for its longest line."""
    column = table.columns[index]
    cells = [line for row in table.rows for line in str(cell_of(row[index])).split("\n")]
    lines = [visible(line) for line in (*column.name.split("\n"), *cells)]
    most = max(map(cell_len, lines))
    most = max(1, most if column.width is None else min(most, column.width))
    if not column.wraps:
        return most, most
    words = max((cell_len(word) for line in lines for word in line.split()), default=1)
    short = max((size for line in cells if (size := cell_len(visible(line))) <= KEPT), default=1)
    return min(max(words, short), most), most


def _shared(group: Sequence[int], least: Sequence[int], most: Sequence[int], room: int) -> list[int]:
    """The widths of columns that stand side by side: the longest word of each, and the remaining room for those that need more,
    the least needy first."""
    room -= GAP * (len(group) - 1)
    widths = {index: least[index] for index in group}
    while (over := sum(widths.values()) - room) > 0:  # a word that is longer than a line is broken after all
        widest = max(group, key=lambda index: widths[index])
        if widths[widest] <= NARROW:
            break
        widths[widest] = max(NARROW, widths[widest] - over)
    spare = max(0, room - sum(widths.values()))
    needy = sorted(
        (index for index in group if most[index] > widths[index]), key=lambda index: most[index] - widths[index]
    )
    for place, index in enumerate(needy):
        given = min(most[index] - widths[index], spare // (len(needy) - place))
        widths[index] += given
        spare -= given
    return [widths[index] for index in group]
