"""Files of users: reading them in bounded memory, and appending to them."""

from __future__ import annotations

import gzip
import os
import stat
import zlib
from io import BytesIO
from pathlib import Path

from simspec import files
from simspec.errors import Problem, SpecError
from simspec.files import kind

# Reading what others may have put there: regular files only, of bounded size, never through a link.
#
# A FIFO hangs its reader, a device never ends, and a symbolic link in an untrusted folder would have its target's content
# read, and perhaps copied, in the name of its author.

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
        return files.open_regular(path, limit)
    except FileNotFoundError:
        raise
    except files.NotReadableError as error:
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
            raise files.NotReadableError(f"its folder {str(place)!r} is {files.kind(mode)}")


def read_bytes(path: Path, limit: int = LARGEST_TEXT, root: Path | None = None) -> bytes:
    """The content of a regular file of at most ``limit`` bytes; as :func:`open_regular`."""
    with os.fdopen(open_regular(path, limit, root), "rb") as file:
        content = files.read_at_most(file, limit)
    if len(content) > limit:
        raise refuse(path, f"more than the {limit:,} bytes that are read")
    return content


def read_gzip(path: Path, limit: int, root: Path | None = None) -> bytes:
    """The uncompressed content of a file, both of at most ``limit`` bytes; as :func:`open_regular`. Raises SpecError also
    where it is damaged."""
    try:
        with gzip.GzipFile(fileobj=BytesIO(read_bytes(path, limit, root))) as file:
            content = file.read(limit + 1)
    except FileNotFoundError:
        raise
    except (OSError, EOFError, zlib.error) as error:
        raise refuse(path, f"cannot be read: {str(error)[:200]}") from None
    if len(content) > limit:
        raise refuse(path, f"more than {limit:,} bytes uncompressed")
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
                    raise refuse(folder / name, f"{files.kind(mode)}, where only regular files are expected")
                if len(found) + len(waiting) > most:
                    raise refuse(folder, f"holds more than {most} files")
    return sorted(found)


# Adding to a file that another program gives simspec to add to, as CI systems do.


def append_text(path: Path, text: str, most: int) -> bool:
    """Add text to a regular file, which is made where there is none; whether it was added: the file may hold ``most`` bytes.

    Raises SpecError when it is no regular file, OSError when it cannot be written.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    descriptor = os.open(path, flags, 0o644)
    with os.fdopen(descriptor, "ab") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise SpecError([Problem(f"{str(path)!r} is {kind(status.st_mode)}, not a file to add to")])
        content = text.encode()
        if status.st_size + len(content) > most:
            return False
        file.write(content)
    return True


def file_size(path: Path) -> int:
    """Bytes of a file; 0 where there is none."""
    try:
        return os.stat(path).st_size
    except FileNotFoundError:
        return 0
