"""Adding to a file that another program gives simspec to add to, as CI systems do."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from simspec.errors import Problem, SpecError
from simspec.reading import kind


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


def size_of(path: Path) -> int:
    """Bytes of a file; 0 where there is none."""
    try:
        return os.stat(path).st_size
    except FileNotFoundError:
        return 0
