"""Where the engines of a study's sweep differ from its first one: ``simspec explain`` of their runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from simspec.attribution.sides import explain
from simspec.errors import SimspecError
from simspec.experiments.store import Store
from simspec.experiments.sweep import Outcome
from simspec.report.study.done import Explained

WINDOWS: Final = 30
"""Windows that are looked at, of each engine."""


def explained(
    outcome: Outcome,
    store: Store,
    pythons: Mapping[str, str],
    deadline: float,
    progress: Callable[..., None],
) -> list[Explained]:
    """Of each engine but the first of the plan, where it differs from that: asked of the runs of the scenario itself at the
    smallest timestep. What is not supported, or failed, is told as such."""
    keys: dict[str, tuple[float, str]] = {}
    for cell, row in outcome.rows():
        if row is None or cell.case is not None or row.failed is not None or cell.perturb:
            continue
        if cell.engine not in keys or row.timestep < keys[cell.engine][0]:
            keys[cell.engine] = (row.timestep, row.key)
    first, *others = outcome.plan.engines
    found: list[Explained] = []
    for engine in others:
        missing = next((name for name in (first, engine) if name not in keys), None)
        if missing is not None:
            found.append(Explained(engine, first, None, f"{missing} has no whole run"))
            continue
        if keys[first][0] != keys[engine][0]:
            found.append(Explained(engine, first, None, f"{first} has no run at {keys[engine][0]:g} s"))
            continue
        progress(f"asking where {engine} differs from {first}")
        runs = [store.load(keys[name][1]) for name in (first, engine)]
        try:
            told = explain(
                *runs, windows=WINDOWS, names=(first, engine), pythons=pythons, deadline=deadline, progress=progress
            )
        except SimspecError as error:
            found.append(Explained(engine, first, None, str(error).splitlines()[0]))
        else:
            found.append(Explained(engine, first, told))
    return found
