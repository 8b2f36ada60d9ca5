"""The console of tables: names from specs are text, never markup and never control characters."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment, Segments
from rich.table import Table as RichTable
from rich.text import Text

from simspec.errors import visible
from simspec.report.fitting import fit
from simspec.report.table import BAD, DIM, GOOD, INFO, WARNING, Table, cell_of

STYLES = {GOOD: "green", WARNING: "yellow", BAD: "bold red", DIM: "dim", INFO: "cyan"}
"""Styles of rich by the tone of a cell."""


class Screen(Console):
    """A console that shows everything escaped which is not seen or does more than be seen (:func:`simspec.errors.visible`):
    whole lines in text to be printed, all but the ends of lines in cells of tables. Styles come from styles alone."""

    def __init__(self, **keywords: Any):
        super().__init__(markup=False, emoji=False, highlight=False, **keywords)

    def print(self, *objects: Any, **keywords: Any) -> None:
        """As rich's; each text is one line, and a table has no blanks at the ends of its lines."""
        keywords.pop("markup", None)
        for table in objects:
            if isinstance(table, Table):
                for part in rich_tables(table, self.width):
                    super().print(Segments(self._trimmed(part)), end="")
        if others := [
            Text(visible(item)) if isinstance(item, str) else item for item in objects if not isinstance(item, Table)
        ]:
            super().print(*others, **keywords)

    def note(self, text: str, style: str = "") -> None:
        """A sentence, wrapped between words; further lines are indented."""
        lines = textwrap.wrap(
            visible(text), self.width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
        for line in lines:
            super().print(Text(line, style=style), soft_wrap=True)

    def message(self, text: str, style: str = "") -> None:
        """A message on standard error: a note on a terminal, elsewhere a single line, since programs read it."""
        if self.is_terminal:
            self.note(text, style)
        else:
            super().print(Text(visible(text), style=style), soft_wrap=True)

    def _trimmed(self, shown: RenderableType) -> Iterator[Segment]:
        for line in self.render_lines(shown, pad=False):
            while line and not line[-1].text.strip():
                line.pop()
            if line:
                yield from line[:-1]
                yield line[-1]._replace(text=line[-1].text.rstrip())
            yield Segment.line()

    def render_str(self, text: str, **keywords: Any) -> Text:
        """As rich's, without markup."""
        return super().render_str(visible(text, lines=True), **{**keywords, "markup": False, "emoji": False})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich's; text is escaped, control segments of rich are not."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text, lines=True))


def rich_tables(table: Table, width: int) -> Iterator[RichTable]:
    """A table for a terminal of ``width`` characters: no lines between rows; in several parts, one below the other, where not
    all columns fit. Further parts lack the rows that are empty there."""
    for number, part in enumerate(parts := fit(table, width)):
        shown = RichTable(
            title=table.title if number == 0 else None,
            caption=table.note or None if number == len(parts) - 1 else None,
            title_justify="left",
            caption_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            pad_edge=False,
        )
        for index, characters in zip(part.columns, part.widths, strict=True):
            justify: Any = "right" if table.columns[index].right else "left"
            shown.add_column(table.columns[index].name, justify=justify, overflow="fold", width=characters)
        for row in table.rows:
            cells = []
            if number and not any(str(cell_of(row[index])) for index in part.columns[1:]):
                continue
            for cell in (cell_of(row[index]) for index in part.columns):
                text = Text(visible(cell.text, lines=True), style=STYLES.get(cell.tone, ""))
                cells.append(text + Text(f"\n{cell.more}", style=STYLES[DIM]) if cell.more else text)
            shown.add_row(*cells)
        yield shown
