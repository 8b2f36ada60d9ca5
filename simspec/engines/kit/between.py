"""Known deviations from the contact law at values between and beyond those of an engine's other tables.

The table ``between.csv`` of an engine is written by ``tools/between.py``. Each row counts around the points that it was
measured at alone: up to the next measured values of friction, restitution, timestep and ratio of masses on both sides.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from simspec.engines.kit.coupled import Reason, measured, setting_of
from simspec.engines.kit.deviations import Deviation

LIMITS = ("friction", "restitution", "timestep", "ratio")
KEYS = ("setting", "cone", "probe", *(f"{name}{end}" for name in LIMITS for end in ("", "_below")), "size", "relative")
"""Columns: from what value on a row counts, and below what; timesteps in ms. ``size``: a share of the expected value where
``relative`` is ``yes``, else in the figure's unit."""
MARGIN = 1.25
"""Declared over measured: the median of what the tables miss between their points, which is what these miss between theirs."""


ELSEWHERE = "measured between the values of the engine's other tables"
"""The reason of a row that no reason of the engine covers."""


def tables(folder: Path, reasons: Sequence[Reason]) -> tuple[Deviation, ...]:
    """The deviations of an engine's ``coupled.csv`` and ``between.csv``, each with the first reason that covers it."""
    return (*measured(folder / "coupled.csv", reasons), *between(folder / "between.csv", reasons))


def between(table: Path, reasons: Sequence[Reason]) -> tuple[Deviation, ...]:
    """The deviations of one table."""
    found = []
    with table.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            why = next((reason.why for reason in reasons if reason.covers(row)), ELSEWHERE)
            below = {name: float(row[f"{name}_below"]) for name in LIMITS}
            found.append(
                Deviation(
                    row["probe"],
                    float(f"{MARGIN * float(row['size']):.3g}"),
                    why,
                    relative=row["relative"] == "yes",
                    friction=float(row["friction"]),
                    timestep=1e-3 * float(row["timestep"]),
                    restitution=float(row["restitution"]),
                    friction_cone=row["cone"],
                    setting=setting_of(row["setting"]),
                    ratio=float(row["ratio"]),
                    below=(below["friction"], below["restitution"], 1e-3 * below["timestep"], below["ratio"]),
                )
            )
    return tuple(found)
