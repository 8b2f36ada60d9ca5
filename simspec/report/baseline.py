"""Figures of a study kept as a baseline, a study compared with it, and what regressed."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from simspec.analysis.speed import alike_size, half_width
from simspec.comparison.floor import Floor
from simspec.comparison.runs import QUANTITIES, summary
from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError
from simspec.experiments.timing import Machine, disturbed
from simspec.outputs.files import read_bytes
from simspec.plugins import simspec_version
from simspec.report.console import Screen
from simspec.report.table import Table, markdown_rows
from simspec.report.tested import Status, TestedEntry, TestedSuite, words
from simspec.runner.metrics import moving_bodies
from simspec.runner.run import Run
from simspec.stored import StoredBaseline, parse, read_as
from simspec.world.canonical import sha256

SCHEMA = 1
BEGINNING = b'{\n "simspec_baseline"'
"""The beginning of each of these files, by which simspec knows the files that it may replace."""
LARGEST_BASELINE = 64 * 2**20
"""Bytes: 10,000 bodies at five moments in four engines have 50."""
MOMENTS = 5
"""Times at which places are kept, evenly spaced up to the end: in a chaotic scene only the early ones can be compared."""
LEAST_TIMED = 3
"""Processes from which there is a spread."""


HIDDEN = "the engine's own noise is above the tolerance"


class FigureKind(StrEnum):
    """The subject of a figure."""

    PHYSICS = "physics"
    VERDICT = "verdict"
    SPEED = "speed"


@dataclass(frozen=True, slots=True)
class BaselineFigure:
    """``value``: numbers in ``unit``; ``interval``: for each the range of values that are not distinguishable from it;
    ``not_compared``: why the figure says nothing, "" where it does."""

    key: str
    kind: FigureKind
    unit: str
    value: tuple[float, ...]
    interval: tuple[tuple[float, float], ...]
    not_compared: str = ""


@dataclass(frozen=True)
class Baseline:
    """The figures of one study, by key, which begins with the engine's label."""

    spec: str
    world_sha256: str
    simspec: str
    versions: Mapping[str, str]
    machine: Machine
    figures: Mapping[str, BaselineFigure] = field(default_factory=dict)

    @property
    def has_speed(self) -> bool:
        """Whether speed was measured."""
        return any(figure.kind is FigureKind.SPEED for figure in self.figures.values())

    def text(self) -> str:
        """As JSON, one figure a line, so that version control shows what changed."""
        head = {
            "simspec_baseline": SCHEMA,
            "simspec": self.simspec,
            "spec": self.spec,
            "world_sha256": self.world_sha256,
            "versions": dict(self.versions),
            "machine": self.machine.plain(),
        }
        names = ("key", "kind", "unit", "value", "interval", "not_compared")
        records = ({name: getattr(figure, name) for name in names} for figure in self.figures.values())
        rows = [json.dumps(record, ensure_ascii=False, allow_nan=False) for record in records]
        lines = json.dumps(head, indent=1, ensure_ascii=False, allow_nan=False).removesuffix("\n}")
        return f'{lines},\n "figures": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"


def is_baseline(content: bytes) -> bool:
    """Whether simspec wrote a file."""
    return content.startswith(BEGINNING)


def read_baseline(path: Path) -> Baseline | None:
    """The baseline in a file; None where there is none. Raises SpecError, which names the file, when it is damaged, is none, or
    was written by a newer simspec."""
    try:
        content = read_bytes(path, LARGEST_BASELINE)
    except FileNotFoundError:
        return None
    plain = parse(content, str(path))
    schema = plain.get("simspec_baseline") if isinstance(plain, dict) else None
    if schema != SCHEMA:
        newer = isinstance(schema, int) and schema > SCHEMA
        why = f"a baseline of schema {schema}, this simspec reads {SCHEMA}" if newer else "not a baseline of simspec"
        raise SpecError([Problem(f"{path}: {why}", hint="--write-baseline FILE writes a new one", code="R109")])
    stored = read_as(StoredBaseline, content, str(path))
    figures = {}
    for figure in stored.figures:
        intervals = tuple((low, high) for low, high in figure.interval)
        if len(figure.value) != len(intervals) or figure.key in figures or any(low > high for low, high in intervals):
            raise SpecError(
                [Problem(f"{path} cannot be read: figure {figure.key!r} is damaged, or is there twice", code="R109")]
            )
        figures[figure.key] = BaselineFigure(
            figure.key, FigureKind(figure.kind), figure.unit, tuple(figure.value), intervals, figure.not_compared
        )
    machine = Machine(**stored.machine.model_dump())
    return Baseline(stored.spec, stored.world_sha256, stored.simspec, stored.versions, machine, figures)


# --- figures of a study -----------------------------------------------------------------------------------------------


def baseline_of(study: Study, timed: Iterable[Run], tolerance: float, machine: Machine) -> Baseline:
    """The figures of a study, and of runs that were timed (:mod:`simspec.experiments.timing`).

    ``tolerance`` (m): figures of a run whose own noise grows past it are kept, and not compared from then on.
    """
    figures: list[BaselineFigure] = []
    if study.certificate is not None:
        for name, proof in study.certificate.engines.items():
            figures.append(_verdict(f"{name}/proof", proof.valid))
    for name, run in study.runs.items():
        figures.append(_verdict(f"{name}/run", run.failed is None))
        for number, outcome in enumerate(study.outcomes.get(name, ()), 1):
            figures.append(_verdict(f"{name}/expectation {number} {outcome.kind}", outcome.passed))
        if run.recorded and run.failed is None:
            floor = study.floors.get(name)
            figures += _places(run, floor, tolerance)
            figures += _quantities(run, study.repeats.get(name, ()), floor, tolerance)
    figures += _speeds(list(timed))
    versions = {name: str(run.provenance.get("engine_version", "")) for name, run in study.runs.items()}
    by_key = {figure.key: figure for figure in figures}
    return Baseline(study.world.name, sha256(study.world), simspec_version(), versions, machine, by_key)


def _verdict(key: str, passed: bool) -> BaselineFigure:
    return BaselineFigure(key, FigureKind.VERDICT, "", (float(passed),), ((float(passed), float(passed)),))


def _hidden(noise: float, tolerance: float) -> str:
    """Why a figure says nothing: "" where its noise is within the tolerance."""
    return "" if noise <= tolerance else f"{HIDDEN}: {noise:.2g}, tolerance {tolerance:.2g}"


def _places(run: Run, floor: Floor | None, tolerance: float) -> list[BaselineFigure]:
    """Position (m) and orientation (quaternion) of each moving body at some moments."""
    rows = sorted({round(share * (len(run.time) - 1) / MOMENTS) for share in range(1, MOMENTS + 1)})
    poses, figures = run.arrays["pose"], []
    for body in moving_bodies(run.world):
        name, largest = run.world.bodies[body].name, float(np.abs(poses[:, body, :3]).max())
        for row in rows:
            key = f"{run.engine}/{name}/{run.time[row]:.6g} s"
            for part, unit, what, size in (
                (slice(0, 3), "m", "position", largest),
                (slice(3, 7), "", "orientation", 1.0),
            ):
                noise = getattr(floor, "position" if unit else "angle")[row, body] if floor is not None else math.inf
                why = "noise was not measured" if floor is None else _hidden(float(noise), tolerance)
                half = 0.0 if why else half_width(run, size, float(noise))
                figures.append(_around(f"{key}/{what}", unit, poses[row, body, part].tolist(), half, why))
    return figures


def _quantities(run: Run, repeats: Sequence[Run], floor: Floor | None, tolerance: float) -> list[BaselineFigure]:
    """The summary of a run (energy, momentum, contacts) with the noise of the repeats."""
    values, again = summary(run), [summary(other) for other in repeats if other.failed is None]
    why = _hidden(floor.largest, tolerance) if floor is not None and again else "noise was not measured"
    figures = []
    for name, unit in QUANTITIES:
        if (value := values.get(name)) is not None:
            noise = max((abs(other[name] - value) for other in again if name in other), default=0.0)
            half = 0.0 if why else half_width(run, alike_size(values, unit), noise)
            figures.append(_around(f"{run.engine}/{name}", unit, [value], half, why))
    return figures


def _around(key: str, unit: str, values: Sequence[float], half: float, why: str) -> BaselineFigure:
    if not all(map(math.isfinite, (*values, half))):
        return BaselineFigure(key, FigureKind.PHYSICS, unit, (), (), "it is not finite")
    return BaselineFigure(
        key, FigureKind.PHYSICS, unit, tuple(values), tuple((value - half, value + half) for value in values), why
    )


def _speeds(runs: Sequence[Run]) -> list[BaselineFigure]:
    """The speed of each engine: median, smallest and largest over processes."""
    figures = []
    for engine in dict.fromkeys(run.engine for run in runs):
        local = [run for run in runs if run.engine == engine and run.failed is None]
        busy = [why for run in local for why in disturbed(run)]
        few = f"{len(local)} processes, of at least {LEAST_TIMED}" if len(local) < LEAST_TIMED else ""
        for name, values, why in (
            ("speed by processor time", [run.cpu_factor for run in local], few),
            ("speed by wall time", [run.real_time_factor for run in local], few or (busy[0] if busy else "")),
        ):
            known = [value for value in values if value is not None]
            if known:
                value, interval = (statistics.median(known),), ((min(known), max(known)),)
                figures.append(BaselineFigure(f"{engine}/{name}", FigureKind.SPEED, "s/s", value, interval, why))
    return figures


# Comparison with a baseline. Physics is compared on any machine, by the engines' noise: a figure has changed where its interval
# and the baseline's are disjoint. Speed is compared on the same machine only.

SLOWER = 0.1
"""Share by which an engine's fastest process must be slower than the baseline's slowest. Measured on two cores that were busy
with other work, six times five processes of two engines: by processor time, medians differ by up to 16 % and the range of five
reaches 15 %, and none of 60 comparisons of one set with another is a regression; by wall time, medians differ by up to 76 %,
which is why that is compared on a quiet machine only."""


class FigureChange(StrEnum):
    """The result of a comparison for a figure."""

    SAME = "same"
    CHANGED = "changed"
    MISSING = "missing"
    NOT_COMPARED = "not compared"
    BETTER = "better"
    NEW = "new"


@dataclass(frozen=True, slots=True)
class FigureRow:
    """One figure, before and now (None: not there), what became of it, and why in words."""

    key: str
    change: FigureChange
    before: BaselineFigure | None
    now: BaselineFigure | None
    why: str = ""


@dataclass(frozen=True)
class BaselineComparison:
    """A study compared with a baseline; ``notes``: facts that a reader must know."""

    rows: tuple[FigureRow, ...]
    notes: tuple[str, ...] = ()

    @property
    def regressions(self) -> list[FigureRow]:
        """Figures that changed for the worse or are missing. A change of physics in either direction is a regression."""
        return [row for row in self.rows if row.change in (FigureChange.CHANGED, FigureChange.MISSING)]

    def count(self, change: FigureChange) -> int:
        """How many figures this became of."""
        return sum(row.change is change for row in self.rows)

    @property
    def compared(self) -> int:
        """Figures that were compared."""
        return sum(row.change in (FigureChange.SAME, FigureChange.CHANGED, FigureChange.BETTER) for row in self.rows)


def compare(before: Baseline, now: Baseline) -> BaselineComparison:
    """Every figure of either, compared by its key. Engines that were not run now are not compared, and named.

    Raises SpecError when the baseline is of another spec.
    """
    if before.spec != now.spec:
        raise SpecError([Problem("the baseline is of another spec", found=before.spec, allowed=now.spec, code="R109")])
    notes = [
        f"{engine}: version {before.versions[engine]} in the baseline, now {number}"
        for engine, number in now.versions.items()
        if before.versions.get(engine, number) != number
    ]
    if before.world_sha256 != now.world_sha256:
        notes.append("the spec, or a value set with --set, is not that of the baseline")
    differences = before.machine.differences(now.machine)
    rows = []
    for key, old in before.figures.items():
        engine = key.split("/", 1)[0]
        if engine not in now.versions:
            rows.append(FigureRow(key, FigureChange.NOT_COMPARED, old, None, f"{engine} was not run"))
        else:
            rows.append(_row(key, old, now.figures.get(key), differences))
    rows += [
        FigureRow(key, FigureChange.NEW, None, figure)
        for key, figure in now.figures.items()
        if key not in before.figures
    ]
    return BaselineComparison(tuple(rows), tuple(notes))


def _row(key: str, old: BaselineFigure, new: BaselineFigure | None, other_machine: Sequence[str]) -> FigureRow:
    if new is None:
        if old.kind is FigureKind.SPEED:
            return FigureRow(key, FigureChange.NOT_COMPARED, old, None, "speed was not measured")
        return FigureRow(key, FigureChange.MISSING, old, None, "not in this run")
    if why := old.not_compared or new.not_compared:
        return FigureRow(key, FigureChange.NOT_COMPARED, old, new, why)
    if old.kind is FigureKind.SPEED:
        if other_machine:
            return FigureRow(key, FigureChange.NOT_COMPARED, old, new, f"another machine ({other_machine[0]})")
        (low, high), (new_low, new_high) = old.interval[0], new.interval[0]
        if new_high < (1.0 - SLOWER) * low:
            return FigureRow(key, FigureChange.CHANGED, old, new, f"slower by {1.0 - new.value[0] / old.value[0]:.0%}")
        return FigureRow(key, FigureChange.BETTER if new_low > (1.0 + SLOWER) * high else FigureChange.SAME, old, new)
    if old.kind is FigureKind.VERDICT:
        change = (
            FigureChange.SAME
            if old.value == new.value
            else FigureChange.CHANGED
            if old.value[0]
            else FigureChange.BETTER
        )
        return FigureRow(key, change, old, new, "passed before" if change is FigureChange.CHANGED else "")
    if len(old.value) != len(new.value) or old.unit != new.unit:
        return FigureRow(key, FigureChange.CHANGED, old, new, "of another form")
    signs = (1.0, -1.0) if key.endswith("/orientation") else (1.0,)  # a rotation has two quaternions
    if any(_overlap(old, new, sign) for sign in signs):
        return FigureRow(key, FigureChange.SAME, old, new)
    far = f"by {math.dist(old.value, new.value):.3g} {old.unit}".rstrip()
    return FigureRow(key, FigureChange.CHANGED, old, new, f"{far}, noise {_noise(old, new):.2g}")


def _overlap(old: BaselineFigure, new: BaselineFigure, sign: float) -> bool:
    turned = [sorted(sign * end for end in ends) for ends in new.interval]
    pairs = zip(old.interval, turned, strict=True)
    return all(low <= new_high and new_low <= high for (low, high), (new_low, new_high) in pairs)


def _noise(old: BaselineFigure, new: BaselineFigure) -> float:
    return max(high - low for low, high in (*old.interval, *new.interval))


def table_rows(comparison: BaselineComparison, most: int) -> list[tuple[str, str, str, str]]:
    """Of the first ``most`` regressions: key, before, now, why."""
    return [(row.key, _shown(row.before), _shown(row.now), row.why) for row in comparison.regressions[:most]]


def _shown(figure: BaselineFigure | None) -> str:
    if figure is None:
        return "–"
    if figure.kind is FigureKind.VERDICT:
        return "passed" if figure.value[0] else "failed"
    unit = f" {figure.unit}" if figure.unit not in ("", "s/s") else ""
    return ", ".join(f"{value:.6g}" for value in figure.value) + unit


def reasons(comparison: BaselineComparison) -> dict[str, int]:
    """Why figures were not compared, each with how many."""
    given: dict[str, int] = {}
    for row in comparison.rows:
        if row.change is FigureChange.NOT_COMPARED and row.before is not None:
            why = f"{row.before.kind}: {HIDDEN if HIDDEN in row.why else row.why}"
            given[why] = given.get(why, 0) + 1
    return given


def comparison_data(comparison: BaselineComparison) -> dict[str, Any]:
    """For ``--json``."""
    return {
        "compared": comparison.compared,
        "same": comparison.count(FigureChange.SAME),
        "better": [row.key for row in comparison.rows if row.change is FigureChange.BETTER],
        "new": comparison.count(FigureChange.NEW),
        "not_compared": reasons(comparison),
        "regressions": [
            {"key": row.key, "why": row.why, "before": _shown(row.before), "now": _shown(row.now)}
            for row in comparison.regressions
        ],
        "notes": list(comparison.notes),
    }


# Output of a comparison, on the terminal and in a job's summary.

SHOWN = 20
"""Regressions that the terminal lists."""
SUMMARISED = 100


def _verdict_regressions(comparison: BaselineComparison) -> str:
    worse, better = len(comparison.regressions), comparison.count(FigureChange.BETTER)
    parts = [f"{comparison.compared:,} figures compared", f"{worse:,} regressed" if worse else "none regressed"]
    parts += [f"{better:,} better"] if better else []
    return ", ".join(parts) if comparison.rows else "no figures"


def show_comparison(comparison: BaselineComparison, screen: Screen) -> None:
    """Print what regressed, and how much was compared, or not, and why."""
    if comparison.regressions:
        regressed = Table("Regressed", "figure", "baseline", "now", "", rows=table_rows(comparison, SHOWN))
        if (left := len(comparison.regressions) - SHOWN) > 0:
            regressed.note = f"and {left:,} more figures"
        screen.print(regressed)
    screen.note(f"baseline: {_verdict_regressions(comparison)}")
    for why, number in reasons(comparison).items():
        screen.note(f"not compared: {number:,} figures: {why}")


def comparison_lines(comparison: BaselineComparison) -> list[str]:
    """The same as Markdown."""
    lines = ["### Baseline", "", f"{_verdict_regressions(comparison)}.", ""]
    rows = [[words(cell) for cell in row] for row in table_rows(comparison, SUMMARISED)]
    if rows:
        lines += [*markdown_rows(("figure", "baseline", "now", ""), rows), ""]
    if (left := len(comparison.regressions) - SUMMARISED) > 0:
        lines += [f"{left:,} more figures regressed.", ""]
    texts = [f"- not compared: {number:,} figures: {words(why)}" for why, number in reasons(comparison).items()]
    texts += [f"- {words(note)}" for note in comparison.notes]
    return [*lines, *texts, ""] if texts else lines


def comparison_suite(spec: str, comparison: BaselineComparison) -> TestedSuite:
    """The same as a suite: an entry for each figure that regressed, one for all that did not, one for each reason why figures
    were not compared."""
    entries = []
    for row in comparison.regressions:
        message = f"{row.why}: {_shown(row.before)} in the baseline, now {_shown(row.now)}"
        entries.append(TestedEntry(row.key, Status.FAILED, message, excess=_excess(row)))
    if good := comparison.compared - comparison.count(FigureChange.CHANGED):
        entries.append(TestedEntry(f"{good:,} figures did not regress", Status.PASSED))
    if not comparison.compared:
        message = "nothing could be compared with the baseline"
        entries.append(TestedEntry("comparison", Status.FAILED, message, excess=math.inf))
    skipped = reasons(comparison).items()
    entries += [TestedEntry(f"{number:,} figures not compared", Status.SKIPPED, why) for why, number in skipped]
    return TestedSuite(spec, "baseline", tuple(entries))


def _excess(row: FigureRow) -> float:
    """How many times its noise a figure has moved."""
    if row.before is None or row.now is None or row.before.kind is not FigureKind.PHYSICS or not row.before.value:
        return math.inf
    noise = _noise(row.before, row.now)
    return math.dist(row.before.value, row.now.value) / noise if noise else math.inf
