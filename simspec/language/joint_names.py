"""Joints by name, or by a pattern in which ``*`` matches any text."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from simspec.language.quantities import Reader
from simspec.language.strict import Faults, fault, read_each, show
from simspec.language.units import article
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.language.words import LONGEST_NAME, clean_name

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
            raise fault(f"expected a {self.of}'s name", show(value), rule)
        if not self.path and "/" in value:
            inner = value.rpartition("/")[2]
            hint = f"did you mean {inner!r}?" if PATTERN.fullmatch(inner) else None
            raise fault(f"a {self.of} of the model is called without the model's name here", show(value), rule, hint)
        if len(value) > 2 * LONGEST_NAME + 1 or not PATTERN.fullmatch(value):
            hint = None if "*" in value else f"did you mean {clean_name(value)!r}?"
            raise fault("not a valid name or pattern", show(value), rule, hint)
        return value

    def describe(self) -> str:
        return f"{article(self.of)}'s {'full name' if self.path else 'name in the model'}; `*` matches any text"

    def schema(self) -> dict[str, Any]:
        pattern = PATTERN.pattern if self.path else PATTERN.pattern.partition("(?:")[0]
        return {"type": "string", "pattern": f"^{pattern}$"}


def read_pattern(value: Any) -> str:
    """A name or pattern. Raises Faults."""
    if not isinstance(value, str):
        raise fault("expected a joint's name", show(value), PATTERN_RULE)
    if len(value) > 2 * LONGEST_NAME + 1 or not PATTERN.fullmatch(value):
        raise fault("not a valid joint name or pattern", show(value), PATTERN_RULE)
    return value


def too_many(entries: Iterable[Any]) -> Faults | None:
    """The fault of a list or mapping that would take too long to compare with all joints."""
    words = list(entries)
    if len(words) > MOST_ENTRIES:
        return fault("too many entries", str(len(words)), f"up to {MOST_ENTRIES}")
    stars = sum(1 for word in words if isinstance(word, str) and "*" in word)
    if stars > MOST_PATTERNS:
        return fault("too many entries with a *", str(stars), f"up to {MOST_PATTERNS}")
    return None


@dataclass(frozen=True)
class JointNames(Reader):
    """A list of names or patterns of joints (``of``: of what else), at least one."""

    SCHEMA: ClassVar = {"type": "array", "items": {"type": "string", "pattern": f"^{PATTERN.pattern}$"}, "minItems": 1}

    of: str = "joint"

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not value:
            found = "an empty list" if isinstance(value, (list, tuple)) else show(value)
            raise fault(f"expected {self.describe()}", found, f"[MODEL/{self.of.upper()}, MODEL/*, ...]")
        if (many := too_many(value)) is not None:
            raise many
        return tuple(read_each(enumerate(value), read_pattern))

    def describe(self) -> str:
        return f"a list of {self.of}s' full names; `*` matches any text"
