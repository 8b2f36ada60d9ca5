"""Sweeps and searches for a changed version: tables, lines, CSV, plain data."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Final

from simspec.experiments.bisect import Bisection, Reading
from simspec.experiments.cases import rounded_data, rounding_lines, roundings
from simspec.experiments.index import Estimate, ProofsLeft, RunRow
from simspec.experiments.plan import Cell, Plan
from simspec.experiments.sweep import SweepOutcome
from simspec.report.screen import console, duration
from simspec.report.table import BAD, Table, TableCell, csv_text, length, listed, number

# Sweeps: a table of groups of runs, CSV, plain data.

MOST_ROWS = 60
"""Rows of a table on a terminal; a file of CSV has all."""
MOST_REASONS = 8
"""Reasons of failures that are listed; runs that failed for the same one are counted."""
CSV_FIRST = ("index", "engine", "engine_version", "case")
CSV_LAST = (
    *("sample", "perturb", "seed", "repeat", "key", "failed", "passed", "expected", "steps", "timestep"),
    *("step_seconds", "cpu_seconds", "process_seconds", "bytes"),
)
SHOWN = (
    ("deepest penetration", "deepest", "m"),
    ("spread at the end", "spread", "m"),
    ("energy at the end", "energy", "J"),
)
"""Quantities of a run that the table has where they are not zero in all rows, with the head of their column and their unit."""


@dataclass
class RunGroup:
    """The runs of one engine with the same case and values: samples, perturbations and repetitions of it.

    ``asked``: cells; ``rows``: the runs that are there.
    """

    engine: str
    case: str | None
    values: tuple[tuple[str, Any], ...]
    requested: int = 0
    rows: list[RunRow] = field(default_factory=list)

    @property
    def whole(self) -> list[RunRow]:
        """The runs that did not fail."""
        return [row for row in self.rows if row.failed is None]

    def real_time_factor(self) -> float | None:
        """Simulated time over the wall time of the steps: the median."""
        return _median(row.steps * row.timestep / row.step_seconds for row in self.whole if row.step_seconds)

    def quantity(self, name: str) -> tuple[float | None, float | None]:
        """The median and the range (largest less smallest) of a quantity at the end; None where no run has it."""
        values = [value for row in self.whole if (value := row.quantities.get(name)) is not None]
        return _median(values), (max(values) - min(values) if len(values) > 1 else None)

    def plain(self) -> dict[str, Any]:
        """As plain data."""
        names = dict.fromkeys(name for row in self.whole for name in row.quantities)
        return {
            "engine": self.engine,
            "case": self.case,
            "values": dict(self.values),
            "asked": self.requested,
            "runs": len(self.rows),
            "failed": len(self.rows) - len(self.whole),
            "expectations": {
                "passed": sum(row.passed for row in self.rows),
                "of": sum(row.expected for row in self.rows),
            },
            "real_time_factor": self.real_time_factor(),
            "quantities": {name: dict(zip(("median", "range"), self.quantity(name), strict=True)) for name in names},
        }


def _median(values: Iterable[float]) -> float | None:
    known = [value for value in values if not math.isnan(value)]
    return median(known) if known else None


def groups(plan: Plan, rows: Iterable[tuple[Cell, RunRow | None]]) -> list[RunGroup]:
    """The runs of a plan, by case, values (those of samples aside) and engine, in the order of the plan."""
    drawn = set(plan.sweep.samples.values) if plan.sweep.samples is not None else set()
    found: dict[tuple[str, str | None, str], RunGroup] = {}
    for cell, row in rows:
        values = tuple((path, value) for path, value in cell.overrides if path not in drawn)
        name = (cell.engine, cell.case, repr(values))
        group = found.setdefault(name, RunGroup(cell.engine, cell.case, values))
        group.requested += 1
        if row is not None:
            group.rows.append(row)
    return list(found.values())


def proof_words(proofs: ProofsLeft | None) -> str:
    """The duration of the remaining proofs in words; None: without proofs."""
    if proofs is None:
        return "without proof"
    if not proofs.count:
        return "proofs: all are there"
    text = f"proofs: {proofs.count:,} at most"
    if proofs.total is None:
        return f"{text}, time not known: an engine has none yet"
    return f"{text}, about {duration(proofs.total)}, from what proofs took in this store"


def show_plan(plan: Plan, done: int, left: Estimate, jobs: int, proofs: ProofsLeft | None) -> None:
    """Print what a sweep would do."""
    screen = console()
    screen.print(f"{plan.spec.name}: {len(plan):,} runs of {plan.worlds:,} sets of values in {', '.join(plan.engines)}")
    for line in [*axes(plan), *rounding_lines(plan)]:
        screen.note(f"  {line}")
    shown = Table("To do", "engine", "runs", "steps", "time, one after the other", right=(1, 2, 3))
    for engine in plan.engines:
        seconds = left.seconds[engine]
        text = "not measured yet" if seconds is None else f"about {duration(seconds)}"
        shown.add(engine, f"{left.runs[engine]:,}", f"{left.steps[engine]:,}", text if left.runs[engine] else "–")
    screen.print(shown)
    to_do = sum(left.runs.values())
    screen.print(f"done: {done:,}; to do: {to_do:,}{' at most' if to_do else ''}")
    if to_do and left.total is not None:
        together = f", {duration(left.total / jobs)} at {jobs} side by side" if jobs > 1 else ""
        about = f"about {duration(left.total)}{together}"
        screen.note(f"runs: {about}, from what such runs took in this store")
    elif to_do:
        unknown = [name for name in plan.engines if left.runs[name] and left.seconds[name] is None]
        screen.note(f"runs: time not known: none yet in {listed(unknown)}")
    screen.note(proof_words(proofs))


def axes(plan: Plan) -> list[str]:
    """The axes of the plan, a line each."""
    describe = plan.describe()
    lines = [f"over {path}: {count} values" for path, count in describe["over"].items()]
    lines += [f"together {', '.join(entry)}: {next(iter(entry.values()))} rows" for entry in describe["together"]]
    if plan.sweep.cases:
        lines.append(f"cases: {', '.join(name or '(none)' for name in describe['cases'])}")
    if describe["samples"]:
        lines.append(f"samples: {describe['samples']}")
    if describe["perturbed"]:
        lines.append(f"perturbed initial states: {describe['perturbed']}")
    if describe["repeat"] > 1:
        lines.append(f"repetitions: {describe['repeat']}")
    return lines


def show_outcome(outcome: SweepOutcome, found: Sequence[RunGroup]) -> None:
    """Print what a sweep came to."""
    screen = console()
    for note in outcome.notes:
        screen.note(f"note: {note}")
    screen.print(results_table(found))
    if len(found) > MOST_ROWS:
        screen.note(f"{len(found) - MOST_ROWS:,} more rows: --csv FILE has all")
    for line in rounding_lines(outcome.plan):
        screen.note(f"note: {line}")
    said = f"{outcome.ran:,} runs now, {outcome.done:,} before"
    missing = sum(group.requested - len(group.rows) for group in found)
    said += f", {missing:,} not run" if missing else ""
    screen.print(said)
    if outcome.verified:
        bad = len(outcome.unproven)
        verdict = f"FAILED for {bad:,} models" if bad else "valid for all models"
        screen.print(f"proof: {verdict} ({outcome.proofs:,} verified now)")
    else:
        screen.print("proof: not requested (--no-verify)")
    errors = console(error=True)
    for why in list(outcome.unproven.values())[:MOST_REASONS]:
        errors.message(f"not proven: {why}", style="bold red")
    for engine, why in outcome.stopped.items():
        errors.message(f"{engine} was stopped: {why} (--retry-failed tries again)", style="bold red")
    failed = Counter((row.engine, row.failed) for group in found for row in group.rows if row.failed is not None)
    for (engine, reason), count in failed.most_common(MOST_REASONS):
        errors.message(f"{count:,} failed: {engine}: {reason}", style="bold red")


def results_table(found: Sequence[RunGroup], most: int = MOST_ROWS) -> Table:
    """A row for each group, of the first ``most``."""
    paths = list(dict.fromkeys(path for group in found for path, _ in group.values))
    heads = short_names(paths)
    cased = any(group.case is not None for group in found)
    columns = (["case"] if cased else []) + [heads[path] for path in paths] + ["engine", "runs", "real time"]
    shown = [entry for entry in SHOWN if any(group.quantity(entry[0])[0] for group in found)]
    columns += [head for _, head, _ in shown] + ["expected"]
    count = len(columns)
    made = Table("Sweep: medians, ± half of the range", *columns, right=range(count - 3 - len(shown), count))
    for group in found[:most]:
        values = dict(group.values)
        cells: list[str | TableCell] = [group.case or "–"] if cased else []
        cells += [str(values.get(path, "–")) for path in paths]
        failed = len(group.rows) - len(group.whole)
        runs = f"{len(group.rows)}" if len(group.rows) == group.requested else f"{len(group.rows)} of {group.requested}"
        cells += [group.engine, TableCell(f"{runs}, {failed} failed", BAD) if failed else runs]
        factor = group.real_time_factor()
        cells.append("–" if factor is None else f"{factor:,.0f} ×" if factor >= 100.0 else f"{factor:.3g} ×")
        for name, _, unit in shown:
            middle, spread = group.quantity(name)
            text = length(middle) if unit == "m" else number(middle, unit)
            half = None if spread is None else spread / 2
            cells.append(text if not half else f"{text} ± {length(half) if unit == 'm' else number(half)}")
        passed, expected = sum(row.passed for row in group.rows), sum(row.expected for row in group.rows)
        text = f"{passed} of {expected}" if expected else "–"
        cells.append(TableCell(text, BAD) if passed < expected else text)
        made.add(*cells)
    return made


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Each dotted path by its last words, as few as tell it from the others."""
    names = {}
    for path in paths:
        words = path.split(".")
        ends = [".".join(words[-count:]) for count in range(1, len(words) + 1)]
        names[path] = next(end for end in ends if sum(f".{other}".endswith(f".{end}") for other in paths) == 1)
    return names


def sweep_csv(plan: Plan, rows: Iterable[tuple[Cell, RunRow | None]]) -> str:
    """A line for each cell: its values and its results, in SI units; empty where there is no run or no figure."""
    kept = list(rows)
    paths = list(dict.fromkeys(path for cell, _ in kept for path, _ in cell.overrides))
    quantities = list(dict.fromkeys(name for _, row in kept if row is not None for name in row.quantities))
    table = Table("", *CSV_FIRST, *paths, *CSV_LAST, *quantities)
    for cell, row in kept:
        names = ("index", "engine", "case", "sample", "perturb", "seed", "repeat")
        facts: dict[str, Any] = {name: getattr(cell, name) for name in names}
        if row is not None:
            facts |= {name: getattr(row, name) for name in ("engine_version", *CSV_LAST) if name not in facts}
        values, measured = dict(cell.overrides), {} if row is None else row.quantities
        line = [*map(facts.get, CSV_FIRST), *map(values.get, paths), *map(facts.get, CSV_LAST)]
        line += map(measured.get, quantities)
        table.add(*(str(value) if isinstance(value, bool) else value for value in line))
    return csv_text(table, newline="\n", lines=True)


def outcome_data(outcome: SweepOutcome, found: Sequence[RunGroup]) -> dict[str, Any]:
    """A sweep as plain data, its runs cell by cell."""
    runs = []
    for cell, row in outcome.rows():
        entry = {"index": cell.index, "engine": cell.engine, "case": cell.case, "values": dict(cell.overrides)}
        if rounded := roundings(outcome.plan, cell):
            entry["rounded"] = rounded_data(rounded)
        entry |= {"sample": cell.sample, "repeat": cell.repeat, "perturb": cell.perturb, "seed": cell.seed}
        if row is not None:
            names = ("key", "failed", "quantities", "step_seconds", "cpu_seconds", "passed", "expected")
            entry |= {name: getattr(row, name) for name in names}
        runs.append(entry)
    return {
        "plan": outcome.plan.describe(),
        "ran": outcome.ran,
        "done_before": outcome.done,
        "skipped": outcome.skipped,
        "stopped": outcome.stopped,
        "invalid": outcome.invalid_count,
        "proof": {
            "asked": outcome.verified,
            "valid": outcome.verified and not outcome.unproven,
            "verified_now": outcome.proofs,
            "failed": list(outcome.unproven.values()),
        },
        "groups": [group.plain() for group in found],
        "runs": runs,
        "notes": outcome.notes,
    }


# Searches for the version that changed a figure.

MOST_SKIPPED: Final = 5
"""Versions that could not be measured which are listed one by one; the others are counted."""
PREFIXES: Final = ((0.1, 1.0, "m"), (1e-5, 1e-3, "mm"), (1e-8, 1e-6, "µm"))
"""Of lengths: from which value (m) on, the factor, and the unit."""
ASSUMES: Final = "the search assumes one change between the ends: others would not be seen"


def bisect_lines(engine: str, done: Bisection, models: Sequence[str], more: str) -> Iterator[str]:
    """The answer first. ``models``: the proofs of the two versions; ``more``: the command that looks further."""
    first, last = (done.readings[done.versions[end]] for end in (0, -1))
    if done.before is None or done.after is None:
        yield f"{done.figure} does not change from {engine} {first.version} to {last.version}"
        yield from _values(first, last)
        yield f"  difference {_shown(abs(last.value - first.value), first.unit)}, within noise"
    else:
        span = f" ({', '.join(done.between)} or {done.after.version})" if done.between else ""
        yield f"{engine} {done.after.version} changed {done.figure}{span}"
        yield from _values(done.before, done.after)
        yield f"  change {_shown(done.after.value - done.before.value, done.after.unit)}{_share(done.before, done.after)}"
    yield from (f"  {line}" for line in models)
    kept = sum(reading.stored for reading in done.readings.values())
    stored = f", {kept} of them from stored runs" if kept else ""
    counted = f"{len(done.readings)} of {len(done.versions)} versions from {first.version} to {last.version}"
    yield f"measured {counted}, each once{stored}"
    skipped = list(done.not_measured.items())
    yield from (f"not measured: {version}: {why}" for version, why in skipped[:MOST_SKIPPED])
    if len(skipped) > MOST_SKIPPED:
        yield f"not measured: {len(skipped) - MOST_SKIPPED} more versions"
    yield from (f"note: {note}" for note in done.notes)
    if done.found:
        if len(done.versions) > len(done.readings) + len(skipped) and not done.notes:
            yield f"note: {ASSUMES}"
        yield f"look further: {more}"


def _values(*readings: Reading) -> Iterator[str]:
    width = max(len(reading.version) for reading in readings)
    for entry in readings:
        yield f"  {entry.version:<{width}}  {_shown(entry.value, entry.unit)}, noise {_shown(entry.noise, entry.unit, 2)}"


def _share(before: Reading, after: Reading) -> str:
    return f" ({(after.value - before.value) / abs(before.value):+.1%})" if before.value else ""


def _shown(value: float, unit: str, digits: int = 4) -> str:
    """A number to some digits, a length with the prefix that suits it."""
    if unit != "m" or not value:
        return f"{value:.{digits}g} {unit}".rstrip()
    for least, factor, prefix in PREFIXES:
        if abs(value) >= least:
            return f"{value / factor:.{digits}g} {prefix}"
    return f"{value:.1e} m"


def bisect_data(engine: str, done: Bisection, models: Sequence[str], more: str) -> dict[str, Any]:
    """For ``--json``: everything."""
    return {
        "engine": engine,
        "figure": done.figure,
        "found": done.found,
        "changed_in": None if done.after is None else done.after.version,
        "between": list(done.between),
        "before": _plain(done.before),
        "after": _plain(done.after),
        "versions": list(done.versions),
        "measured": {version: _plain(done.readings[version]) for version in done.versions if version in done.readings},
        "not_measured": dict(done.not_measured),
        "notes": list(done.notes),
        "models": list(models),
        "explain": more if done.found else None,
    }


def _plain(reading: Reading | None) -> dict[str, Any] | None:
    names = {"half_width": "half", **{name: name for name in ("version", "value", "unit", "noise", "stored")}}
    return None if reading is None else {name: getattr(reading, field) for name, field in names.items()}
