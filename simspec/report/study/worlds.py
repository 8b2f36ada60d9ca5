"""The runs of a sweep by world: what engines, perturbations and repetitions of one world are compared by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.report.study.done import Done, milliseconds
from simspec.runner.run import Run

TIMESTEP = "physics.timestep"
Member = tuple[Cell, Row]


@dataclass
class Runs:
    """The runs of one world of a sweep: ``of[engine]`` in the order of the plan, failed ones too, repetitions left out."""

    timestep: float
    values: str
    of: dict[str, list[Member]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The timestep, and the other values of the sweep."""
        return f"{milliseconds(self.timestep)}, {self.values}" if self.values else milliseconds(self.timestep)

    def unmoved(self, engine: str) -> Member | None:
        """The run of an engine whose initial state is not moved; None where there is none."""
        return next((member for member in self.of.get(engine, ()) if member[0].seed is None), None)

    def moved(self, engine: str) -> Mapping[int, Row]:
        """The whole runs of an engine by seed; the one that is not moved has seed 0."""
        return {cell.seed or 0: row for cell, row in self.of.get(engine, ()) if row.failed is None}


def worlds_of(done: Done) -> list[Runs]:
    """The worlds of a sweep without its named cases, by timestep."""
    worlds: dict[tuple[float, str, int | None], Runs] = {}
    for cell, row in done.runs():
        if cell.repeat == 0:
            values = ", ".join(f"{path}: {value}" for path, value in cell.overrides if path != TIMESTEP)
            if cell.sample is not None:
                values = f"sample {cell.sample}"
            own = worlds.setdefault((row.timestep, values, cell.sample), Runs(row.timestep, values))
            own.of.setdefault(cell.engine, []).append((cell, row))
    return [worlds[key] for key in sorted(worlds, key=lambda key: key[:2])]


def run_of(done: Done, row: Row) -> Run:
    """A stored run with its arrays."""
    return done.store.load(row.key)
