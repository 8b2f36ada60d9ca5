"""What a sweep is of: the models that its plan asks for as they are compiled today, each by hashes. No engine is started.

Figures that are kept are of models that were compiled earlier. Where these hashes differ from those that were kept with the
figures, the figures are older than the code.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simspec.compiler import Compiled, compile_world
from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.errors import SpecError, UnsupportedError
from simspec.experiments.asked import digest
from simspec.experiments.cases import case_of
from simspec.experiments.plan import Cell, Plan
from simspec.outputs.writing import Artifacts
from simspec.world.canonical import sha256
from simspec.world.types import World

PARTS = ("world", "settings", "files", "version")
"""What of a model is told apart, the first cause first: files follow from the world and the settings."""


@dataclass(frozen=True)
class Model:
    """A model that an engine is given.

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
        return digest([self.engine, self.case, [list(one) for one in self.values]]).hex()

    def __str__(self) -> str:
        values = [f"{path}={value}" for path, value in self.values if self.case is None]
        return ", ".join([self.engine, *([self.case] if self.case else []), *values])


def models_of(plan: Plan) -> Iterator[Model]:
    """Every model of a plan once. What makes the scenario invalid has empty hashes."""
    known: set[str] = set()
    for cell in plan:
        place = Model(cell.engine, cell.case, cell.overrides, "", "", "", "").place
        if place not in known:
            known.add(place)
            yield model_of(plan, cell)


def model_of(plan: Plan, cell: Cell) -> Model:
    """The model of a cell, as it is compiled today."""
    version = plan.versions[cell.engine]["engine_version"]
    try:
        world = case_of(plan, cell).resolved
    except SpecError:
        return Model(cell.engine, cell.case, cell.overrides, "", "", "", version)
    try:
        files = files_hash(world, compile_world(world, [cell.engine])[cell.engine])
    except UnsupportedError:
        files = ""
    return Model(cell.engine, cell.case, cell.overrides, _world(world), _settings(world, cell.engine), files, version)


def files_hash(world: World, compiled: Compiled) -> str:
    """The hash of compiled files without the hash of the world in them."""
    mark = sha256(world).encode()
    return Artifacts({path: content.replace(mark, b"") for path, content in compiled.artifacts.items()}).sha256


def _world(world: World) -> str:
    return sha256(dataclasses.replace(world, name="", engines=()))


def _settings(world: World, label: str) -> str:
    name = engine_name(label)
    options = world.options(name)
    settings = dict(sorted(resolve_settings(find_engine(name), world).items()))
    return digest([settings, sorted(options.accept), sorted(options.outside)]).hex()


def asked_hash(spec_sweep: Any, words: Sequence[Any]) -> str:
    """The hash of what a study asks for in a sweep: repetitions and seeds are of no model."""
    return digest([spec_sweep, list(words)]).hex()


def changed(kept: Iterable[Model], now: Iterable[Model]) -> str | None:
    """In words, how models differ from those that were kept; None where they do not."""
    before = {one.place: one for one in kept}
    after = {one.place: one for one in now}
    first = ""
    counts: Counter[str] = Counter()
    for place, one in after.items():
        old = before.get(place)
        if old is None:
            why = "new"
        else:
            why = next((part for part in PARTS if getattr(one, part) != getattr(old, part)), "")
        if why:
            counts[why] += 1
            first = first or f"{one} ({f'{old.version}, now {one.version}' if old and why == 'version' else why})"
    gone = [one for place, one in before.items() if place not in after]
    if gone:
        counts["no longer asked for"] = len(gone)
        first = first or f"{gone[0]} (no longer asked for)"
    if not counts:
        return None
    told = ", ".join(f"{part}: {count}" for part, count in counts.items())
    return f"{counts.total()} of {len(before.keys() | after.keys())} models differ ({told}), first {first}"


def plain_model(model: Model) -> dict[str, Any]:
    """As data of JSON."""
    return {**dataclasses.asdict(model), "values": [list(one) for one in model.values]}


def read_model(plain: Mapping[str, Any]) -> Model:
    """The inverse of :func:`plain_model`."""
    return Model(**{**plain, "values": tuple((path, value) for path, value in plain["values"])})
