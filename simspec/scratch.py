"""Temporary folders that do not outlive their process for long: each is marked, and a dead process's are removed by the next.

The marker is a file inside, locked for as long as the process lives that made the folder: the system lets the lock go when the
process ends, however it ends. A folder is removed only when it is this user's, carries the marker, and nobody holds the lock.
"""

from __future__ import annotations

import fcntl
import functools
import os
import secrets
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
NEW = f"{MARKER}.new"
"""Name of the marker until it is whole and locked."""
UNMARKED = 0o1700
"""Mode that a folder is made with: a sticky bit on what only its owner can write to, which nobody has a use for. So a folder
is known that is empty because its process ended before it could mark it."""


@contextmanager
def scratch_folder(what: str) -> Iterator[Path]:
    """A new temporary folder ``simspec-WHAT-…``, removed at the end of the block; see the module for what happens otherwise."""
    clean_up()
    made = None
    while made is None:
        made = _make(Path(tempfile.gettempdir(), f"{PREFIX}{what}-{secrets.token_hex(4)}"))
    folder, lock = made
    try:
        yield folder
    finally:
        # what cannot be removed now is left to the next process: it must not hide what the block came to
        _remove(folder, lock)
        os.close(lock)


def _make(folder: Path) -> tuple[Path, int] | None:
    """Make a folder with its marker; returns it with the marker, open and locked. None where the name is taken, or where
    another process took the folder for a dead one's while it had no marker."""
    try:
        os.mkdir(folder, UNMARKED)
    except FileExistsError:
        return None
    lock = -1
    try:
        # locked before it has the marker's name: nobody can find it unlocked
        lock = os.open(folder / NEW, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        os.write(lock, CONTENT)
        os.rename(folder / NEW, folder / MARKER)
    except BaseException as error:
        if lock >= 0:
            os.close(lock)
        _remove_dead(folder)
        if isinstance(error, FileNotFoundError):
            return None
        raise
    return folder, lock


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
    except FileNotFoundError:
        _remove_unmarked(folder)
        return
    except OSError:
        return  # gone meanwhile, or not one of ours to remove
    try:
        if not stat.S_ISREG(os.fstat(marker).st_mode) or os.read(marker, len(CONTENT) + 1) != CONTENT:
            return
        fcntl.flock(marker, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _remove(folder, marker)
    except OSError:
        return  # locked: its process lives
    finally:
        os.close(marker)


def _remove_unmarked(folder: Path) -> None:
    """Remove a folder whose process ended before it was marked: empty, or with a marker that is not whole yet, and of the mode
    that simspec alone gives."""
    opened = fresh = -1
    try:
        opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        found = os.fstat(opened)
        if found.st_uid != os.geteuid() or stat.S_IMODE(found.st_mode) & ~stat.S_ISGID != UNMARKED:
            return
        if os.listdir(opened) == [NEW]:
            fresh = os.open(NEW, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=opened)
            if not stat.S_ISREG(os.fstat(fresh).st_mode) or not CONTENT.startswith(os.read(fresh, len(CONTENT) + 1)):
                return
            fcntl.flock(fresh, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(NEW, dir_fd=opened)
        folder.rmdir()
    except OSError:
        return  # locked: its process lives; or gone, or there is something in it
    finally:
        for descriptor in (opened, fresh):
            if descriptor >= 0:
                os.close(descriptor)


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
