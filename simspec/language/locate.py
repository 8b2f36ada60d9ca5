"""From a path of the spec or of its world back to the place in a file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from simspec.errors import Location
from simspec.language import trees
from simspec.language.arrays import initial_entries, matches
from simspec.language.contact import PairSettings
from simspec.language.document import Document, Key, listed, mapping
from simspec.language.sources import Source

_ELEMENT = re.compile(r"(.+)_\d+")

Candidate = tuple[Document, tuple[Key, ...]]


def locate(source: Source, path: str) -> Location | None:
    """The place that says what the world has at ``path``, or of the nearest thing around it."""
    steps = tuple(path.split("."))
    best: tuple[Document, tuple[str | int, ...]] = (source.document, steps)
    depth = -1
    for document, candidate in _candidates(source, steps):
        known = _depth(document.data, candidate)
        # the first candidate that is there wholly; else the one that is there furthest
        if known == len(candidate):
            return document.locate(_keys(document.data, candidate))
        if known > depth:
            best, depth = (document, candidate), known
    document, candidate = best
    return document.locate(_keys(document.data, candidate[: max(depth, 0)]))


def _keys(data: Any, steps: Sequence[Key]) -> list[Key]:
    """The steps, with indices of lists as numbers."""
    keys: list[Key] = []
    for step in steps:
        key: Key = int(step) if isinstance(data, list) else step
        keys.append(key)
        data = data[key]
    return keys


def _depth(data: Any, steps: Sequence[Key]) -> int:
    """How many steps of a path exist."""
    for depth, step in enumerate(steps):
        if isinstance(data, Mapping) and step in data:
            data = data[step]
        elif isinstance(data, list) and str(step).isascii() and str(step).isdigit() and int(step) < len(data):
            data = data[int(step)]
        else:
            return depth
    return len(steps)


def _candidates(source: Source, steps: tuple[str, ...]) -> Iterator[Candidate]:
    if steps[0] == "bodies" and len(steps) > 1:
        yield from _of_body(source, steps[1], steps[2:])
        if steps[2:] == ("joint", "armature"):
            yield from _of_rotor(source, steps[1])
    if steps[0] in ("constraints", "frames") and len(steps) > 1:
        yield from _of_named(source, steps[0], steps[1], steps[2:])
    if steps[:2] == ("contact", "pairs") and len(steps) > 4:
        yield from _of_pair(source, steps[2], steps[3], steps[4:])
    if steps[0] == "engines" and len(steps) == 4 and steps[2] == "settings":
        yield from _of_setting(source, steps[1], steps[3])
    if steps[0] == "engines" and len(steps) == 6 and steps[2] == "pairs":
        yield from _of_pair_setting(source, steps[1], (steps[3], steps[4]), steps[5])
    yield source.document, steps
    if steps[0] == "contact":
        for member in source.all():
            yield member.document, steps


def _of_setting(source: Source, engine: str, name: str) -> Iterator[Candidate]:
    """Where a setting comes from that follows from the timestep."""
    file = source.file
    if file is None or engine not in file.engines:
        return
    options = file.engines[engine]
    for entry in reversed(options.holding(file.physics.timestep)):
        if name in entry.settings:
            index = options.at_timestep.index(entry)
            yield source.document, ("engines", engine, "at_timestep", str(index), "settings", name)


def _of_pair_setting(source: Source, engine: str, materials: tuple[str, str], name: str) -> Iterator[Candidate]:
    """Where the setting of a pair of materials comes from."""
    file = source.file
    if file is None or engine not in file.engines:
        return
    options = file.engines[engine]
    places: list[tuple[tuple[Key, ...], Sequence[PairSettings]]] = [
        (("at_timestep", str(options.at_timestep.index(entry)), "pairs"), entry.pairs)
        for entry in reversed(options.holding(file.physics.timestep))
    ]
    for place, pairs in (*places, (("pairs",), options.pairs)):
        for index, pair in enumerate(pairs):
            if pair.materials == materials and name in pair.settings:
                yield source.document, ("engines", engine, *place, str(index), "settings", name)


def _of_pair(source: Source, first: str, second: str, rest: tuple[str, ...]) -> Iterator[Candidate]:
    """Where the law of two materials comes from: their own entry of ``pairs``, else the materials, else what holds for all."""
    document = source.document
    for index, pair in enumerate(listed(document.at("contact", "pairs"))):
        if sorted(map(str, listed(mapping(pair).get("between")))) == sorted((first, second)):
            yield from _whole(document, ("contact", "pairs", str(index), *rest))
    for member in source.all():
        for name in (first, second):
            yield from _whole(member.document, ("contact", "materials", name, *rest))
    yield from _whole(document, ("contact", *rest))


def _of_body(source: Source, name: str, rest: tuple[str, ...]) -> Iterator[Candidate]:
    model, slash, short = name.partition("/")
    if not slash:
        for bodies in _unplaced(source):
            yield from _in_tree(bodies, _base(name, bodies.raw), rest)
        return
    model, placed = _placed(source, model)
    if placed is None:
        return
    bodies = placed
    index, of_joint = _joint_of(bodies, short, rest)
    if of_joint[:1] in (("position",), ("velocity",)) and short in bodies.raw:
        part = {"position": "positions", "velocity": "velocities"}[of_joint[0]]
        joint = bodies.joint_names(short)[index]
        yield from _of_start(source, bodies, source.document, ("models", model, part), joint)
        chosen = trees.chosen_state(source, bodies)
        state = trees.states(source, bodies).get(chosen[2]) if chosen is not None else None
        if state is not None:
            yield from _of_start(source, bodies, state.source.document, (*map(str, state.path), part), joint)
    if short in bodies.roots() and rest and rest[0] in ("pose", "velocity"):
        yield from _whole(source.document, ("models", model, rest[0]))
    if short in bodies.raw:
        yield from _in_tree(bodies, short, rest)
    else:
        yield source.document, ("models", model)


def _of_start(
    source: Source, bodies: trees.Bodies, document: Document, path: tuple[str, ...], joint: str
) -> Iterator[Candidate]:
    """The entry of initial positions or velocities that a joint has its value from."""
    values = document.at(*path)
    if isinstance(values, Mapping):
        kinds = {
            name: kind
            for body in bodies.raw
            for name, kind in zip(bodies.joint_names(body), bodies.joint_types(body), strict=True)
        }
        entries, _ = initial_entries(values, kinds, trees.followers(source, bodies))
        yield from _whole(document, (*path, entries.get(joint, joint)))


def _of_named(source: Source, word: str, name: str, rest: tuple[str, ...]) -> Iterator[Candidate]:
    """A constraint or a frame (``word``) of the scenario, of a model placed in it, or of the model itself; in an array by its
    name in the spec."""
    model, slash, short = name.partition("/")
    if not slash:
        written: Mapping[str, Any] = getattr(source.file, word) if source.file is not None else {}
        yield source.document, (word, _base(name, written), *rest)
        model_bodies = trees.model_of(source)
        for file in model_bodies.files if model_bodies is not None else ():
            yield file.document, ("model", word, name, *rest)
        return
    model, bodies = _placed(source, model)
    yield source.document, ("models", model, word, short, *rest)
    for file in bodies.files if bodies is not None else ():
        yield file.document, ("model", word, short, *rest)


def _of_rotor(source: Source, name: str) -> Iterator[Candidate]:
    """The rotor inertia of the controller that drives a body's joint, where the joint itself says no armature."""
    file = source.file
    joint = _joint(source, name)
    for controller, content in file.control.items() if file is not None else ():
        if joint is not None and any(matches(entry, joint) for entry in content.joints or ()):
            yield from _whole(source.document, ("control", controller, "rotor_inertia"))


def _joint(source: Source, name: str) -> str | None:
    """The full name of the joint of a body."""
    model, slash, short = name.partition("/")
    if slash:
        _, placed = _placed(source, model)
        return f"{model}/{placed.joint_name(short)}" if placed is not None and short in placed.raw else None
    for bodies in _unplaced(source):
        base = _base(name, bodies.raw)
        if base in bodies.raw:
            named = bodies.joint_name(base)
            # an element's joint has the suffix after a name of its own, else its body's name
            implied = named == base + (end := named.removeprefix(base)) and end.startswith("_joint")
            return f"{name}{end}" if implied else f"{named}{name.removeprefix(base)}"
    return None


def _placed(source: Source, model: str) -> tuple[str, trees.Bodies | None]:
    """A placed model by its name in the world: its name in the spec, and its bodies (None where they cannot be read)."""
    placed = {placement: bodies for placement, _, bodies in trees.placed(source)}
    model = _base(model, placed)
    return model, placed.get(model)


def _unplaced(source: Source) -> list[trees.Bodies]:
    return [bodies for bodies in (trees.loose(source), trees.model_of(source)) if bodies is not None]


def _base(name: str, names: Mapping[str, Any]) -> str:
    """The name in the spec of an element of an array."""
    element = _ELEMENT.fullmatch(name)
    return element[1] if name not in names and element is not None and element[1] in names else name


def _joint_of(bodies: trees.Bodies, name: str, rest: tuple[str, ...]) -> tuple[int, tuple[str, ...]]:
    """Which of its joints a path below a body speaks of (−1: the last one), and the path below that joint; () where it speaks
    of none. The carrier that moves with the first of several joints has its joint's name in the world
    (``world/kinematics.py``)."""
    if rest[:1] == ("joint",):
        return -1, rest[1:]
    if rest[1:2] == ("joint",) and name in bodies.raw and rest[0] in (names := bodies.joint_names(name)):
        return names.index(rest[0]), rest[2:]
    return -1, ()


def _in_tree(bodies: trees.Bodies, name: str, rest: tuple[str, ...]) -> Iterator[Candidate]:
    if name not in bodies.raw:
        return
    document, path = bodies.source.document, (*bodies.path, name)
    if several := bodies.several(name):
        index, of_joint = _joint_of(bodies, name, rest)
        if of_joint:
            yield from _whole(document, (*path, "joints", str(index % len(several)), *of_joint))
            rest = ("joints", str(index % len(several)), *of_joint)
    if rest == ("joint", "origin"):  # of a root that says it as its pose
        yield from _whole(document, (*path, "pose"))
    if rest[:1] == ("mass",) or rest[:1] == ("inertia",):
        yield from _whole(document, (*path, *rest))
        yield from _whole(document, (*path, "mass"))
        yield from _whole(document, (*path, "shapes"))  # the shapes say it, by their densities
    yield document, (*path, *rest)


def _whole(document: Document, path: tuple[Key, ...]) -> Iterator[Candidate]:
    """A candidate only where it is there wholly."""
    if _depth(document.data, path) == len(path):
        yield document, path
