"""Figures measured before, so that a proof of the same contact costs nothing the second time.

The key of an entry is the hash of everything that could change it: the probe world's compiled files (materials, numbers,
cone, hardness, timestep, solver settings), how they are driven, the engine's version, and simspec's own code of engines and
probes. Entries are never wrong, at most useless.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from simspec.proof.contact.probe import Figure
from simspec.world.canonical import canonical_json, from_plain, to_plain

CODE = ("engines", "proof/contact")
"""Folders of the package whose code decides what is measured; files that formats write are part of the key themselves."""


def folder() -> Path:
    """Where entries are kept: ``simspec/contact`` in the user's cache folder (XDG_CACHE_HOME, or ~/.cache)."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "simspec" / "contact"


@functools.cache
def code_digest() -> str:
    """The hash of simspec's own code that takes part in measuring."""
    digest = hashlib.sha256()
    package = Path(__file__).resolve().parents[2]
    for part in CODE:
        for path in sorted((package / part).glob("*.py")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def key(*parts: object) -> str:
    """The name of an entry."""
    return hashlib.sha256(canonical_json([code_digest(), *parts]).encode()).hexdigest()


def read(name: str) -> list[Figure] | None:
    """The figures of an entry; None when there is none, or when it cannot be read (it is then measured anew)."""
    path = folder() / f"{name}.json"
    try:
        entries = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
        return [from_plain(Figure, entry) for entry in entries] or None  # every probe gives some figure
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _refuse(constant: str) -> float:
    """NaN and infinity: no entry is written with them."""
    raise ValueError(constant)


def write(name: str, figures: Sequence[Figure]) -> bool:
    """Keep figures, whole or not at all; False when the folder cannot be written, which costs time only."""
    text = json.dumps([to_plain(figure) for figure in figures], allow_nan=False)
    try:
        folder().mkdir(parents=True, exist_ok=True)
        # a name of its own: several processes may measure the same at the same time
        with tempfile.TemporaryDirectory(prefix=".part-", dir=folder()) as place:
            part = Path(place) / "entry.json"
            part.write_text(text, encoding="utf-8")
            os.replace(part, folder() / f"{name}.json")
    except OSError:
        return False
    return True
