"""Output on terminals: names from specs are text, never markup and never control characters; progress of long work."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from simspec.errors import visible

if TYPE_CHECKING:
    from simspec.report.console import Screen

PIPE_WIDTH = 120
"""Columns where neither a terminal nor COLUMNS says how many there are."""
NARROWEST, WIDEST = 40, 120


def say(line: str, error: bool = False) -> None:
    """One line on standard output, or standard error, now, as long as it is."""
    print(visible(line), file=sys.stderr if error else sys.stdout, flush=True)


def console(error: bool = False) -> Screen:
    """The console for standard output (or standard error): rich detects the terminal, NO_COLOR and the pipe; COLUMNS counts for
    both."""
    from simspec.report.console import Screen

    stream = sys.stderr if error else sys.stdout
    terminal = stream.isatty()
    given = os.environ.get("COLUMNS", "")
    if given.isascii() and given.isdigit() and int(given) > 0:
        wanted = int(given)
    else:
        wanted = Screen(file=stream).width if terminal else PIPE_WIDTH
    width = min(max(wanted, NARROWEST), WIDEST)
    return (
        Screen(file=stream, width=width)
        if terminal
        else Screen(file=stream, width=width, no_color=True, force_terminal=False)
    )


# Progress: on a terminal as it goes, elsewhere a line now and then.

EVERY = 10.0
"""s between two lines where there is no terminal: a run of a minute leaves six, and silence never means that it hangs."""
FROM_SHARE = 0.02
"""Share of the work from which the remaining time is shown: before, it is a guess."""


class Progress(Protocol):
    """Receives the current work in words, and the share of it that is done, where that is known."""

    def __call__(self, text: str, share: float | None = None, /) -> None: ...


class Latest:
    """The latest report of progress, as a line: ``running x: 45 %, about 20 s left``. ``clock`` gives seconds.

    Another text is another work, unless the share goes on growing: ``3 of 40 runs`` and ``4 of 40 runs`` are one.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._text, self._share, self._since = "", 0.0, clock()

    def __call__(self, text: str, share: float | None = None, /) -> None:
        goes_on = bool(share and self._share and share >= self._share)
        if text != self._text and not goes_on:
            self._since = self._clock()
        self._text, self._share = text, share or 0.0

    def line(self) -> str:
        """The line to show now."""
        passed = self._clock() - self._since
        text = visible(self._text)
        if self._share <= 0.0:
            return f"{text}, for {duration(passed)}" if passed >= 1.0 else text
        given = f"{text}: {self._share:.0%}"
        if self._share < FROM_SHARE:
            return given
        return f"{given}, about {duration(passed * (1.0 - self._share) / self._share)} left"


def duration(seconds: float) -> str:
    """A time for reading: ``40 s``, ``3 min``, ``2 h 10 min``."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


@contextmanager
def progress(enabled: bool = True) -> Iterator[Progress]:
    """A function to say what is being done, and how far it is: shown on standard error, with a spinner on a terminal,
    elsewhere as a line every ``EVERY`` seconds. Nothing at all where not ``enabled``."""
    screen = console(error=True)
    given = Latest()
    if not enabled:
        yield given
    elif screen.is_terminal:
        from rich.text import Text

        with screen.status("") as status:

            def show(text: str, share: float | None = None, /) -> None:
                given(text, share)
                status.update(Text(given.line()))

            yield show
    else:
        ended = threading.Event()
        teller = threading.Thread(target=_tell, args=(given, ended), daemon=True, name="simspec-progress")
        teller.start()
        try:
            yield given
        finally:
            ended.set()
            teller.join()


def _tell(given: Latest, ended: threading.Event) -> None:
    while not ended.wait(EVERY):
        say(given.line(), error=True)
