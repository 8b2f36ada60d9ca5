"""Folders that grow: finished folders and files are placed in a marked folder one by one, under names that say what they are.

A named entry is whole. It is written below ``tmp/`` on the same disk, synced, and renamed; a name that is taken is not
written again. So a process may end at any moment: all that it leaves is below ``tmp/``, and the next one that holds the lock
removes that. The lock is the system's, on an open file: it ends with the process, however the process ends.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from simspec.errors import Problem, SpecError
from simspec.files import kind as kind_of
from simspec.outputs.files import cache_folder, read_bytes, written_by_others
from simspec.outputs.staging import locked, sync_folder
from simspec.outputs.targets import check_folder, check_names
from simspec.outputs.writing import Content, named_errors, put, sync, update_folder, write_file

TEMPORARY = "tmp"
"""Unfinished files, below the collection: the rename stays on one disk."""
LOCK_FILE = "lock"
ASIDE = "damaged"
"""Where what is not what its name says is moved to: it may still be of use."""
LOOK_EVERY = 0.2
"""s between two looks at a lock that another process has."""
MOST_HOLDER = 200
"""Characters of what a lock's file says of its holder."""
_TAKEN = (errno.EEXIST, errno.ENOTEMPTY)


def open_collection(folder: Path, kind: str, files: Mapping[str, Content]) -> Collection:
    """The collection in ``folder``, made with ``files`` where there is none. Raises SpecError when the folder belongs to
    another program, or a folder of another kind (:mod:`simspec.outputs.targets`)."""
    place, marker = check_folder(folder, kind)
    if marker is None:
        update_folder(lambda there: files if there is None else None, folder, kind)
    return Collection(place.path, folder)


class Collection:
    """A marked folder: ``path`` is its real path, ``told`` the one that messages name."""

    def __init__(self, path: Path, shown: Path):
        self.path = path
        self.shown = shown

    @contextlib.contextmanager
    def alone(self, holder: str, wait: bool = False) -> Iterator[None]:
        """Hold the lock, and remove what dead holders left below ``tmp/``.

        ``holder``: a description of the lock's holder, for the message of the next process. Raises SpecError when another
        process has it, unless ``wait``.
        """
        lock = self._locked(wait)
        try:
            os.ftruncate(lock, 0)
            os.pwrite(lock, holder.encode()[:MOST_HOLDER], 0)
            path = self._folder(TEMPORARY)
            for entry in os.scandir(path):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path)
                else:
                    os.unlink(entry.path)
            yield
        finally:
            os.close(lock)

    def _locked(self, wait: bool) -> int:
        while True:
            lock = self._open_lock()
            try:
                if _take(lock, self.path / LOCK_FILE):
                    return lock
                holder = os.pread(lock, MOST_HOLDER, 0).decode(errors="replace")
            except OSError as error:
                os.close(lock)
                raise self._error(f"{self.shown / LOCK_FILE} cannot be locked: {error.strerror}") from None
            except BaseException:
                os.close(lock)
                raise
            os.close(lock)
            if not wait:
                raise self._error(
                    f"{self.shown}: another process is writing here{f' ({holder})' if holder else ''}",
                    "wait until it has ended (--wait), or use another folder",
                )
            time.sleep(LOOK_EVERY)

    def _open_lock(self) -> int:
        path = self.path / LOCK_FILE
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        try:
            lock = os.open(path, flags, 0o644)
        except OSError as error:
            raise self._error(f"{self.shown / LOCK_FILE} cannot be opened: {error.strerror}") from None
        mode = os.fstat(lock).st_mode
        if not stat.S_ISREG(mode):
            os.close(lock)
            raise self._error(f"{self.shown / LOCK_FILE} is {kind_of(mode)}, not a regular file")
        return lock

    def has(self, name: str) -> bool:
        """Whether something was placed under this name."""
        return os.path.lexists(self.path / name)

    def place(self, name: str, build: Callable[[Path], None]) -> bool:
        """Place a folder whose files ``build`` writes into the one that it is given. False, and nothing is written, where the
        name is taken. The lock must be held. Raises OSError, which names the collection, where the disk is full."""
        return self._place(name, build, os.mkdir)

    def place_file(self, name: str, content: Content) -> bool:
        """The same for a file."""
        return self._place(name, lambda fresh: put(fresh, content), None)

    def replace_file(self, name: str, content: Content) -> None:
        """Write a file over the one of this name, whole or not at all."""
        check_names([name], self.shown)
        with named_errors(self.shown), self._fresh() as fresh:
            put(fresh, content)
            sync(fresh)
            parent = self._folder(str(PurePosixPath(name).parent))
            os.replace(fresh, parent / PurePosixPath(name).name)
            sync_folder(parent)

    def set_aside(self, name: str) -> Path:
        """Move what has this name below ``damaged/``; its new path."""
        aside = self._folder(ASIDE)
        base = PurePosixPath(name).name
        place, count = aside / base, 1
        while os.path.lexists(place):
            count += 1
            place = aside / f"{base}-{count}"
        os.rename(self.path / name, place)
        sync_folder(aside)
        sync_folder((self.path / name).parent)
        return place

    def drop(self, name: str) -> None:
        """Remove a folder: at once from its place, then what is in it."""
        with self._fresh() as fresh:
            os.rename(self.path / name, fresh)
            sync_folder((self.path / name).parent)

    def _place(self, name: str, build: Callable[[Path], None], make: Callable[[Path], None] | None) -> bool:
        check_names([name], self.shown)
        if self.has(name):
            return False
        with named_errors(self.shown), self._fresh() as fresh:
            if make is not None:
                make(fresh)
            build(fresh)
            _sync_all(fresh)
            parent = self._folder(str(PurePosixPath(name).parent))
            target = parent / PurePosixPath(name).name
            try:
                os.rename(fresh, target)
            except OSError as error:
                if error.errno not in _TAKEN:
                    raise
                return False  # another process was first
            sync_folder(parent)
        return True

    @contextlib.contextmanager
    def _fresh(self) -> Iterator[Path]:
        """A new path below ``tmp/``; nothing is left of it afterwards."""
        fresh = self._folder(TEMPORARY) / secrets.token_hex(8)
        try:
            yield fresh
        finally:
            if fresh.is_dir():
                shutil.rmtree(fresh)
            elif os.path.lexists(fresh):
                os.unlink(fresh)

    def _folder(self, name: str) -> Path:
        """A folder below the collection, made where it is missing; never one that a link leads to."""
        place = self.path
        for part in PurePosixPath(name).parts:
            above, place = place, place / part
            try:
                os.mkdir(place)
                sync_folder(above)
            except FileExistsError:
                mode = os.lstat(place).st_mode
                if not stat.S_ISDIR(mode):
                    raise self._error(f"{place} is {kind_of(mode)}, not a folder") from None
        return place

    def _error(self, why: str, hint: str | None = None) -> SpecError:
        return SpecError([Problem(why, hint=hint, code="C106")])


def _take(lock: int, path: Path) -> bool:
    """Lock an open file; False where another process has it, or where ``path`` is another file by now."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(lock), os.lstat(path))
    except (BlockingIOError, FileNotFoundError):
        return False


def _sync_all(path: Path) -> None:
    if path.is_dir():
        for base, _, files in os.walk(path, topdown=False):
            for name in files:
                sync(Path(base, name))
            sync(Path(base))
    else:
        sync(path)


# Entries that are kept in the user's cache folder: each a file of its own, whole or not at all, and all together of bounded
# size. The caller interprets the content of an entry, and decides whether to trust it.

NAME: Final = re.compile(r"[0-9a-f]{64}\.json")
"""Names of entries: a SHA-256."""
LEFT: Final = 0.75
"""Share of the bound that is left when the oldest entries leave, so that this is not done for each new one."""


@dataclass(frozen=True)
class Entries:
    """The entries in the folder ``simspec/NAME`` of the user's cache folder (XDG_CACHE_HOME or ~/.cache).

    ``head``: how every entry begins; a file that begins otherwise is not simspec's, and is left alone. ``largest``: bytes of
    one that is read. ``bound``: bytes of all; beyond it those leave that were not read or written for the longest time.
    """

    name: str
    head: bytes
    largest: int
    bound: int

    def folder(self) -> Path | None:
        """Where entries are kept; None where the user has no cache folder."""
        return cache_folder(self.name)

    def refused(self) -> str | None:
        """Why the folder is not used, though the user has one: others may have written it; None where it is."""
        place = self.folder()
        why = None if place is None else written_by_others(place)
        return None if why is None else f"the cache {place} is not used: {why}"

    def read(self, key: str) -> bytes | None:
        """The entry of a key; None where there is none that can be read, or where others may have written it."""
        place = self.folder()
        if place is None or self.refused():
            return None
        path = place / f"{key}.json"
        try:
            content = read_bytes(path, self.largest, place)
        except (OSError, SpecError):
            return None
        with contextlib.suppress(OSError):  # a folder that is only read: its entries leave by when they were written
            os.utime(path, follow_symlinks=False)
        return content

    def write(self, key: str, content: str) -> bool:
        """Keep an entry; False where that is not possible, which costs time only. Every sixteenth key looks after the bound."""
        place = self.folder()
        if place is None or self.refused():
            return False
        try:
            # not synced: a file that a power cut truncates is no entry
            write_file(place / f"{key}.json", content, self._is_ours, lasting=False)
            if key.startswith("0"):
                self._shrink(place)
        except (OSError, SpecError):
            return False
        return True

    def _is_ours(self, content: bytes) -> bool:
        return content.startswith(self.head) or self.head.startswith(content)

    def _shrink(self, place: Path) -> None:
        """Delete the oldest entries, where all together are too large."""
        found: list[tuple[int, int, str]] = []
        with os.scandir(place) as inside:
            for entry in inside:
                status = entry.stat(follow_symlinks=False)
                if NAME.fullmatch(entry.name) and stat.S_ISREG(status.st_mode):
                    found.append((status.st_mtime_ns, status.st_size, entry.name))
        total = sum(size for _, size, _ in found)
        if total <= self.bound:
            return
        with locked(place):
            for _, size, name in sorted(found):
                if total <= LEFT * self.bound:
                    return
                path = place / name
                try:
                    if self._is_ours(read_bytes(path, self.largest, place)[: len(self.head)]):
                        path.unlink()
                except (FileNotFoundError, SpecError):
                    continue  # another process was faster, or it is not simspec's
                total -= size
