"""What was made of files before: a robot's meshes are read and made into hulls once, whatever its spec changes.

The key of an entry is the hash of everything that could change it: the files' content, how they are taken, simspec's own code
that takes part, and the versions of the libraries. An entry carries its key and a hash of its content: one that was damaged,
edited or renamed is no entry.
"""

from __future__ import annotations

import functools
import hashlib
import json
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from simspec.errors import SpecError
from simspec.meshes.files import MeshFile
from simspec.meshes.made import MadeMesh, MeshOptions
from simspec.outputs.entries import Entries
from simspec.reading import parse_json
from simspec.stored import MeshEntry, read_as
from simspec.world.canonical import canonical_json, from_plain, to_plain

VERSION = 1
ENTRIES = Entries("meshes", head=b'{"simspec_mesh": ', largest=64 * 2**20, bound=512 * 2**20)
"""A hull of 4,096 vertices has 250 kB, and a mesh may have many pieces."""
LIBRARIES = ("numpy", "scipy", "trimesh", "pycollada", "coacd")


@functools.cache
def _maker() -> str:
    """The hash of the code that makes entries, and of the versions that it stands on."""
    package = Path(__file__).resolve().parents[1]
    files = [
        *(package / "meshes").glob("*.py"),
        *(package / "world" / name for name in ("hull.py", "frames.py")),
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
    content = ENTRIES.read(name)
    if content is None:
        return None
    try:
        entry = read_as(MeshEntry, content, name)
        if (entry.simspec_mesh, entry.key) != (VERSION, name) or entry.sha256 != _digest(entry.made):
            return None
        made: MadeMesh = from_plain(MadeMesh, parse_json(entry.made))
    except (SpecError, ValueError, KeyError, TypeError):
        return None
    return made


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def write(name: str, made: MadeMesh) -> bool:
    """Keep an entry; False when the folder cannot be written, which costs time only."""
    text = canonical_json(made)
    entry = {"simspec_mesh": VERSION, "key": name, "sha256": _digest(text), "made": text}
    return ENTRIES.write(name, json.dumps(entry, allow_nan=False))
