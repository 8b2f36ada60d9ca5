"""Reading what others may have put there: regular files only, of bounded size, never through a link.

A FIFO hangs its reader, a device never ends, and a symbolic link in a folder from a stranger would have its target's content
read, and perhaps copied, in the stranger's name.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from simspec.errors import Problem, SpecError

MOST_FILES = 100_000
"""Entries of one folder of output: the largest scenario has one file for each of 10,000 bodies."""
LARGEST_TEXT = 256 * 2**20
"""Bytes of a text that simspec wrote; the largest, the MJCF of 10,000 bodies, has 20 MB."""

KINDS = (
    (stat.S_ISLNK, "a symbolic link"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISREG, "a regular file"),
)


def kind_of(mode: int) -> str:
    """What stands at a path, in words."""
    return next((name for test, name in KINDS if test(mode)), "something unknown")


def refuse(path: Path | str, why: str, hint: str | None = None) -> SpecError:
    """The error of a file that cannot be read."""
    return SpecError([Problem(f"{path}: {why}", hint=hint)])


def open_regular(path: Path, limit: int, root: Path | None = None) -> int:
    """A descriptor of a regular file of at most ``limit`` bytes.

    ``root``: the folder that the file must be in; no part of the way from there may be a link. Raises FileNotFoundError when
    there is no file, SpecError (which names it) when it is none to read.
    """
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        if root is None:
            found = os.open(path, flags)
        else:
            found = _open_below(root, path.relative_to(root).parts, flags)
    except FileNotFoundError:
        raise
    except OSError as error:
        try:
            mode = os.lstat(path).st_mode
        except OSError:
            mode = stat.S_IFREG
        if not stat.S_ISREG(mode):
            raise refuse(path, f"{kind_of(mode)}, where a regular file is expected") from None
        raise refuse(path, f"cannot be read: {error.strerror}") from None
    held = os.fstat(found)
    if not stat.S_ISREG(held.st_mode):
        os.close(found)
        raise refuse(path, f"{kind_of(held.st_mode)}, where a regular file is expected")
    if held.st_size > limit:
        os.close(found)
        raise refuse(path, f"{held.st_size / 1e6:.1f} MB, more than the {limit / 1e6:.1f} MB that such a file may have")
    return found


def _open_below(root: Path, parts: tuple[str, ...], flags: int) -> int:
    folder = os.open(root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        for part in parts[:-1]:
            if part == "..":
                raise refuse(root.joinpath(*parts), "leaves its folder")
            below = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)
            os.close(folder)
            folder = below
        return os.open(parts[-1], flags, dir_fd=folder)
    finally:
        os.close(folder)


def read_bytes(path: Path, limit: int = LARGEST_TEXT, root: Path | None = None) -> bytes:
    """The content of a regular file of at most ``limit`` bytes; as :func:`open_regular`."""
    with os.fdopen(open_regular(path, limit, root), "rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise refuse(path, f"more than {limit / 1e6:.1f} MB")
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
                    raise refuse(folder / name, f"{kind_of(mode)}, where only regular files are expected")
                if len(found) + len(waiting) > most:
                    raise refuse(folder, f"holds more than {most} files")
    return sorted(found)
