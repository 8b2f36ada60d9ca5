"""``--set path=value``: values put into the tree before it is validated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simspec.errors import Location, Problem, SpecError
from simspec.language import walk
from simspec.language.document import Document, Mark, parse
from simspec.language.hints import hint_for_key
from simspec.language.models import File
from simspec.language.strict import near, show

FILE = "--set"
"""What stands for the file in the location of an override's value; the line is the override's number."""


def apply(document: Document, sets: Sequence[str]) -> list[Problem]:
    """Put every ``path=value`` into the document; returns what is wrong with them."""
    problems: list[Problem] = []
    for number, text in enumerate(sets, start=1):
        problems.extend(_apply(document, text, number))
    return problems


def _apply(document: Document, text: str, number: int) -> list[Problem]:
    path, equals, value = text.partition("=")
    place = Location(FILE, number, 1)
    if not equals or not path.strip():
        return [Problem("expected path=value", location=place, found=show(text), hint="physics.timestep=2ms")]
    start = len(path) + 2
    try:
        read = parse(value, FILE)
    except SpecError as error:
        return [
            Problem(problem.message, path, Location(FILE, number, start), found=show(value))
            for problem in error.problems
        ]
    steps = path.strip().split(".")
    problems = [
        Problem(misread.message, path, Location(FILE, number, start), misread.found, misread.allowed, misread.hint)
        for misread in read.problems
    ]
    holder: Any = document.data
    mark, kind, last = document.mark, File, steps[-1]
    for index, step in enumerate(steps[:-1]):
        entered = _enter(holder, mark, kind, step, ".".join(steps[: index + 1]), place)
        if isinstance(entered, Problem):
            return [*problems, entered]
        holder, mark, kind = entered
    problem = _put(holder, mark, kind, last, read.data, number, start, path)
    return [*problems, problem] if problem else problems


def _enter(holder: Any, mark: Mark | None, kind: Any, step: str, path: str, place: Location) -> Any:
    if isinstance(holder, list):
        index = _index(step, len(holder))
        if index is None:
            return Problem("no such element", path, place, found=step, allowed=f"0 to {len(holder) - 1}")
        return holder[index], mark.items.get(index) if mark and mark.items else None, walk.child(kind, index)
    if not isinstance(holder, dict):
        return Problem("this value has no elements", path, place, found=show(holder))
    if step not in holder:
        if unknown := _unknown(holder, kind, step, path, place):
            return unknown
        holder[step] = [] if isinstance(walk.child(kind, step), list) else {}
        if mark is not None and mark.items is not None and mark.keys is not None:
            mark.items[step] = Mark(place.line, place.column, {}, {}, FILE)
            mark.keys[step] = (place.line, place.column)
    return holder[step], mark.items.get(step) if mark and mark.items else None, walk.child(kind, step)


def _unknown(holder: dict[str, Any], kind: Any, step: str, path: str, place: Location) -> Problem | None:
    """A problem unless a key may be made: names of the user's must exist, words of the language must be in it."""
    if walk.is_model(kind):
        words = walk.keys(kind)
        if step in words:
            return None
    elif kind is walk.at(File, ("engines",)) or kind is None:
        return None
    else:
        words = list(holder)
    allowed = ", ".join(words[:30]) + (", ..." if len(words) > 30 else "")
    hint = (hint_for_key(step, kind.__name__) if walk.is_model(kind) else None) or near(step, words)
    return Problem(f"the spec has no {path!r}", path, place, found=step, allowed=allowed, hint=hint)


def _index(step: str, length: int) -> int | None:
    return int(step) if step.isascii() and step.isdigit() and len(step) < 9 and int(step) < length else None


def _put(
    holder: Any, mark: Mark | None, kind: Any, step: str, value: Any, number: int, column: int, path: str
) -> Problem | None:
    place = Location(FILE, number, 1)
    key: Any = step
    if isinstance(holder, list):
        key = _index(step, len(holder))
        if key is None:
            return Problem("no such element", path, place, found=step, allowed=f"0 to {len(holder) - 1}")
    elif not isinstance(holder, dict):
        return Problem("this value has no elements", path, place, found=show(holder))
    elif step not in holder:
        plain_values = isinstance(kind, walk.Free) and not walk.is_model(kind.item)  # settings, joint positions
        unknown = None if plain_values else _unknown(holder, kind, step, path, place)
        if unknown is not None:
            return unknown
    holder[key] = value
    if mark is not None and mark.items is not None:
        mark.items[key] = Mark(number, column, file=FILE)
        if mark.keys is not None:
            mark.keys.setdefault(step, (number, column))
    return None
