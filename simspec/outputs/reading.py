"""Reading what others may have put there: regular files only, of bounded size, never through a link.

A FIFO hangs its reader, a device never ends, and a symbolic link in a folder from a stranger would have its target's content
read, and perhaps copied, in the stranger's name.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from simspec import reading
from simspec.errors import Problem, SpecError

MOST_FILES = 100_000
"""Entries of one folder of output: the largest scenario has one file for each of 10,000 bodies."""
LARGEST_TEXT = 256 * 2**20
"""Bytes of a text that simspec wrote; the largest known, a file of 10,000 bodies, has 20 MB."""


def refuse(path: object, why: str, hint: str | None = None) -> SpecError:
    """The error of a file that cannot be read."""
    return SpecError([Problem(f"{path}: {why}", hint=hint)])


def open_regular(path: Path, limit: int, root: Path | None = None) -> int:
    """A descriptor of a regular file of at most ``limit`` bytes.

    ``root``: the folder that the file must be in; no part of the way from there may be a link. Raises FileNotFoundError when
    there is no file, SpecError (which names it) when it is none to read.
    """
    try:
        if root is not None:
            _demand_below(root, path.relative_to(root).parts)
        return reading.open_regular(path, limit)
    except FileNotFoundError:
        raise
    except reading.NotReadableError as error:
        raise refuse(path, str(error)) from None
    except OSError as error:
        raise refuse(path, f"cannot be read: {error.strerror}") from None


def _demand_below(root: Path, parts: tuple[str, ...]) -> None:
    """Raise NotReadableError where the way from ``root`` to a file goes through anything but folders."""
    place = root
    for part in parts[:-1]:
        place /= part
        mode = os.lstat(place).st_mode
        if part == ".." or not stat.S_ISDIR(mode):
            raise reading.NotReadableError(f"its folder {str(place)!r} is {reading.kind(mode)}")


def read_bytes(path: Path, limit: int = LARGEST_TEXT, root: Path | None = None) -> bytes:
    """The content of a regular file of at most ``limit`` bytes; as :func:`open_regular`."""
    with os.fdopen(open_regular(path, limit, root), "rb") as file:
        content = reading.read_at_most(file, limit)
    if len(content) > limit:
        raise refuse(path, f"more than the {limit:,} bytes that are read")
    return content


def read_text(path: Path, limit: int = LARGEST_TEXT, root: Path | None = None) -> str:
    """The same as text. Raises SpecError also where it is not UTF-8."""
    try:
        return read_bytes(path, limit, root).decode("utf-8")
    except UnicodeDecodeError as error:
        raise refuse(path, f"not UTF-8 at byte {error.start}") from None


def files_below(folder: Path, most: int = MOST_FILES) -> list[str]:
    """The relative paths of all files below a folder, sorted.

    Raises SpecError where one is no regular file (a link, a pipe, a device), or there are more than ``most``.
    """
    found: list[str] = []
    waiting = [""]
    while waiting:
        below = waiting.pop()
        with os.scandir(folder / below) as entries:
            for entry in entries:
                name = f"{below}/{entry.name}" if below else entry.name
                mode = entry.stat(follow_symlinks=False).st_mode
                if stat.S_ISDIR(mode):
                    waiting.append(name)
                elif stat.S_ISREG(mode):
                    found.append(name)
                else:
                    raise refuse(folder / name, f"{reading.kind(mode)}, where only regular files are expected")
                if len(found) + len(waiting) > most:
                    raise refuse(folder, f"holds more than {most} files")
    return sorted(found)
