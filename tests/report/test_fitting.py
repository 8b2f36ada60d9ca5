"""Tables on terminals: whole words, whole numbers, every column, no blanks at the ends of lines."""

from __future__ import annotations

import io

from hypothesis import given
from hypothesis import strategies as st

from simspec.report.console import Screen
from simspec.report.fitting import EDGES, GAP, KEPT, fit
from simspec.report.table import Table

WORDS = st.text("abcdefgh0123456789.", min_size=1, max_size=14)
CELLS = st.lists(WORDS, max_size=6).map(" ".join)
TABLES = st.integers(1, 9).flatmap(
    lambda count: st.builds(
        lambda heads, rows: Table("title", *heads, rows=rows),
        st.lists(WORDS, min_size=count, max_size=count),
        st.lists(st.lists(CELLS, min_size=count, max_size=count), min_size=1, max_size=4),
    )
)


def printed(table: Table, width: int) -> str:
    screen = Screen(file=io.StringIO(), width=width)
    screen.print(table)
    return screen.file.getvalue()


@given(TABLES, st.integers(60, 130))
def test_every_column_has_room_and_is_printed_once(table, width):
    parts = fit(table, width)
    assert all(part.columns[0] == 0 for part in parts)
    assert [index for part in parts for index in part.columns[1:]] == list(range(1, len(table.columns)))
    for part in parts:
        assert sum(part.widths) + GAP * (len(part.widths) - 1) + EDGES <= width


@given(TABLES, st.integers(60, 130))
def test_no_word_is_broken_and_no_line_is_too_long_or_ends_with_a_blank(table, width):
    text = printed(table, width)
    assert all(len(line) <= width and line == line.rstrip() for line in text.splitlines())
    shown = text.split()
    for row in table.rows:
        for index, cell in enumerate(row):
            if index == 0 or len(cell) > KEPT:
                assert set(cell.split()) <= set(shown) or not any(row[1:])
            else:
                assert cell in text


def test_a_table_that_fits_is_not_split():
    table = Table("title", "engine", "value", right=(1,), rows=[("a", "1.0 m"), ("b", "")])
    assert len(fit(table, 80)) == 1
    assert "b" in printed(table, 80)


def test_a_word_longer_than_the_line_is_broken_after_all():
    table = Table("title", "engine", "path", rows=[("a", "x" * 300)])
    text = printed(table, 80)
    assert text.count("x") == 300
    assert max(map(len, text.splitlines())) <= 80
