"""How a target is written: next to it, synced, then put in its place by one rename; whole or not at all.

A *stage* is a folder ``.simspec-<16 digits>`` next to the target, with a marker file that its writer keeps locked. When the
lock is free, the writer is dead: the next writer in the same folder completes or removes its remains.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import json
import os
import re
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from simspec.errors import Problem, SpecError
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import MARKER_FILE, read_marker
from simspec.stored import StagingMarker, read_as

STAGE = re.compile(r"\.simspec-[0-9a-f]{16}")
STAGE_FILE = "simspec-staging.json"
LOCK_FILE = ".simspec-lock"
"""Only where a file system has no locks on folders (NFS)."""
VERSION = 1
FRESH, OLD = "new", "old"
PATIENCE = 120.0
"""s to wait for another simspec that writes in the same folder: each holds the lock for the renames only, or for some MB."""
LOOK_EVERY = 0.02
"""s between two tries."""
LARGEST_STAGE_FILE = 65536
_AT_FDCWD = {"linux": -100, "darwin": -2}
_RENAME_EXCHANGE = {"linux": 2, "darwin": 2}
_NO_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP)


class Stage:
    """A place next to a target. ``fresh`` is where the new content is built, by the caller."""

    def __init__(self, folder: Path, target: str, lock: int, lasting: bool = True):
        self.lasting = lasting
        self.folder = folder
        self.fresh = folder / FRESH
        self._target = target
        self._lock = lock

    def note(self) -> None:
        """Write down the inode of the new content: it shows to the next process on which side of the rename the stage is."""
        status = os.lstat(self.fresh)
        self.write({"simspec_staging": VERSION, "target": self._target, "fresh": [status.st_dev, status.st_ino]})

    def write(self, data: dict[str, object]) -> None:
        """Write the stage's marker."""
        os.pwrite(self._lock, (json.dumps(data) + "\n").encode().ljust(512), 0)  # one write of one block: whole or not
        if self.lasting:
            os.fsync(self._lock)

    def close(self) -> None:
        """Remove what is left of the stage; after the exchange, that is the target's old content."""
        try:
            if self.folder.exists():
                recover(self.folder)
        finally:
            os.close(self._lock)


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Hold the lock on what is written in ``folder`` (made where it is missing), cleaned of what the dead have left there."""
    os.makedirs(folder, exist_ok=True)
    with locked(folder):
        clean(folder)
        yield


@contextlib.contextmanager
def begun(target: Path, lasting: bool = True) -> Iterator[Stage]:
    """A stage next to ``target`` (a real path), of which nothing is left afterwards. Its folder must be locked throughout.

    ``lasting``: whether all is synced, so that also a power cut leaves the old or the new.
    """
    stage = begin(target, lasting)
    try:
        yield stage
    finally:
        stage.close()


@contextlib.contextmanager
def staged(target: Path) -> Iterator[Stage]:
    """The same for long work: the folder is locked at the beginning and at the end only."""
    with alone(target.parent):
        stage = begin(target)
    try:
        yield stage
    finally:
        with locked(target.parent):
            stage.close()


def begin(target: Path, lasting: bool = True) -> Stage:
    """Make a stage. The folder of ``target`` must be locked."""
    folder = target.parent / f".simspec-{secrets.token_hex(8)}"
    lock = -1
    os.mkdir(folder)
    try:
        lock = os.open(folder / STAGE_FILE, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        stage = Stage(folder, target.name, lock, lasting)
        stage.write({"simspec_staging": VERSION, "target": target.name})
    except BaseException:
        recover(folder)
        if lock >= 0:
            os.close(lock)
        raise
    return stage


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock on what is written in ``folder``. Raises SpecError when another process keeps it too long."""
    ends = time.monotonic() + PATIENCE
    while (is_locked := _try_lock(folder)) is None:
        if time.monotonic() > ends:
            raise SpecError(
                [Problem(f"{folder}: another simspec has been writing here for {PATIENCE:g} s", code="C111")]
            )
        time.sleep(LOOK_EVERY)
    handle, path = is_locked
    try:
        yield
    finally:
        if path is not None:
            os.unlink(path)
        os.close(handle)


def _try_lock(folder: Path) -> tuple[int, Path | None] | None:
    """Lock the folder itself, or a file in it where folders cannot be locked; None when another process has the lock."""
    handle, path = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC), None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            os.close(handle)
            path = folder / LOCK_FILE
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        there = folder if path is None else path
        if _same(handle, there):
            return handle, path
    except BlockingIOError:
        pass
    except BaseException:
        os.close(handle)
        raise
    os.close(handle)
    return None


def _same(handle: int, path: Path) -> bool:
    """Whether what was locked still is what has that name: a folder may have been replaced, a lock's file removed."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def clean(folder: Path) -> None:
    """Complete or remove every stage in ``folder`` whose writer is dead. The folder must be locked."""
    with os.scandir(folder) as entries:
        found = [Path(entry.path) for entry in entries if STAGE.fullmatch(entry.name)]
    for stage in found:
        if stat.S_ISDIR(os.lstat(stage).st_mode) and _abandoned(stage):
            recover(stage)


def _abandoned(stage: Path) -> bool:
    """Whether a folder is a stage, by its marker (or so young that it has none yet), and its lock is free."""
    try:
        handle = os.open(stage / STAGE_FILE, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        return not any(os.scandir(stage))  # its writer died before it could say more
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        young = os.fstat(handle).st_size == 0 and _only_marker(stage)
        return young or _marker(stage) is not None
    except OSError:
        return False
    finally:
        os.close(handle)


def _only_marker(stage: Path) -> bool:
    return [entry.name for entry in os.scandir(stage)] == [STAGE_FILE]


def _marker(stage: Path) -> StagingMarker | None:
    try:
        found = read_as(StagingMarker, read_bytes(stage / STAGE_FILE, LARGEST_STAGE_FILE), str(stage))
    except (SpecError, OSError):
        return None
    plain = found.simspec_staging == VERSION and found.target not in ("", ".", "..") and "/" not in found.target
    return found if plain else None


def recover(stage: Path) -> None:
    """Bring a stage to its end: before the exchange the new content goes, after it the old one (but for files of others)."""
    marker = _marker(stage)
    if marker is not None:
        target, fresh, old = stage.parent / marker.target, stage / FRESH, stage / OLD
        if os.path.lexists(old):
            # between the two renames of a system that cannot exchange: the new content is whole
            if not os.path.lexists(target) and os.path.lexists(fresh):
                os.rename(fresh, target)
            dispose(old, target)
        if os.path.lexists(fresh):
            status = os.lstat(fresh)
            if marker.fresh is None or marker.fresh == [status.st_dev, status.st_ino]:
                if stat.S_ISDIR(os.lstat(fresh).st_mode):
                    shutil.rmtree(fresh)
                else:
                    os.unlink(fresh)
            else:
                dispose(fresh, target)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(stage / STAGE_FILE)
    elif _only_marker(stage):
        os.unlink(stage / STAGE_FILE)
    os.rmdir(stage)


def dispose(old: Path, target: Path) -> None:
    """Remove the former content of ``target``. Files that simspec did not write stay: they are put back into ``target``."""
    if not stat.S_ISDIR(os.lstat(old).st_mode):
        os.unlink(old)
        return
    try:
        marker = read_marker(old)
    except SpecError:
        marker = None  # damaged meanwhile: nothing is known to be simspec's
    for place, folders, files in os.walk(old, topdown=False):
        for name in files:
            path = Path(place) / name
            relative = path.relative_to(old).as_posix()
            if relative != MARKER_FILE and (marker is None or not marker.owns(relative)):
                _give_back(path, target / relative)
            elif relative != MARKER_FILE:
                os.unlink(path)
        for name in folders:
            path = Path(place) / name
            if path.is_symlink():
                _give_back(path, target / path.relative_to(old))
            else:
                with contextlib.suppress(FileNotFoundError):
                    os.rmdir(path)
    # the marker last: until then whoever finds this knows what is whose
    with contextlib.suppress(FileNotFoundError):
        os.unlink(old / MARKER_FILE)
    os.rmdir(old)


def _give_back(path: Path, place: Path) -> None:
    """Put a file that is not simspec's where it was; next to it, under a new name, if another file is there now."""
    os.makedirs(place.parent, exist_ok=True)
    count = 0
    while os.path.lexists(place):
        if os.path.samestat(os.lstat(path), os.lstat(place)):
            os.unlink(path)  # linked there before the exchange
            return
        count += 1
        place = place.with_name(f"{path.name}.kept-{count}")
    os.rename(path, place)


def publish(stage: Stage, target: Path, exists: bool) -> None:
    """Put the new content in the target's place. The parent must be locked; the previous content is in the stage afterwards."""
    stage.note()
    if not exists:
        os.rename(stage.fresh, target)
    elif not exchange(stage.fresh, target):
        # no such call here: for a moment there is nothing at the target, which the next call in this folder would repair
        os.rename(target, stage.folder / OLD)
        os.rename(stage.fresh, target)
    sync_folder(target.parent)


def exchange(path: Path, other: Path) -> bool:
    """Exchange two paths in one step (renameat2 on Linux, renameatx_np on macOS); False where that cannot be done."""
    system = sys.platform
    if system not in _AT_FDCWD:
        return False
    call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2" if system == "linux" else "renameatx_np", None)
    if call is None:
        return False
    here = _AT_FDCWD[system]
    if call(here, os.fsencode(path), here, os.fsencode(other), ctypes.c_uint(_RENAME_EXCHANGE[system])) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(other))


def sync_folder(folder: Path) -> None:
    """Make the names in a folder last."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
