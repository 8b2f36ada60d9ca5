"""A world in an engine, as one of the two sides that are compared, and what is asked of it: runs, and windows."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simspec.compiler import compile_world, missing_options
from simspec.control.request import to_request
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.process import DEADLINE, Answer, Operation, start
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import Value, idle_settings, pair_settings, resolve_settings
from simspec.engines.kit.warm import WarmProcesses
from simspec.scratch import scratch_folder
from simspec.world.canonical import sha256
from simspec.world.contact_pairs import Pair
from simspec.world.kinematics import initial_state
from simspec.world.types import EngineOptions, PairSettings, World

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Configuration:
    """A world in an engine (a label), and the interpreter that has the engine (None: this one). ``start``: the initial (q, v)
    where it is not the world's."""

    world: World
    engine: str
    python: str | None = None
    start: tuple[Floats, Floats] | None = field(default=None, compare=False)

    @property
    def kind(self) -> type[Engine]:
        """The engine's class."""
        return find_engine(self.engine)

    @property
    def key(self) -> tuple[str, str, str | None]:
        """What its windows depend on."""
        return sha256(self.world), self.engine, self.python

    @property
    def settings(self) -> dict[str, Value]:
        """All solver settings at work: the engine's own choices included."""
        return dict(self.kind.chosen_settings(self.world, resolve_settings(self.kind, self.world)))

    @property
    def initial(self) -> tuple[Floats, Floats]:
        """The initial (q, v)."""
        return initial_state(self.world) if self.start is None else self.start

    def in_world(self, world: World) -> Configuration:
        """The same engine with another world."""
        return dataclasses.replace(self, world=world)

    def with_settings(self, values: Mapping[str, Value]) -> Configuration:
        """The same with some other settings; those that then do nothing are left out."""
        wanted = {**resolve_settings(self.kind, self.world), **values}
        idle = idle_settings(self.kind, wanted)
        written = {
            name: value
            for name, value in wanted.items()
            if name not in idle and value != self.kind.SETTINGS[name].default
        }
        options = dataclasses.replace(self.world.options(self.kind.NAME), settings=tuple(sorted(written.items())))
        return self.in_world(_with_options(self.world, options))

    def with_pair_setting(self, pair: Pair, name: str, value: Value | None) -> Configuration:
        """The same with another setting of a pair of materials; None: the pair takes the engine's own."""
        settings = {**pair_settings(self.kind, self.world).get(pair, {}), name: value}
        own = {key: kept for key, kept in settings.items() if kept is not None}
        options = self.world.options(self.kind.NAME)
        pairs = [entry for entry in options.pairs if (entry.first, entry.second) != pair]
        pairs += [PairSettings(*pair, tuple(sorted(own.items())))] if own else []
        ordered = tuple(sorted(pairs, key=lambda entry: (entry.first, entry.second)))
        return self.in_world(_with_options(self.world, dataclasses.replace(options, pairs=ordered)))

    def with_options_of(self, other: Configuration) -> Configuration:
        """The same with what another side's world accepts and has computed outside the engine."""
        theirs = other.world.options(other.kind.NAME)
        own = self.world.options(self.kind.NAME)
        return self.in_world(
            _with_options(self.world, dataclasses.replace(own, accept=theirs.accept, outside=theirs.outside))
        )

    def accepting(self) -> Configuration:
        """The same with everything accepted that the engine has approximately or outside: a counterfactual is no claim.
        Raises UnsupportedError for what it does not support at all."""
        pythons = {} if self.python is None else {self.engine: self.python}
        needed = missing_options(self.world, self.engine, pythons)
        if not needed:
            return self
        own = self.world.options(self.kind.NAME)
        accept, outside = (tuple(sorted({*getattr(own, key), *needed.get(key, {})})) for key in ("accept", "outside"))
        return self.in_world(_with_options(self.world, dataclasses.replace(own, accept=accept, outside=outside)))


def _with_options(world: World, options: EngineOptions) -> World:
    others = [other for other in world.engines if other.engine != options.engine]
    return dataclasses.replace(world, engines=tuple(sorted([*others, options], key=lambda some: some.engine)))


def run_operation(configuration: Configuration, steps: int, every: int, channels: Iterable[str] = ()) -> Operation:
    """A run of ``steps`` from the initial state, recorded every ``every`` steps."""
    parameters, arrays = to_request(configuration.world)
    q, v = configuration.initial
    asked = {**parameters, "steps": steps, "every": every, "channels": list(channels)}
    return Operation("run", asked, {**arrays, "q": q, "v": v}, configuration.world)


def windows_operation(
    configuration: Configuration,
    q: Floats,
    v: Floats,
    starts: Sequence[int],
    steps: int,
    contacts: bool = False,
    before: tuple[Floats, Floats] | None = None,
) -> Operation:
    """Windows of ``steps`` steps from states q (k, nq), v (k, nv), each the one after ``starts`` (k) steps of a run.
    ``before``: states so many steps earlier, for an engine that keeps contact points of earlier steps; others do not step from
    them."""
    parameters, arrays = to_request(configuration.world)
    channels = ["contacts"] if contacts else []
    asked = {**parameters, "starts": list(starts), "steps": steps, "channels": channels}
    states = {"q": np.ascontiguousarray(q), "v": np.ascontiguousarray(v)}
    if before is not None and configuration.kind.KEEPS_CONTACTS:
        states |= {"q_before": np.ascontiguousarray(before[0]), "v_before": np.ascontiguousarray(before[1])}
    return Operation("windows", asked, {**arrays, **states}, configuration.world)


@dataclass(frozen=True)
class Asking:
    """How engines are asked: each question in a process of its own, under a ``deadline`` (s), forked from ``warm`` ones."""

    warm: WarmProcesses | None = None
    deadline: float = DEADLINE

    def ask(self, configuration: Configuration, *operations: Operation) -> list[Answer]:
        """The answers of a process of the configuration's engine. Raises UnsupportedError where the engine does not support
        the world, EngineError where it fails."""
        engine, python = configuration.engine, configuration.python
        with (
            _compiled(configuration) as folder,
            start(engine, folder, operations, python=python, deadline=self.deadline, warm=self.warm) as running,
        ):
            return running.wait().answers


@contextlib.contextmanager
def _compiled(configuration: Configuration) -> Iterator[Path]:
    pythons = {} if configuration.python is None else {configuration.engine: configuration.python}
    compiled = compile_world(configuration.world, [configuration.engine], pythons=pythons)[configuration.engine]
    with scratch_folder(engine_name(configuration.engine)) as place:
        folder = place / "compiled"
        compiled.artifacts.write(folder)
        yield folder
