"""The trees of bodies of a spec, as far as they can be read: bodies with errors in them stand as None, so that what is
wrong between bodies is found together with what is wrong in one.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pydantic import ValidationError

from simspec.errors import Problem
from simspec.language.arrays import MOST_ELEMENTS, Array, State
from simspec.language.document import Key
from simspec.language.models import Body, Use
from simspec.language.sources import Source, use_key
from simspec.language.vocabulary import TREE_JOINTS


def unused(name: str, taken: Container[str]) -> str:
    """An implied name as it is, or with the first number from 2 behind it that makes it another than those given."""
    if name not in taken:
        return name
    return next(candidate for number in itertools.count(2) if (candidate := f"{name}_{number}") not in taken)


def _given_name(joint: Any) -> str | None:
    """The name that a plain joint was given."""
    name = joint.get("name") if isinstance(joint, Mapping) else None
    return name if isinstance(name, str) else None


@dataclass
class Bodies:
    """The bodies of one mapping: loose ones of a scenario, or those of a model.

    ``path`` is the mapping's place in ``source``; ``raw`` the plain data; ``typed`` the models (None: has errors);
    ``model`` whether it is a model, which has one root; ``fixed``, ``kinematic``, ``attached`` (to a body of another model) and
    ``placed`` what its placement in a scenario says of the root, and where; ``files`` the model files that lead to it, the
    one that holds it last.
    """

    source: Source
    path: tuple[Key, ...]
    raw: Mapping[str, Any]
    typed: Mapping[str, Body | None]
    model: bool
    fixed: bool | None = None
    kinematic: bool | None = None
    attached: bool = False
    placed: tuple[Key, ...] = ()
    files: tuple[Source, ...] = ()

    def content(self, name: str) -> Body:
        """The model of a body without errors. Raises ValueError for another."""
        body = self.typed[name]
        if body is None:
            raise ValueError(f"{name} has errors, so it is not resolved")
        return body

    def field(self, name: str, key: str) -> Any:
        """A plain field of a body, None where there is none."""
        body = self.raw.get(name)
        return body.get(key) if isinstance(body, Mapping) else None

    def parent(self, name: str) -> str | None:
        """The parent's name; None for a root (and for what is no name)."""
        parent = self.field(name, "parent")
        return parent if isinstance(parent, str) else None

    def joint_type(self, name: str) -> str:
        """The type of a body's joint, the stated or the implied one."""
        if (several := self.several(name)) and self.field(name, "joint") is None:
            stated = several[-1].get("type")
            return stated if stated in TREE_JOINTS else "hinge"
        joint = self.field(name, "joint")
        if isinstance(joint, Mapping):
            stated = joint.get("type")
            kind = stated if isinstance(stated, str) else "free"
        else:
            kind = "fixed" if self.field(name, "fixed") is True else "free"
        if self.fixed is not None and kind in ("fixed", "free") and self.field(name, "parent") is None:
            return "fixed" if self.fixed else "free"
        return kind

    def is_kinematic(self, name: str) -> bool:
        """Whether a body is a root that moves as it is told."""
        if self.field(name, "parent") is not None or self.attached:
            return False
        return self.field(name, "kinematic") is True if self.kinematic is None else self.kinematic

    def several(self, name: str) -> list[Mapping[str, Any]]:
        """The plain `joints` of a body, the parent's side first; empty where it has one joint."""
        joints = self.field(name, "joints")
        return [joint if isinstance(joint, Mapping) else {} for joint in joints] if isinstance(joints, list) else []

    def joint_name(self, name: str) -> str:
        """The name of a body's joint within its tree, of several joints that of the last."""
        return self.joint_names(name)[-1]

    def joint_names(self, name: str) -> list[str]:
        """The names of a body's joints within its tree: the given ones, else `<body>_joint`, of several `<body>_joint_<index>`,
        with a number behind where another joint was given that name."""
        taken = self._given_joint_names
        several = self.several(name)
        if not several:
            own = _given_name(self.field(name, "joint"))
            return [own if own is not None else unused(f"{name}_joint", taken)]
        return [_given_name(joint) or unused(f"{name}_joint_{index}", taken) for index, joint in enumerate(several)]

    def joint_types(self, name: str) -> list[str]:
        """The types of a body's joints; "" for one that cannot be read."""
        several = self.several(name)
        kinds = (joint.get("type") for joint in several)
        return [kind if isinstance(kind, str) else "" for kind in kinds] if several else [self.joint_type(name)]

    def joint_place(self, name: str, index: int) -> tuple[Key, ...]:
        """The path in the body of the joint at ``index`` among its own."""
        return ("joints", index) if self.several(name) else ("joint",)

    @cached_property
    def _given_joint_names(self) -> frozenset[str]:
        return frozenset(
            given
            for name in self.raw
            for joint in (self.field(name, "joint"), *self.several(name))
            if (given := _given_name(joint)) is not None
        )

    def roots(self) -> list[str]:
        """Bodies without a parent."""
        return [name for name in self.raw if self.field(name, "parent") is None]

    def cycles(self) -> list[list[str]]:
        """Every cycle of parents, each beginning with its first body in the file."""
        state: dict[str, int] = {}
        cycles = []
        for start in self.raw:
            chain: list[str] = []
            name: str | None = start
            while name is not None and name in self.raw and name not in state:
                state[name] = 1
                chain.append(name)
                name = self.parent(name)
            if name is not None and state.get(name) == 1:
                cycles.append(chain[chain.index(name) :])
            state.update(dict.fromkeys(chain, 2))
        return cycles

    def order(self) -> list[str]:
        """All bodies that hang on a root: trees in the order of their roots, every parent before its children."""
        children: dict[str, list[str]] = {}
        for name in self.raw:
            if (parent := self.parent(name)) is not None:
                children.setdefault(parent, []).append(name)
        order, waiting = [], self.roots()[::-1]
        while waiting:
            name = waiting.pop()
            order.append(name)
            waiting.extend(reversed(children.get(name, ())))
        return order

    def still(self) -> set[str]:
        """Bodies that cannot move: fixed to the world through fixed joints only. What is attached may move with its
        carrier."""
        still: set[str] = set()
        if self.attached:
            return still
        for name in self.order():
            parent = self.parent(name)
            if self.joint_type(name) == "fixed" and (parent is None or parent in still):
                still.add(name)
        return still

    def moving_groups(self) -> dict[str, list[str]]:
        """The bodies that move as one, joined through fixed joints, by the topmost, which stands first."""
        still, top, groups = self.still(), dict[str, str](), dict[str, list[str]]()
        for name in self.order():
            if name not in still:
                parent = self.parent(name) or ""
                top[name] = top.get(parent, name) if self.joint_type(name) == "fixed" else name
                groups.setdefault(top[name], []).append(name)
        return groups


def _typed(raw: Mapping[str, Any], valid: Mapping[str, Body] | None) -> dict[str, Body | None]:
    if valid is not None:
        return dict(valid)
    typed: dict[str, Body | None] = {}
    for name, body in raw.items():
        try:
            typed[name] = Body.model_validate(body)
        except ValidationError:
            typed[name] = None  # its errors are reported with the file's
    return typed


def _bodies(source: Source, path: tuple[Key, ...], valid: Any, model: bool) -> Bodies | None:
    raw: Any = source.document.data
    for step in path:
        raw = raw.get(step) if isinstance(raw, Mapping) else None
    if not isinstance(raw, Mapping):
        return None
    raw = {name: body for name, body in raw.items() if isinstance(name, str)}
    return Bodies(source, path, raw, _typed(raw, valid), model)


def model_of(source: Source) -> Bodies | None:
    """The bodies of a model file, following ``use``; None where they cannot be read."""
    files = [source]
    while True:
        data = source.document.data
        model = data.get("model") if isinstance(data, Mapping) else None
        text = model.get("use") if isinstance(model, Mapping) else None
        if not isinstance(model, Mapping) or not isinstance(text, str):
            break
        key = use_key(model)
        if key not in source.uses:
            return None
        source = source.uses[key]
        files.append(source)
    file = source.file
    bodies = _bodies(source, ("model", "bodies"), file.model.bodies if file and file.model else None, True)
    if bodies is not None:
        bodies.files = tuple(files)
    return bodies


def loose(source: Source) -> Bodies | None:
    """The loose bodies of a scenario; None where there are none."""
    return _bodies(source, ("bodies",), source.file.bodies if source.file else None, False)


def placed(source: Source) -> Iterator[tuple[str, Use | None, Bodies]]:
    """Every model placed in a scenario, with its bodies: (name, placement or None where it has errors, bodies)."""
    data = source.document.data
    models = data.get("models") if isinstance(data, Mapping) else None
    for name, raw in models.items() if isinstance(models, Mapping) else ():
        if not isinstance(raw, Mapping):
            continue
        use = source.file.models[name] if source.file else None
        path = ("models", name)
        if isinstance(raw.get("use"), str):
            below = source.uses.get(use_key(raw))
            bodies = model_of(below) if below is not None else None
        else:
            bodies = _bodies(source, (*path, "bodies"), use.bodies if use else None, True)
        if bodies is None:
            continue
        fixed = raw.get("fixed")
        bodies.fixed, bodies.placed = fixed if isinstance(fixed, bool) else None, path
        if isinstance(kinematic := raw.get("kinematic"), bool):
            bodies.kinematic = kinematic
            bodies.fixed = False if kinematic else bodies.fixed
        if raw.get("attach") is not None:
            bodies.fixed = bodies.attached = True
        yield name, use, bodies


@dataclass(frozen=True)
class WrittenState:
    """An initial state as it is written: the file, its place there, the plain data, and the model (None: has errors)."""

    source: Source
    path: tuple[Key, ...]
    raw: Mapping[str, Any]
    typed: State | None


def states(source: Source, bodies: Bodies) -> dict[str, WrittenState]:
    """The states of a model by name; the nearer file's, and at last the placement's in ``source``, replaces another's."""
    named: dict[str, WrittenState] = {}
    places: list[tuple[Source, tuple[Key, ...], Any]] = [
        (file, ("model", "states"), file.file.model.states if file.file is not None and file.file.model else {})
        for file in reversed(bodies.files)
    ]
    if bodies.placed:
        use = source.file.models.get(str(bodies.placed[1])) if source.file is not None else None
        places.append((source, (*bodies.placed, "states"), use.states if use is not None else {}))
    for file, path, typed in places:
        raw = _at(file, path)
        for name, state in raw.items() if isinstance(raw, Mapping) else ():
            if isinstance(name, str) and isinstance(state, Mapping):
                named[name] = WrittenState(file, (*path, name), state, typed.get(name))
    return named


def followers(source: Source, bodies: Bodies) -> set[str]:
    """The joints of a model that follow others, by constraints of its files, of its placement in ``source`` and of the
    scenario."""
    places: list[tuple[Source, tuple[Key, ...], str]] = [(file, ("model", "constraints"), "") for file in bodies.files]
    if bodies.placed:
        places.append((source, (*bodies.placed, "constraints"), ""))
        places.append((source, ("constraints",), f"{bodies.placed[1]}/"))
    found: set[str] = set()
    for file, path, prefix in places:
        raw = _at(file, path)
        for constraint in raw.values() if isinstance(raw, Mapping) else ():
            follow = constraint.get("follow") if isinstance(constraint, Mapping) else None
            joint = follow.get("joint") if isinstance(follow, Mapping) else None
            if isinstance(joint, str) and joint.startswith(prefix):
                found.add(joint.removeprefix(prefix))
    return found


def actuator_names(source: Source, bodies: Bodies) -> list[str]:
    """The names of a model's actuators: of its files', and of its placement's in ``source``."""
    places: list[tuple[Source, tuple[Key, ...]]] = [(file, ("model", "actuators")) for file in reversed(bodies.files)]
    if bodies.placed:
        places.append((source, (*bodies.placed, "actuators")))
    written = (_at(file, path) for file, path in places)
    return list(dict.fromkeys(str(name) for raw in written if isinstance(raw, Mapping) for name in raw))


def chosen_state(source: Source, bodies: Bodies) -> tuple[Source, tuple[Key, ...], str] | None:
    """The name of the state that a model begins in, with the place that says it; None where nothing does."""
    places: list[tuple[Source, tuple[Key, ...]]] = [(file, ("model", "state")) for file in bodies.files]
    if bodies.placed:
        places.insert(0, (source, (*bodies.placed, "state")))
    for file, path in places:
        name = _at(file, path)
        if isinstance(name, str):
            return file, path, name
    return None


def _at(source: Source, path: tuple[Key, ...]) -> Any:
    """The plain data at a place; None where there is none."""
    data: Any = source.document.data
    for step in path:
        data = data.get(step) if isinstance(data, Mapping) else None
    return data


def every(source: Source) -> Iterator[Bodies]:
    """All bodies of a spec: loose ones, those of its own model, those of each placed model."""
    for bodies in (loose(source), model_of(source)):
        if bodies is not None:
            yield bodies
    for _, _, bodies in placed(source):
        yield bodies


# How much a spec stands for, counted before anything of it is copied: an array stands for many elements, each with all shapes
# of its tree; ``use:`` for all that a file holds, once for each model that names it.

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
    bodies = loose(source)
    separate = list(_loose(bodies)) if bodies is not None else []
    yield from separate
    if (bodies := model_of(source)) is not None:
        yield ("model",), 1, _model(bodies)
    held = source.document.data.get("constraints") if isinstance(source.document.data, Mapping) else None
    if number := _length(held):
        most = max((copies for _, copies, _ in separate), default=1)  # those within an array's tree are copied with it
        yield ("constraints",), most, Counter(constraints=number)
    named = source.document.data.get("frames") if isinstance(source.document.data, Mapping) else None
    if number := _length(named):
        most = max((copies for _, copies, _ in separate), default=1)
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
                own_model = model_of(source.uses[key])
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
