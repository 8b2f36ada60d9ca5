"""Known deviations of an engine from the contact law, each measured.

Those of several bodies stand in the table ``contact_deviations.csv`` of an engine, which ``tools/deviations.py`` writes; the
engine's module ``coupled.py`` gives reasons.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Any

from simspec.support.declarations import is_before
from simspec.world.types import PairContact


@dataclass(frozen=True, slots=True)
class Deviation:
    """A known deviation of an engine from the contact law, in one contact probe (see ``proof/contact/``).

    ``size`` is the largest measured one, ``why`` what it comes from. ``relative``: size is a share of the expected value,
    else it is in the figure's unit. It counts for pairs with at least this ``friction`` and ``restitution``, from this
    ``timestep`` (s) on, and under this ``friction_cone``, kind of ``hardness`` and ``setting`` (name, value) of the engine
    alone, where these are given, in worlds where bodies of at least this ``ratio`` of masses may touch, and in releases before
    ``until`` ("": in all), where the release is known; and below the values of ``below``: friction, restitution, timestep,
    ratio.
    """

    probe: str
    size: float
    why: str
    relative: bool = True
    friction: float = 0.0
    timestep: float = 0.0
    restitution: float = 0.0
    friction_cone: str = ""
    hardness: str = ""
    setting: tuple[str, Any] | None = None
    ratio: float = 0.0
    until: str = ""
    below: tuple[float, float, float, float] = (inf, inf, inf, inf)

    @property
    def is_local(self) -> bool:
        """Whether it counts around single values alone."""
        return min(self.below) < inf

    def counts_for(
        self,
        pair: PairContact,
        friction_cone: str,
        timestep: float,
        settings: Mapping[str, Any] = MappingProxyType({}),
        ratio: float = 0.0,
        version: str | None = None,
    ) -> bool:
        """Whether it is one of this pair's, under this cone, timestep, and these settings of the engine, in this release of
        it (None: not known)."""
        return (
            (not self.until or (version is not None and is_before(version, self.until)))
            and (self.setting is None or settings.get(self.setting[0]) == self.setting[1])
            and pair.friction >= self.friction
            and pair.restitution >= self.restitution
            and timestep >= self.timestep
            and ratio >= self.ratio
            and self.friction_cone in ("", friction_cone)
            and self.hardness in ("", pair.hardness.kind)
            and pair.friction < self.below[0]
            and pair.restitution < self.below[1]
            and timestep < self.below[2]
            and ratio < self.below[3]
        )


LIMITS = ("friction", "restitution", "timestep", "ratio")
COLUMNS = (
    "setting",
    "cone",
    "probe",
    *(f"{name}{end}" for name in LIMITS for end in ("", "_below")),
    "size",
    "relative",
)
"""Columns of a table. A row counts from ``friction``, ``restitution``, ``timestep`` (ms) and ``ratio`` on and below the limits
``_below``; an empty cell is no limit. ``setting``: ``name=value``. ``size``: a share of the expected value where ``relative``
is ``yes``, else in the figure's unit; it includes a margin."""
BETWEEN_VALUES = "simspec measured this deviation between the values of the engine's other tables"
"""Reason of a local deviation that no reason of the engine covers."""

# Reasons that several engines have in common.

UNKNOWN = "simspec measured this deviation, and its cause is not known"
SWEEPS = (
    "the solver sweeps over its constraints one after another, and leaves overlaps and wrong friction where heavy bodies rest "
    "on light ones"
)
JAMMED = "the solver ends before friction has built up the normal force of a jammed clamp"
DEEP = (
    "the engine removes a share of an overlap in each step: heavy bodies rest deeper, with the square of the timestep"
)
NEAR_LIMIT = (
    "bodies that slide on or under a lighter one require friction within 0.1 % of its limit at a mass ratio of 1000"
)
PREDICTED = (
    "the engine applies restitution to the speed at the end of the step, with gravity: the ratio is e (1 + g dt / v)"
)
THRESHOLD = "the engine's restitution threshold is fixed: bodies with e v < 0.1 m/s do not bounce"
HOPS = "the engine lets bodies with restitution hop without end where g dt alone exceeds its least bounce"
PYRAMID = "the circumscribed pyramid replaces the elliptic cone, as accepted"


def coarse(motion: str) -> str:
    """That the timestep is too long for bodies that do something."""
    return f"timesteps of several ms are coarse for bodies that {motion}"


def unconverged(solver: str) -> str:
    return f"{solver} ends before friction and normal forces have converged"


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


def read_deviations(table: Path, reasons: Sequence[Reason]) -> tuple[Deviation, ...]:
    """The deviations of a table, each with the first reason that covers it. Raises ValueError for a row without upper limits
    that no reason covers, and for a reason without such a row."""
    unused, found = list(reasons), list[Deviation]()
    with table.open(newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            low = {name: float(row[name] or 0.0) for name in LIMITS}
            below = {name: float(row[f"{name}_below"] or inf) for name in LIMITS}
            reason = next((reason for reason in reasons if reason.covers(row)), None)
            if min(below.values()) == inf:
                if reason is None:
                    raise ValueError(f"{table}: no reason is given for {row['probe']} {row['setting']} {row['cone']}")
                if reason in unused:
                    unused.remove(reason)
            found.append(
                Deviation(
                    row["probe"],
                    float(row["size"]),
                    reason.why if reason else BETWEEN_VALUES,
                    relative=row["relative"] == "yes",
                    friction=low["friction"],
                    timestep=low["timestep"] / 1e3,
                    restitution=low["restitution"],
                    friction_cone=row["cone"],
                    setting=_setting(row["setting"]),
                    ratio=low["ratio"],
                    below=(below["friction"], below["restitution"], below["timestep"] / 1e3, below["ratio"]),
                )
            )
    for reason in unused:
        raise ValueError(f"{table}: no row is of the reason for {reason.probes} {reason.setting} {reason.cone}")
    return tuple(found)


def named_reasons(table: Path, reasons: Mapping[str, str]) -> tuple[Deviation, ...]:
    """The deviations of a table whose column ``why`` names one of ``reasons``, with the columns ``hardness`` and ``until`` and
    without upper limits. Raises KeyError for another reason, and ValueError for one without a row."""
    with table.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    if unused := reasons.keys() - {row["why"] for row in rows}:
        raise ValueError(f"{table}: no row is of the reasons {', '.join(sorted(unused))}")
    return tuple(
        Deviation(
            row["probe"],
            float(row["size"]),
            reasons[row["why"]],
            row["relative"] == "yes",
            float(row["friction"] or 0.0),
            float(row["timestep"] or 0.0) / 1e3,
            float(row["restitution"] or 0.0),
            row["cone"],
            row["hardness"],
            _setting(row["setting"]),
            until=row["until"],
        )
        for row in rows
    )


def _setting(cell: str) -> tuple[str, str] | None:
    name, _, value = cell.partition("=")
    return (name, value) if value else None
