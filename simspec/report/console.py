"""The console of tables: foreign text is text, never markup, never an emoji's name, and never what a terminal obeys."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from simspec.errors import visible


class Screen(Console):
    """A console that shows everything escaped which is not seen or does more than be seen (:func:`simspec.errors.visible`):
    whole lines in text to be printed, all but the ends of lines in cells of tables. Styles come from styles alone."""

    def __init__(self, **keywords: Any):
        super().__init__(markup=False, emoji=False, highlight=False, **keywords)

    def print(self, *objects: Any, **keywords: Any) -> None:
        """As rich's; each text is one line."""
        keywords.pop("markup", None)
        super().print(*(Text(visible(item)) if isinstance(item, str) else item for item in objects), **keywords)

    def render_str(self, text: str, **keywords: Any) -> Text:
        """As rich's, without markup."""
        return super().render_str(visible(text, lines=True), **{**keywords, "markup": False, "emoji": False})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich's; what is written by others is escaped, rich's own controls are not."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text, lines=True))
