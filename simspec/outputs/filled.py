"""A folder in the user's cache that a library fills by itself, with a folder for each version and in it one for each thing that
it made: how many of these are kept, and that none is removed while a process uses it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
from pathlib import Path

from simspec.outputs.cache import demand_private

LOCK = "lock"

_held: list[int] = []
"""The lock of this process, which the system lets go when it and those that were forked from it have ended."""


def hold(folder: Path, made: re.Pattern[str], most: int) -> None:
    """Say that this process uses what is kept in a folder. Where no other does, what is more than ``most`` is removed before:
    the library reads files that it has seen to be there. Those stay that were made last, since a library leaves no mark of use;
    what has no name as in ``made`` is nobody's here, and stays. Raises OSError where the folder cannot be written, and
    PermissionError where others than this user can write it, since the library runs what it finds there."""
    demand_private(folder)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = os.lstat(folder)
    if status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise PermissionError(f"{folder} is not a folder that this user alone can write: remove it")
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    _held.append(lock)
    with contextlib.suppress(BlockingIOError):  # another uses it: the next that is alone removes what is too much
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _remove(folder, made, most)
    fcntl.flock(lock, fcntl.LOCK_SH)


def _remove(folder: Path, made: re.Pattern[str], most: int) -> None:
    """Remove all but the ``most`` that were made last, of all versions; what a killed process left is one of them."""
    found = [
        (one.stat(follow_symlinks=False).st_mtime_ns, one.path)
        for version in os.scandir(folder)
        if version.is_dir(follow_symlinks=False)
        for one in os.scandir(version)
        if made.fullmatch(one.name) and one.is_dir(follow_symlinks=False)
    ]
    for _, path in sorted(found)[: max(len(found) - most, 0)]:
        shutil.rmtree(path)
