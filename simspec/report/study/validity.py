"""Up to which timestep all that is expected holds."""

from __future__ import annotations

import dataclasses

from rich.text import Text

from simspec.analysis.validity import limit, trial
from simspec.experiments.cases import world_of
from simspec.report.kit import table
from simspec.report.study.done import Done, Record, Shown, elsewhere, figure_records, milliseconds
from simspec.runner.expectations import evaluate


def validity_tables(done: Done) -> list[Shown]:
    """``validity``."""
    made = table(f"{done.sweep.name}: Up to which timestep all that is expected holds", "engine", "limit", "runs")
    records: list[Record] = []
    for engine in done.engines:
        trials = []
        for cell, row in done.runs():
            if cell.engine == engine and cell.repeat == 0:
                run = done.store.load(row.key, tables=row.failed is None)
                # what is expected is of the study, and may be other than when the run was made
                run = dataclasses.replace(run, world=world_of(done.outcome.plan, cell))
                trials.append(trial(run, evaluate(run)))
        if not trials:
            made.add_row(engine, "no runs", "0")
            continue
        whole = limit(trials)
        made.add_row(engine, str(whole), str(len(trials)))
        records.append(
            {"engine": engine, "limit": whole.timestep, "first_invalid": whole.first_invalid, "runs": len(trials)}
            | {"failure": whole.first_failure, "later_valid": list(whole.later_valid)}
            | {"fewer_seeds": list(whole.fewer_seeds)}
        )
        records += [
            {"engine": engine, "timestep": timestep, "share": share.value, "runs": share.trials}
            | {"lower": share.lower, "upper": share.upper}
            for timestep, share in whole.shares.items()
        ]
    for figure in done.figures:
        if figure.quantity == "largest_valid_timestep":
            made.add_row(elsewhere(figure), Text(f"{milliseconds(figure.values[0])}: {figure.source}"), "–")
    known = figure_records(figure for figure in done.figures if figure.quantity == "largest_valid_timestep")
    return [Shown("validity", made, records + known)]
