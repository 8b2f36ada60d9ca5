"""What was made of files before: a robot's meshes are read and made into hulls once, whatever its spec changes.

The key of an entry is the hash of everything that could change it: the files' content, how they are taken, simspec's own code
that takes part, and the versions of the libraries. An entry carries its key and a hash of its content: one that was damaged,
edited or renamed is no entry.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from simspec.errors import SpecError
from simspec.meshes.files import MeshFile
from simspec.meshes.made import MadeMesh, MeshOptions
from simspec.outputs.reading import read_bytes
from simspec.outputs.writing import write_file
from simspec.reading import parse_json
from simspec.stored import MeshEntry, read_as
from simspec.world.canonical import canonical_json, from_plain, to_plain

VERSION = 1
HEAD = b'{"simspec_mesh": '
"""How every entry begins: what begins otherwise is not simspec's, and is left alone."""
LARGEST_ENTRY = 64 * 2**20
"""Bytes; a hull of 4,096 vertices has 250 kB, and a mesh may have many pieces."""
LIBRARIES = ("numpy", "scipy", "trimesh", "pycollada", "coacd")


def folder() -> Path | None:
    """Where entries are kept: ``simspec/meshes`` in the user's cache folder (XDG_CACHE_HOME or ~/.cache), if any."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):  # the specification of that variable: a relative path is to be ignored
        return Path(base) / "simspec" / "meshes"
    try:
        return Path.home() / ".cache" / "simspec" / "meshes"
    except RuntimeError:
        return None


@functools.cache
def _maker() -> str:
    """The hash of the code that makes entries, and of the versions that it stands on."""
    package = Path(__file__).resolve().parents[1]
    files = [
        *(package / "meshes").glob("*.py"),
        *(package / "world" / name for name in ("hull.py", "solid.py", "frames.py")),
    ]
    digest = hashlib.sha256(json.dumps([sys.version, *map(_version, LIBRARIES)]).encode())
    for path in sorted(files):
        content = path.read_bytes()
        digest.update(f"{path.name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return ""


def key(file: MeshFile, options: MeshOptions) -> str:
    """The name of the entry of a file that is taken so."""
    return hashlib.sha256(canonical_json([VERSION, _maker(), file.digest(), to_plain(options)]).encode()).hexdigest()


def read(name: str) -> MadeMesh | None:
    """An entry; None when there is none, or it is not what was kept (it is then made anew)."""
    place = folder()
    if place is None:
        return None
    path = place / f"{name}.json"
    try:
        entry = read_as(MeshEntry, read_bytes(path, LARGEST_ENTRY, place), str(path))
        if (entry.simspec_mesh, entry.key) != (VERSION, name) or entry.sha256 != _digest(entry.made):
            return None
        made: MadeMesh = from_plain(MadeMesh, parse_json(entry.made))
    except (OSError, SpecError, ValueError, KeyError, TypeError):
        return None
    return made


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def write(name: str, made: MadeMesh) -> bool:
    """Keep an entry, whole or not at all; False when the folder cannot be written, which costs time only."""
    place = folder()
    if place is None:
        return False
    text = canonical_json(made)
    entry = {"simspec_mesh": VERSION, "key": name, "sha256": _digest(text), "made": text}
    try:
        # not synced: what a power cut leaves half is no entry
        write_file(place / f"{name}.json", json.dumps(entry, allow_nan=False), _ours, lasting=False)
    except (OSError, SpecError):
        return False
    return True


def _ours(content: bytes) -> bool:
    return content.startswith(HEAD) or HEAD.startswith(content)
