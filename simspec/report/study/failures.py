"""What happened first in the runs that do not do what is expected."""

from __future__ import annotations

from collections import Counter

from simspec.analysis.failures import KINDS
from simspec.report.kit import table
from simspec.report.study.done import Done, Record, Shown, finite, milliseconds
from simspec.report.study.judged import Judged, judged


def failures_tables(done: Done) -> list[Shown]:
    """``failures``: by timestep and engine, how many runs fail, and what happened first in them."""
    columns = ("timestep", "engine", "failed", "what happened first", "for example")
    made = table(f"{done.sweep.name}: What happened first in the runs that fail", *columns, right=(0, 2))
    runs = judged(done)
    groups: dict[tuple[float, int], list[Judged]] = {}
    for one in runs:
        groups.setdefault((one.trial.timestep, done.engines.index(one.cell.engine)), []).append(one)
    records: list[Record] = []
    for (timestep, index), own in sorted(groups.items()):
        failed = [one for one in own if one.failure is not None]
        if not failed:
            continue
        kinds = Counter(one.failure.kind for one in failed if one.failure is not None)
        said = ", ".join(f"{count} × {KINDS[kind]}" for kind, count in kinds.most_common())
        shown = (milliseconds(timestep), done.engines[index], f"{len(failed)} of {len(own)}")
        made.add_row(*shown, said, example(failed))
        records += [_record(one) for one in failed]
    if not records:
        made.add_row("–", "–", f"0 of {len(runs)}", "no run failed", "–")
    made.caption = "From the recorded motion: an event between two records has the time of the later one"
    return [Shown("failures", made, records)]


def example(failed: list[Judged]) -> str:
    """The first of some failures in words; the run without a seed comes first."""
    first = min(failed, key=lambda one: -1 if one.cell.seed is None else one.cell.seed)
    seed = "" if first.cell.seed is None else f"seed {first.cell.seed}: "
    return f"{seed}{first.failure}"


def _record(one: Judged) -> Record:
    failure = one.failure
    assert failure is not None, "only failed runs are recorded"
    return {
        "timestep": one.trial.timestep,
        "engine": one.cell.engine,
        "seed": one.cell.seed,
        "kind": failure.kind,
        "time": failure.time,
        "what": failure.what,
        "at": failure.at,
        "body": failure.body,
        "away": finite(failure.away),
    }
