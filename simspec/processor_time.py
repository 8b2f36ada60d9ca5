"""Processor time of this process and of the programs that work for it, which the system counts for themselves alone."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

Clock = Callable[[], float]
"""Gives seconds."""
_others: list[Clock] = []


def processor_clock() -> Clock:
    """The clock of all that work here now: of this process alone, as the system has it, where nothing else works."""
    if not _others:
        return time.process_time
    return lambda: time.process_time() + sum(other() for other in _others)


@contextlib.contextmanager
def counted(other: Clock) -> Iterator[None]:
    """Count what ``other`` says to the processor time of this process, within the block."""
    _others.append(other)
    try:
        yield
    finally:
        _others.remove(other)
