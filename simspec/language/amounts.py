"""How much a spec stands for, counted before anything of it is copied: bodies, shapes, pairs that models exclude, grasps, named
frames, and constraints.

A line of a spec can stand for many things: an array for many elements, each with all shapes of its tree; ``use:`` for all that
a file holds, once for each model that names it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from simspec.errors import Problem
from simspec.language import trees
from simspec.language.arrays import MOST_ELEMENTS, Array
from simspec.language.document import Key
from simspec.language.sources import Source, use_key
from simspec.language.trees import Bodies

MOST_SHAPES = 200_000
"""Shapes of one scenario, two for each of the most bodies: expanded, each takes some 300 bytes (measured), and ten times that
in an engine's file and memory."""
MOST_EXCLUDED = 200_000
"""Pairs that the models of one scenario exclude, or let touch, in all copies; each is two names."""
MOST_GRASPS = 10_000
"""Grasps of all models, in all copies: each is held against the joints, which takes some 0.1 ms."""
MOST_ACTUATORS = 10_000
"""Actuators of all models, in all copies: each is held against the entries of each controller."""
MOST_FRAMES = 200_000
"""Named frames of one scenario, in all copies; each is a name and a pose."""
MOST_CONSTRAINTS = 10_000
"""Constraints of one scenario, in all copies. A step solves them together, in time that grows with the cube of how many act on
one tree."""
MOST = {
    "bodies": MOST_ELEMENTS,
    "shapes": MOST_SHAPES,
    "excluded pairs": MOST_EXCLUDED,
    "grasps": MOST_GRASPS,
    "actuators": MOST_ACTUATORS,
    "frames": MOST_FRAMES,
    "constraints": MOST_CONSTRAINTS,
}


def too_much(source: Source) -> list[Problem]:
    """The problem of the tree or model with which a scenario becomes too large; none where it does not."""
    total: Counter[str] = Counter()
    for path, copies, amounts in _parts(source):
        for what, count in amounts.items():
            total[what] += copies * count
            if total[what] > MOST[what]:
                own = f"{copies:,} × {count:,}" if copies > 1 else f"{count:,}"
                before = total[what] - copies * count
                found = own + (f", after {before:,}" if before else "")
                message, allowed = f"too many {what} in one scenario", f"up to {MOST[what]:,}"
                return [source.document.problem(path, message, key=True, found=found, allowed=allowed)]
    return []


def _parts(source: Source) -> Iterator[tuple[tuple[Key, ...], int, Counter[str]]]:
    """Every tree and every model: its path, how many copies there are, and what one copy holds."""
    bodies = trees.loose(source)
    loose = list(_loose(bodies)) if bodies is not None else []
    yield from loose
    if (bodies := trees.model_of(source)) is not None:
        yield ("model",), 1, _model(bodies)
    held = source.document.data.get("constraints") if isinstance(source.document.data, Mapping) else None
    if number := _length(held):
        most = max((copies for _, copies, _ in loose), default=1)  # those within an array's tree are copied with it
        yield ("constraints",), most, Counter(constraints=number)
    named = source.document.data.get("frames") if isinstance(source.document.data, Mapping) else None
    if number := _length(named):
        most = max((copies for _, copies, _ in loose), default=1)
        yield ("frames",), most, Counter(frames=number)
    acting = source.document.data.get("actuators") if isinstance(source.document.data, Mapping) else None
    if number := _length(acting):
        yield ("actuators",), 1, Counter(actuators=number)
    models = source.document.data.get("models") if isinstance(source.document.data, Mapping) else None
    used: dict[str, Counter[str]] = {}
    for name, raw in models.items() if isinstance(models, Mapping) else ():
        if not isinstance(raw, Mapping):
            continue
        used_here = Counter({word: _length(raw.get(word)) for word in ("grasps", "actuators", "frames", "constraints")})
        text = raw.get("use")
        if not isinstance(text, str):
            own = raw.get("bodies")
            used_here += Counter(bodies=_length(own), shapes=_shapes(own))
        elif (key := use_key(raw)) in source.uses:
            if key not in used:  # a file of many bodies may be used by many models
                own_model = trees.model_of(source.uses[key])
                used[key] = _model(own_model) if own_model is not None else Counter()
            used_here += used[key]
        array = source.file.models[name].array if source.file is not None else None
        yield ("models", name), _copies(array), used_here


def _loose(bodies: Bodies) -> Iterator[tuple[tuple[Key, ...], int, Counter[str]]]:
    root, copies, tree = "", 1, Counter[str]()
    for name in bodies.order():
        if bodies.parent(name) is None:
            if tree:
                yield (*bodies.path, root), copies, tree
            typed = bodies.typed[name]
            root, copies, tree = name, _copies(typed.array if typed is not None else None), Counter()
        tree += Counter(bodies=1, shapes=_length(bodies.field(name, "shapes")))
    if tree:
        yield (*bodies.path, root), copies, tree


def _model(bodies: Bodies) -> Counter[str]:
    files = [file.file for file in bodies.files if file.file is not None]
    excluded = sum(len(file.contact.exclude) + len(file.contact.touch) for file in files)
    if not all(file.contact.self_collision for file in files):
        excluded += math.comb(len(bodies.raw), 2)
    grasps = sum(len(file.model.grasps) for file in files if file.model is not None)
    actuators = sum(len(file.model.actuators) for file in files if file.model is not None)
    named = sum(len(file.model.frames) for file in files if file.model is not None)
    held = sum(len(file.model.constraints) for file in files if file.model is not None)
    of_bodies = {"bodies": len(bodies.raw), "shapes": _shapes(bodies.raw)}
    of_model = {"excluded pairs": excluded, "grasps": grasps, "actuators": actuators}
    of_model |= {"frames": named, "constraints": held}
    return Counter({**of_bodies, **of_model})


def _shapes(bodies: Any) -> int:
    items = bodies.values() if isinstance(bodies, Mapping) else ()
    return sum(_length(body.get("shapes")) for body in items if isinstance(body, Mapping))


def _length(value: Any) -> int:
    return len(value) if isinstance(value, (list, tuple, Mapping)) else 0


def _copies(array: Array | None) -> int:
    """The elements of an array; 1 for none, and for one with errors, which is never expanded."""
    return 1 if array is None else array.count()
