"""Files of users: reading them in bounded memory, and appending to them; and the user's cache folder. Imports nothing that an
engine's process may lack: it uses the cache, too, in whatever interpreter it lives."""

from __future__ import annotations

import contextlib
import fcntl
import gzip
import json
import os
import platform
import re
import secrets
import shutil
import stat
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Final

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
    return SpecError([Problem(f"{path}: {why}", hint=hint, code="C104")])


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
            raise SpecError([Problem(f"{str(path)!r} is {kind(status.st_mode)}, not a file to add to", code="C106")])
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


# The user's cache folder, and files in it that a program makes: each whole or not at all, made by one process at a time.

LOCK: Final = "lock"
STAGE: Final = re.compile(r"tmp-[0-9a-f]{16}")
"""Names of folders in which a file is being made."""
OURS: Final = re.compile(r"[0-9a-f]{64}(\.[a-z]+)?")
"""Names of files: a SHA-256, and what says their kind."""
KEPT: Final = 8
"""Files that a folder keeps by default: those that were used last. Each is of another version of a program or library."""
LOOK_EVERY: Final = 0.05
"""s between two tries for a lock."""


def cache_folder(name: str) -> Path | None:
    """The folder ``simspec/NAME`` of the user's cache folder (XDG_CACHE_HOME or ~/.cache); None where the user has none."""
    return _folder_of_user("XDG_CACHE_HOME", ".cache", name)


def data_folder(name: str) -> Path | None:
    """The folder ``simspec/NAME`` of the user's data folder (XDG_DATA_HOME or ~/.local/share); None where the user has none."""
    return _folder_of_user("XDG_DATA_HOME", ".local/share", name)


def _folder_of_user(variable: str, usual: str, name: str) -> Path | None:
    base = os.environ.get(variable, "")
    if os.path.isabs(base):  # the specification of these variables: a relative path is to be ignored
        return Path(base) / "simspec" / name
    if not os.path.isabs(os.environ.get("HOME", "/")):
        return None  # a relative HOME is a folder of whatever project the command is started in
    try:
        return Path.home() / usual / "simspec" / name
    except RuntimeError:
        return None


def written_by_others(folder: Path) -> str | None:
    """Why other users may have written into a folder, or put another in its place: a part of its path that is another user's
    (but root's), or that all users can write (but a parent with the sticky bit, as /tmp). Both the path as it is given and the
    one without links count: a link in a folder that all users can write leads where its last writer wants. None where no other
    user can."""
    given, place = Path(os.path.abspath(folder)), Path(os.path.realpath(folder))
    for part in dict.fromkeys((place, *place.parents, *given.parents)):
        try:
            status = os.stat(part)
        except OSError:
            continue  # not there yet, or not to be seen: nothing is read from it
        if status.st_uid not in (0, os.geteuid()):
            return f"{part} is another user's (uid {status.st_uid})"
        if status.st_mode & stat.S_IWOTH and (part == place or not status.st_mode & stat.S_ISVTX):
            return f"all users can write {part}"
    return None


def demand_private(folder: Path) -> None:
    """Raise PermissionError where others may have written into a folder: its files are executed."""
    if (why := written_by_others(folder)) is not None:
        raise PermissionError(f"the folder {folder} is not used: {why}")


def built(place: Path, build: Callable[[Path], None], patience: float, anew: bool = False, keep: int = KEPT) -> Path:
    """``place``, a file in a folder of such files alone, of which those ``keep`` stay that were used last. Where it is not
    there, or ``anew``, ``build`` makes it: under another name, in a folder of its own on the same disk, from where it is
    moved in one step.

    One process makes files in the folder at a time; a second process waits, up to ``patience`` (s), and finds the files of the
    first. Remains of a killed process are removed by the next that makes a file. Raises TimeoutError where another process
    takes longer, PermissionError where the file is another user's or others may write it, OSError, and what ``build`` raises.
    """
    if not OURS.fullmatch(place.name):
        raise ValueError(f"{place.name} is no name of a file that is made here")
    if not anew and is_there(place):
        return place
    folder = place.parent
    demand_private(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder, patience):
        _clean(folder, place, keep)
        if anew or not is_there(place):
            stage = folder / f"tmp-{secrets.token_hex(8)}"
            os.mkdir(stage, 0o700)
            try:
                build(stage / place.name)
                os.chmod(stage / place.name, 0o700)
                _sync(stage / place.name)
                os.replace(stage / place.name, place)
            finally:
                shutil.rmtree(stage)
    return place


def is_there(place: Path) -> bool:
    """Whether the file is there; it is then said to be used. Raises PermissionError where another user may have made it."""
    try:
        status = os.lstat(place)
    except FileNotFoundError:
        return False
    demand_private(place.parent)
    if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise PermissionError(f"{place} is not a file that this user alone can write: remove it")
    with contextlib.suppress(OSError):  # a folder that is only read: its files leave by when they were made
        os.utime(place, follow_symlinks=False)
    return True


@contextlib.contextmanager
def _locked(folder: Path, patience: float) -> Iterator[None]:
    """Hold the lock of a folder; the system lets it go when the process ends, however it ends."""
    ends = time.monotonic() + patience
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > ends:
                    raise TimeoutError(
                        f"another process has been making a file in {folder} for {patience:g} s"
                    ) from None
                time.sleep(LOOK_EVERY)
        yield
    finally:
        os.close(lock)


def _clean(folder: Path, place: Path, keep: int) -> None:
    """Remove what the dead left, and the files that were not used for the longest time. The folder must be locked."""
    known: list[tuple[int, str]] = []
    for entry in os.scandir(folder):
        if STAGE.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path)
        elif OURS.fullmatch(entry.name) and entry.name != place.name and entry.is_file(follow_symlinks=False):
            known.append((entry.stat(follow_symlinks=False).st_mtime_ns, entry.name))
    for _, name in sorted(known)[: -(keep - 1)]:
        os.unlink(folder / name)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


# Folders that other programs fill for simspec: a file in each says that simspec began it, and whether it is whole.
#
# One that broke off is not used, and is begun anew; a folder without that file is not touched.

BEGUN: Final = "simspec-begun.json"
"""The file that says whose a folder is: ``{"name": NAME, "whole": true or false}``, with the folder's own name."""
MOST: Final = 10_000
"""Bytes of that file."""


def is_complete(place: Path) -> bool | None:
    """Whether the folder at ``place`` is whole; None: there is none that simspec began for this user."""
    try:
        with (place / BEGUN).open("rb") as stream:
            if os.fstat(stream.fileno()).st_uid not in (os.geteuid(), 0):
                return None  # a program of another user is not started without a request
            content = json.loads(stream.read(MOST))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, Mapping) or content.get("name") != place.name:
        return None
    return content.get("whole") is True


def mark_begun(place: Path) -> None:
    """An empty folder at ``place``, in the place of one that simspec began before. Raises FileExistsError for what it did not
    begin, OSError."""
    if os.path.lexists(place):
        if is_complete(place) is None:
            raise FileExistsError(f"{place} exists, and simspec did not make it: move it away")
        shutil.rmtree(place)
    place.mkdir(parents=True)
    _mark(place, whole=False)


def mark_complete(place: Path) -> None:
    """Say that the folder at ``place`` is whole. Raises OSError."""
    _mark(place, whole=True)


def _mark(place: Path, whole: bool) -> None:
    (place / BEGUN).write_text(json.dumps({"name": place.name, "whole": whole}) + "\n", encoding="utf-8")


# The processor that a program runs on: the target of compilation, and the instructions by which libraries choose.


def processor() -> list[str]:
    """The processor's model and instruction sets, as far as the system says."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    wanted = ("model name", "flags", "Features", "CPU part")
    flags = dict.fromkeys(line for line in lines if line.split("\t")[0].split(":")[0].strip() in wanted)
    return [platform.machine(), platform.processor(), *flags]


# A folder in the user's cache that a library fills by itself, with a folder for each version and in it one for each thing that
# it made: how many of these are kept, and that none is removed while a process uses it.

LOCK_FILLED = "lock"

_locks: list[int] = []
"""The lock of this process, which the system lets go when it and those that were forked from it have ended."""


def hold_folder(folder: Path, made: re.Pattern[str], most: int) -> None:
    """Say that this process uses what is kept in a folder. Where no other does, what is more than ``most`` is removed before:
    the library reads files that it has seen to be there. Those stay that were made last, since a library leaves no mark of use;
    files with other names than in ``made`` stay. Raises OSError where the folder cannot be written, and
    PermissionError where others than this user can write it, since the library runs what it finds there."""
    demand_private(folder)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = os.lstat(folder)
    if status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise PermissionError(f"{folder} is not a folder that this user alone can write: remove it")
    lock = os.open(folder / LOCK_FILLED, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    _locks.append(lock)
    with contextlib.suppress(BlockingIOError):  # another uses it: the next that is alone removes what is too much
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        found = [
            (entry.stat(follow_symlinks=False).st_mtime_ns, entry.path)
            for version in os.scandir(folder)
            if version.is_dir(follow_symlinks=False)
            for entry in os.scandir(version)
            if made.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
        ]
        for _, path in sorted(found)[: max(len(found) - most, 0)]:
            shutil.rmtree(path)
    fcntl.flock(lock, fcntl.LOCK_SH)
