"""What is shown to people: foreign text is text, never markup, never an emoji's name, and never what a terminal obeys."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from simspec.errors import visible

if TYPE_CHECKING:
    from simspec.report.console import Screen

PIPE_WIDTH = 120
"""Columns where there is no terminal to ask."""
NARROWEST, WIDEST = 80, 120


def say(line: str, error: bool = False) -> None:
    """One line on standard output, or standard error, now, as long as it is."""
    print(visible(line), file=sys.stderr if error else sys.stdout, flush=True)


def console(error: bool = False) -> Screen:
    """The console for standard output (or standard error): rich asks the terminal, NO_COLOR and the pipe."""
    from simspec.report.console import Screen

    stream = sys.stderr if error else sys.stdout
    if not stream.isatty():
        return Screen(file=stream, width=PIPE_WIDTH, no_color=True, force_terminal=False)
    wanted = Screen(file=stream).width
    return Screen(file=stream, width=min(max(wanted, NARROWEST), WIDEST))
