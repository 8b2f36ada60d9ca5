"""Joints of the world by name: a full name, or a pattern in which ``*`` matches any text."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from simspec.language.document import INVALID
from simspec.language.reader import Reader
from simspec.language.strict import Fault, Faults, fault, replace_loc, show
from simspec.language.words import LONGEST_NAME

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


def chosen(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that a pattern means, in their order."""
    return [name for name in names if matches(pattern, name)]


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

    of: str = "joint"

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not value:
            found = "an empty list" if isinstance(value, (list, tuple)) else show(value)
            raise fault(f"expected {self.describe()}", found, f"[MODEL/{self.of.upper()}, MODEL/*, ...]")
        if (many := too_many(value)) is not None:
            raise many
        names, faults = [], []
        for index, item in enumerate(value):
            if item is INVALID:
                faults.append(Fault((index,), "", reported=True))
                continue
            try:
                names.append(read_pattern(item))
            except Faults as error:
                faults.extend(replace_loc(error.faults, (index,)))
        if faults:
            raise Faults(faults)
        return tuple(names)

    def describe(self) -> str:
        return f"a list of {self.of}s' full names; `*` matches any text"

    def schema(self) -> dict[str, Any]:
        item = {"type": "string", "pattern": f"^{PATTERN.pattern}$"}
        return {"type": "array", "items": item, "minItems": 1}
