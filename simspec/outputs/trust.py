"""The trust store: which files of a user may name programs that are started and folders that are read, by their content.

A record stands for one path with one content: a file that is changed, moved or copied is not trusted until its user says so.
Records are files in the folder ``simspec/trust`` of the user's data folder (XDG_DATA_HOME or ~/.local/share), each named by the
SHA-256 of the resolved path and the content. The folder has mode 0700; a folder that others can write is not used.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import Field

from simspec.errors import Problem, SpecError
from simspec.outputs.files import data_folder, read_bytes, written_by_others
from simspec.outputs.staging import locked
from simspec.outputs.writing import write_file
from simspec.stored import Stored, read_as

FOLDER: Final = "trust"
VERSION: Final = 1
"""Of a record's form."""
MOST_BYTES: Final = 16_384
"""Bytes of a record: a path has at most 4096."""
_NAME = re.compile(r"[0-9a-f]{64}")


class StoredTrust(Stored):
    """A record of the trust store; ``file``: the resolved path."""

    version: int = Field(alias="simspec_trust")
    file: str


@dataclass(frozen=True)
class TrustRecord:
    """The entry of the store on one file. ``file``: its resolved path, None where the record is damaged."""

    place: Path
    file: Path | None


def resolved(file: Path) -> Path:
    """The path by which a file is trusted: absolute and without links."""
    return Path(os.path.realpath(file))


def digest(file: Path, content: bytes) -> str:
    """The name of the record of a file with this content: SHA-256 of its resolved path, a zero byte and the content."""
    return hashlib.sha256(os.fsencode(resolved(file)) + b"\0" + content).hexdigest()


def store() -> Path:
    """The folder of records. Raises SpecError where the user has no data folder, or others can write in it."""
    folder = data_folder(FOLDER)
    if folder is None:
        hint = "set XDG_DATA_HOME to an absolute path of a folder of yours"
        raise SpecError([Problem("there is no home folder to keep trusted files in", hint=hint, code="C113")])
    why = written_by_others(folder)
    with contextlib.suppress(OSError):  # not there yet
        status = os.lstat(folder)
        if not stat.S_ISDIR(status.st_mode):
            why = "it is not a folder"
        elif status.st_mode & 0o022:
            why = "others can write in it"
    if why is not None:
        raise SpecError(
            [Problem(f"the trust store {folder} is not used: {why}", hint="chmod, or set XDG_DATA_HOME", code="C113")]
        )
    return folder


def why_not(file: Path, content: bytes) -> str | None:
    """Why a file with this content is not trusted; None where it is."""
    try:
        place = store() / digest(file, content)
        record = _read(place)
    except FileNotFoundError:
        return "not trusted"
    except SpecError as error:
        return f"not trusted: {error.problems[0].message}"
    if record.file is None:
        return f"not trusted: its record {place} is damaged"
    return None if record.file == resolved(file) else f"not trusted: its record {place} is of another file"


def trust(file: Path, content: bytes) -> Path:
    """Trust a file with this content, and with none that it had before; the path of the record. Raises SpecError, OSError."""
    folder = store()
    try:
        str(resolved(file)).encode()
    except UnicodeEncodeError:
        raise SpecError(
            [Problem(f"{file}: its path is not UTF-8 text", hint="rename the folder", code="C116")]
        ) from None
    _make(folder)
    text = json.dumps({"simspec_trust": VERSION, "file": str(resolved(file))}) + "\n"
    place = write_file(folder / digest(file, content), text, lambda found: True)
    _forget(folder, file, keep=place.name)
    return place


def revoke(file: Path) -> int:
    """Trust a file with no content any more; the number of records that were removed. Raises SpecError, OSError."""
    folder = store()
    return _forget(folder, file) if folder.is_dir() else 0


def records() -> list[TrustRecord]:
    """All records, by path; those that are damaged last. Raises SpecError."""
    folder = store()
    found = list(_records(folder)) if folder.is_dir() else []
    return sorted(found, key=lambda record: (record.file is None, str(record.file), record.place.name))


def _records(folder: Path) -> Iterator[TrustRecord]:
    with os.scandir(folder) as entries:
        names = sorted(entry.name for entry in entries if _NAME.fullmatch(entry.name))
    for name in names:
        with contextlib.suppress(FileNotFoundError):  # another process was faster
            yield _read_or_damaged(folder / name)


def _read_or_damaged(place: Path) -> TrustRecord:
    try:
        return _read(place)
    except SpecError:
        return TrustRecord(place, None)


def _read(place: Path) -> TrustRecord:
    """A record. Raises FileNotFoundError, SpecError where something else than a file is there."""
    content = read_bytes(place, MOST_BYTES, place.parent)
    try:
        found = read_as(StoredTrust, content, str(place))
    except SpecError:
        return TrustRecord(place, None)
    plain = found.version == VERSION and os.path.isabs(found.file) and "\0" not in found.file
    return TrustRecord(place, Path(found.file) if plain else None)


def _forget(folder: Path, file: Path, keep: str = "") -> int:
    """Remove the records of a file but the one of the name ``keep``."""
    gone = 0
    with locked(folder):
        for record in _records(folder):
            if record.file == resolved(file) and record.place.name != keep:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(record.place)
                    gone += 1
    return gone


def _make(folder: Path) -> None:
    """The folder and what is missing above it, which only this user may enter."""
    for place in reversed([folder, *folder.parents]):
        with contextlib.suppress(FileExistsError):
            os.mkdir(place, 0o700)
    if stat.S_IMODE(os.lstat(folder).st_mode) != 0o700:
        os.chmod(folder, 0o700)
