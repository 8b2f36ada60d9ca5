"""A study compared with a baseline.

Physics is compared on any machine, by the engines' own noise: a figure has changed where its interval and the baseline's have
nothing in common. Speed is compared on the same machine only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from simspec.errors import Problem, SpecError
from simspec.report.baseline import HIDDEN, Baseline, Figure, Kind

SLOWER = 0.1
"""Share by which an engine's fastest process must be slower than the baseline's slowest. Measured on two cores that were busy
with other work, six times five processes of two engines: by processor time, medians differ by up to 16 % and the range of five
reaches 15 %, and none of 60 comparisons of one set with another is a regression; by wall time, medians differ by up to 76 %,
which is why that is compared on a quiet machine only."""


class Change(StrEnum):
    """What became of a figure."""

    SAME = "same"
    CHANGED = "changed"
    MISSING = "missing"
    NOT_COMPARED = "not compared"
    BETTER = "better"
    NEW = "new"


@dataclass(frozen=True, slots=True)
class Row:
    """One figure, before and now (None: not there), what became of it, and why in words."""

    key: str
    change: Change
    before: Figure | None
    now: Figure | None
    why: str = ""


@dataclass(frozen=True)
class Comparison:
    """A study compared with a baseline; ``notes``: what must be known to read it."""

    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    @property
    def regressions(self) -> list[Row]:
        """What changed for the worse, or is not there any more. Physics that changed is a regression whatever its direction."""
        return [row for row in self.rows if row.change in (Change.CHANGED, Change.MISSING)]

    def count(self, change: Change) -> int:
        """How many figures this became of."""
        return sum(row.change is change for row in self.rows)

    @property
    def compared(self) -> int:
        """Figures that were compared."""
        return sum(row.change in (Change.SAME, Change.CHANGED, Change.BETTER) for row in self.rows)


def compare(before: Baseline, now: Baseline) -> Comparison:
    """Every figure of either, compared by its key. Engines that were not run now are not compared, and named.

    Raises SpecError when the baseline is of another spec.
    """
    if before.spec != now.spec:
        problem = Problem("the baseline is of another spec", found=before.spec, allowed=now.spec)
        raise SpecError([problem])
    notes = [
        f"{engine}: version {before.versions[engine]} in the baseline, now {number}"
        for engine, number in now.versions.items()
        if before.versions.get(engine, number) != number
    ]
    if before.world_sha256 != now.world_sha256:
        notes.append("the spec, or a value set with --set, is not that of the baseline")
    apart = before.machine.differences(now.machine)
    rows = []
    for key, old in before.figures.items():
        engine = key.split("/", 1)[0]
        if engine not in now.versions:
            rows.append(Row(key, Change.NOT_COMPARED, old, None, f"{engine} was not run"))
        else:
            rows.append(_row(key, old, now.figures.get(key), apart))
    rows += [Row(key, Change.NEW, None, one) for key, one in now.figures.items() if key not in before.figures]
    return Comparison(tuple(rows), tuple(notes))


def _row(key: str, old: Figure, new: Figure | None, apart: Sequence[str]) -> Row:
    if new is None:
        if old.kind is Kind.SPEED:
            return Row(key, Change.NOT_COMPARED, old, None, "speed was not measured")
        return Row(key, Change.MISSING, old, None, "not in this run")
    if why := old.not_compared or new.not_compared:
        return Row(key, Change.NOT_COMPARED, old, new, why)
    if old.kind is Kind.SPEED:
        if apart:
            return Row(key, Change.NOT_COMPARED, old, new, f"another machine ({apart[0]})")
        (low, high), (new_low, new_high) = old.interval[0], new.interval[0]
        if new_high < (1.0 - SLOWER) * low:
            return Row(key, Change.CHANGED, old, new, f"slower by {1.0 - new.value[0] / old.value[0]:.0%}")
        return Row(key, Change.BETTER if new_low > (1.0 + SLOWER) * high else Change.SAME, old, new)
    if old.kind is Kind.VERDICT:
        change = Change.SAME if old.value == new.value else Change.CHANGED if old.value[0] else Change.BETTER
        return Row(key, change, old, new, "passed before" if change is Change.CHANGED else "")
    if len(old.value) != len(new.value) or old.unit != new.unit:
        return Row(key, Change.CHANGED, old, new, "of another form")
    signs = (1.0, -1.0) if key.endswith("/orientation") else (1.0,)  # a rotation has two quaternions
    if any(_overlap(old, new, sign) for sign in signs):
        return Row(key, Change.SAME, old, new)
    return Row(key, Change.CHANGED, old, new, _moved(old, new))


def _overlap(old: Figure, new: Figure, sign: float) -> bool:
    for (low, high), ends in zip(old.interval, new.interval, strict=True):
        new_low, new_high = sorted(sign * end for end in ends)
        if new_high < low or high < new_low:
            return False
    return True


def _moved(old: Figure, new: Figure) -> str:
    far = math.dist(old.value, new.value)
    noise = max(high - low for low, high in (*old.interval, *new.interval))
    return f"by {far:.3g} {old.unit}".rstrip() + f", noise {noise:.2g}"


def table_rows(comparison: Comparison, most: int) -> list[tuple[str, str, str, str]]:
    """Of the first ``most`` regressions: key, before, now, why."""
    return [(row.key, _shown(row.before), _shown(row.now), row.why) for row in comparison.regressions[:most]]


def _shown(figure: Figure | None) -> str:
    if figure is None:
        return "–"
    if figure.kind is Kind.VERDICT:
        return "passed" if figure.value[0] else "failed"
    return ", ".join(f"{value:.6g}" for value in figure.value) + (
        f" {figure.unit}" if figure.unit not in ("", "s/s") else ""
    )


def reasons(comparison: Comparison) -> dict[str, int]:
    """Why figures were not compared, each with how many."""
    told: dict[str, int] = {}
    for row in comparison.rows:
        if row.change is Change.NOT_COMPARED and row.before is not None:
            why = f"{row.before.kind}: {HIDDEN if HIDDEN in row.why else row.why}"
            told[why] = told.get(why, 0) + 1
    return told


def comparison_data(comparison: Comparison) -> dict[str, Any]:
    """For ``--json``."""
    return {
        "compared": comparison.compared,
        "same": comparison.count(Change.SAME),
        "better": [row.key for row in comparison.rows if row.change is Change.BETTER],
        "new": comparison.count(Change.NEW),
        "not_compared": reasons(comparison),
        "regressions": [
            {"key": row.key, "why": row.why, "before": _shown(row.before), "now": _shown(row.now)}
            for row in comparison.regressions
        ],
        "notes": list(comparison.notes),
    }
