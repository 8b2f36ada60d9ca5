"""Engines held against themselves at other timesteps (after Erez, Tassa and Todorov 2015)."""

from __future__ import annotations

import itertools

import numpy as np

from simspec.analysis.consistency import Consistency, consistency, convergence
from simspec.errors import SpecError
from simspec.report.kit import length, table
from simspec.report.study.done import Done, Record, Shown, finite, milliseconds
from simspec.report.study.worlds import Runs, run_of, worlds_of
from simspec.runner.run import Run

SHARES = (0.1, 0.5, 1.0)
"""Of the time that both timesteps recorded: when the deviation is told."""


def consistency_tables(done: Done) -> list[Shown]:
    """``consistency``: each timestep against the next smaller one, of the runs whose initial state is not moved."""
    heads = ("timesteps", "time", "RMS", "largest", "½ g t Δdt", "order")
    made = table(
        f"{done.sweep.name}: Each engine against itself at the next smaller timestep",
        "engine",
        *heads,
        right=range(2, 7),
    )
    records: list[Record] = []
    by_values: dict[str, list[Runs]] = {}
    for world in worlds_of(done):
        by_values.setdefault(world.values, []).append(world)
    for values, worlds in by_values.items():
        for engine in done.engines:
            loaded = {world.timestep: run for world in worlds if (run := _whole(done, world, engine)) is not None}
            steps = sorted(loaded, reverse=True)
            if len(steps) < 2:
                made.add_row(engine, values or "–", "fewer than two timesteps with a whole run", *[""] * 4)
                records.append({"engine": engine, "values": values, "reason": "fewer than two timesteps"})
            for coarse, fine in itertools.pairwise(steps):
                named = f"{milliseconds(coarse)}, {milliseconds(fine)}" + (f", {values}" if values else "")
                record = {"engine": engine, "values": values, "coarse": coarse, "fine": fine}
                try:
                    told = consistency(loaded[coarse], loaded[fine])
                except SpecError as error:
                    made.add_row(engine, named, error.problems[0].message, *[""] * 4)
                    records.append({**record, "reason": error.problems[0].message})
                    continue
                orders = _orders(loaded, steps, coarse, fine)
                for row in dict.fromkeys(told.row(share * float(told.time[-1])) for share in SHARES):
                    order = _at(orders, float(told.time[row]))
                    made.add_row(engine, named, f"{told.time[row]:.4g} s", *_lengths(told, row), _order(order))
                    records.append(
                        {**record, "time": float(told.time[row]), "rms": finite(float(told.rms[row]))}
                        | {"largest": finite(float(told.largest[row])), "drift": finite(float(told.drift[row]))}
                        | {"order": finite(order)}
                    )
    made.caption = (
        "Deviation of the moving bodies' positions. ½ g t Δdt: by how much two first-order motions in free fall differ. "
        "Order: of convergence, with the next smaller timestep of the same ratio; – without one, or without deviation"
    )
    return [Shown("consistency", made, records)]


def _whole(done: Done, world: Runs, engine: str) -> Run | None:
    member = world.unmoved(engine)
    return None if member is None or member[1].failed is not None else run_of(done, member[1])


def _orders(
    loaded: dict[float, Run], steps: list[float], coarse: float, fine: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Times and observed orders of a timestep, the next smaller, and the one of the same ratio after it; None without one."""
    finest = next((step for step in steps if abs(step * coarse - fine**2) <= 1e-9 * fine**2), None)
    if finest is None:
        return None
    try:
        told = convergence([loaded[coarse], loaded[fine], loaded[finest]])
    except SpecError:  # no time that all three recorded: there is no order to tell
        return None
    return told.time, told.order


def _at(orders: tuple[np.ndarray, np.ndarray] | None, time: float) -> float | None:
    if orders is None or not len(orders[0]):
        return None
    row = int(np.abs(orders[0] - time).argmin())
    near = abs(float(orders[0][row]) - time) <= 1e-6 * max(1.0, time)
    return finite(float(orders[1][row])) if near else None


def _lengths(told: Consistency, row: int) -> list[str]:
    return [length(float(values[row])) for values in (told.rms, told.largest, told.drift)]


def _order(order: float | None) -> str:
    return "–" if order is None else f"{order:.2g}"
