"""Writing: folders as a whole, files in them, single files. Everything in simspec that writes goes through here."""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import os
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from simspec.errors import Problem, SpecError
from simspec.outputs import staging
from simspec.outputs.files import files_below, read_bytes
from simspec.outputs.targets import MARKER_FILE, MOVE, Marker, check_file, check_folder, check_names, not_ours

Content = str | bytes | Callable[[BinaryIO], None]
"""The content of a file: text, bytes, or a function that writes it, for content that is too large to have in memory."""
_NO_LINKS = (errno.EPERM, errno.EACCES, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)


def put(path: Path, content: Content) -> None:
    """Write a new file into a folder that is being built. Raises FileExistsError where there is one."""
    with open(path, "xb") as file:
        if callable(content):
            content(file)
        else:
            file.write(content.encode() if isinstance(content, str) else content)


def _write_all(files: Mapping[str, Content], folder: Path) -> None:
    for name, content in files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        put(place, content)


def sync(path: Path) -> None:
    """Make a file's content, or the names in a folder, last."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def named_errors(target: Path) -> Iterator[None]:
    """Errors of the system name the target: a full disk shows at a descriptor, which has no name."""
    try:
        yield
    except OSError as error:
        if error.filename is not None:
            raise
        raise OSError(error.errno or 0, error.strerror or str(error), str(target)) from error


def write_private(files: Mapping[str, Content], folder: Path) -> None:
    """Write files into a folder of the caller's own, in a temporary place: it must not exist, or be empty.

    Raises SpecError when it holds something, or a name would leave it.
    """
    check_names(files, folder)
    os.makedirs(folder, exist_ok=True)
    if any(os.scandir(folder)):
        raise SpecError([Problem(f"{folder} is not empty", code="C106")])
    _write_all(files, folder)


def write_folder(files: Mapping[str, Content], folder: Path, kind: str) -> Path:
    """Write ``files`` as the whole of what simspec has in ``folder``; files of others in it stay. Returns the real path.

    Raises SpecError when the folder may not be written, or one of the files would take the place of another program's.
    """

    def build(fresh: Path) -> Iterable[str]:
        _write_all(files, fresh)
        return files

    check_names(files, folder)
    return build_folder(build, folder, kind)


def build_folder(build: Callable[[Path], Iterable[str]], folder: Path, kind: str) -> Path:
    """As :func:`write_folder`; ``build`` writes the files into the folder that it is given, and returns their names."""
    place, _ = check_folder(folder, kind)
    with named_errors(folder), staging.staged(place.path) as stage:
        os.mkdir(stage.fresh)
        names = list(build(stage.fresh))
        check_names(names, folder)
        with staging.locked(place.path.parent):
            _publish(stage, names, folder, kind)
    return place.path


def update_folder(
    change: Callable[[Path | None], Mapping[str, Content] | None], folder: Path, kind: str
) -> Mapping[str, Content] | None:
    """Write a folder whose new content depends on what is there, so that two that do so at a time both get their say.

    ``change`` is given the folder's real path, or None when there is none (or an empty one) yet, and returns all files, or
    None when nothing is to be written. Returns what it returned.
    """
    place, _ = check_folder(folder, kind)
    with named_errors(folder), staging.alone(place.path.parent):
        now, marker = check_folder(folder, kind)
        files = change(now.path if marker is not None else None)
        if files is not None:
            check_names(files, folder)
            with staging.begun(place.path) as stage:
                os.mkdir(stage.fresh)
                _write_all(files, stage.fresh)
                _publish(stage, files, folder, kind)
    return files


def _publish(stage: staging.Stage, names: Iterable[str], folder: Path, kind: str) -> None:
    """Put what was built in its place. The target's folder must be locked."""
    names = frozenset(names)
    place, marker = check_folder(folder, kind)  # again: work has been done since
    put(stage.fresh / MARKER_FILE, Marker(kind, names).text())
    if marker is not None:
        staging.clean(place.path)
        _take_along(place.path, marker, stage.fresh)
    for name in (*names, MARKER_FILE):
        sync(stage.fresh / name)
    for base, _, _ in os.walk(stage.fresh, topdown=False):
        sync(Path(base))
    staging.publish(stage, place.path, place.status is not None)


def _take_along(old: Path, marker: Marker, fresh: Path) -> None:
    """Link what is not simspec's from the old folder into the new one: it is there before and after the exchange."""
    for base, folders, files in os.walk(old):
        relative = Path(base).relative_to(old)
        links = [name for name in folders if os.path.islink(os.path.join(base, name))]
        foreign = [name for name in [*files, *links] if not marker.owns((relative / name).as_posix())]
        empty = not files and not folders
        if foreign or empty:
            os.makedirs(fresh / relative, exist_ok=True)
            shutil.copymode(base, fresh / relative)
        for name in foreign:
            here, there = Path(base) / name, fresh / relative / name
            if os.path.lexists(there):
                raise SpecError(
                    [
                        Problem(
                            f"{str(here)!r} has the name of a file that simspec writes, and was not written by simspec",
                            hint=MOVE,
                            code="C106",
                        )
                    ]
                )
            try:
                os.link(here, there, follow_symlinks=False)
            except OSError as error:
                if error.errno not in _NO_LINKS:
                    raise  # without links, files are put back after the exchange


def add_file(folder: Path, kind: str, name: str, content: Content) -> Path:
    """Write one more file of simspec's into a folder that it made (or, for one that is not there, makes)."""
    _change(folder, kind, name, lambda there: content)
    return folder / name


def change_file(folder: Path, kind: str, name: str, change: Callable[[bytes | None], Content | None]) -> bool:
    """As :func:`add_file`, for a file whose new content depends on the old one (None: there is none): two that do so at a
    time both get their say. ``change`` returns None to leave it as it is. Whether anything was written.

    The marker is written first, so that at every moment all that simspec wrote is known as its own.
    """
    return _change(folder, kind, name, lambda there: change(read_bytes(there) if there is not None else None))


def _change(folder: Path, kind: str, name: str, change: Callable[[Path | None], Content | None]) -> bool:
    """The same; ``change`` is given the old file's path."""
    if "/" in name:
        raise ValueError(f"{name!r}: a file in the folder itself is meant")
    check_names([name], folder)
    real = open_folder(folder, kind)
    target = real / name
    with _inside(real):
        _, marker = check_folder(folder, kind)
        known = marker.files if marker is not None else frozenset()
        exists = os.path.lexists(target)
        if exists and name not in known:
            raise SpecError([not_ours(target)])
        content = change(target if exists else None)
        if content is None:
            return False
        with staging.begun(target) as stage:
            if name not in known:
                _replace(stage, real / MARKER_FILE, Marker(kind, known | {name}).text())
            _replace(stage, target, content)
    return True


def remove_file(folder: Path, kind: str, name: str) -> bool:
    """Remove a file of simspec's from a folder that it made; whether there was one."""
    place, marker = check_folder(folder, kind)
    if marker is None:
        return False
    with _inside(place.path):
        _, marker = check_folder(folder, kind)
        if marker is None or name not in marker.files:
            return False
        with staging.begun(place.path / name) as stage:
            found = os.path.lexists(place.path / name)
            if found:
                os.unlink(place.path / name)
            _replace(stage, place.path / MARKER_FILE, Marker(kind, marker.files - {name}).text())
    return found


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    """Hold the locks for changing single files of a folder: also that under which the folder as a whole is replaced."""
    with named_errors(folder), staging.alone(folder.parent), staging.alone(folder):
        yield


def open_folder(folder: Path, kind: str) -> Path:
    """See to it that a folder of this kind is there, for files and folders that are added one by one; the real path."""
    place, marker = check_folder(folder, kind)
    if marker is None:
        update_folder(lambda found: None if found is not None else {}, folder, kind)
    return place.path


def write_file(path: Path, content: Content, ours: Callable[[bytes], bool], lasting: bool = True) -> Path:
    """Write a single file, whole or not at all, over nothing or over what ``ours`` says to be simspec's; it keeps its mode.

    ``lasting``: whether it is synced, so that also a power cut leaves the old or the new.

    Raises SpecError when something else is there (see :func:`simspec.outputs.targets.check_file`).
    """
    place = check_file(path, ours)
    with named_errors(path), staging.alone(place.path.parent):
        place = check_file(path, ours)
        with staging.begun(place.path, lasting) as stage:
            if place.status is None:
                put(stage.fresh, content)
                if stage.lasting:
                    sync(stage.fresh)
                try:
                    os.link(stage.fresh, place.path)
                except FileExistsError:
                    raise SpecError(
                        [Problem(f"{str(place.path)!r} was created by another process", code="C111")]
                    ) from None
                except OSError as error:
                    if error.errno not in _NO_LINKS:
                        raise
                    os.rename(stage.fresh, place.path)
                if stage.lasting:
                    sync(place.path.parent)
            else:
                _replace(stage, place.path, content, stat.S_IMODE(place.status.st_mode))
    return place.path


def _replace(stage: staging.Stage, target: Path, content: Content, mode: int | None = None) -> None:
    """Write a temporary file, and rename it over ``target``, which is simspec's, or not there."""
    put(stage.fresh, content)
    if mode is not None:
        os.chmod(stage.fresh, mode)
    if stage.lasting:
        sync(stage.fresh)
    os.replace(stage.fresh, target)
    if stage.lasting:
        sync(target.parent)


# Compiled files: bytes by relative path, with one hash, wherever they are: in memory, in a folder, in a stored run.


class Artifacts(Mapping[str, bytes]):
    """Files of a world for one engine or one tool; immutable.

    Names are relative paths with ``/``. ``sha256`` covers names and contents.
    """

    def __init__(self, contents: Mapping[str, str | bytes]):
        """``contents``: texts, which are written as UTF-8, or bytes."""
        self._contents = {
            name: content.encode() if isinstance(content, str) else bytes(content) for name, content in contents.items()
        }

    @classmethod
    def read(cls, folder: Path) -> Artifacts:
        """All files below a folder. Raises SpecError where one is no regular file, or too large."""
        return cls({name: read_bytes(folder / name, root=folder) for name in files_below(folder)})

    def write(self, folder: Path) -> None:
        """Write all files into a folder of the caller's own, in a temporary place: it must not exist yet, or be empty.

        Folders that a user names are written by :mod:`simspec.outputs`. Raises SpecError where a name would leave the folder.
        """
        write_private(self, folder)

    def __getitem__(self, name: str) -> bytes:
        return self._contents[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._contents)

    def __len__(self) -> int:
        return len(self._contents)

    def __repr__(self) -> str:
        return f"<Artifacts: {', '.join(sorted(self))[:100]}>"

    @functools.cached_property
    def sha256(self) -> str:
        """Hexadecimal SHA-256 over names, lengths and contents, in the order of the names."""
        digest = hashlib.sha256()
        for name in sorted(self):
            digest.update(f"{name}\0{len(self[name])}\0".encode())
            digest.update(self[name])
        return digest.hexdigest()

    @functools.cached_property
    def texts(self) -> Mapping[str, str]:
        """The files as texts. Raises UnicodeDecodeError where one is not UTF-8."""
        return {name: content.decode() for name, content in self.items()}
