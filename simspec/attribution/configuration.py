"""One side of an explanation: a world with the settings of an engine, and the proof of its model."""

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
from simspec.engines.kit.process import DEADLINE, Answer, Operation, start
from simspec.engines.kit.registry import engine_name, find_engine
from simspec.engines.kit.settings import Value, idle_settings, pair_settings, resolve_settings
from simspec.engines.kit.warm import WarmProcesses
from simspec.files import scratch_folder
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.judge import judge_proof
from simspec.proof.verify import LEVELS, verify
from simspec.world.canonical import sha256
from simspec.world.kinematics import initial_state
from simspec.world.types import EngineOptions, Pair, PairSettings, World

# A world in an engine, as one of the two sides that are compared, and the requests to it: runs, and windows.

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
        """The parts that its windows depend on."""
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
        remaining = {key: kept for key, kept in settings.items() if kept is not None}
        options = self.world.options(self.kind.NAME)
        pairs = [entry for entry in options.pairs if (entry.first, entry.second) != pair]
        pairs += [PairSettings(*pair, tuple(sorted(remaining.items())))] if remaining else []
        ordered = tuple(sorted(pairs, key=lambda entry: (entry.first, entry.second)))
        return self.in_world(_with_options(self.world, dataclasses.replace(options, pairs=ordered)))

    def with_options_of(self, other: Configuration) -> Configuration:
        """The same with what another side's world accepts and has computed outside the engine."""
        theirs = other.world.options(other.kind.NAME)
        options = self.world.options(self.kind.NAME)
        return self.in_world(
            _with_options(self.world, dataclasses.replace(options, accept=theirs.accept, outside=theirs.outside))
        )

    def accepting(self) -> Configuration:
        """The same with everything accepted that the engine has approximately or outside: a counterfactual is no claim.
        Raises UnsupportedError for what it does not support at all."""
        pythons = {} if self.python is None else {self.engine: self.python}
        needed = missing_options(self.world, self.engine, pythons)
        if not needed:
            return self
        options = self.world.options(self.kind.NAME)
        accept, outside = (
            tuple(sorted({*getattr(options, key), *needed.get(key, {})})) for key in ("accept", "outside")
        )
        return self.in_world(_with_options(self.world, dataclasses.replace(options, accept=accept, outside=outside)))


def _with_options(world: World, options: EngineOptions) -> World:
    others = [other for other in world.engines if other.engine != options.engine]
    return dataclasses.replace(world, engines=tuple(sorted([*others, options], key=lambda some: some.engine)))


def run_operation(configuration: Configuration, steps: int, every: int, channels: Iterable[str] = ()) -> Operation:
    """A run of ``steps`` from the initial state, recorded every ``every`` steps."""
    parameters, arrays = to_request(configuration.world)
    q, v = configuration.initial
    requested = {**parameters, "steps": steps, "every": every, "channels": list(channels)}
    return Operation("run", requested, {**arrays, "q": q, "v": v}, configuration.world)


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
    requested = {**parameters, "starts": list(starts), "steps": steps, "channels": channels}
    states = {"q": np.ascontiguousarray(q), "v": np.ascontiguousarray(v)}
    if before is not None and configuration.kind.KEEPS_CONTACTS:
        states |= {"q_before": np.ascontiguousarray(before[0]), "v_before": np.ascontiguousarray(before[1])}
    return Operation("windows", requested, {**arrays, **states}, configuration.world)


@dataclass(frozen=True)
class Asking:
    """How engines are queried: each request in a separate process, under a ``deadline`` (s), forked from ``warm`` ones."""

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


# Proofs of the sides: whether each engine has the model that it was given.

MODEL = ("L0", "L1", "L2", "L3", "L4")
"""Levels that say whether the models are equal."""
MOTION = ("L6",)
"""Levels that say whether motion without contact is."""
MEASURED = "L5"
"""The level of measured contact."""
CHEAP = tuple(level for level in LEVELS if level != MEASURED)
"""Levels that a requested proof covers here: all but the measured contact, which takes longest."""
MOST_FAULTS = 3
"""Faults of a side that are listed; the others are counted."""


@dataclass(frozen=True)
class ModelProof:
    """The proof of one side's model.

    engine    by label
    source    where the proof stands ("" where there is none)
    missing   why there is none ("" where there is one)
    levels    by level the number of checks, and the largest deviation of those that compare numbers
    faults    what did not hold, or was not compared though it should be, a line each; with none the proof is valid
    contact   statements on contact in addition to the verdict (:attr:`EngineProof.contact_words`), a line each
    """

    engine: str
    source: str = ""
    missing: str = ""
    levels: Mapping[str, tuple[int, float]] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    contact: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether there is a proof, and all of it holds."""
        return not self.missing and not self.faults

    def compared(self, levels: Sequence[str]) -> tuple[int, float]:
        """Of some levels the number of checks, and the largest deviation."""
        parts = [self.levels[level] for level in levels if level in self.levels]
        return sum(count for count, _ in parts), max((worst for _, worst in parts), default=0.0)


def proof_of(side: Configuration, certificate: Certificate | None, source: str, version: str | None) -> ModelProof:
    """The proof in a certificate for a side whose engine is of ``version`` (None: unknown)."""
    if certificate is None:
        return ModelProof(side.engine, missing=f"{source} has no certificate" if source else "no proof was requested")
    if certificate.world_sha256 != sha256(side.world):
        return ModelProof(side.engine, missing=f"{source} is of another world")
    proof = certificate.engines.get(side.engine)
    if proof is None:
        return ModelProof(side.engine, missing=f"{source} does not contain {side.engine}")
    if version is not None and proof.version != version:
        return ModelProof(side.engine, missing=f"{source} is of {side.engine} {proof.version}, not {version}")
    faults = judge_proof(side.engine, proof, side.world)
    if MEASURED in proof.not_compared:  # not a property of models: --verify leaves out measured contact, too
        faults = [line for line in faults if not line.startswith(f"{MEASURED} ")]
    return ModelProof(side.engine, source, "", _levels(proof), tuple(faults), tuple(proof.contact_words))


def _levels(proof: EngineProof) -> dict[str, tuple[int, float]]:
    levels = {}
    for level in LEVELS:
        checks = proof.level(level)
        if checks:
            worst = max((check.worst for check in checks if check.worst is not None), default=0.0)
            levels[level] = (len(checks), worst)
    return levels


def prove(sides: Sequence[Configuration], deadline: float = DEADLINE) -> tuple[ModelProof, ...]:
    """Prove here that each side's engine holds its world, by all levels but L5. Raises UnsupportedError."""
    certificates: dict[tuple[str, str], Certificate] = {}
    for side in sides:
        key = (sha256(side.world), side.engine)
        if key not in certificates:
            pythons = {} if side.python is None else {side.engine: side.python}
            certificates[key] = verify(side.world, [side.engine], levels=CHEAP, pythons=pythons, deadline=deadline)
    return tuple(proof_of(side, certificates[sha256(side.world), side.engine], "proven here", None) for side in sides)


def model_lines(proofs: Sequence[ModelProof], same_values: bool, hint: str = "") -> list[str]:
    """Whether models and smooth motion are equal, in two lines. ``same_values``: whether the two worlds are the same."""
    if not proofs:
        return []
    faulty = [proof for proof in proofs if proof.faults]
    if faulty:
        return [f"models: NOT proven equal: {listed_faults(proof)}" for proof in faulty]
    missing = list(dict.fromkeys(proof.missing for proof in proofs if proof.missing))
    if missing:
        return [f"models: not proven to be equal ({'; '.join(missing)}){hint}"]
    sources = ", ".join(dict.fromkeys(proof.source for proof in proofs))
    checks = [proof.compared(MODEL) for proof in proofs]
    text = "equal" if same_values else "each engine holds the values that it was given"
    lines = [
        f"models: {text}: L0 to L4, {' and '.join(str(count) for count, _ in checks)} checks, largest deviation "
        f"{max(worst for _, worst in checks):.2g} ({sources})"
    ]
    smooth = [proof.compared(MOTION) for proof in proofs]
    if all(count for count, _ in smooth):
        lines.append(f"motion without contact: as the oracle's, to {max(worst for _, worst in smooth):.2g} (L6)")
    else:
        lines.append("motion without contact: L6 was not compared")
    return lines + [f"contact in {proof.engine}: {words}" for proof in proofs for words in proof.contact]


def listed_faults(proof: ModelProof) -> str:
    """The faults of a proof, the first few."""
    more = f" (and {len(proof.faults) - MOST_FAULTS} more)" if len(proof.faults) > MOST_FAULTS else ""
    return f"{proof.engine}: {'; '.join(proof.faults[:MOST_FAULTS])}{more}"
