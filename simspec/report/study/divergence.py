"""How long engines' positions can be compared: their noise, their first gap, and what a gap of that size becomes in one
engine."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from simspec.analysis.horizons import Horizons, horizons
from simspec.comparison.floor import Floor
from simspec.errors import SpecError
from simspec.experiments.first_gap import Overrides, amount_of, floors_of, moved_by_round_off, unmoved
from simspec.report.kit import length, table
from simspec.report.study.done import Done, Record, Shown, finite, milliseconds
from simspec.report.study.worlds import TIMESTEP, Member
from simspec.runner.run import Run


def divergence_tables(done: Done) -> list[Shown]:
    """``divergence``: each two engines at each timestep, from the runs whose initial state is not moved."""
    heads = ("noise at the end", "noise horizon", "first gap", "of", "at", "second horizon", "comparable until")
    made = table(
        f"{done.sweep.name}: How long positions can be compared",
        "timestep",
        "engines",
        *heads,
        right=(0, 2, 3, 4, 6, 7, 8),
    )
    records: list[Record] = []
    notes: dict[str, None] = {}
    noisy = moved_by_round_off(done.outcome)
    for overrides, members in sorted(unmoved(done.outcome).items(), key=lambda item: _timestep(item[1])):
        timestep = _timestep(members)
        values = ", ".join(f"{path}: {value}" for path, value in overrides if path != TIMESTEP)
        name = f"{milliseconds(timestep)}, {values}" if values else milliseconds(timestep)
        runs = {engine: done.store.load(row.key) for engine, (_, row) in members.items()}
        for first, second in itertools.combinations(done.engines, 2):
            record: dict[str, object] = {"timestep": timestep, "values": values, "engines": [first, second]}
            missing = [engine for engine in (first, second) if engine not in runs]
            if missing:
                why = f"no whole run of {', '.join(missing)}"
                made.add_row(name, f"{first}, {second}", why, *[""] * 6)
                records.append({**record, "reason": why})
                continue
            pair = (runs[first], runs[second])
            try:
                floors = floors_of(pair, overrides, noisy, done.store)
                moved = _moved(done, overrides, pair, floors)
                told = horizons(*pair, floors, moved)
            except SpecError as error:
                made.add_row(name, f"{first}, {second}", error.problems[0].message, *[""] * 6)
                records.append({**record, "reason": error.problems[0].message})
                continue
            noise = max((floor.largest for floor in floors), default=None)
            notes.update(dict.fromkeys(f"{name}, {first} and {second}: {note}" for note in told.notes))
            made.add_row(name, f"{first}, {second}", length(noise), *_cells(told, bool(floors)))
            records.append({**record, **_data(told, noise, bool(floors))})
    if not records:
        made.add_row("–", "–", "no two engines to compare", *[""] * 6)
    made.caption = (
        "Noise: of runs moved in the last bits; from its horizon on it hides 1 mm. First gap: more than 1 nm and 3 × noise. "
        "Second horizon: when an engine alone, moved by the size of that gap, is off by 1 mm. –: never"
        + "".join(f"; {note}" for note in notes)
    )
    return [Shown("divergence", made, records)]


def _timestep(members: Mapping[str, Member]) -> float:
    return float(next(row.timestep for _, row in members.values()))


def _moved(done: Done, overrides: Overrides, pair: tuple[Run, Run], floors: Sequence[Floor]) -> list[Floor]:
    """The floors of runs moved by the size of the first gap; none where there were none."""
    amount = amount_of(*pair, floors)
    repeats = [
        (cell, row)
        for second, outcome in done.moved
        if second.amount == amount
        for cell, row in outcome.rows()
        if row is not None and cell.seed is not None
    ]
    return floors_of(pair, overrides, repeats, done.store)


def _cells(told: Horizons, noisy: bool) -> list[str]:
    gap = told.gap
    second = _time(told.second) if told.measured else "not measured"
    return [
        _time(told.noise) if noisy else "not measured",
        "–" if gap is None else length(gap.size),
        "–" if gap is None else gap.body,
        "–" if gap is None else f"{gap.time:.4g} s",
        second,
        _time(told.comparable_until) if told.comparable_until is not None else "the end",
    ]


def _time(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g} s"


def _data(told: Horizons, noise: float | None, noisy: bool) -> dict[str, object]:
    gap = told.gap
    return {
        "noise": finite(noise),
        "noise_measured": noisy,
        "noise_horizon": told.noise,
        "gap": None if gap is None else finite(gap.size),
        "gap_time": None if gap is None else gap.time,
        "gap_body": None if gap is None else gap.body,
        "second_horizon": told.second,
        "second_measured": told.measured,
        "comparable_until": told.comparable_until,
        "notes": list(told.notes),
    }
