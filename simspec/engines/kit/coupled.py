"""How engines declare contact of several bodies: deviations by probe, timestep and ratio of masses, from a measured table.

The table ``coupled.csv`` of an engine is written by ``tools/coupled.py --declare``; the engine's ``coupled.py`` gives reasons.
"""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from simspec.contact.reachability import HEAVY_ON_LIGHT
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import written_settings
from simspec.support.declarations import Level, Refinement, Support, approximate
from simspec.world.meeting import meeting_laws
from simspec.world.reach import Reach, largest_ratio, reach
from simspec.world.types import PairContact, World

MARGIN = 1.15
"""Declared over measured: figures at frictions between the measured ones differ by some percent."""
ABOVE = 1.05
"""A row counts from this multiple of the timestep measured before it: at timesteps between, the larger size is declared."""
LENGTHS = frozenset(
    {
        "rod",
        "clamp",
        "jam",
        "jam-light",
        "squeeze",
        "squeeze-turns",
        "pile",
        "stack",
        "stack-sideways",
        "stack-stays",
        "stack-stays-plane",
        "cross",
        "cross-sideways",
        "carrier",
    }
)
"""Probes whose deviations are lengths (m); those of the others are shares of the expected value."""
KEYS = ("setting", "cone", "probe", "restitution", "ratio")
"""Columns that say where a row of the table counts; the others are timesteps (ms) with the largest measured deviation, empty
within the probe's tolerance. An empty key: everywhere. ``restitution``: ``0`` from none on, ``>0`` with any."""
RATIOS = {"": 0.0, "1": 0.0, "10": 1.001, "100": 10.01, "1000": 100.1}
SLIDING_RATIOS = {**RATIOS, "4": 1.001, "10": 4.004}
"""Ratio of masses from which a row counts, by the measured ratio, which is the largest it counts for; beyond 1000 the last row
counts, and level L5 decides. Stacks that slide are measured at a ratio of 4, too."""
SLIDING = ("stack-slides", "stack-stays", "stack-slides-plane", "stack-stays-plane")
"""Probes of stacks that slide: their rows say nothing of worlds in which no body that moves has faces, or of those without a
plane."""
SOME = 0.01
"""Restitution from which rows of ``>0`` count."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why probes deviate: ``probes`` are patterns of their names, separated by spaces, for a setting (``name=value``) and a
    friction cone alone where these are given."""

    probes: str
    why: str
    setting: str = ""
    cone: str = ""

    def covers(self, row: Mapping[str, str]) -> bool:
        return (
            any(fnmatchcase(row["probe"], pattern) for pattern in self.probes.split())
            and self.setting in ("", row["setting"])
            and self.cone in ("", row["cone"])
        )


def measured(table: Path, reasons: Sequence[Reason]) -> tuple[Deviation, ...]:
    """The deviations of a table, each with the first reason that covers it. Raises ValueError for a row without a reason, and
    for a reason without a row."""
    used: set[Reason] = set()
    found: list[Deviation] = []
    with table.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            reason = next((reason for reason in reasons if reason.covers(row)), None)
            if reason is None:
                raise ValueError(f"{table}: no reason is given for {' '.join(row[key] for key in KEYS)}")
            used.add(reason)
            found += _deviations(row, reason.why)
    for reason in reasons:
        if reason not in used:
            raise ValueError(f"{table}: no row is of the reason for {reason.probes} {reason.setting} {reason.cone}")
    return tuple(found)


def _deviations(row: Mapping[str, str], why: str) -> Iterator[Deviation]:
    timesteps = [name for name in row if name not in KEYS]
    largest = 0.0
    for before, timestep in itertools.pairwise(["0", *timesteps]):
        size = MARGIN * float(row[timestep] or 0.0)
        if size > largest:
            largest = size
            yield Deviation(
                row["probe"],
                float(f"{size:.3g}"),
                why,
                relative=row["probe"] not in LENGTHS,
                timestep=1e-3 * ABOVE * float(before),
                restitution=SOME if row["restitution"] == ">0" else 0.0,
                friction_cone=row["cone"],
                setting=setting_of(row["setting"]),
                ratio=(SLIDING_RATIOS if row["probe"] in SLIDING else RATIOS)[row["ratio"]],
            )


def setting_of(text: str) -> tuple[str, str] | None:
    """The setting of a row, as ``name=value``; None where it counts for all."""
    name, _, value = text.partition("=")
    return (name, value) if value else None


def in_force(engine: str) -> Callable[[World], Mapping[str, Any]]:
    """The settings that are in force in a world: those that its spec gives the engine, and the engine's own."""

    def settings(world: World) -> Mapping[str, Any]:
        return written_settings(find_engine(engine), world)

    return settings


def _happens(row: Deviation, law: PairContact, there: Reach) -> bool:
    """Whether two materials can do what a row is of; stacks at rest below ``HEAVY_ON_LIGHT`` are near enough to the law."""
    if row.probe not in SLIDING:
        return not row.probe.startswith("stack") or there.ratio >= HEAVY_ON_LIGHT
    return (
        law.friction > 0.0 and there.ratio > 0.0 and there.corners and (there.plane or not row.probe.endswith("-plane"))
    )


def leans(world: World) -> bool:
    """Whether friction can change a normal force in ``world``: a body with friction may lean, clamp or be piled."""
    return any(law.friction and reach(world, *pair).leans for pair, law in meeting_laws(world).items())


def heavy_on_light(
    rows: Sequence[Deviation], settings: Callable[[World], Mapping[str, Any]], how: str, short: str
) -> Support:
    """Exact where no declared deviation of a stack, at rest or sliding, counts under a world's settings, otherwise to be
    accepted by name."""
    return _where_rows_count([row for row in rows if row.probe.startswith("stack")], settings, how, short)


def self_locking(
    rows: Sequence[Deviation], settings: Callable[[World], Mapping[str, Any]], how: str, short: str
) -> Support:
    """Exact where no declared deviation of a clamp that jams counts under a world's settings, otherwise to be accepted by
    name."""
    return _where_rows_count([row for row in rows if row.probe.startswith("jam")], settings, how, short)


def even_pressure(
    rows: Sequence[Deviation], settings: Callable[[World], Mapping[str, Any]], how: str, short: str
) -> Support:
    """Exact where no declared deviation of what fingers press counts under a world's settings, otherwise to be accepted by
    name."""
    return _where_rows_count([row for row in rows if row.probe.startswith("squeeze")], settings, how, short)


def _where_rows_count(
    rows: Sequence[Deviation], settings: Callable[[World], Mapping[str, Any]], how: str, short: str
) -> Support:
    def exact(world: World) -> Refinement | None:
        ratio, timestep, cone = largest_ratio(world), world.physics.timestep, world.contact.friction_cone
        counting = any(
            row.counts_for(law, cone, timestep, settings(world), ratio) and _happens(row, law, reach(world, *pair))
            for pair, law in meeting_laws(world).items()
            for row in rows
        )
        return None if counting else Refinement(Level.EXACT, "")

    return approximate(how, exact, short)
