"""Up to which timestep all that is expected holds."""

from __future__ import annotations

import dataclasses

from rich.text import Text

from simspec.analysis.validity import limit, trial
from simspec.experiments.cases import world_of
from simspec.report.kit import table
from simspec.report.study.done import Done, Shown, elsewhere, milliseconds
from simspec.runner.expectations import evaluate


def validity_tables(done: Done) -> list[Shown]:
    """``validity``."""
    made = table(f"{done.sweep.name}: Up to which timestep all that is expected holds", "engine", "limit", "runs")
    for engine in done.engines:
        trials = []
        for cell, row in done.runs():
            if cell.engine == engine and cell.repeat == 0:
                run = done.store.load(row.key, tables=row.failed is None)
                # what is expected is of the study, and may be other than when the run was made
                run = dataclasses.replace(run, world=world_of(done.outcome.plan, cell))
                trials.append(trial(run, evaluate(run)))
        made.add_row(engine, str(limit(trials)) if trials else "no runs", str(len(trials)))
    for figure in done.figures:
        if figure.quantity == "largest_valid_timestep":
            made.add_row(elsewhere(figure), Text(f"{milliseconds(figure.values[0])}: {figure.source}"), "–")
    return [Shown("validity", made)]
