"""What a run of a sweep comes to, ready to be stored: facts that are the same in every repetition, apart from those that are
not, and its tables, written when there is a place for them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

from simspec.comparison.runs import summary
from simspec.runner.case import shared_world
from simspec.runner.expectations import evaluate
from simspec.runner.labels import labels_of
from simspec.runner.run import Run
from simspec.runner.tables import table_writers
from simspec.world.canonical import sha256, to_plain
from simspec.world.types import World

CIRCUMSTANCES = ("started", "seconds", "usage", "timed", "warnings", "python_version", "platform", "machine")
"""Parts of a run's provenance that are not the same when it is repeated (warnings: an engine's own output)."""
CIRCUMSTANCE_TABLES = ("seconds",)
"""Tables that are not the same when a run is repeated."""
ASKED = ("spec", "world_sha256", "artifacts_sha256")
"""Parts that are of the sweep that asked first: another one may ask for the same run."""
LEFT_OUT = ("schema", "case", "engine")
"""Parts that are stored elsewhere: the key of the case is the run's name."""
LAST_OUTPUT = "; its last output:"
"""From here on, the error of an engine's process quotes the engine's own output."""

Write = Callable[[BinaryIO], int]
"""Writes a table into an open file, and gives its number of rows."""


@dataclass(frozen=True)
class TaskResult:
    """One run to be stored under ``key``. ``result``: what a repetition gives to the bit; ``asked``: what the sweep asked with;
    ``circumstances``: when, how long, on what machine; ``tables``: what writes each, by name."""

    key: str
    result: Mapping[str, Any]
    asked: Mapping[str, Any]
    circumstances: Mapping[str, Any]
    tables: Mapping[str, Write]


def whole_world(shared: World, asked: Mapping[str, Any]) -> World:
    """The world that was run: the shared one, with what was left out of it."""
    from simspec.world.canonical import from_plain

    plain = {**to_plain(shared), **{name: asked[name] for name in ("name", "expectations", "engines")}}
    world: World = from_plain(World, plain)
    return world


def result_of(
    run: Run, key: str, *, repeat: int = 0, cell: Mapping[str, Any] | None = None, more: Mapping[str, Any] | None = None
) -> TaskResult:
    """What is stored of ``run`` under ``key``, the repetition ``repeat`` of its case; ``cell``: who asked for it (its key, and
    what it changes in the spec); ``more``: further circumstances."""
    told = {**run.provenance, "repeat": repeat}
    circumstances = {name: told.pop(name) for name in CIRCUMSTANCES if name in told} | dict(more or {})
    asked = {name: told.pop(name) for name in ASKED if name in told}
    for name in LEFT_OUT:
        told.pop(name, None)
    failed = run.failed
    if failed is not None and (LAST_OUTPUT in failed or "\n" in failed):
        circumstances["error"] = failed
        failed = failed.partition(LAST_OUTPUT)[0].splitlines()[0]
    world = run.world
    return TaskResult(
        key,
        {
            "world": sha256(shared_world(world)),
            "engine": run.engine,
            "failed": failed,
            "provenance": told,
            "summary": {name: _number(value) for name, value in summary(run).items()},
        },
        {
            "cell": dict(cell) if cell is not None else None,
            "name": world.name,
            "world_sha256": asked.get("world_sha256", sha256(world)),
            "expectations": to_plain(world.expectations),
            "outcomes": [_outcome(one) for one in evaluate(run)],
            "engines": to_plain(world.engines),
            "spec": asked.get("spec", {}),
            "artifacts_sha256": asked.get("artifacts_sha256"),
        },
        circumstances,
        table_writers(world, run.columns, labels_of(run.provenance)) if run.recorded else {},
    )


def _outcome(outcome: Any) -> dict[str, Any]:
    plain: dict[str, Any] = dataclasses.asdict(outcome)
    return {name: _number(value) if isinstance(value, float) else value for name, value in plain.items()}


def _number(value: float) -> float | str:
    """For JSON, which has no infinity: ``float`` reads the word back."""
    return value if math.isfinite(value) else repr(value)
