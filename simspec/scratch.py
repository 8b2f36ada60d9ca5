"""Temporary folders that do not outlive their process for long: each is marked, and a dead process's are removed by the next.

The marker is a file inside, locked for as long as the process lives that made the folder: the system lets the lock go when the
process ends, however it ends. A folder is removed only when it is this user's, carries the marker, and nobody holds the lock.
"""

from __future__ import annotations

import fcntl
import functools
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PREFIX = "simspec-"
MARKER = ".simspec-scratch"
"""Name of the marker in a folder."""
CONTENT = b"simspec scratch folder 1: removed when the process that made it is gone\n"
"""What makes a file of that name a marker."""


@contextmanager
def scratch_folder(what: str) -> Iterator[Path]:
    """A new temporary folder ``simspec-WHAT-…``, removed at the end of the block; see the module for what happens otherwise."""
    clean_up()
    folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{what}-"))
    lock = -1
    try:
        # locked before it has the marker's name: nobody can find it unlocked
        fresh = folder / f"{MARKER}.new"
        lock = os.open(fresh, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        os.write(lock, CONTENT)
        fresh.rename(folder / MARKER)
        yield folder
    finally:
        # what cannot be removed now is left to the next process: it must not hide what the block came to
        if lock >= 0:
            _remove(folder, lock)
            os.close(lock)


@functools.cache
def clean_up() -> None:
    """Remove the folders of dead processes; once in a process."""
    root = Path(tempfile.gettempdir())
    try:
        names = os.listdir(root)
    except OSError:
        return  # making a folder there fails next, and says so
    for name in names:
        if name.startswith(PREFIX):
            _remove_dead(root / name)


def _remove_dead(folder: Path) -> None:
    try:
        found = os.lstat(folder)
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
            return
        marker = os.open(folder / MARKER, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return  # no marker, or gone meanwhile: not one of ours to remove
    try:
        if not stat.S_ISREG(os.fstat(marker).st_mode) or os.read(marker, len(CONTENT) + 1) != CONTENT:
            return
        fcntl.flock(marker, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _remove(folder, marker)
    except OSError:
        return  # locked: its process lives
    finally:
        os.close(marker)


def _remove(folder: Path, marker: int) -> None:
    """Remove the folder that holds the open file ``marker`` as its marker, that last: the next process can finish an
    interrupted removal. Works on the opened folder, so that nothing put in its place meanwhile is touched."""
    try:
        opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return  # gone, or replaced by something else
    try:
        if not os.path.samestat(os.stat(MARKER, dir_fd=opened, follow_symlinks=False), os.fstat(marker)):
            return
        with os.scandir(opened) as entries:
            names = {entry.name: entry.is_dir(follow_symlinks=False) for entry in entries if entry.name != MARKER}
        for name, is_folder in names.items():
            if is_folder:
                shutil.rmtree(name, dir_fd=opened)
            else:
                os.unlink(name, dir_fd=opened)
        os.unlink(MARKER, dir_fd=opened)
        folder.rmdir()
    except OSError:
        return  # in use, or protected: the next process tries again
    finally:
        os.close(opened)
