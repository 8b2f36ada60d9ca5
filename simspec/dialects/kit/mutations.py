"""Every change that a compiled file can suffer, one at a time: the tools, for any XML or JSON file.

The values to change are taken from the file itself, so that none is left out: every number (scaled, moved from zero, its sign,
swapped with its neighbour, dropped from its list), every word and flag (replaced by every other), every attribute and element
(removed, doubled), and the same for every field of the sidecar. Possible additions to a file are declared by its dialect, in a
:class:`MutationTable` called ``TABLE`` of the module ``mutations`` next to ``dialect``:

words      by site the other allowed words (other sites get every word of the same site, and an unknown one)
integers   sites whose numbers are whole: they are changed by one, not by a hundredth
moved      by site what a zero becomes, where 0.01 would have no effect
additions  by file (a pattern) :class:`FileAddition` rows: attributes, elements or fields that the engine supports and simspec
           does not write, with a value that has an effect. ``where`` is the tag (XML) or site (JSON) of the element that
           gets it; each such element gets it, one at a time. ``{joint[0]}`` in a value is the name of the first joint of
           the file; a row whose names a file does not have is not applied to it
inert      :class:`Inert` rows: sites (patterns) and kinds of changes that have no effect, with the reason. A row counts only
           for a change after which the engine moves as before (see ``proof/complete.py``)

A *site* is the place of a value without names and numbers: ``joint@damping``, ``mass/text()``, ``geom`` (the element itself),
and in JSON ``settings.solver``, ``bodies.*.frame_offset.*``.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

from simspec.language.vocabulary import FRICTION_CONES, JOINT_KINDS
from simspec.world.shapes import SHAPES

Files = Mapping[str, str]

KINDS = (
    "scaled",
    "moved",
    "sign",
    "swapped",
    "number dropped",
    "word",
    "flag",
    "attribute removed",
    "element removed",
    "element doubled",
    "attribute added",
    "element added",
    "field removed",
    "field added",
)
"""The classes of changes, in the order of tables."""
SCALE = 1.01
MOVED = 0.01
"""The replacement of a zero: far above every tolerance, small enough to be a sound value almost everywhere."""
SAME_MOTION = 1e-12
"""Metres, radians and their rates, relative to the larger of one and the value: motions within it are the same. So it is for
engines that compute with doubles; for others it is as many roundings: 5.4e-4 in single precision, where what is computed in
another way was up to 4.1e-5 off (measured: quaternions of one rotation of a shape or of equal moments)."""
UNKNOWN = "something-else"
FLAGS = {"true": "false", "false": "true", "enable": "disable", "disable": "enable"}


@dataclass(frozen=True, slots=True)
class Mutation:
    """One change: ``text`` is the whole of ``file`` with it. ``site`` and ``kind`` are what declarations match, ``place`` and
    ``change`` what people read."""

    file: str
    kind: str
    site: str
    place: str
    change: str
    text: str

    @property
    def name(self) -> str:
        """Unique within the files of a world."""
        return f"{self.file}: {self.place}: {self.kind}: {self.change}"


@dataclass(frozen=True, slots=True)
class FileAddition:
    """Something that the emitter does not write: an attribute (XML, ``name`` given), an element (XML, ``value`` its text), or a
    field (JSON, ``name`` and ``value``, which is JSON). ``once``: only in the first such place of a file."""

    where: str
    value: str
    name: str = ""
    once: bool = False


@dataclass(frozen=True, slots=True)
class Inert:
    """Changes that move nothing: ``site`` a pattern as of ``fnmatch``, ``kinds`` of change (empty: all), and the reason.

    ``place``: a pattern of the mutation's place, with round brackets: ``*/default(visual)/*``. ``without``: only where an XML
    file has nothing at this path (as of ElementTree: ``.//worldbody//geom``). ``within``: how far motion may depart; more than
    ``STILL`` only where the reason says that the same is computed in another order, or that the change is within what the
    engine is declared to round; changes that the read-back shows are caught before.
    """

    site: str
    why: str
    kinds: tuple[str, ...] = ()
    file: str = "*"
    place: str = "*"
    without: str = ""
    within: float = SAME_MOTION

    @property
    def name(self) -> str:
        """The row as a report names it, by its restrictions."""
        limits = (", ".join(self.kinds), *(part for part in (self.file, self.place) if part != "*"))
        without = f"without {self.without}" if self.without else ""
        return "; ".join(part for part in (self.site, *limits, without) if part)

    def says(self, mutation: Mutation) -> bool:
        """Whether this row declares ``mutation``."""
        return (
            fnmatch.fnmatchcase(mutation.site, self.site)
            and fnmatch.fnmatchcase(mutation.file, self.file)
            and fnmatch.fnmatchcase(_plain(mutation.place), self.place)
            and (not self.kinds or mutation.kind in self.kinds)
            and (not self.without or ElementTree.fromstring(mutation.text).find(self.without) is None)
        )


def _plain(place: str) -> str:
    """A place without the brackets that patterns would take for sets of letters: ``default(visual)/geom``."""
    return place.translate(str.maketrans("[]", "()"))


@dataclass(frozen=True, slots=True)
class MutationTable:
    """Knowledge of a format about its files beyond their content; see the head of this module."""

    words: Mapping[str, Sequence[str]] = field(default_factory=dict)
    integers: frozenset[str] = frozenset()
    moved: Mapping[str, str] = field(default_factory=dict)
    additions: Mapping[str, Sequence[FileAddition]] = field(default_factory=dict)
    inert: Sequence[Inert] = ()

    def inertness(self, mutation: Mutation) -> Inert | None:
        """The row that declares ``mutation`` inert; None when none does."""
        return next((row for row in self.inert if row.says(mutation)), None)

    def added(self, file: str) -> list[FileAddition]:
        """Additions to a file, one at a time."""
        return [row for pattern, rows in self.additions.items() if fnmatch.fnmatchcase(file, pattern) for row in rows]


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def changed(value: float, site: str, table: MutationTable) -> Iterator[tuple[str, str]]:
    """The kinds of change of one number, with the new text."""
    if site in table.integers:
        yield ("moved" if value == 0 else "scaled"), str(int(value) + 1)
        if value:
            yield "sign", str(-int(value))
    elif value == 0.0:
        yield "moved", table.moved.get(site, str(MOVED))
    elif math.isfinite(value):
        yield "scaled", repr(value * SCALE)
        yield "sign", repr(-value)


def text_values(text: str, site: str, others: Sequence[str], table: MutationTable) -> Iterator[tuple[str, str, str]]:
    """Every change of one attribute's or element's text: (kind, what, new text). ``others``: other texts of the same site."""
    tokens = text.split()
    values = [_number(token) for token in tokens]
    numeric = [index for index, value in enumerate(values) if value is not None]
    if len(numeric) == len(tokens) and tokens:
        for index, value in enumerate(values):
            for kind, new in changed(float(value or 0.0), site, table):
                yield kind, f"[{index}] {tokens[index]} to {new}", _with(tokens, index, new)
        for index in range(len(tokens) - 1):
            swapped = [*tokens[:index], tokens[index + 1], tokens[index], *tokens[index + 2 :]]
            yield "swapped", f"[{index}] with [{index + 1}]", " ".join(swapped)
        if len(tokens) > 1:
            yield "number dropped", f"[{len(tokens) - 1}]", " ".join(tokens[:-1])
        return
    if text in FLAGS:
        yield "flag", f"{text} to {FLAGS[text]}", FLAGS[text]
    words = table.words.get(site)
    if words is None:
        words = (*sorted(set(others) - {text}), UNKNOWN) if text not in FLAGS else ()
    for word in words:
        if word != text:
            yield "word", f"{text} to {word}", word


def _with(tokens: Sequence[str], index: int, new: str) -> str:
    return " ".join([*tokens[:index], new, *tokens[index + 1 :]])


# Additions to ``world.json``, and changes declared inert, for the complete self-test of every engine that reads it (see
# ``dialects/kit/mutations.py``). The form is checked field by field, so that a field more or less is refused.

WORLD = "world.json"
COPY = '{"layer": 7, "friction": 0.3, "torsional_friction": 0, "rolling_friction": 0, "restitution": 0}'

ADDITIONS = (
    FileAddition("", "1.0", "strength"),
    FileAddition("bodies.*", "0.1", "drag"),
    FileAddition("bodies.*.joint", "0.1", "backlash"),
    FileAddition("bodies.*.joint", '{"kp": 10.0, "kd": 1.0, "effort_limit": null}', "servo"),
    FileAddition("bodies.*.joint.servo", "0.1", "ki"),
    FileAddition("bodies.*.shapes.*", "0.01", "margin"),
    FileAddition("bodies.*.shapes.*.copies", COPY),
    FileAddition("bodies.*.shapes.*.copies.*", "0.1", "adhesion"),
    FileAddition("meets", '["nothing", "nothing", 0]'),
    FileAddition("apart.bodies", '["absent", "nothing"]'),
    FileAddition("apart.groups", '["absent", "nothing"]'),
)

SEEN = "visual only"
SYMMETRIC = "the order of elements that are found by name, or of the two names of a pair"
PASSIVE_BY_NAME = tuple(
    Inert(site, SYMMETRIC, ("swapped",), "sidecar.json")
    for site in ("passive.gravity_scales.*", "passive.around.boxes.*")
)
"""Rows of an engine whose passive forces are simspec's: their entries name bodies and shapes."""
INERT = (
    Inert("bodies.*.group", "a group that no pair names, or of a body that touches nothing", ("word",), WORLD),
    Inert("bodies.*.shapes.*.material", "a material of what touches nothing", ("word",), WORLD),
    Inert("*quaternion*", "q and −q are the same rotation", ("sign",), WORLD),
    Inert("bodies.*.joint.position.*", "q and −q are the same rotation", ("sign",), WORLD),
    Inert("bodies.*.shapes.*.pose.quaternion.*", "a rotation within a shape's symmetry", (), WORLD),
    Inert("bodies.*.shapes.*.pose.position.*", "a translation of a plane within itself", (), WORLD),
    Inert("bodies.*.shapes.*", "the order of visual-only shapes among collision shapes", ("swapped",), WORLD),
    Inert("apart.bodies.*", "engines never let welded bodies collide", ("element removed",), WORLD),
    Inert("bodies.*.shapes.*.colour*", SEEN, (), WORLD),
    *(Inert(site, SYMMETRIC, ("swapped",), WORLD) for site in ("meets.*", "meets.*.*", "apart.*.*", "apart.*.*.*")),
)

INERTIAL = ("bodies.*.mass", "bodies.*.centre_of_mass.*", "bodies.*.inertia.*")


def in_single_precision(within: float) -> tuple[Inert, ...]:
    """Rows of an engine that computes in single precision: changes that are inert but for its roundings, by which motion
    departs up to ``within``; the read-back shows changes that turn a shape itself."""
    rounded = "but for roundings to single precision"
    return (
        Inert("*quaternion*", f"q and −q are the same rotation, {rounded}", ("sign",), WORLD, within=within),
        Inert(
            "bodies.*.shapes.*.pose.position.*",
            f"a translation of a plane within itself, {rounded}",
            (),
            WORLD,
            within=within,
        ),
        Inert(
            "bodies.*.shapes.*.pose.quaternion.*",
            f"a rotation within a shape's symmetry, {rounded}",
            ("swapped",),
            WORLD,
            within=within,
        ),
    )


def table(
    settings: Mapping[str, Sequence[str]],
    sidecar_additions: Sequence[FileAddition] = (),
    inert: Sequence[Inert] = (),
) -> MutationTable:
    """The table of a dialect. ``settings``: by name the words of the engine's settings that are words. ``sidecar_additions``:
    fields of the sidecar, and settings, that other engines have and this one does not. ``inert``: rows of its own, before
    those of all."""
    return MutationTable(
        words={
            "bodies.*.joint.kind": (*JOINT_KINDS, UNKNOWN),
            "bodies.*.kind": (*JOINT_KINDS, UNKNOWN),
            "bodies.*.shapes.*.kind": (*SHAPES, UNKNOWN),
            "friction_cone": (*FRICTION_CONES, UNKNOWN),
            **{f"settings.{name}": (*words, UNKNOWN) for name, words in settings.items()},
        },
        integers=frozenset({"schema", "meets.*.2", "bodies.*.shapes.*.copies.*.layer"}),
        additions={WORLD: ADDITIONS, "sidecar.json": tuple(sidecar_additions)},
        inert=(*inert, *INERT),
    )
