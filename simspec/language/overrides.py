"""Values put into a spec's tree before it is validated, by dotted path: ``--set path=value``, and what a sweep changes."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from simspec.errors import Location, Problem, SpecError
from simspec.language import problems as walk
from simspec.language.contact import EngineOptions, SettingsAtTimestep
from simspec.language.control import PerJoint
from simspec.language.document import Document, Key, Mark, parse
from simspec.language.models import File
from simspec.language.parameters import ParameterValue
from simspec.language.quantities import Reader, Vector
from simspec.language.strict import Faults, fault_problem, near, show
from simspec.language.sweep import Sweep
from simspec.language.sweep_values import Distribution, same
from simspec.language.words import hint_for_key

FILE = "--set"
"""The file in the location of an override's value; the line is the override's number."""


class Override(NamedTuple):
    """A plain value and the dotted path that it is put at. ``place``: where the path is written, ``value_place``: the
    value; None for a spec that was made in Python."""

    path: str
    value: Any
    place: Location | None
    value_place: Location | None


def apply(document: Document, sets: Sequence[str]) -> list[Problem]:
    """Put every ``path=value`` into the document; returns what is wrong with them."""
    problems: list[Problem] = []
    for number, text in enumerate(sets, start=1):
        override, wrong = _read(text, number)
        problems += wrong
        if override is not None and (problem := put(document, override)) is not None:
            problems.append(problem)
    return problems


def _read(text: str, number: int) -> tuple[Override | None, list[Problem]]:
    path, equals, value = text.partition("=")
    place = Location(FILE, number, 1)
    if not equals or not path.strip():
        return None, [
            Problem("expected path=value", location=place, found=show(text), hint="physics.timestep=2ms", code="S308")
        ]
    value_place = Location(FILE, number, len(path) + 2)
    try:
        read = parse(value, FILE)
    except SpecError as error:
        return None, [
            Problem(problem.message, path, value_place, found=show(value), code="S308") for problem in error.problems
        ]
    problems = [dataclasses.replace(problem, path=path, location=value_place) for problem in read.problems]
    return Override(path.strip(), read.data, place, value_place), problems


def overridden(document: Document, overrides: Iterable[Override]) -> tuple[Document, list[Problem]]:
    """A document as another one, with values put into it, and what is wrong with them. The other one stays as it is; the two
    share what is equal."""
    changed = Document(document.file, document.data, document.mark, list(document.problems))
    return changed, [problem for override in overrides if (problem := put(changed, override)) is not None]


def put(document: Document, override: Override) -> Problem | None:
    """Put a value into a document, in copies of all that is on the way to it; returns what is wrong with the path, where the
    document stays as it is."""
    before = document.data, document.mark
    problem = _put_in_copies(document, override)
    if problem is not None:
        document.data, document.mark = before
    return problem


def _put_in_copies(document: Document, override: Override) -> Problem | None:
    path, place = override.path, override.place
    steps = path.split(".")
    document.data, document.mark = copy.copy(document.data), _copied(document.mark)
    holder, mark, kind = document.data, document.mark, File
    for index, step in enumerate(steps[:-1]):
        so_far = ".".join(steps[: index + 1])
        if isinstance(holder, dict) and step not in holder and (problem := _no_parts(kind, step, so_far, override)):
            return problem
        below = _enter(holder, mark, kind, step, so_far, place)
        if isinstance(below, Problem):
            return below
        holder, mark, kind = below
    return _put(holder, mark, kind, steps[-1], override)


def _no_parts(kind: Any, step: str, path: str, override: Override) -> Problem | None:
    """The problem of a part of a list, or of another whole value, that the spec does not have: nothing says what the other
    parts would be."""
    below = walk.child(kind, step)
    if not isinstance(below, (Reader, list)):
        return None
    whole = f"[{', '.join(['…'] * below.length)}]" if isinstance(below, Vector) else "…"
    return Problem(
        f"the spec has no {path!r}, so that no part of it can be changed",
        override.path,
        override.place,
        hint=f"{path}={whole}",
        code="S309",
    )


def kind_at(document: Document, path: str, place: Location | None) -> Any:
    """The type that the language has at the path of an override (see :func:`simspec.language.problems.at`), or the problem of a
    path that nothing can be put at. The document stays as it is."""
    _, problems = overridden(document, [Override(path, None, place, place)])
    if problems:
        return problems[0]
    kind: Any = File
    for step in path.split("."):
        # a list of numbers is one type of the language: its elements have none of their own
        kind = kind.item if isinstance(kind, Vector) else walk.child(kind, step)
    return kind


def without_effect(document: Document, file: File, changed: Iterable[str]) -> Iterator[Problem]:
    """The problems of solver settings that are put in and that `at_timestep` replaces at this timestep: each of them by
    itself, or with all that stands around it in ``settings`` or ``pairs``."""
    timestep = file.physics.timestep
    for path in changed:
        steps = path.split(".")
        if len(steps) < 3 or steps[0] != "engines" or steps[1] not in file.engines:
            continue
        options = file.engines[steps[1]]
        for place, name, value_of in _replaceable(options):
            full = (*place, name)
            if steps[2:] != list(map(str, full[: len(steps) - 2])):
                continue
            replacing = [
                (entry, where, values[name])
                for entry in options.holding(timestep)
                for where, values in value_of(entry)
                if name in values
            ]
            if replacing:
                entry, where, value = replacing[-1]
                yield document.problem(
                    (*steps[:2], *full),
                    f"no effect: at_timestep sets {name} at this timestep",
                    found=f"{value} above {entry.above:g} s, at {timestep:g} s",
                    hint=".".join((*steps[:2], "at_timestep", str(options.at_timestep.index(entry)), *where, name)),
                    code="S310",
                )


_Places = Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]
"""Settings of one kind in an entry of `at_timestep`, with their place in it."""


def _replaceable(
    options: EngineOptions,
) -> Iterator[tuple[tuple[Key, ...], str, Callable[[SettingsAtTimestep], _Places]]]:
    """The place, in the options, and the name of each setting that `at_timestep` can replace, and where an entry would."""

    def of_engine(entry: SettingsAtTimestep) -> _Places:
        yield ("settings",), entry.settings

    def of_pair(materials: tuple[str, str]) -> Callable[[SettingsAtTimestep], _Places]:
        return lambda entry: (
            (("pairs", str(index), "settings"), pair.settings)
            for index, pair in enumerate(entry.pairs)
            if pair.materials == materials
        )

    for name in options.settings:
        yield ("settings",), name, of_engine
    for index, pair in enumerate(options.pairs):
        for name in pair.settings:
            yield ("pairs", index, "settings"), name, of_pair(pair.materials)


def _copied(mark: Mark | None) -> Mark | None:
    if mark is None:
        return None
    keys = None if mark.keys is None else dict(mark.keys)
    return Mark(mark.line, mark.column, keys, None if mark.items is None else dict(mark.items), mark.file)


def _key(holder: Any, step: str, path: str, place: Location | None) -> Key | Problem:
    """The key of a step in a mapping or a list."""
    if isinstance(holder, dict):
        return step
    if not isinstance(holder, list):
        return Problem("this value has no elements", path, place, found=show(holder), code="S309")
    if step.isascii() and step.isdigit() and len(step) < 9 and int(step) < len(holder):
        return int(step)
    return Problem("no such element", path, place, found=step, allowed=f"0 to {len(holder) - 1}", code="S309")


def _enter(holder: Any, mark: Mark | None, kind: Any, step: str, path: str, place: Location | None) -> Any:
    key = _key(holder, step, path, place)
    if isinstance(key, Problem):
        return key
    if isinstance(holder, dict) and step not in holder:
        if unknown := _unknown(holder, kind, step, path, place):
            return unknown
        holder[step] = [] if isinstance(walk.child(kind, step), list) else {}
        if place is not None and mark is not None and mark.items is not None and mark.keys is not None:
            mark.items[step] = Mark(place.line, place.column, {}, {}, place.file)
            mark.keys[step] = (place.line, place.column)
    holder[key] = copy.copy(holder[key])
    below = None
    if mark is not None and mark.items is not None and key in mark.items:
        below = mark.items[key] = _copied(mark.items[key])  # type: ignore[assignment]
    return holder[key], below, walk.child(kind, key)


def _unknown(holder: dict[str, Any], kind: Any, step: str, path: str, place: Location | None) -> Problem | None:
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
    return Problem(f"the spec has no {path!r}", path, place, found=step, allowed=allowed, hint=hint, code="S309")


def _put(holder: Any, mark: Mark | None, kind: Any, step: str, override: Override) -> Problem | None:
    path, place, value_place = override.path, override.place, override.value_place
    key = _key(holder, step, path, place)
    if isinstance(key, Problem):
        return key
    if isinstance(holder, dict) and step not in holder:
        # settings, joint positions, gains by joint
        plain_values = isinstance(kind, PerJoint) or (isinstance(kind, walk.Free) and not walk.is_model(kind.item))
        unknown = None if plain_values else _unknown(holder, kind, step, path, place)
        if unknown is not None:
            return unknown
    holder[key] = override.value
    if value_place is not None and mark is not None and mark.items is not None:
        mark.items[key] = Mark(value_place.line, value_place.column, file=value_place.file)
        if mark.keys is not None:
            mark.keys.setdefault(step, (value_place.line, value_place.column))
    return None


MOST_REPORTED = 20
"""Values of one path that are reported: more of them have the same cause."""
SWEEP = "sweep"

Placed = list[tuple[tuple[Key, ...], Any]]
"""Values, each with its place below that of its path."""


def check_sweep(
    document: Document, sweep: Sweep | None, parameters: Mapping[str, Mapping[str, Reader]]
) -> Iterator[Problem]:
    """Every problem of a sweep's paths, checked as ``--set`` checks them, and of the values whose type is known before the spec
    is resolved. Errors that only the resolved world of a value shows are problems of that run. ``parameters``: those of the
    files of placed models, by the placement's name."""
    if sweep is None:
        return
    for place, path, values, alike in _axes(document, sweep):
        location = document.locate(place, key=True)
        kind = kind_at(document, path, location)
        model, parameter = _parameter_at(path)
        if isinstance(kind, ParameterValue) and model in parameters:
            known = parameters[model]
            if parameter not in known:
                message, hint = f"the model has no parameter {parameter!r}", near(parameter, known)
                allowed = ", ".join(known) or "nothing: it has no parameters"
                yield document.problem(place, message, key=True, allowed=allowed, hint=hint, code="S302")
                continue
            kind = known[parameter]
        if isinstance(kind, Problem):
            yield kind
        elif isinstance(kind, Reader):
            yield from _values(document, place, path, kind, values, alike)


def _parameter_at(path: str) -> tuple[str, str]:
    """The placement and the parameter that a path names; empty texts for another path."""
    steps = path.split(".")
    return (steps[1], steps[3]) if len(steps) == 4 and steps[0] == "models" and steps[2] == "with" else ("", "")


def _axes(document: Document, sweep: Sweep) -> Iterator[tuple[tuple[Key, ...], str, Placed, bool]]:
    """Every path of a sweep: its place, the path, its values with their places below it, and whether they may be alike."""
    for path, values in sweep.over.items():
        written = document.data[SWEEP]["over"][path]
        ranged = isinstance(written, dict)
        ends: Placed = [(("from",), values[0]), (("to",), values[-1])]
        yield (SWEEP, "over", path), path, ends if ranged else _listed(values), ranged
    for row, entry in enumerate(sweep.together):
        for path, values in entry.items():
            yield (SWEEP, "together", row, path), path, _listed(values), True
    for name, case in sweep.cases.items():
        for path, value in case.items():
            yield (SWEEP, "cases", name, path), path, [((), value)], True
    if sweep.samples is not None:
        for path, distribution in sweep.samples.values.items():
            yield (SWEEP, "samples", "values", path), path, list(_drawn(distribution)), True


def _listed(values: Iterable[Any]) -> Placed:
    return [((index,), value) for index, value in enumerate(values)]


def _drawn(distribution: Distribution) -> Iterator[tuple[tuple[Key, ...], Any]]:
    """Values that a distribution may give: the bounds, the mean, each choice."""
    if distribution.choice is not None:
        yield from ((("choice", index), value) for index, value in enumerate(distribution.choice))
    elif distribution.normal is not None:
        yield ("normal", 0), distribution.normal[0]
    else:
        name = "uniform" if distribution.uniform is not None else "log_uniform"
        yield from (((name, index), bound) for index, bound in enumerate(getattr(distribution, name)))


def _values(
    document: Document,
    place: tuple[Key, ...],
    path: str,
    kind: Reader,
    values: Placed,
    alike: bool,
) -> Iterator[Problem]:
    first: dict[str, Any] = {}
    reported = 0
    for below, value in values:
        at = (*place, *below)
        try:
            read = same(kind.read(value))
        except Faults as error:
            yield from (fault_problem(document, at, fault) for fault in error.faults)
            reported += 1
        else:
            if not alike and read in first:
                found = f"{show(value)}, which is {show(first[read])}"
                yield document.problem(at, f"this value of {path} is duplicated", found=found, code="S804")
                reported += 1
            first.setdefault(read, value)
        if reported >= MOST_REPORTED:
            return
