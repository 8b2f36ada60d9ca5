"""Captured output of the native code of an engine."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

_COLOUR = re.compile("\x1b\\[[0-9;]*m")


@contextlib.contextmanager
def captured(stream: TextIO, lines: list[str], known: Sequence[str] = ()) -> Iterator[None]:
    """Catch what native code of this process prints meanwhile to ``sys.stdout`` or ``sys.stderr``, and add it to ``lines``.

    Blank lines, colours and lines with one of the ``known`` texts are left out.
    """
    if os.name != "posix":  # the C library's buffers cannot be flushed from here; nothing is caught
        yield
        return
    descriptor = 2 if stream is sys.stderr else 1
    flush = ctypes.CDLL(None).fflush
    stream.flush()
    flush(None)
    original = os.dup(descriptor)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), descriptor)
        try:
            yield
        finally:
            flush(None)
            os.dup2(original, descriptor)
            os.close(original)
            file.seek(0)
            printed = _COLOUR.sub("", file.read().decode(errors="replace")).splitlines()
            lines.extend(line for line in printed if line.strip() and not any(text in line for text in known))


# Long activities of an engine that are no steps: reported to the process that waits, by a file next to the request.

DOING = "doing.txt"
"""The file, in the process's own folder: there while something takes long."""
_place: list[Path] = []


def tell_into(folder: Path) -> None:
    """From now on this process reports its long work by a file in ``folder``."""
    _place[:] = [folder / DOING]


@contextlib.contextmanager
def doing(what: str) -> Iterator[None]:
    """Report ``what`` (a few words) while the block runs; only in a worker's process."""
    with contextlib.suppress(OSError):  # a courtesy, as is to read it
        for place in _place:
            place.write_text(what, encoding="utf-8")
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            for place in _place:
                place.unlink(missing_ok=True)
