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
from simspec.language.document import Key, mapping
from simspec.language.models import Body, Model, Use
from simspec.language.sources import Source, use_key
from simspec.language.vocabulary import TREE_JOINTS


def unused(name: str, taken: Container[str]) -> str:
    """An implied name as it is, or with the first number from 2 behind it that makes it another than those given."""
    if name not in taken:
        return name
    return next(candidate for number in itertools.count(2) if (candidate := f"{name}_{number}") not in taken)


def _text(data: Any, key: str) -> str | None:
    """A text of a plain mapping; None where there is none."""
    text = mapping(data).get(key)
    return text if isinstance(text, str) else None


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
        return mapping(self.raw.get(name)).get(key)

    def parent(self, name: str) -> str | None:
        """The parent's name; None for a root (and for what is no name)."""
        return _text(self.raw.get(name), "parent")

    def joint_type(self, name: str) -> str:
        """The type of a body's joint, the stated or the implied one."""
        if (several := self.several(name)) and self.field(name, "joint") is None:
            stated = several[-1].get("type")
            return stated if stated in TREE_JOINTS else "hinge"
        joint = self.field(name, "joint")
        if isinstance(joint, Mapping):
            kind = _text(joint, "type") or "free"
        else:
            kind = "fixed" if self.field(name, "fixed") is True else "free"
        if self.fixed is not None and kind in ("fixed", "free") and self.field(name, "parent") is None:
            return "fixed" if self.fixed else "free"
        return kind

    def is_kinematic(self, name: str) -> bool:
        """Whether a body is a root that moves as `motion` says."""
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
            given = _text(self.field(name, "joint"), "name")
            return [given if given is not None else unused(f"{name}_joint", taken)]
        return [_text(joint, "name") or unused(f"{name}_joint_{index}", taken) for index, joint in enumerate(several)]

    def joint_types(self, name: str) -> list[str]:
        """The types of a body's joints; "" for one that cannot be read."""
        several = self.several(name)
        return [_text(joint, "type") or "" for joint in several] if several else [self.joint_type(name)]

    def joint_place(self, name: str, index: int) -> tuple[Key, ...]:
        """The path in the body of the joint at ``index`` among its own."""
        return ("joints", index) if self.several(name) else ("joint",)

    @cached_property
    def _given_joint_names(self) -> frozenset[str]:
        return frozenset(
            given
            for name in self.raw
            for joint in (self.field(name, "joint"), *self.several(name))
            if (given := _text(joint, "name")) is not None
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

    def fixed_bodies(self) -> set[str]:
        """Bodies that cannot move: fixed to the world through fixed joints only. An attached model may move with its
        carrier."""
        static: set[str] = set()
        if self.attached:
            return static
        for name in self.order():
            parent = self.parent(name)
            if self.joint_type(name) == "fixed" and (parent is None or parent in static):
                static.add(name)
        return static

    def moving_groups(self) -> dict[str, list[str]]:
        """The bodies that move as one, joined through fixed joints, by the topmost, which stands first."""
        static, top, groups = self.fixed_bodies(), dict[str, str](), dict[str, list[str]]()
        for name in self.order():
            if name not in static:
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
    raw = source.document.at(*path)
    if not isinstance(raw, Mapping):
        return None
    raw = {name: body for name, body in raw.items() if isinstance(name, str)}
    return Bodies(source, path, raw, _typed(raw, valid), model)


def model_of(source: Source) -> Bodies | None:
    """The bodies of a model file, following ``use``; None where they cannot be read."""
    files = [source]
    while True:
        model = source.document.at("model")
        if _text(model, "use") is None:
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
    for name, raw in mapping(source.document.at("models")).items():
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


def _places(source: Source, bodies: Bodies, word: str) -> list[tuple[Source, tuple[Key, ...]]]:
    """Where a field of a model can be written: in its placement in ``source``, and in its files; the nearest last."""
    places: list[tuple[Source, tuple[Key, ...]]] = [(file, ("model", word)) for file in reversed(bodies.files)]
    return [*places, (source, (*bodies.placed, word))] if bodies.placed else places


def states(source: Source, bodies: Bodies) -> dict[str, WrittenState]:
    """The states of a model by name; the nearer file's, and at last the placement's in ``source``, replaces another's."""
    named: dict[str, WrittenState] = {}
    for file, path in _places(source, bodies, "states"):
        content: Model | Use | None = None
        if file.file is not None:
            content = file.file.model if path[0] == "model" else file.file.models.get(str(path[1]))
        for name, state in mapping(file.document.at(*path)).items():
            if isinstance(name, str) and isinstance(state, Mapping):
                typed = content.states.get(name) if content is not None else None
                named[name] = WrittenState(file, (*path, name), state, typed)
    return named


def followers(source: Source, bodies: Bodies) -> set[str]:
    """The joints of a model that follow others, by constraints of its files, of its placement in ``source`` and of the
    scenario."""
    places = [(file, path, "") for file, path in _places(source, bodies, "constraints")]
    if bodies.placed:
        places.append((source, ("constraints",), f"{bodies.placed[1]}/"))
    found: set[str] = set()
    for file, path, prefix in places:
        for constraint in mapping(file.document.at(*path)).values():
            joint = _text(mapping(constraint).get("follow"), "joint")
            if joint is not None and joint.startswith(prefix):
                found.add(joint.removeprefix(prefix))
    return found


def actuator_names(source: Source, bodies: Bodies) -> list[str]:
    """The names of a model's actuators: of its files', and of its placement's in ``source``."""
    written = (mapping(file.document.at(*path)) for file, path in _places(source, bodies, "actuators"))
    return list(dict.fromkeys(str(name) for names in written for name in names))


def chosen_state(source: Source, bodies: Bodies) -> tuple[Source, tuple[Key, ...], str] | None:
    """The name of the state that a model begins in, with the place that says it; None where nothing does."""
    for file, path in reversed(_places(source, bodies, "state")):
        name = file.document.at(*path)
        if isinstance(name, str):
            return file, path, name
    return None


def every(source: Source) -> Iterator[Bodies]:
    """All bodies of a spec: loose ones, those of its own model, those of each placed model."""
    for bodies in (loose(source), model_of(source)):
        if bodies is not None:
            yield bodies
    yield from (bodies for _, _, bodies in placed(source))


# How much a spec stands for, counted before anything of it is copied: an array stands for many elements, each with all shapes
# of its tree; ``use:`` for all that a file holds, once for each model that names it.

MOST = {
    "bodies": MOST_ELEMENTS,
    "shapes": 200_000,  # two for each of the most bodies; expanded, each takes some 300 bytes, ten times that in an engine
    "excluded pairs": 200_000,  # of bodies that models exclude, or let touch
    "grasps": 10_000,  # each is compared with the joints, which takes some 0.1 ms
    "actuators": 10_000,  # each is compared with the entries of each controller
    "frames": 200_000,
    "constraints": 10_000,  # a step solves them together, in time that grows with the cube of how many act on one tree
}
"""How many of each one scenario can have, in all copies of its models."""
_OF_MODEL = ("grasps", "actuators", "frames", "constraints")


def too_much(source: Source) -> list[Problem]:
    """The problem of the tree or model with which a scenario becomes too large; none where it does not."""
    total: Counter[str] = Counter()
    for path, copies, amounts in _parts(source):
        for what, count in amounts.items():
            total[what] += copies * count
            if total[what] > MOST[what]:
                text = f"{copies:,} × {count:,}" if copies > 1 else f"{count:,}"
                before = total[what] - copies * count
                found = text + (f", after {before:,}" if before else "")
                message, allowed = f"too many {what} in one scenario", f"up to {MOST[what]:,}"
                return [source.document.problem(path, message, key=True, found=found, allowed=allowed, code="S109")]
    return []


def _parts(source: Source) -> Iterator[tuple[tuple[Key, ...], int, Counter[str]]]:
    """Every tree and every model: its path, how many copies there are, and what one copy holds."""
    bodies = loose(source)
    separate = list(_loose(bodies)) if bodies is not None else []
    yield from separate
    if (bodies := model_of(source)) is not None:
        yield ("model",), 1, _model(bodies)
    most = max((copies for _, copies, _ in separate), default=1)  # those within an array's tree are copied with it
    for word, copies in (("constraints", most), ("frames", most), ("actuators", 1)):
        if number := _length(source.document.at(word)):
            yield (word,), copies, Counter({word: number})
    used: dict[str, Counter[str]] = {}
    for name, raw in mapping(source.document.at("models")).items():
        if not isinstance(raw, Mapping):
            continue
        used_here = Counter({word: _length(raw.get(word)) for word in _OF_MODEL})
        text = raw.get("use")
        if not isinstance(text, str):
            bodies_here = raw.get("bodies")
            used_here += Counter(bodies=_length(bodies_here), shapes=_shapes(bodies_here))
        elif (key := use_key(raw)) in source.uses:
            if key not in used:  # a file of many bodies may be used by many models
                used_model = model_of(source.uses[key])
                used[key] = _model(used_model) if used_model is not None else Counter()
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
    amounts = Counter({"bodies": len(bodies.raw), "shapes": _shapes(bodies.raw), "excluded pairs": excluded})
    for word in _OF_MODEL:
        amounts[word] = sum(len(getattr(file.model, word)) for file in files if file.model is not None)
    return amounts


def _shapes(bodies: Any) -> int:
    return sum(_length(mapping(body).get("shapes")) for body in mapping(bodies).values())


def _length(value: Any) -> int:
    return len(value) if isinstance(value, (list, tuple, Mapping)) else 0


def _copies(array: Array | None) -> int:
    """The elements of an array; 1 for none, and for one with errors, which is never expanded."""
    return 1 if array is None else array.count()
