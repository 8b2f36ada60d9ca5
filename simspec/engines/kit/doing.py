"""What an engine does that takes long and is no step: told to who waits for its process, by a file beside its request."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

DOING = "doing.txt"
"""The file, in the process's own folder: there while something takes long."""
_place: list[Path] = []


def tell_into(folder: Path) -> None:
    """From now on this process tells what it does by a file in ``folder``."""
    _place[:] = [folder / DOING]


@contextlib.contextmanager
def doing(what: str) -> Iterator[None]:
    """While this lasts, say that it is done: a few words. Nobody is told in a process that no worker runs in."""
    with contextlib.suppress(OSError):  # a courtesy, as is to read it
        for place in _place:
            place.write_text(what, encoding="utf-8")
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            for place in _place:
                place.unlink(missing_ok=True)
