"""What is measured of each engine on its page: how closely the committed certificates hold, and how it does in the published
study of all engines."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from simspec.outputs.reading import read_bytes
from simspec.proof.certificate import Certificate
from simspec.proof.checks import Check
from simspec.report.terminal import level_title

STUDY = "docs/studies/every-engine"
"""The study that has every engine that can be had, each scenario of it in one run of one machine."""
LINK = "../studies/every-engine/study.md"
LARGEST = 64 * 2**20
"""Bytes of a study that are read."""
HEAD = "| scenario, timestep | a step, processor time | × real time | all that is expected holds | the same run again | gap |"
NOTE = """Gap: the mean distance of all bodies from {first}'s, {length:g} ms after both began in the same state; mean of
{windows} such windows."""


def closeness(name: str, certificates: Mapping[str, Certificate]) -> Iterator[str]:
    """For each level of the certificates how much was compared, and which deviation is the largest share of its tolerance."""
    checks = [
        (scenario, check)
        for scenario, one in certificates.items()
        if name in one.engines
        for check in one.engines[name].checks
    ]
    if not checks:
        return
    yield from ("| level | scenarios | comparisons | nearest to what is tolerated |", "|---|---:|---:|---|")
    for level in sorted({check.level for _, check in checks}):
        of_level = [(scenario, check) for scenario, check in checks if check.level == level]
        scenarios = len({scenario for scenario, _ in of_level})
        count = sum(check.count for _, check in of_level)
        title = level_title(level, [check for _, check in of_level])
        yield f"| {title} | {scenarios} | {count:,} | {_nearest(of_level)} |"
    yield ""


def _nearest(checks: Iterable[tuple[str, Check]]) -> str:
    """The check whose deviation is the largest share of its tolerance; one that failed comes first."""
    scenario, check = max(checks, key=lambda one: _share(one[1]))
    if check.passed and not check.worst:
        return "equal"
    what = f"{check.name}, {scenario}"
    if not check.count:
        return f"{what}: nothing was compared"
    if check.worst is None:
        return f"{what}: different in kind"
    return f"{what}: {check.worst:.2g} of {check.tolerance:.2g}"


def _share(check: Check) -> float:
    if check.worst is None or not check.count:
        return float("inf")
    if not check.tolerance:
        return float("inf") if check.worst else 0.0
    return check.worst / check.tolerance


def study_of(root: Path) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """The records of the published study's tables, by sweep and name; empty where it is not published."""
    file = root / STUDY / "study.json"
    if not file.is_file():
        return {}
    sweeps = json.loads(read_bytes(file, LARGEST))["sweeps"]
    return {sweep: {table["name"]: table["records"] for table in tables} for sweep, tables in sweeps.items()}


def compared(name: str, study: Mapping[str, Mapping[str, list[dict[str, Any]]]]) -> Iterator[str]:
    """How an engine does in each sweep of the study, at its smallest timestep, with a row for each of its versions."""
    rows = list(_rows(name, study))
    if rows:
        gaps = [row for tables in study.values() for row in tables.get("attribution", ()) if "gap.all" in row]
        yield from (f"In the [study of every engine]({LINK}), at each scenario's smallest timestep:", "")
        yield from (HEAD, "|---|---:|---:|---|---|---:|", *rows, "")
        if gaps:
            told = NOTE.format(first=gaps[0]["first"], length=1e3 * gaps[0]["length"], windows=gaps[0]["windows"])
            yield from (told, "")


def _rows(name: str, study: Mapping[str, Mapping[str, list[dict[str, Any]]]]) -> Iterator[str]:
    for sweep, tables in study.items():
        speeds = [row for row in tables.get("speed.cpu_factor", ()) if "elsewhere" not in row]
        if not speeds:
            continue
        smallest = min(row["timestep"] for row in speeds)
        for row in speeds:
            label = row["engine"]
            if row["timestep"] != smallest or label.partition("@")[0] != name:
                continue
            version = f", {label}" if label != name else ""
            cells = (
                f"{sweep}{version}, {1e3 * smallest:g} ms",
                _time(smallest / row["median"]),
                f"{row['median']:.3g}",
                _holds(_of(tables, "validity", label)),
                _of(tables, "determinism", label, smallest).get("result", "–"),
                _distance(_of(tables, "attribution", label)),
            )
            yield f"| {' | '.join(cells)} |"


def _of(
    tables: Mapping[str, list[dict[str, Any]]], table: str, label: str, timestep: float | None = None
) -> dict[str, Any]:
    """The row of an engine in a table; {} where there is none."""
    for row in tables.get(table, ()):
        if row.get("engine") == label and timestep in (None, row.get("timestep")):
            return row
    return {}


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.3g} µs"


def _holds(row: Mapping[str, Any]) -> str:
    if not row:
        return "–"
    limit, beyond = row["limit"], row["first_invalid"]
    if limit is None:
        return f"not at {1e3 * beyond:g} ms: {row['missed']}" if beyond is not None else "–"
    return f"up to {1e3 * limit:g} ms" if beyond is not None else f"up to {1e3 * limit:g} ms at least"


def _distance(row: Mapping[str, Any]) -> str:
    """Mean distance of all bodies at the end of windows (m); – of the first engine, and of one that was not asked."""
    gap = row.get("gap.all")
    return "–" if gap is None else f"{gap:.2g} m"
