"""Files: reading those of others in bounded memory, temporary folders that do not outlive their process, folders shipped with
simspec, and arrays mapped from a file. numpy is imported with the first such array: small commands start without it.
"""

from __future__ import annotations

import errno
import fcntl
import functools
import json
import math
import mmap
import os
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from simspec.errors import Problem, SpecError

if TYPE_CHECKING:
    import numpy as np

# Reading files that another program wrote, or that are untrusted: regular files only, no links, no more than is allowed.

MOST_VALUES = 4_000_000
"""Values in one JSON file: each may take 100 bytes of memory. A world of 10,000 bodies has one million."""


class NotReadableError(ValueError):
    """The file is of another kind, too large, or not text. The message names what is wrong, not the file."""


def open_regular(path: Path, most: int, *, links: bool = False) -> int:
    """A descriptor of the regular file ``path``, of at most ``most`` bytes; the caller closes it.

    Never waits, whatever ``path`` is (opening a FIFO for reading would, until another process writes). A symbolic link as the
    last part of the path is refused unless ``links``. Raises NotReadableError, and OSError as ``os.open`` does.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if links else os.O_NOFOLLOW)
    if not links and path.is_symlink():
        raise NotReadableError("a symbolic link, not a file")
    descriptor = os.open(path, flags)
    try:
        found = os.fstat(descriptor)
        _demand(found, most)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _demand(found: os.stat_result, most: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise NotReadableError(f"{kind(found.st_mode)}, not a regular file")
    if found.st_size > most:
        raise NotReadableError(f"{found.st_size:,} bytes, more than the {most:,} that are read")


def read_bytes(path: Path, most: int, *, links: bool = False) -> bytes:
    """The content of a regular file of at most ``most`` bytes; see :func:`open_regular`."""
    with os.fdopen(open_regular(path, most, links=links), "rb") as file:
        content = read_at_most(file, most)
    if len(content) > most:
        raise NotReadableError(f"more than the {most:,} bytes that are read")
    return content


def read_at_most(file: BinaryIO, most: int) -> bytes:
    """The content of a file; of one of more than ``most`` bytes, one byte more than that. Takes no more memory than it has."""
    content = file.read(min(most, os.fstat(file.fileno()).st_size) + 1)
    while len(content) <= most and (more := file.read(min(most + 1 - len(content), 2**20))):
        content += more  # it grew meanwhile, or its size is unknown (as below /proc)
    return content


def read_text(path: Path, most: int, *, links: bool = False) -> str:
    """As :func:`read_bytes`, of a file in UTF-8."""
    try:
        return read_bytes(path, most, links=links).decode("utf-8")
    except UnicodeDecodeError as error:
        raise NotReadableError(f"not UTF-8 text: {error.reason} at byte {error.start}") from None


def parse_json(content: bytes | str) -> Any:
    """JSON as plain data, in bounded memory. Raises NotReadableError for anything else, also for NaN."""
    values = sum(
        content.count(b"%c" % mark) if isinstance(content, bytes) else content.count(chr(mark)) for mark in b",[{"
    )
    if values > MOST_VALUES:
        raise NotReadableError(f"{values:,} values, more than the {MOST_VALUES:,} that are read")
    try:
        return json.loads(content, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise NotReadableError(f"not JSON: {why[:200]}") from None


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant} is not a number")


def kind(mode: int) -> str:
    """The kind of a file of this mode, in words."""
    for test, word in (
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a FIFO"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
        (stat.S_ISSOCK, "a socket"),
        (stat.S_ISLNK, "a symbolic link"),
        (stat.S_ISREG, "a file"),
    ):
        if test(mode):
            return word
    return "of an unknown kind"


# Temporary folders that do not outlive their process for long: each is marked, and a dead process's are removed by the next.
#
# The marker is a file inside, locked for as long as the process lives that made the folder: the system lets the lock go when
# the process ends, however it ends. A folder is removed only when it is this user's, carries the marker, and no process holds
# the lock.

PREFIX = "simspec-"
MARKER = ".simspec-scratch"
"""Name of the marker in a folder."""
CONTENT = b"simspec scratch folder 1: removed when the process that made it is gone\n"
"""The content that makes a file of that name a marker."""
NEW = f"{MARKER}.new"
"""Name of the marker until it is whole and locked."""
ATTEMPTS, PAUSE = 50, 0.01
"""How often the removal of a folder is repeated while files come and go, and the seconds between."""
UNMARKED = 0o1700
"""Mode that a folder is made with: a sticky bit on a folder that only its owner can write to, which has no other use. So a
folder is known that is empty because its process ended before it could mark it."""


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
        # files that cannot be removed now are left to the next process: the error must not hide that of the block
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
        # locked before it has the marker's name: no process can find it unlocked
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
        for attempt in range(ATTEMPTS):  # a process that is being killed may still write
            if attempt:
                time.sleep(PAUSE)
            if _emptied(opened):
                with suppress(FileNotFoundError):
                    os.unlink(MARKER, dir_fd=opened)
                try:
                    folder.rmdir()
                except OSError as error:
                    if error.errno != errno.ENOTEMPTY:
                        raise
                else:
                    return
    except OSError:
        return  # in use, or protected: the next process tries again
    finally:
        os.close(opened)


def _emptied(opened: int) -> bool:
    """Remove all but the marker from an open folder; False where something went or came meanwhile."""
    with os.scandir(opened) as entries:
        names = {entry.name: entry.is_dir(follow_symlinks=False) for entry in entries if entry.name != MARKER}
    try:
        for name, is_folder in names.items():
            if is_folder:
                shutil.rmtree(name, dir_fd=opened)
            else:
                os.unlink(name, dir_fd=opened)
    except OSError as error:
        if error.errno not in (errno.ENOENT, errno.ENOTEMPTY):
            raise
        return False
    return True


# Folders that travel with simspec: templates and the scenario library, in the wheel or next to the source.

_PACKAGE = Path(__file__).resolve().parent


def resource_folder(name: str) -> Path:
    """The folder ``name`` ("templates", "specs"): inside the installed package, or at the repository's top.

    Raises FileNotFoundError when neither exists (a broken installation).
    """
    for folder in (_PACKAGE / "_resources" / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"simspec's folder {name!r} is missing: the installation is incomplete")


LIBRARY = ("*.yaml", "contact/*.yaml")
"""Where the library's scenarios are below ``specs``; the others there are models."""


def library() -> dict[str, Path]:
    """The files of the library's scenarios by name."""
    folder = resource_folder("specs")
    return {found.stem: found for part in LIBRARY for found in sorted(folder.glob(part))}


def find_spec(name: str) -> Path:
    """The file of a spec: a path, or the name of a scenario of the library that is shipped with simspec.

    Raises SpecError naming the library when there is neither.
    """
    path = Path(name)
    if path.is_file():
        return path
    scenarios = library()
    if name in scenarios:
        return scenarios[name]
    import difflib

    near = difflib.get_close_matches(path.stem, scenarios, 1)
    try:
        there: str | None = kind(path.stat().st_mode)
    except (OSError, ValueError):  # nothing is there, or nothing can be: a name too long, or with a zero byte
        there = None
    what = f"is {there}, not a spec" if there else "no such file, and no such scenario in the library"
    raise SpecError(
        [
            Problem(
                f"{name}: {what}",
                allowed="a YAML file, or a scenario of the library (simspec list)",
                hint=f"did you mean {near[0]!r}?" if near else None,
                code="C104",
            )
        ]
    )


# Arrays that are larger than memory should be: mapped from a file, and looked at block by block.

RECORDED_BYTES = 16 * 2**30
"""Most bytes that a run may record: 10 million rows of seven free bodies. More would fill a disk before it is noticed."""
BLOCK_BYTES = 8_000_000
"""Of one block of rows."""
MAPPED_BYTES = 4_000_000
"""Arrays larger than this stay on disk, mapped. A study of three engines with repeats holds some hundred arrays."""


def block_rows(row_bytes: int) -> int:
    """Rows of one block."""
    return max(1, BLOCK_BYTES // max(1, row_bytes))


def blocks(rows: int, row_bytes: int, first: int = 0) -> Iterator[slice]:
    """Slices of the rows from ``first`` on that are together all ``rows`` rows, each of about ``BLOCK_BYTES``; one, empty, of
    no rows."""
    count = block_rows(row_bytes)
    for start in range(first, max(rows, first + 1), count):
        yield slice(start, max(start, min(start + count, rows)))


def parts(rows: int, row_bytes: int, *arrays: np.ndarray, first: int = 0) -> Iterator[slice]:
    """The same; after each, the memory is given back that looking at ``arrays`` took."""
    for part in blocks(rows, row_bytes, first):
        try:
            yield part
        finally:
            for array in arrays:
                release(array)


def release(array: np.ndarray) -> None:
    """Give the memory back that looking at a mapped array took (it is read again when it is looked at again); nothing
    for other arrays."""
    import numpy as np

    base: object = array
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)


def all_finite(array: np.ndarray) -> bool:
    """Whether every number is finite, whatever the array's size."""
    import numpy as np

    return all(np.isfinite(array[part]).all() for part in parts(len(array), array[:1].nbytes, array))


def zeros(shape: tuple[int, ...], kind: type = float) -> np.ndarray:
    """A new array of zeros. A large one is in a temporary file that has no name: its room on disk is given back with the
    array, or when the process ends. Raises OSError where there is no room."""
    import numpy as np

    size = np.dtype(kind).itemsize * math.prod(shape)
    if size <= MAPPED_BYTES:
        return np.zeros(shape, kind)
    with scratch_folder("array") as folder, open(folder / "rows.bin", "xb+") as file:
        try:
            _reserve(file, size)
        except OSError as error:
            raise OSError(error.errno or 0, error.strerror or str(error), tempfile.gettempdir()) from error
        return np.memmap(file, kind, "r+", shape=shape).view(np.ndarray)


def _reserve(file: BinaryIO, size: int) -> None:
    """Give a new file its size, with room on disk: where that is missing, writing to a mapped file ends the process."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
        return
    empty = bytes(min(size, BLOCK_BYTES))
    for part in blocks(size, 1):
        file.write(empty[: part.stop - part.start])
    file.flush()
