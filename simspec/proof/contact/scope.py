"""The basis of the contact figures of a proof: kinds of contact that were measured, declared deviations, absent effects, and
figures measured before."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import inspect
import itertools
import json
import math
import platform
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from simspec.engines.kit.contract import Engine
from simspec.errors import SpecError
from simspec.outputs.collection import Entries
from simspec.outputs.files import processor
from simspec.plugins import simspec_version
from simspec.proof.contact.normal import LYING
from simspec.proof.contact.probe import ProbeFigure
from simspec.stored import CacheEntry, read_as
from simspec.world.canonical import canonical_json, from_plain, to_plain
from simspec.world.contact_pairs import meeting_laws
from simspec.world.reach import MaterialReach, reach
from simspec.world.types import World

# How many figures pass by a declared deviation alone, how wide these are, and which effects are absent. A deviation says how
# far an engine is known to be off in a probe (``Engine.CONTACT_DEVIATIONS``). Where it is so wide that an engine without the
# effect would pass, the figure shows nothing of the effect: the effect is then called absent.

EFFECTS: Mapping[str, str] = {
    "push": "sliding friction",
    "push-oblong": "sliding friction",
    "stop": "sliding friction",
    "stop-oblong": "sliding friction",
    "stick": "static friction",
    "carry": "friction on moving surfaces",
    "restitution": "restitution",
    "threshold": "restitution threshold",
    "rest": "support at rest",
    "steady": "rest",
    "overlap": "recovery of overlaps",
    "oblique": "friction in impacts",
    "oblique-separation": "restitution of oblique impacts",
    "compliance": "compliance",
    "compliance-shape": "compliance by shape",
    "torsional": "torsional friction",
    "rolling": "rolling friction",
    "rod": "friction of leaning bodies",
    "rod-slips": "friction of leaning bodies",
    "clamp": "friction of clamped bodies",
    "clamp-slips": "friction of clamped bodies",
    "jam": "friction that alone presses a clamp",
    "jam-light": "friction that alone presses a clamp",
    "squeeze": "friction between fingers",
    "squeeze-slips": "friction between fingers",
    "squeeze-turns": "even pressure of faces",
    "pile": "friction in piles",
    "pile-slips": "friction in piles",
    "strike": "impacts on several bodies",
    "strike-energy": "energy of impacts on several bodies",
    "row": "impacts on several bodies",
    "row-energy": "energy of impacts on several bodies",
    "edge": "impacts on several corners",
    "edge-energy": "energy of impacts on several corners",
    "stack": "heavy bodies on light ones",
    "stack-sideways": "heavy bodies on light ones",
    "stack-slides": "friction of heavy bodies on light ones",
    "stack-stays": "friction of heavy bodies on light ones",
    "stack-slides-plane": "friction of heavy bodies on light ones",
    "stack-stays-plane": "friction of heavy bodies on light ones",
    "cross": "boxes whose edges cross",
    "cross-sideways": "boxes whose edges cross",
    "carrier": "friction on accelerating carriers",
    "slide-spin": "friction of sliding with spin",
}
"""By probe the effect that its figures measure; a probe that is not named here has its name."""


@dataclass(frozen=True, slots=True)
class DeclaredShare:
    """Of ``figures`` contact figures ``declared`` pass by a declared deviation alone; ``widest``: the one with the largest
    :attr:`ProbeFigure.width`; ``absent``: the probes of absent effects; ``cached``: figures that come from the cache."""

    figures: int
    declared: int
    widest: ProbeFigure | None
    absent: tuple[str, ...]
    cached: int

    @property
    def width(self) -> str:
        """The widest deviation in words: "oblique 99 %"; empty where there is none."""
        return "" if self.widest is None else f"{self.widest.probe} {width_text(self.widest)}"

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that are absent, in words."""
        return tuple(dict.fromkeys(EFFECTS.get(probe, probe) for probe in self.absent))

    @property
    def words(self) -> str:
        """In a line: "28 of 70 contact figures by declared deviation, widest: oblique 99 %; absent: friction in impacts". Empty
        where nothing passes by declared deviation."""
        if self.widest is None:
            return ""
        absent = f"; absent: {', '.join(self.effects)}" if self.absent else ""
        return f"{self.declared} of {self.figures} contact figures by declared deviation, widest: {self.width}{absent}"

    def data(self) -> dict[str, object]:
        """The same as plain data."""
        widest = None
        if self.widest is not None:
            figure = self.widest
            widest = {
                "probe": figure.probe,
                "subject": figure.subject,
                "case": figure.case,
                "quantity": figure.quantity,
                "width": figure.width if math.isfinite(figure.width) else None,
                "of": "expected" if figure.expected else "tolerance",
            }
        return {
            "figures": self.figures,
            "declared": self.declared,
            "widest": widest,
            "absent": list(self.absent),
            "absent_effects": list(self.effects),
            "cached": self.cached,
        }


def declared(figures: Sequence[ProbeFigure]) -> DeclaredShare:
    """The basis of the contact figures of one engine."""
    by = [figure for figure in figures if figure.declared]
    widest = max(by, key=lambda figure: figure.width, default=None)
    absent = tuple(dict.fromkeys(figure.probe for figure in by if figure.absent))
    return DeclaredShare(len(figures), len(by), widest, absent, sum(figure.cached for figure in figures))


def width_text(figure: ProbeFigure) -> str:
    """The width of a figure's tolerance: in per cent of the expected value, or as a multiple of the probe's tolerance."""
    if not math.isfinite(figure.width):
        return "of any size"
    value = 100.0 * figure.width if figure.expected else figure.width
    text = f"{value:,.0f}" if value >= 10.0 else f"{value:.2g}"
    return f"{text} %" if figure.expected else f"{text} times its tolerance"


# Which kinds of contact the probes of level L5 measured for a world, and which not, with the reason: a verdict must
# name them, since a law that is right between two bodies says little of a stack.
#
# A kind is a group of probes. A world either has such contact, or does not for a reason that follows from the world alone; so
# a stored certificate is judged by the same function.

MEASURED = "measured"
NO_FIGURE = "not measured: none of its probes gave a figure"
NONE_HERE = "none in this world: "


@dataclass(frozen=True, slots=True)
class ContactKind:
    """A kind of contact: the probes that measure it, by the names of their figures, and why a world has none of it ("" where
    it has some)."""

    probes: tuple[str, ...]
    missing: Callable[[World], str]


def _meets(world: World) -> str:
    return "" if meeting_laws(world) else "no two shapes may touch"


def _several(world: World) -> str:
    there = [reach(world, *pair) for pair in meeting_laws(world)]
    return (
        ""
        if any(dataclasses.replace(entry, kinds=(), plane=False) != MaterialReach() for entry in there)
        else "each body can touch one flat surface alone"
    )


def _clamps(world: World) -> str:
    there = any(law.friction and reach(world, *pair).jams for pair, law in meeting_laws(world).items())
    return (
        ""
        if there
        else "no body with friction has room for another between two of its shapes, or fits between two walls"
    )


def _pressed(world: World) -> str:
    there = any(law.friction and reach(world, *pair).squeezes for pair, law in meeting_laws(world).items())
    return "" if there else "no body on a joint can press a face, or none with friction"


def _carriers(world: World) -> str:
    there = any(law.friction and reach(world, *pair).carries for pair, law in meeting_laws(world).items())
    return "" if there else "nothing lies on what moves"


def _compliant(world: World) -> str:
    stiff = [pair for pair, law in meeting_laws(world).items() if law.hardness.kind == "stiffness"]
    if not stiff:
        return "no stiffness is stated"
    several = any(set(reach(world, *pair).kinds) & BORNE for pair in stiff)
    return "" if several else "all that is compliant touches in one point"


def _slides(world: World) -> str:
    return "" if any(law.friction for law in meeting_laws(world).values()) else "no pair has friction"


SEVERAL = (
    *("rod", "rod-slips", "clamp", "clamp-slips", "pile", "pile-slips", "strike", "row", "edge", "cross"),
    *("stack", "stack-slides", "stack-stays", "stack-slides-plane", "stack-stays-plane"),
)
"""Probes of several bodies, or of several contacts of one."""
SQUEEZED = ("squeeze", "squeeze-slips", "squeeze-turns")
JAMS = ("jam", "jam-light")
_OTHERS = (
    *SEVERAL,
    *JAMS,
    *SQUEEZED,
    *(f"{name}-energy" for name in SEVERAL),
    "stack-sideways",
    "cross-sideways",
    "carrier",
    "slide-spin",
    "compliance-shape",
)
PAIRS = tuple(probe for probe in EFFECTS if probe not in _OTHERS)
"""Probes of one contact."""
BORNE = {body.kind for body in LYING.values()}
"""Kinds of shapes that lie on several points."""
KINDS: Mapping[str, ContactKind] = {
    "contact of two bodies": ContactKind(PAIRS, _meets),
    "contact of several bodies": ContactKind(SEVERAL, _several),
    "clamps that friction alone presses": ContactKind(JAMS, _clamps),
    "faces that joints press": ContactKind(SQUEEZED, _pressed),
    "contact on accelerating carriers": ContactKind(("carrier",), _carriers),
    "compliance by shape": ContactKind(("compliance-shape",), _compliant),
    "sliding with spin": ContactKind(("slide-spin",), _slides),
}
"""By name, in the order of verdicts."""


def scope(world: World, probes: Iterable[str]) -> dict[str, str]:
    """By kind of contact whether it was measured, or why not; ``probes``: the names of the figures that there are. Empty
    where nothing can touch."""
    if not meeting_laws(world):
        return {}
    there = set(probes)
    return {name: _state(kind, world, there) for name, kind in KINDS.items()}


def _state(kind: ContactKind, world: World, there: set[str]) -> str:
    if why := kind.missing(world):
        return NONE_HERE + why
    return MEASURED if there & set(kind.probes) else NO_FIGURE


def unmeasured(states: Mapping[str, str]) -> dict[str, str]:
    """The kinds that the world has and that were not measured, with the reason."""
    return {
        name: state.removeprefix("not measured: ")
        for name, state in states.items()
        if state != MEASURED and not state.startswith(NONE_HERE)
    }


# Figures measured before, so that a proof of the same contact costs nothing the second time.
#
# Any program that can write the user's files can write an entry with a valid hash. So a folder that other users could have
# written is not used, and of each proof one entry, chosen at random, is measured again and compared; figures say that they come
# from here.
#
# The key of an entry is the hash of everything that could change it: the probe world's compiled files (materials, numbers,
# cone, hardness, timestep, solver settings), how they are driven, simspec's own code that takes part and the engine module's,
# the versions of engine, simspec, Python and numpy, and the processor. An entry carries its key and a hash of its figures: one
# that was damaged, edited or renamed is no entry.

EXCLUDED = (
    "cli.py",
    "__main__.py",
    "report",
    "comparison",
    "generated.py",
    "runner",
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
    return files_digest(files, package)


def engine_digest(engine: type[Engine]) -> str:
    """The hash of the code of an engine's module and of those next to it, which may be another package's."""
    return _folder_digest(Path(inspect.getfile(engine)).resolve().parent)


@functools.cache
def _folder_digest(folder: Path) -> str:
    return files_digest(
        sorted([*folder.glob("*.py"), *(path for kind in COMPILED for path in folder.rglob(kind))]), folder
    )


def files_digest(files: Sequence[Path], root: Path) -> str:
    """The hash of the names below ``root`` and the contents of some files."""
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
