"""Parts of models other than bodies: arrays (many bodies or models written once), joints by name or pattern, named initial
states, named frames."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from simspec.language.quantities import Number, Reader, Vector, Whole, article
from simspec.language.shapes import Length, Point, Pose, Switch, Velocity
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, read_each, required, show
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.language.words import LONGEST_NAME, Name, clean_name

# Joints by name, or by a pattern in which ``*`` matches any text.

PATTERN = re.compile(r"[A-Za-z0-9_*-]+(?:/[A-Za-z0-9_*-]+)?")
PATTERN_RULE = "a joint's full name (MODEL/JOINT, or JOINT of a loose body); * matches any text"
MOST_PATTERNS = 100
"""Entries with a ``*`` in one list or mapping: each is compared with every joint of the world."""
MOST_ENTRIES = 10_000
"""Entries of one list or mapping."""


def matches(pattern: str, name: str) -> bool:
    """Whether a full name is meant by a pattern: ``*`` matches any text, also for none, and for ``/``. Linear in the
    length of the name, whatever the pattern."""
    first, *rest = pattern.split("*")
    if not rest:
        return name == pattern
    last = rest.pop()
    if not name.startswith(first) or len(name) < len(first) + len(last) or not name.endswith(last):
        return False
    position, end = len(first), len(name) - len(last)
    for part in rest:
        at = name.find(part, position, end)
        if at < 0:
            return False
        position = at + len(part)
    return True


def is_name_or_pattern(value: Any) -> bool:
    """Whether a key may be the name of something in a model, or a pattern; other keys are reported where they are read."""
    return isinstance(value, str) and "/" not in value and PATTERN.fullmatch(value) is not None


def chosen(pattern: str, names: Collection[str]) -> list[str]:
    """The names that a pattern means, in their order."""
    if "*" not in pattern:
        return [pattern] if pattern in names else []
    return [name for name in names if matches(pattern, name)]


class Clash(NamedTuple):
    """A name to which two patterns of one mapping give different values."""

    name: str
    first: str
    other: str


def entry_of(entries: Mapping[str, Any], meant: Callable[[str], Iterable[str]]) -> tuple[dict[str, str], list[Clash]]:
    """Which entry of a mapping by name or pattern each name has its value from, and the names to which patterns give different
    values. The exact name has precedence over patterns; of patterns with equal values the first counts. ``meant``: the names
    that an entry matches."""
    found: dict[str, str] = {}
    clashes: dict[str, Clash] = {}
    for entry in sorted(entries, key=lambda entry: "*" in entry):  # exact names first, else in their order
        for name in meant(entry):
            before = found.setdefault(name, entry)
            if before != entry and "*" in before and entries[before] != entries[entry]:
                clashes.setdefault(name, Clash(name, before, entry))
    return found, list(clashes.values())


def clash_words(clash: Clash) -> str:
    """The message of a clash."""
    return f"{clash.name} has two values: from {clash.other!r} and from {clash.first!r}"


CLASH_HINT = "patterns that match one name have equal values; an entry by name has precedence over patterns"


def initial_meant(
    entry: str, values: Mapping[str, Any], kinds: Mapping[str, str], left_out: Container[str] = ()
) -> list[str]:
    """The joints of a model to which an entry of initial positions or velocities gives its value. A pattern means hinges and
    slides, with an orientation or three numbers ball joints, and none of ``left_out`` (those that follow others). ``kinds``:
    types of joints by name."""
    if "*" not in entry:
        return [entry] if entry in kinds else []
    wanted = ("ball",) if isinstance(values[entry], (Mapping, list, tuple)) else SCALAR_JOINTS
    return [name for name in chosen(entry, kinds) if kinds[name] in wanted and name not in left_out]


def initial_entries(
    values: Mapping[str, Any], kinds: Mapping[str, str], left_out: Container[str] = ()
) -> tuple[dict[str, str], list[Clash]]:
    """The entry of initial positions or velocities that each joint of a model has its value from: see :func:`entry_of`."""
    return entry_of(values, lambda entry: initial_meant(entry, values, kinds, left_out))


@dataclass(frozen=True)
class NamePattern(Reader):
    """The name of something in a model, or a pattern; with ``path`` a full name."""

    of: str = "joint"
    path: bool = False

    def read(self, value: Any) -> str:
        rule = f"a {self.of}'s {'full name' if self.path else 'name in the model'}; * matches any text"
        if not isinstance(value, str):
            raise fault(f"expected a {self.of}'s name", show(value), rule, code="S301")
        if not self.path and "/" in value:
            inner = value.rpartition("/")[2]
            hint = f"did you mean {inner!r}?" if PATTERN.fullmatch(inner) else None
            raise fault(
                f"a {self.of} of the model is called without the model's name here",
                show(value),
                rule,
                hint,
                code="S301",
            )
        if len(value) > 2 * LONGEST_NAME + 1 or not PATTERN.fullmatch(value):
            hint = None if "*" in value else f"did you mean {clean_name(value)!r}?"
            raise fault("not a valid name or pattern", show(value), rule, hint, code="S301")
        return value

    def describe(self) -> str:
        return f"{article(self.of)}'s {'full name' if self.path else 'name in the model'}; `*` matches any text"

    def schema(self) -> dict[str, Any]:
        pattern = PATTERN.pattern if self.path else PATTERN.pattern.partition("(?:")[0]
        return {"type": "string", "pattern": f"^{pattern}$"}


def read_pattern(value: Any) -> str:
    """A name or pattern. Raises Faults."""
    if not isinstance(value, str):
        raise fault("expected a joint's name", show(value), PATTERN_RULE, code="S301")
    if len(value) > 2 * LONGEST_NAME + 1 or not PATTERN.fullmatch(value):
        raise fault("not a valid joint name or pattern", show(value), PATTERN_RULE, code="S301")
    return value


def too_many(entries: Iterable[Any]) -> Faults | None:
    """The fault of a list or mapping that would take too long to compare with all joints."""
    words = list(entries)
    if len(words) > MOST_ENTRIES:
        return fault("too many entries", str(len(words)), f"up to {MOST_ENTRIES}", code="S109")
    stars = sum(1 for word in words if isinstance(word, str) and "*" in word)
    if stars > MOST_PATTERNS:
        return fault("too many entries with a *", str(stars), f"up to {MOST_PATTERNS}", code="S109")
    return None


@dataclass(frozen=True)
class JointNames(Reader):
    """A list of names or patterns of joints (``of``: of what else), at least one."""

    SCHEMA: ClassVar = {"type": "array", "items": {"type": "string", "pattern": f"^{PATTERN.pattern}$"}, "minItems": 1}

    of: str = "joint"

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not value:
            found = "an empty list" if isinstance(value, (list, tuple)) else show(value)
            raise fault(f"expected {self.describe()}", found, f"[MODEL/{self.of.upper()}, MODEL/*, ...]", code="S104")
        if (many := too_many(value)) is not None:
            raise many
        return tuple(read_each(enumerate(value), read_pattern))

    def describe(self) -> str:
        return f"a list of {self.of}s' full names; `*` matches any text"


MOST_ELEMENTS = 100_000
"""Elements of one array, and bodies of one scenario: beyond it a slip of the pen is likelier than a plan."""


@dataclass(frozen=True)
class Grid(Reader):
    """Three counts."""

    WORDS = "a list of 3 whole numbers ≥ 1"
    SCHEMA: ClassVar = {"type": "array", "items": Whole(1, MOST_ELEMENTS).schema(), "minItems": 3, "maxItems": 3}

    def read(self, value: Any) -> tuple[int, int, int]:
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise fault("expected three whole numbers", show(value), "[nx, ny, nz]", code="S104")
        counts = [Whole(1, MOST_ELEMENTS).read(item) for item in value]
        total = counts[0] * counts[1] * counts[2]
        if total > MOST_ELEMENTS:
            raise fault("too many elements", f"{total}", f"up to {MOST_ELEMENTS}", code="S109")
        return counts[0], counts[1], counts[2]


@dataclass(frozen=True)
class Spacing(Reader):
    """One length for all axes, or three."""

    UNIT = "m"
    WORDS = "a length, or a list of 3"
    SCHEMA: ClassVar = {"anyOf": [Number("length").schema(), Vector(Number("length")).schema()]}

    def read(self, value: Any) -> tuple[float, ...]:
        if isinstance(value, (list, tuple)):
            return Vector(Number("length")).read(value)
        distance = Number("length").read(value)
        return (distance, distance, distance)


class Jitter(Strict):
    """Seeded perturbation of an array's elements: the same layout on every machine and in every engine."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("uniform", "radial")

    uniform: Maybe[Annotated[float, Number("length", 0)]] = Field(
        ABSENT, description="a: each coordinate of each element moves by U(−a, a); three draws per element: x, y, z"
    )
    radial: Maybe[Annotated[float, Number("number", 0, 1)]] = Field(
        ABSENT,
        description="a: each element's offset from the array's origin is scaled by U(1 − a, 1 + a); one draw each",
    )
    seed: Annotated[int, Whole()] = Field(..., description="Seed of the generator (Python's random.Random)")


class Array(Strict):
    """Copies of a root body with all its descendants, or of a model, named `<name>_<index>` with zeros in front to equal
    width. The elements are laid out in the frame that `pose` gives."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("grid", "line", "ring", "poses")
    COMPANIONS: ClassVar[Mapping[str, tuple[str, bool]]] = {
        "spacing": ("grid", True),
        "step": ("line", True),
        "radius": ("ring", True),
        "face": ("ring", False),
    }
    """Fields that belong to one layout, and whether it needs them."""

    grid: Maybe[Annotated[Any, Grid()]] = Field(
        ABSENT, description="[nx, ny, nz]: element (i, j, k) at spacing × (i, j, k); k runs fastest"
    )
    spacing: Annotated[Any, Spacing()] = Field(None, description="Distance of neighbours in a grid, along each axis")
    line: Maybe[Annotated[int, Whole(1, MOST_ELEMENTS)]] = Field(
        ABSENT, description="n elements, element i at i × `step`"
    )
    step: Maybe[Point] = Field(ABSENT, description="Displacement from one element of a line to the next")
    ring: Maybe[Annotated[int, Whole(1, MOST_ELEMENTS)]] = Field(
        ABSENT, description="n elements on a circle in the x-y plane, element i at the angle 2π i/n from the x axis"
    )
    radius: Maybe[Length] = Field(ABSENT, description="Radius of a ring")
    face: Switch = Field(
        False, description="Whether each element of a ring is turned by its angle, so that its x axis points outwards"
    )
    poses: Maybe[list[Pose]] = Field(ABSENT, description="The elements' poses, one by one")
    jitter: Maybe[Jitter] = Field(ABSENT, description="Perturbation of the elements' positions")

    def count(self) -> int:
        """How many elements there are."""
        if self.grid is not None:
            return math.prod(self.grid)
        return self.line or self.ring or len(required(self.poses))

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        for name, (layout, needed) in cls.COMPANIONS.items():
            if name in data and layout not in data:
                yield Fault(
                    (name,), f"{name} belongs to {layout}", None, None, f"remove it, or write {layout}", code="S110"
                )
            if needed and layout in data and name not in data:
                yield Fault((), f"{layout} needs {name}", code="S102")
        poses = data.get("poses")
        if isinstance(poses, list) and not 0 < len(poses) <= MOST_ELEMENTS:
            yield Fault(
                ("poses",), "expected one pose or more", f"{len(poses)} poses", f"1 to {MOST_ELEMENTS}", code="S113"
            )


class State(Strict):
    """An initial state of a model. Omitted values are those of the model's bodies."""

    pose: Maybe[Pose] = Field(ABSENT, description="Pose of the root in the model, in place of the body's")
    velocity: Maybe[Velocity] = Field(
        ABSENT, description="Velocity of a free root in the model's axes, in place of the body's"
    )
    positions: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Joint positions by the joint's name in the model; `*` matches any text"
    )
    velocities: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Joint velocities by the joint's name in the model; `*` matches any text"
    )
    commands: dict[Annotated[str, NamePattern("actuator")], Any] = Field(
        {},
        description="Commands by the actuator's name in the model, in place of the actuator's `command`; `*` "
        "matches any text",
    )


class Frame(Strict):
    """A frame fixed to a body, without mass or contact. It names a place: a tool point, a sensor, a site."""

    body: Annotated[str, Name(path=True)] = Field(
        ...,
        description="Body to which the frame is fixed: by its name in the model, or by its full name for a "
        "frame of a scenario",
    )
    pose: Maybe[Pose] = Field(ABSENT, description="Pose of the frame in the body's frame; default: the same frame")
