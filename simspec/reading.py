"""Reading files that another program wrote, or that a stranger sent: regular files only, no links, no more than is allowed."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any, BinaryIO

MOST_VALUES = 4_000_000
"""Values in one JSON file: each may take 100 bytes of memory. A world of 10,000 bodies has one million."""


class NotReadableError(ValueError):
    """The file is of another kind, too large, or not text. The message names what is wrong, not the file."""


def open_regular(path: Path, most: int, *, links: bool = False) -> int:
    """A descriptor of the regular file ``path``, of at most ``most`` bytes; the caller closes it.

    Never waits, whatever ``path`` is (opening a FIFO for reading would, until somebody writes). A symbolic link as the last
    part of the path is refused unless ``links``. Raises NotReadableError, and OSError as ``os.open`` does.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if links else os.O_NOFOLLOW)
    if not links and path.is_symlink():
        raise NotReadableError("a symbolic link, not a file")
    descriptor = os.open(path, flags)
    try:
        found = os.fstat(descriptor)
        _demand(found, most)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _demand(found: os.stat_result, most: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise NotReadableError(f"{kind(found.st_mode)}, not a regular file")
    if found.st_size > most:
        raise NotReadableError(f"{found.st_size:,} bytes, more than the {most:,} that are read")


def read_bytes(path: Path, most: int, *, links: bool = False) -> bytes:
    """The content of a regular file of at most ``most`` bytes; see :func:`open_regular`."""
    with os.fdopen(open_regular(path, most, links=links), "rb") as file:
        content = read_at_most(file, most)
    if len(content) > most:
        raise NotReadableError(f"more than the {most:,} bytes that are read")
    return content


def read_at_most(file: BinaryIO, most: int) -> bytes:
    """The content of a file; of one of more than ``most`` bytes, one byte more than that. Takes no more memory than it has."""
    content = file.read(min(most, os.fstat(file.fileno()).st_size) + 1)
    while len(content) <= most and (more := file.read(min(most + 1 - len(content), 2**20))):
        content += more  # it grew meanwhile, or its size is not told (as below /proc)
    return content


def read_text(path: Path, most: int, *, links: bool = False) -> str:
    """As :func:`read_bytes`, of a file in UTF-8."""
    try:
        return read_bytes(path, most, links=links).decode("utf-8")
    except UnicodeDecodeError as error:
        raise NotReadableError(f"not UTF-8 text: {error.reason} at byte {error.start}") from None


def parse_json(content: bytes | str) -> Any:
    """JSON as plain data, in bounded memory. Raises NotReadableError for anything else, also for NaN."""
    values = sum(
        content.count(b"%c" % mark) if isinstance(content, bytes) else content.count(chr(mark)) for mark in b",[{"
    )
    if values > MOST_VALUES:
        raise NotReadableError(f"{values:,} values, more than the {MOST_VALUES:,} that are read")
    try:
        return json.loads(content, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise NotReadableError(f"not JSON: {why[:200]}") from None


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant} is not a number")


def kind(mode: int) -> str:
    """What a file of this mode is, in words."""
    for test, word in (
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a FIFO"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
        (stat.S_ISSOCK, "a socket"),
        (stat.S_ISLNK, "a symbolic link"),
        (stat.S_ISREG, "a file"),
    ):
        if test(mode):
            return word
    return "of an unknown kind"
