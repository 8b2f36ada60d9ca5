"""The targets that may be written: checked before any work is done.

A folder may be written when it is not there yet, is empty, or has simspec's marker of the same kind. A file may be written when
it is not there yet, or when its own content says that simspec wrote it. Everything else stays as it is, and is an error.
"""

from __future__ import annotations

import dataclasses
import json
import os
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from simspec.errors import Problem, SpecError
from simspec.files import kind as kind_of
from simspec.outputs.files import read_bytes
from simspec.stored import FolderMarker, read_as

# The marker: the file in a folder that says that simspec made it, as what, and which of its files are simspec's.
#
# Files that are not listed belong to others, and stay.

MARKER_FILE = "simspec-folder.json"
VERSION = 1
"""Of the marker's form. A folder of a newer one is left alone."""
LARGEST_MARKER = 64 * 2**20
"""Bytes: 100,000 file names of some hundred characters."""

COMPILED = "compiled"
"""world.json, one folder of artifacts for each engine, certificate.json."""
PLAIN = "plain"
"""Plain files of one world in one format, for any tool, and the list of what they do not carry."""
RUN = "run"
"""The result of an engine for a world: tables, world.json, provenance.json."""
STUDY = "study"
"""Holds folders of runs and of compiled artifacts, each with its own marker, and what was found by comparing them."""

MESHES = "meshes"
"""Copies of the meshes that a robot file names."""
STORE = "store"
"""The results of sweeps, each under the hash of what was run (:mod:`simspec.outputs.collection`)."""


@dataclass(frozen=True)
class Marker:
    """The kind of a folder, and the relative paths of the files that simspec wrote."""

    kind: str
    files: frozenset[str] = frozenset()

    def text(self) -> str:
        """The marker as the text of its file: one name a line, so that version control shows what changed."""
        data = {"simspec_folder": VERSION, "kind": self.kind, "files": sorted(self.files)}
        return json.dumps(data, indent=1, ensure_ascii=False) + "\n"

    def owns(self, name: str) -> bool:
        """Whether simspec wrote this file (relative path)."""
        return name == MARKER_FILE or name in self.files


def check_names(names: Iterable[str], what: object) -> None:
    """Raise SpecError for relative paths that would leave their folder, or take the marker's place."""
    for name in names:
        path = PurePosixPath(name)
        if not name or path.is_absolute() or ".." in path.parts or path.as_posix() != name or "\0" in name:
            raise SpecError([Problem(f"the file name {name!r} leaves the output folder {what}", code="C106")])
        if name == MARKER_FILE:
            raise SpecError([Problem(f"the file name {name!r} is that of the folder's marker", code="C106")])


def read_marker(folder: Path) -> Marker | None:
    """The marker of a folder; None when it has none. Raises SpecError when it has one that cannot be used."""
    path = folder / MARKER_FILE
    try:
        content = read_bytes(path, LARGEST_MARKER, folder)
    except (FileNotFoundError, NotADirectoryError):
        return None
    found = read_as(FolderMarker, content, str(path))
    if found.simspec_folder != VERSION:
        raise SpecError(
            [
                Problem(
                    f"{path}: a folder of form {found.simspec_folder}, this simspec writes form {VERSION}",
                    hint="use the simspec that wrote it, or another folder",
                    code="R104",
                )
            ]
        )
    check_names(found.files, folder)
    return Marker(found.kind, frozenset(found.files))


LARGEST_MARKER = 64 * 2**20
"""Bytes of a single file that may be looked at to see whether simspec wrote it."""
ELSEWHERE = "use a new folder: --out build/NAME"
REMOVE = "remove it if it contains nothing of yours; it is then created again"
OTHER_FILE = "use a new file name, or remove this file"
MOVE = "move it elsewhere"
NEVER: Callable[[bytes], bool] = lambda content: False  # noqa: E731
"""For files that are only ever made, not replaced."""


@dataclass(frozen=True)
class Place:
    """A target that may be written: its real path, and what is there now (None: nothing)."""

    path: Path
    status: os.stat_result | None


def demand(problems: Iterable[Problem | None]) -> None:
    """Raise SpecError with all problems together."""
    found = [problem for problem in problems if problem is not None]
    if found:
        raise SpecError(found)


def folder_problem(folder: Path, kind: str, holds: Iterable[Path] = ()) -> Problem | None:
    """Why ``folder`` cannot be written as a folder of this kind; None when it can.

    ``holds``: files that it must not hold: the specs that are read.
    """
    try:
        check_folder(folder, kind, holds)
    except SpecError as error:
        return error.problems[0]
    return None


def existing_name_problem(folder: Path, name: str) -> Problem | None:
    """Why the file ``name`` cannot be written into a folder that may be: a file of another program has its name; None when it
    can."""
    marker = read_marker(folder)
    if not os.path.lexists(folder / name) or (marker is not None and marker.owns(name)):
        return None
    return not_ours(folder / name)


def not_ours(path: Path) -> Problem:
    """A file of another program has a name that simspec writes."""
    return Problem(f"{str(path)!r} exists, and simspec did not write it", hint=MOVE, code="C106")


def file_problem(path: Path, ours: Callable[[bytes], bool]) -> Problem | None:
    """Why ``path`` cannot be written as a file; ``ours`` says of what is there whether simspec wrote it."""
    try:
        check_file(path, ours)
    except SpecError as error:
        return error.problems[0]
    return None


def check_folder(folder: Path, kind: str, holds: Iterable[Path] = ()) -> tuple[Place, Marker | None]:
    """The place of a folder that may be written, and its marker. Raises SpecError."""
    place = _place(folder, ELSEWHERE)
    _refuse_protected(folder, place.path, holds)
    if place.status is None:
        return place, None
    mode = place.status.st_mode
    if not stat.S_ISDIR(mode):
        raise _error(folder, f"is {kind_of(mode)}, which simspec does not replace", ELSEWHERE)
    if not os.access(place.path, os.R_OK | os.W_OK | os.X_OK):
        raise _error(folder, "cannot be written: permission denied", ELSEWHERE)
    try:
        marker = read_marker(place.path)
    except SpecError as error:
        hint = f"{REMOVE}; or {ELSEWHERE}"
        raise SpecError(
            [dataclasses.replace(problem, hint=problem.hint or hint) for problem in error.problems]
        ) from None
    if marker is None:
        if any(os.scandir(place.path)):
            raise _error(
                folder,
                f"is not empty and has no {MARKER_FILE}: simspec did not make it, or an old version did",
                f"{ELSEWHERE}; or {REMOVE}",
            )
    elif marker.kind != kind:
        raise _error(folder, f"is a folder of kind {marker.kind!r}, not {kind!r}", ELSEWHERE)
    return place, marker


def check_file(path: Path, ours: Callable[[bytes], bool]) -> Place:
    """The place of a file that may be written. Raises SpecError."""
    place = _place(path, OTHER_FILE)
    if place.status is None:
        return place
    mode = place.status.st_mode
    if not stat.S_ISREG(mode):
        raise _error(path, f"is {kind_of(mode)}, which simspec does not replace", OTHER_FILE)
    if not os.access(place.path, os.W_OK):
        raise _error(path, "cannot be written: permission denied", OTHER_FILE)
    if ours is NEVER or not ours(read_bytes(place.path, LARGEST_MARKER)):
        why = "exists; it is never overwritten" if ours is NEVER else "exists, and simspec did not write it"
        raise _error(path, why, OTHER_FILE)
    return place


def _error(path: Path, why: str, hint: str) -> SpecError:
    return SpecError([Problem(f"{str(path)!r} {why}", hint=hint, code="C106")])


def _place(path: Path, hint: str) -> Place:
    """The real path of a target, through folders only that stay where they stand. Raises SpecError."""
    if not path.name or path.name == "..":
        words = "the root of the file system" if path.is_absolute() and not path.name else "not a name"
        raise _error(path, f"is {words} (an empty path is the working folder, '.')", hint)
    try:
        parent = _parent(path, hint)
        real = parent / path.name
        try:
            status = os.lstat(real)
        except FileNotFoundError:
            status = None
        if status is not None and stat.S_ISLNK(status.st_mode):
            dangling = "" if real.exists() else ", whose target does not exist"
            raise _error(path, f"is a symbolic link{dangling}; simspec does not write through links", hint)
        above = next(path for path in (parent, *parent.parents) if path.exists())
        if not os.access(above, os.W_OK | os.X_OK):
            raise _error(path, f"cannot be written: permission denied in {above}", hint)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise _error(path, f"cannot be written: {why}", hint) from None
    return Place(real, status)


def _parent(path: Path, hint: str) -> Path:
    """The real path of a target's parent. A link among its parts may lead down from where it stands, nowhere else."""
    current = Path(path.anchor) if path.is_absolute() else Path.cwd()
    parts = path.parts[1:-1] if path.is_absolute() else path.parts[:-1]
    missing = False
    for part in parts:
        if part == "..":
            if missing:
                raise _error(path, "goes through a folder that does not exist", hint)
            current = current.parent
            continue
        below = current / part
        mode = None if missing else _mode(below)
        if mode is None:
            missing, current = True, below
        elif stat.S_ISLNK(mode):
            leads = Path(os.path.realpath(below))
            if not leads.is_dir():
                raise _error(path, f"goes through {str(below)!r}, a symbolic link that does not lead to a folder", hint)
            if not leads.is_relative_to(current):
                raise _error(
                    path,
                    f"goes through {str(below)!r}, a symbolic link that leads outside, to {str(leads)!r}",
                    "use the path of the real folder, if that is intended",
                )
            current = leads
        elif stat.S_ISDIR(mode):
            current = below
        else:
            raise _error(path, f"goes through {str(below)!r}, {kind_of(mode)}", hint)
    return current


def _mode(path: Path) -> int | None:
    try:
        return os.lstat(path).st_mode
    except FileNotFoundError:
        return None


def _refuse_protected(folder: Path, real: Path, holds: Iterable[Path]) -> None:
    """Folders that are never written as a whole, whatever is in them."""
    here = Path.cwd()
    if real == here or real in here.parents:
        raise _error(folder, "is the working folder, or contains it", ELSEWHERE)
    try:
        home = Path.home().resolve()
    except (RuntimeError, OSError):
        home = None  # there is no home folder
    if home is not None and (real == home or real in home.parents):
        raise _error(folder, "is the home folder, or contains it", ELSEWHERE)
    for spec in holds:
        if Path(os.path.realpath(spec)).is_relative_to(real):
            raise _error(folder, f"contains the spec {str(spec)!r}", ELSEWHERE)
