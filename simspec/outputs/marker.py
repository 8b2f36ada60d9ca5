"""The marker: the file in a folder that says that simspec made it, as what, and which of its files are simspec's.

What is not listed is somebody else's, and stays.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from simspec.errors import Problem, SpecError
from simspec.outputs.reading import read_bytes
from simspec.stored import FolderMarker, read_as

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
"""What one engine made of one world: tables, world.json, provenance.json."""
STUDY = "study"
"""Holds folders of runs and of compiled artifacts, each with its own marker, and what was found by comparing them."""

MESHES = "meshes"
"""Copies of the meshes that a robot file names."""
STORE = "store"
"""The results of sweeps, each under the hash of what was run (:mod:`simspec.outputs.collection`)."""


@dataclass(frozen=True)
class Marker:
    """What a folder is (``kind``), and the relative paths of the files that simspec wrote."""

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
            raise SpecError([Problem(f"the file name {name!r} leaves the output folder {what}")])
        if name == MARKER_FILE:
            raise SpecError([Problem(f"the file name {name!r} is that of the folder's marker")])


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
                )
            ]
        )
    check_names(found.files, folder)
    return Marker(found.kind, frozenset(found.files))
