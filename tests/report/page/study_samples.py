"""Tables of a made-up study, as ``simspec study`` stores them: every kind of figure that has a plot."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from simspec.report.study.sentences import said_of
from simspec.stored import StudyTables

TIMESTEPS = (0.001, 0.002, 0.004, 0.008)
SPEED = {"first": 4.0, "second": 2.0}
"""Real-time factors at 1 ms; they grow with the timestep."""


def speeds(engines: Sequence[str]) -> list[dict[str, Any]]:
    records: list[dict[str, Any]] = []
    for engine, factor in zip(engines, SPEED.values(), strict=True):
        for timestep in TIMESTEPS:
            median = factor * timestep / 0.001
            values = [0.9 * median, median, 1.1 * median]
            common = {"timestep": timestep, "engine": engine, "quantity": "cpu_factor", "median": median}
            records.append({**common, "lower": values[0], "upper": values[2], "values": values})
    for engine, factor in ((engines[0].upper(), 1.0), ("Third", 3.0)):
        common = {"elsewhere": True, "engine": engine, "models": "as-published", "quantity": "cpu_factor", "unit": "1"}
        records += [{**common, "source": "a paper", "timestep": 0.001, "value": factor}]
    return records


def shares(engines: Sequence[str]) -> list[dict[str, Any]]:
    records: list[dict[str, Any]] = []
    for engine, limit in zip(engines, (0.004, None), strict=True):
        common = {"engine": engine, "limit": limit, "first_invalid": 0.008 if limit else 0.001, "runs": 40}
        records.append({**common, "failure": "it fell", "later_valid": [], "fewer_seeds": []})
        for timestep in TIMESTEPS:
            share = 1.0 if limit and timestep <= limit else 0.25
            bounds = {"lower": share - 0.2, "upper": min(1.0, share + 0.2)}
            records.append({"engine": engine, "timestep": timestep, "share": share, "runs": 10, **bounds})
    common = {"elsewhere": True, "engine": "Third", "models": "as-published", "quantity": "largest_valid_timestep"}
    return [*records, {**common, "unit": "s", "source": "a paper", "timestep": None, "value": 0.003}]


def paces(engines: Sequence[str]) -> list[dict[str, Any]]:
    return [
        {"timestep": 0.001, "begin": 0.5 * part, "end": 0.5 * (part + 1), "engine": engine, "contacts": 10.0 * part}
        | {"cpu_factor": 8.0 / (1 + part + number), "real_time_factor": 1.0, "cpu_seconds": 1.0}
        for number, engine in enumerate(engines)
        for part in range(4)
    ]


def comparison(engines: Sequence[str], factors: Sequence[float]) -> list[dict[str, Any]]:
    return [
        {"timestep": 0.001, "engine": engine, "case": None, "cpu_factor": factor, "spread": 1.0}
        for engine, factor in zip(engines, factors, strict=True)
    ]


def study_tables(engines: Sequence[str] = ("first", "second"), name: str = "made-up") -> StudyTables:
    """The tables; names are those of the study, of a sweep, and of all that is in the cells."""
    records = {
        "speed.cpu_factor": speeds(engines),
        "validity": shares(engines),
        "over_time": paces(engines),
        "unequal.equal": comparison(engines, (2.0, 1.0)),
        f"unequal.models.{name}": comparison(engines, (1.0, 2.0)),
    }
    cell = {"text": engines[0], "classes": ""}
    shown = [
        {"name": key, "title": f"{name}: {key}", "said": list(said_of(key, rows)), "records": rows, "note": name}
        | {"head": [cell], "rows": [[cell]]}
        for key, rows in records.items()
    ]
    plain = {"schema": 2, "study": name, "description": name, "small": False, "figures": name, "bad": [0]}
    plain |= {"said": [f"{name}: proof FAILED", "all else is done"], "sweeps": {name: shown}}
    plain |= {"measured": [{"what": "machine", "value": name}]}
    return StudyTables.model_validate_json(json.dumps(plain))
