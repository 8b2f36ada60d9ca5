"""The console of tables: names from specs are text, never markup and never control characters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table as RichTable
from rich.text import Text

from simspec.errors import visible
from simspec.report.table import BAD, DIM, GOOD, INFO, WARNING, Table, cell_of

STYLES = {GOOD: "green", WARNING: "yellow", BAD: "bold red", DIM: "dim", INFO: "cyan"}
"""Styles of rich by the tone of a cell."""


class Screen(Console):
    """A console that shows everything escaped which is not seen or does more than be seen (:func:`simspec.errors.visible`):
    whole lines in text to be printed, all but the ends of lines in cells of tables. Styles come from styles alone."""

    def __init__(self, **keywords: Any):
        super().__init__(markup=False, emoji=False, highlight=False, **keywords)

    def print(self, *objects: Any, **keywords: Any) -> None:
        """As rich's; each text is one line."""
        keywords.pop("markup", None)
        super().print(*map(_renderable, objects), **keywords)

    def render_str(self, text: str, **keywords: Any) -> Text:
        """As rich's, without markup."""
        return super().render_str(visible(text, lines=True), **{**keywords, "markup": False, "emoji": False})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich's; text is escaped, control segments of rich are not."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text, lines=True))


def _renderable(item: Any) -> Any:
    if isinstance(item, Table):
        return rich_table(item)
    return Text(visible(item)) if isinstance(item, str) else item


def rich_table(table: Table) -> RichTable:
    """A table for a terminal: no lines between rows, cells folded where they are too wide."""
    shown = RichTable(
        title=table.title,
        caption=table.note or None,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    for column in table.columns:
        justify: Any = "right" if column.right else "left"
        shown.add_column(
            column.name, justify=justify, overflow="fold", max_width=column.width, no_wrap=not column.wraps
        )
    for row in table.rows:
        cells = []
        for cell in map(cell_of, row):
            text = Text(visible(cell.text, lines=True), style=STYLES.get(cell.tone, ""))
            cells.append(text + Text(f"\n{cell.more}", style=STYLES[DIM]) if cell.more else text)
        shown.add_row(*cells)
    return shown
