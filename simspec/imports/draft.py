"""What an importer is making: the spec's data with the places that its values come from, the defects and the repairs.

Every problem of a file is collected, and raised at the end: a user repairs a file in one go.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import Element
from simspec.imports.files import Files
from simspec.language.document import Path_, dotted
from simspec.language.foreign import Fate, ImportOptions, Repair, Severity
from simspec.language.words import LONGEST_NAME, NAME, clean_name

WHOLE: Final = 1e15
"""Whole numbers below this are written without a point, and read back as the same double."""
TURN: Final = 2.0 * math.pi
"""rad; what is written as a bare number above this would be asked whether degrees are meant, and a foreign file has said it."""


@dataclass
class Draft:
    """A spec in the making. ``rules``: every rule of repair that the importer has; ``with_value``: those that take
    a value."""

    files: Files
    options: ImportOptions
    rules: Sequence[str] = ()
    with_value: Sequence[str] = ()
    places: dict[Path_, Location] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    repairs: list[Repair] = field(default_factory=list)
    comments: dict[str, str] = field(default_factory=dict)
    suspicious: list[Problem] = field(default_factory=list)
    """What is allowed, and yet looks like a slip."""
    meshes: dict[str, Any] = field(default_factory=dict)
    """Files that the data names, by the text that names them."""

    @contextlib.contextmanager
    def collecting(self) -> Iterator[None]:
        """Within it, a SpecError ends what is being read there, and its problems are kept."""
        try:
            yield
        except SpecError as error:
            self.problems.extend(error.problems)

    def place(self, path: Path_, element: Element) -> None:
        """The value at a path of the data comes from an element."""
        self.places[path] = element.location

    def defect(self, element: Element, message: str, rule: str = "", repair: str = "", **more: Any) -> None:
        """A defect of the source, which ``rule`` would repair by ``repair``."""
        hint = f"simspec import --repair {rule}: {repair}" if rule else more.pop("hint", None)
        self.problems.append(element.problem(message, hint=hint, **more))

    def suspect(self, element: Element, message: str, rule: str, repair: str, found: str) -> None:
        """Something that is allowed looks like a slip, which ``rule`` would repair by ``repair``."""
        self.suspicious.append(element.problem(message, found=found, hint=f"simspec import --repair {rule}: {repair}"))

    def repairing(self, rule: str) -> bool:
        """Whether a rule is requested, by its name or by `all`."""
        return rule in self.options.repairs

    def repaired(self, rule: str, element: Element, what: str, path: Path_) -> None:
        """A rule was applied; ``what`` says what it changed, ``path`` where this is seen in the data."""
        self.repairs.append(Repair(rule, element.location, what, dotted(path)))

    def take_back(self, path: Path_) -> None:
        """Remove the repairs of what is at a path, or in it: another rule has replaced it, so that they have no effect."""
        place = dotted(path)
        self.repairs = [one for one in self.repairs if one.path != place and not one.path.startswith(f"{place}.")]

    def note(self, path: Path_, sentence: str) -> None:
        """A sentence that stands above a value in the written spec, after those that are there already."""
        key = dotted(path)
        self.comments[key] = f"{self.comments[key]}; {sentence}" if key in self.comments else sentence

    def finish(self) -> None:
        """Raise SpecError with all problems, in the order of the file; a rule that does not exist is one."""
        self.problems += self.options.repairs.problems(self.files.shown, self.rules, self.with_value)
        if self.problems:
            here = self.files.shown

            def order(problem: Problem) -> tuple[bool, int, int]:
                place = problem.location or Location(here, 0, 0)
                return (place.file != here, place.line, place.column)

            raise SpecError(sorted(self.problems, key=order))


def names(wanted: Sequence[str], reserved: Sequence[str] = ()) -> list[str]:
    """For each of ``wanted`` a name that the language allows, none twice: those that are allowed keep theirs, the others are
    cleaned, or get a number."""
    taken, numbers_of = set(reserved), dict[str, int]()
    given: list[str | None] = []
    for name in wanted:
        keeps = NAME.fullmatch(name) is not None and len(name) <= LONGEST_NAME and name not in taken
        given.append(name if keeps else None)
        if keeps:
            taken.add(name)
    for index, name in enumerate(wanted):
        if given[index] is not None:
            continue
        clean = (name if NAME.fullmatch(name) else clean_name(name))[:LONGEST_NAME]
        free = clean
        while free in taken:
            numbers_of[clean] = numbers_of.get(clean, 1) + 1
            free = f"{clean[: LONGEST_NAME - 8]}_{numbers_of[clean]}"
        taken.add(free)
        given[index] = free
    return [name for name in given if name is not None]


def renamed(element: Element, name: str, given: str) -> None:
    """Say of the attribute ``name`` of ``element`` that the spec calls it ``given``, where that is another name."""
    if element.attributes.get(name, "").strip() != given:
        element.set_aside(name, Fate.CARRIED, f"called {given} in the spec", Severity.INFORMATION)


# --- values as a person would write them ----------------------------------------------------------------------------


def plain(value: float) -> float:
    """The same number; a whole one as an int, and no negative zero. Those that are none (twice the half size of 1e308) are left
    to the language, which refuses them at their place."""
    return int(value) if abs(value) < WHOLE and value == math.floor(value) else value


def numbers(values: Sequence[float]) -> list[float]:
    """Several such numbers."""
    return [plain(value) for value in values]


def angle(value: float) -> float | str:
    """An angle in rad; one of more than a turn says its unit."""
    return f"{plain(value)!r} rad" if abs(value) > TURN else plain(value)


def pose(xyz: Sequence[float] | None, rpy: Sequence[float] | None) -> dict[str, Any]:
    """A pose with only what is not zero; empty for the same frame."""
    said: dict[str, Any] = {}
    if xyz is not None and any(xyz):
        said["xyz"] = numbers(xyz)
    if rpy is not None and any(rpy):
        said["rpy"] = [angle(value) for value in rpy]
    return said
