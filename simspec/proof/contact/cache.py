"""Figures measured before, so that a proof of the same contact costs nothing the second time.

Any program that can write the user's files can write an entry with a valid hash. So a folder that other users could have
written is not used, and of each proof one entry, chosen at random, is measured again and compared; figures say that they come
from here.

The key of an entry is the hash of everything that could change it: the probe world's compiled files (materials, numbers,
cone, hardness, timestep, solver settings), how they are driven, simspec's own code that takes part and the engine module's,
the versions of engine, simspec, Python and numpy, and the processor. An entry carries its key and a hash of its figures: one
that was damaged, edited or renamed is no entry.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import itertools
import json
import math
import platform
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from simspec.distribution import simspec_version
from simspec.engines.kit.contract import Engine
from simspec.errors import SpecError
from simspec.outputs.cache import processor
from simspec.outputs.collection import Entries
from simspec.proof.contact.probe import ProbeFigure
from simspec.stored import CacheEntry, read_as
from simspec.world.canonical import canonical_json, from_plain, to_plain

EXCLUDED = (
    "cli.py",
    "__main__.py",
    "report",
    "comparison",
    "generated.py",
    "runner",
    "spec",
    "resolve",
    "outputs",
    "stored.py",
)
"""Parts of the package whose code takes no part in measuring; all other code is part of the key."""
COMPILED = ("*.c", "*.cc", "*.cpp", "*.h", "*.hpp")
"""Sources that an engine compiles for itself."""
SAME = 0.1
"""How far, in tolerances, a figure from the cache may be from what is measured again. The last digits of some solvers depend on
where in memory their bodies are: by 5e-4 of a tolerance (measured)."""
VERSION = 1
ENTRIES = Entries("contact", head=b'{"simspec_cache": ', largest=16 * 2**20, bound=256 * 2**20)
"""The largest entry, with the points of 24 directions, has some 10 kB."""


@functools.cache
def code_digest() -> str:
    """The hash of simspec's own code that takes part in measuring."""
    package = Path(__file__).resolve().parents[2]
    files = sorted(path for path in package.rglob("*.py") if path.relative_to(package).parts[0] not in EXCLUDED)
    return _digest(files, package)


def engine_digest(engine: type[Engine]) -> str:
    """The hash of the code of an engine's module and of those next to it, which may be another package's."""
    return _folder_digest(Path(inspect.getfile(engine)).resolve().parent)


@functools.cache
def _folder_digest(folder: Path) -> str:
    return _digest(sorted([*folder.glob("*.py"), *(path for kind in COMPILED for path in folder.rglob(kind))]), folder)


def _digest(files: Sequence[Path], root: Path) -> str:
    digest = hashlib.sha256()
    for path in files:
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


@functools.cache
def environment() -> dict[str, Any]:
    """Other causes of different last digits: versions, and the processor, whose instructions libraries choose by."""
    return {
        "simspec": simspec_version(),
        "numpy": version("numpy"),
        "python": sys.version,
        "platform": platform.platform(),
        "processor": processor(),
    }


def key(engine: type[Engine], *parts: object) -> str:
    """The name of an entry."""
    versions = [engine.NAME, str(engine.version()), engine_digest(engine)]
    return hashlib.sha256(canonical_json([code_digest(), environment(), versions, *parts]).encode()).hexdigest()


def read(name: str) -> list[ProbeFigure] | None:
    """The figures of an entry; None when there is none, or it is not what was kept (it is then measured anew)."""
    kept = ENTRIES.read(name)
    if kept is None:
        return None
    try:
        entry = read_as(CacheEntry, kept, name)
        if (entry.simspec_cache, entry.key) != (VERSION, name) or entry.sha256 != _content(entry.figures):
            return None
        return [from_plain(ProbeFigure, figure) for figure in entry.figures] or None  # every probe gives some figure
    except (SpecError, ValueError, KeyError, TypeError):
        return None


def differing(cached: Sequence[ProbeFigure], now: Sequence[ProbeFigure]) -> list[ProbeFigure]:
    """Of figures that were cached, and were measured again ``now`` in the same order, those that are not the same: each
    without a number, so that it fails, and with both in its case."""
    found = []
    for figure, other in itertools.zip_longest(cached, now):
        if figure is not None and (other is None or not _same(figure, other)):
            value = "no such figure" if other is None else other.measured
            why = f"{figure.case}; the cache has {figure.measured}, measured now: {value}. Remove {ENTRIES.folder()}"
            found.append(replace(figure, measured=None, case=f"{why}, or use --no-cache"))
    return found


def _same(figure: ProbeFigure, other: ProbeFigure) -> bool:
    if (figure.probe, figure.subject, figure.quantity) != (other.probe, other.subject, other.quantity):
        return False
    if figure.measured is None or other.measured is None:
        return figure.measured is other.measured
    if figure.worst != other.worst:
        # of parts that are as far off, rounding says which is the worst, and each has its own expected value
        return abs(_off(figure) - _off(other)) <= SAME
    pairs = (
        (figure.measured, other.measured),
        (figure.expected, other.expected),
        (figure.tolerance, other.tolerance),
        (figure.without or 0.0, other.without or 0.0),
    )
    return all(abs(value - another) <= SAME * other.tolerance for value, another in pairs)


def _off(figure: ProbeFigure) -> float:
    """How far a figure is off, in tolerances."""
    if figure.measured is None or not figure.tolerance:
        return 0.0 if figure.measured == figure.expected else math.inf
    return abs(figure.measured - figure.expected) / figure.tolerance


def _content(figures: Sequence[Any]) -> str:
    return hashlib.sha256(canonical_json(list(figures)).encode()).hexdigest()


def write(name: str, figures: Sequence[ProbeFigure]) -> bool:
    """Keep figures; False when the folder cannot be written, which costs time only."""
    plain = [to_plain(figure) for figure in figures]
    entry = {"simspec_cache": VERSION, "key": name, "sha256": _content(plain), "figures": plain}
    return ENTRIES.write(name, json.dumps(entry, allow_nan=False))
