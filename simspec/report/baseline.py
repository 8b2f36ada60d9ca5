"""Figures of a study kept as a baseline: places, quantities and verdicts of each engine's run, and its speed."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path

import numpy as np

from simspec.analysis.run_figures import alike_size, half_width
from simspec.comparison.floor import Floor
from simspec.comparison.runs import summary
from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError
from simspec.experiments.machine import Machine
from simspec.experiments.timing import disturbed
from simspec.outputs.reading import read_bytes
from simspec.runner.metrics import moving_bodies
from simspec.runner.run import Run
from simspec.stored import StoredBaseline, parse, read_as
from simspec.world.canonical import sha256

SCHEMA = 1
BEGINNING = b'{\n "simspec_baseline"'
"""How each of these files begins: what simspec may replace."""
LARGEST_BASELINE = 64 * 2**20
"""Bytes: 10,000 bodies at five moments in four engines have 50."""
MOMENTS = 5
"""Times at which places are kept, evenly spaced up to the end: in a chaotic scene only the early ones can be compared."""
LEAST_TIMED = 3
"""Processes from which there is a spread."""


HIDDEN = "the engine's own noise is above the tolerance"


class Kind(StrEnum):
    """What a figure is about."""

    PHYSICS = "physics"
    VERDICT = "verdict"
    SPEED = "speed"


@dataclass(frozen=True, slots=True)
class Figure:
    """``value``: numbers in ``unit``; ``interval``: for each the smallest and the largest that are not told apart from it;
    ``not_compared``: why the figure says nothing, "" where it does."""

    key: str
    kind: Kind
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
    figures: Mapping[str, Figure] = field(default_factory=dict)

    @property
    def has_speed(self) -> bool:
        """Whether speed was measured."""
        return any(figure.kind is Kind.SPEED for figure in self.figures.values())

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
        rows = []
        for one in self.figures.values():
            row = {"key": one.key, "kind": one.kind, "unit": one.unit, "value": one.value, "interval": one.interval}
            rows.append(json.dumps(row | {"not_compared": one.not_compared}, ensure_ascii=False, allow_nan=False))
        lines = json.dumps(head, indent=1, ensure_ascii=False, allow_nan=False).removesuffix("\n}")
        return f'{lines},\n "figures": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"


def own_baseline(content: bytes) -> bool:
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
        raise SpecError([Problem(f"{path}: {why}", hint="--write-baseline FILE writes a new one")])
    stored = read_as(StoredBaseline, content, str(path))
    figures = {}
    for one in stored.figures:
        intervals = tuple((low, high) for low, high in one.interval)
        if len(one.value) != len(intervals) or one.key in figures or any(low > high for low, high in intervals):
            raise SpecError([Problem(f"{path} cannot be read: figure {one.key!r} is damaged, or is there twice")])
        figures[one.key] = Figure(one.key, Kind(one.kind), one.unit, tuple(one.value), intervals, one.not_compared)
    machine = Machine(**stored.machine.model_dump())
    return Baseline(stored.spec, stored.world_sha256, stored.simspec, stored.versions, machine, figures)


# --- figures of a study -----------------------------------------------------------------------------------------------


def baseline_of(study: Study, timed: Iterable[Run], tolerance: float, machine: Machine) -> Baseline:
    """The figures of a study, and of runs that were timed (:mod:`simspec.experiments.timing`).

    ``tolerance`` (m): figures of a run whose own noise grows past it are kept, and not compared from then on.
    """
    figures: list[Figure] = []
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
    by_key = {one.key: one for one in figures}
    return Baseline(study.world.name, sha256(study.world), version("simspec"), versions, machine, by_key)


def _verdict(key: str, passed: bool) -> Figure:
    return Figure(key, Kind.VERDICT, "", (float(passed),), ((float(passed), float(passed)),))


def _hidden(noise: float, tolerance: float) -> str:
    """Why a figure says nothing: "" where its noise is within the tolerance."""
    return "" if noise <= tolerance else f"{HIDDEN}: {noise:.2g}, tolerance {tolerance:.2g}"


def _places(run: Run, floor: Floor | None, tolerance: float) -> list[Figure]:
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


def _quantities(run: Run, repeats: Sequence[Run], floor: Floor | None, tolerance: float) -> list[Figure]:
    """What summarises a run: energy, momentum, contacts; their noise is that of the repeats."""
    from simspec.comparison.runs import QUANTITIES

    values, again = summary(run), [summary(other) for other in repeats if other.failed is None]
    why = _hidden(floor.largest, tolerance) if floor is not None and again else "noise was not measured"
    figures = []
    for name, unit in QUANTITIES:
        if name not in values:
            continue
        value = values[name]
        noise = max((abs(other[name] - value) for other in again if name in other), default=0.0)
        half = half_width(run, alike_size(values, unit), noise)
        figures.append(_around(f"{run.engine}/{name}", unit, [value], 0.0 if why else half, why))
    return figures


def _around(key: str, unit: str, values: Sequence[float], half: float, why: str) -> Figure:
    if not all(map(math.isfinite, (*values, half))):
        return Figure(key, Kind.PHYSICS, unit, (), (), "it is not finite")
    return Figure(key, Kind.PHYSICS, unit, tuple(values), tuple((value - half, value + half) for value in values), why)


def _speeds(runs: Sequence[Run]) -> list[Figure]:
    """The speed of each engine: median, smallest and largest over processes."""
    figures = []
    for engine in dict.fromkeys(run.engine for run in runs):
        own = [run for run in runs if run.engine == engine and run.failed is None]
        busy = [why for run in own for why in disturbed(run)]
        few = f"{len(own)} processes, of at least {LEAST_TIMED}" if len(own) < LEAST_TIMED else ""
        for name, values, why in (
            ("speed by processor time", [run.cpu_factor for run in own], few),
            ("speed by wall time", [run.real_time_factor for run in own], few or (busy[0] if busy else "")),
        ):
            known = [value for value in values if value is not None]
            if known:
                interval = ((min(known), max(known)),)
                figures.append(
                    Figure(f"{engine}/{name}", Kind.SPEED, "s/s", (statistics.median(known),), interval, why)
                )
    return figures
