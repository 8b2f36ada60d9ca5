"""The proofs of a sweep: each model that an engine is given is verified once, and the certificate is kept in the store.

A model is what the proof looks at: the world without its name, its expectations, its duration and what is recorded; the
engine's own options; the compiled files, but for the hash of the world in them; and all versions. Worlds that differ in
nothing else share a certificate. Initial states that are moved a little are not part of a world.
"""

from __future__ import annotations

import contextlib
import dataclasses
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec.compiler import Compiled, compile_world
from simspec.engines.kit.registry import engine_name, find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.errors import SpecError, UnsupportedError
from simspec.experiments.cases import case_of
from simspec.experiments.executors import Task
from simspec.experiments.plan import Cell, Plan, digest
from simspec.experiments.store import Store
from simspec.files import scratch_folder
from simspec.outputs.writing import Artifacts
from simspec.plugins import simspec_version
from simspec.runner.run import Case
from simspec.world.canonical import derived, sha256, to_plain
from simspec.world.types import RecordOptions, World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate
    from simspec.proof.verify import Probes


MOST_KEPT = 16
"""Compiled worlds that are kept while no task needs them: engines, repetitions and perturbations of one world follow each
other."""


@dataclass
class Prepared:
    """A world compiled for one engine, in a folder; ``users``: tasks that still need it."""

    world: World
    compiled: Compiled
    folder: Path
    closing: contextlib.ExitStack = field(repr=False)
    users: int = 0


class LocalSupplies:
    """Worlds in memory, compiled files in temporary folders. ``close`` removes all of them. ``pythons``: interpreters by
    label."""

    def __init__(self, pythons: Mapping[str, str] | None = None) -> None:
        self._pythons = pythons or {}
        self._kept: OrderedDict[tuple[str, str], Prepared] = OrderedDict()
        self._lock = threading.Lock()

    def prepare(self, case: Case) -> Prepared:
        """The compiled world of a case. Raises UnsupportedError where its engine does not support it."""
        name = (sha256(case.resolved), case.engine)
        with self._lock:
            prepared = self._kept.get(name)
            if prepared is not None:
                self._kept.move_to_end(name)
                return prepared
        compiled = compile_world(case.resolved, [case.engine], pythons=self._pythons)[case.engine]
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(scratch_folder("sweep")) / "compiled"
            compiled.artifacts.write(folder)
            prepared = Prepared(case.resolved, compiled, folder, stack.pop_all())
        with self._lock:
            self._kept[name] = prepared
            idle = [old for old, prepared in self._kept.items() if not prepared.users and old != name]
            dropped = [self._kept.pop(old) for old in idle[: max(0, len(self._kept) - MOST_KEPT)]]
        for entry in dropped:
            entry.closing.close()
        return prepared

    def hold(self, task: Task) -> Task:
        """Keep what a task needs, until :meth:`release`."""
        with self._lock:
            self._kept[task.world, task.engine].users += 1
        return task

    def release(self, task: Task) -> None:
        """The task is done."""
        with self._lock:
            self._kept[task.world, task.engine].users -= 1

    def case(self, task: Task) -> Case:
        """As of :class:`simspec.experiments.executors.Supplies`."""
        with self._lock:
            return Case(self._kept[task.world, task.engine].world, task.engine, perturb=task.perturb, seed=task.seed)

    def folder(self, task: Task) -> Path:
        """As of :class:`simspec.experiments.executors.Supplies`."""
        with self._lock:
            return self._kept[task.world, task.engine].folder

    def close(self) -> None:
        """Remove all folders."""
        with self._lock:
            kept = list(self._kept.values())
            self._kept.clear()
        for prepared in kept:
            prepared.closing.close()


PARTS = ("world", "settings", "files", "version")
"""The parts of a model that are distinguished, the first cause first: files follow from the world and the settings."""


@dataclass(frozen=True)
class CertifiedModel:
    """A model that an engine is given, by hashes, as it is compiled today. Figures that were stored with other hashes are older
    than the code.

    case, values  what the sweep puts into the scenario: (dotted path, plain value)
    world         hash of the resolved world with its expectations, without its name and options of engines
    settings      hash of all settings of the engine, and of what is accepted and outside
    files         hash of the compiled files, without the hash of the world in them; empty where the engine does not support
                  the world
    version       of the engine
    """

    engine: str
    case: str | None
    values: tuple[tuple[str, Any], ...]
    world: str
    settings: str
    files: str
    version: str

    @property
    def place(self) -> str:
        """Which model of its sweep it is."""
        return digest([self.engine, self.case, [list(entry) for entry in self.values]]).hex()

    def __str__(self) -> str:
        values = [f"{path}={value}" for path, value in self.values if self.case is None]
        return ", ".join([self.engine, *([self.case] if self.case else []), *values])


def models_of(plan: Plan) -> Iterator[CertifiedModel]:
    """Every model of a plan once. Values that make the scenario invalid have empty hashes."""
    known: set[str] = set()
    for cell in plan:
        place = CertifiedModel(cell.engine, cell.case, cell.overrides, "", "", "", "").place
        if place not in known:
            known.add(place)
            yield model_of(plan, cell)


def model_of(plan: Plan, cell: Cell) -> CertifiedModel:
    """The model of a cell, as it is compiled today."""
    version = plan.versions[cell.engine]["engine_version"]
    try:
        world = case_of(plan, cell).resolved
    except SpecError:
        return CertifiedModel(cell.engine, cell.case, cell.overrides, "", "", "", version)
    try:
        files = files_hash(world, compile_world(world, [cell.engine])[cell.engine])
    except UnsupportedError:
        files = ""
    return CertifiedModel(
        cell.engine, cell.case, cell.overrides, _model_hash(world), _settings(world, cell.engine), files, version
    )


@derived
def _model_hash(world: World) -> str:
    """The hash of a world without its name and the options of engines, which all engines share."""
    return sha256(dataclasses.replace(world, name="", engines=()))


def files_hash(world: World, compiled: Compiled) -> str:
    """The hash of compiled files without the hash of the world in them."""
    mark = sha256(world).encode()
    return Artifacts({path: content.replace(mark, b"") for path, content in compiled.artifacts.items()}).sha256


def _settings(world: World, label: str) -> str:
    name = engine_name(label)
    options = world.options(name)
    settings = dict(sorted(resolve_settings(find_engine(name), world).items()))
    return digest([settings, sorted(options.accept), sorted(options.outside)]).hex()


def changed(kept: Iterable[CertifiedModel], now: Iterable[CertifiedModel]) -> str | None:
    """In words, how models differ from those that were kept; None where they do not."""
    before = {model.place: model for model in kept}
    after = {model.place: model for model in now}
    first = ""
    counts: Counter[str] = Counter()
    for place, entry in after.items():
        old = before.get(place)
        why = "new"
        if old is not None:
            why = next((part for part in PARTS if getattr(entry, part) != getattr(old, part)), "")
        if why:
            counts[why] += 1
            first = first or f"{entry} ({f'{old.version}, now {entry.version}' if old and why == 'version' else why})"
    gone = [model for place, model in before.items() if place not in after]
    if gone:
        counts["no longer requested"] = len(gone)
        first = first or f"{gone[0]} (no longer requested)"
    if not counts:
        return None
    text = ", ".join(f"{part}: {count}" for part, count in counts.items())
    return f"{counts.total()} of {len(before.keys() | after.keys())} models differ ({text}), first {first}"


def plain_model(model: CertifiedModel) -> dict[str, Any]:
    """As data of JSON."""
    return {**dataclasses.asdict(model), "values": [list(entry) for entry in model.values]}


def read_model(plain: Mapping[str, Any]) -> CertifiedModel:
    """The inverse of :func:`plain_model`."""
    return CertifiedModel(**{**plain, "values": tuple((path, value) for path, value in plain["values"])})


KEY_SCHEMA = 1
MEASURED_CONTACT = "L5"
"""The level that says how an engine solves contact at a timestep. All others say that it holds the model."""


def model_key(world: World, prepared: Prepared, versions: Mapping[str, str]) -> str:
    """The hash of the model that an engine is given, different for all models that the proof distinguishes."""
    physics = dataclasses.replace(world.physics, steps=0)
    alike = dataclasses.replace(world, name="", expectations=(), engines=(), record=RecordOptions(), physics=physics)
    name = engine_name(prepared.compiled.engine)
    return sha256(
        {
            "schema": KEY_SCHEMA,
            "simspec": simspec_version(),
            "world": to_plain(alike),
            "engine": prepared.compiled.engine,
            "options": to_plain(world.options(name)),
            "files": files_hash(world, prepared.compiled),
            "versions": dict(sorted(versions.items())),
        }
    )


class Certifier:
    """Verifies models that have no certificate in ``store`` yet. ``verdicts``: by the model's key, why it is not proven;
    None where it is. ``by_contact``: those that are not proven by contact as it was measured (L5), and by nothing else."""

    def __init__(
        self, store: Store, pythons: Mapping[str, str], deadline: float, say: Callable[[str], None], verify: bool = True
    ):
        self._store, self._pythons, self._deadline, self._say = store, pythons, deadline, say
        self._verify = verify
        self.verdicts: dict[str, str | None] = {}
        self.by_contact: set[str] = set()
        self.notes: list[str] = []
        self.made = 0
        self._probes: tuple[str, Probes] | None = None

    def known(self, key: str) -> bool:
        """Whether there is a certificate of a model, valid or not, that can be read."""
        return key in self.verdicts or self._stored(key)

    def demand(self, world: World, prepared: Prepared, versions: Mapping[str, str]) -> str:
        """See to it that the model has a certificate; its key. Whether it is valid stands in ``verdicts``."""
        key = model_key(world, prepared, versions)
        if not self.known(key):
            self._make(key, world, prepared)
        return key

    def _stored(self, key: str) -> bool:
        from simspec.proof.certificate import Certificate

        text = self._store.certificate_text(key)
        if text is None:
            return False
        try:
            certificate = Certificate.from_json(text, f"the certificate {key[:16]}…")
        except SpecError as error:
            self.notes.append(f"{error.problems[0].message}; it is made anew")
            return False
        self._judge(key, certificate)
        return True

    def _make(self, key: str, world: World, prepared: Prepared) -> None:
        from simspec.proof.verify import prepare, verify

        label = prepared.compiled.engine
        self._say(f"verifying {label}")
        name = sha256(world)
        if self._probes is None or self._probes[0] != name:
            self._probes = (name, prepare(world))
        certificate = verify(
            world,
            [label],
            compiled={label: prepared.compiled},
            artifacts={label: prepared.folder},
            pythons=self._pythons,
            deadline=self._deadline,
            probes=self._probes[1],
        )
        self._store.put_certificate(key, certificate.to_json())
        self._judge(key, certificate)
        self.made += 1

    def _judge(self, key: str, certificate: Certificate) -> None:
        self.verdicts[key] = _verdict(certificate)
        failures = certificate.failures()
        if failures and all(check.level == MEASURED_CONTACT for _, check in failures):
            self.by_contact.add(key)


def _verdict(certificate: Certificate) -> str | None:
    """Why a certificate is not valid; None where it is."""
    if certificate.valid:
        return None
    failures = certificate.failures()
    if not failures:
        return "nothing was compared"
    _, check = failures[0]
    more = f"; and {len(failures) - 1} more failed checks" if len(failures) > 1 else ""
    return f"{check.level} {check.name}{more}"
