"""The plots of a page: differences beside the engines' own noise, energy, contacts, errors of driven joints, over time."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.comparison.floor import FLOOR_FACTOR, deviations
from simspec.comparison.study import Study
from simspec.errors import visible
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.report.page.packing import Frames, Numbers, Packed, Rows
from simspec.report.table import length
from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.runner.store import driven_joints
from simspec.world.types import World

LEAST = 1e-18
"""What a logarithmic axis shows in place of zero, in m: a thousandth of a double's last bit at 1 m."""
UNITS = {"hinge": "rad", "slide": "m"}


@dataclass(frozen=True)
class Curve:
    """One line of a plot: values at the first so many frames. ``kind``: ``line``, ``band`` (filled from below) or ``limit``."""

    label: str
    values: Numbers
    colour: int = 0
    dash: int = 0
    kind: str = "line"


@dataclass(frozen=True)
class Chart:
    """A plot over time."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    logarithmic: bool = False

    def data(self, packed: Packed) -> dict[str, Any]:
        """As ``page/src/data.ts`` declares it."""
        return {
            "title": self.title,
            "unit": self.unit,
            "logarithmic": self.logarithmic,
            "lines": [
                {
                    "label": visible(curve.label),
                    "values": packed.floats(curve.values),
                    "colour": curve.colour,
                    "dash": curve.dash,
                    "kind": curve.kind,
                }
                for curve in self.curves
            ],
        }


def charts(study: Study, runs: Sequence[Run], frames: Frames) -> list[Chart]:
    """The plots of a study; ``runs``: those of ``frames``. What no run recorded has no plot."""
    shown = [frames.rows[:count] for count in frames.shown]
    made = [_differences(study, runs, frames, shown), _energy(study.world, runs, shown), *_contacts(runs, shown)]
    made += _tracking(study.world, runs, shown)
    return [chart for chart in made if chart is not None and chart.curves]


def _differences(study: Study, runs: Sequence[Run], frames: Frames, shown: Sequence[Rows]) -> Chart | None:
    """For each pair the largest distance of any body; the tolerance; and what is within the engines' own noise."""
    moving = metrics.moving_bodies(study.world)
    if not len(moving) or (len(runs) < 2 and not study.floors):
        return None
    curves = []
    if noise := _noise(study, moving, frames.rows):
        curves.append(noise)
    for number, (a, b) in enumerate(itertools.combinations(range(len(runs)), 2)):
        rows = min(shown[a], shown[b], key=len)
        if not np.array_equal(runs[a].time[rows], runs[b].time[rows]):
            continue  # recorded at other times: the table of differences compares what they have in common
        largest = _largest_distances(runs[a], runs[b], rows, moving)
        label = f"{runs[a].engine} – {runs[b].engine}"
        curves.append(Curve(label, np.maximum(largest, LEAST), number, number))
    if study.diffs:
        tolerance = study.diffs[0].tolerance
        if tolerance > 0.0:
            curves.append(Curve(f"tolerance {length(tolerance)}", np.full(len(frames.rows), tolerance), kind="limit"))
    return Chart("Largest difference of any body's position", "m", tuple(curves), logarithmic=True)


def _largest_distances(a: Run, b: Run, rows: Rows, moving: Rows) -> Numbers:
    """The largest distance (m) of any moving body, (rows,)."""
    position, _ = deviations(a.arrays["pose"][rows][:, moving], b.arrays["pose"][rows][:, moving])
    largest: Numbers = position.max(axis=1)
    return largest


def _noise(study: Study, moving: Rows, rows: Rows) -> Curve | None:
    """Below this, differences are not told apart from round-off; what was not measured is left out."""
    if not study.floors:
        return None
    worst = np.zeros(len(rows))
    for floor in study.floors.values():
        own = np.full(len(rows), np.inf)
        inside = rows < len(floor.position)
        own[inside] = floor.position[rows[inside]][:, moving].max(axis=1)
        worst = np.maximum(worst, own)
    return Curve(f"{FLOOR_FACTOR:g} × the engines' noise", np.maximum(FLOOR_FACTOR * worst, LEAST), kind="band")


def _part(run: Run, rows: Rows) -> dict[str, Numbers]:
    return {name: np.asarray(run.arrays[name][rows]) for name in ("q", "v", "pose", "velocity")}


def _energy(world: World, runs: Sequence[Run], shown: Sequence[Rows]) -> Chart:
    curves = [
        Curve(run.engine, sum(metrics.energy(world, _part(run, rows)), np.zeros(len(rows))), index, index)
        for index, (run, rows) in enumerate(zip(runs, shown, strict=True))
    ]
    return Chart("Energy of all bodies", "J", tuple(curves))


def _contacts(runs: Sequence[Run], shown: Sequence[Rows]) -> Iterator[Chart]:
    recorded = [
        (index, run, rows)
        for index, (run, rows) in enumerate(zip(runs, shown, strict=True))
        if "contact.row" in run.arrays
    ]
    counts, forces = [], []
    for index, run, rows in recorded:
        count, force = _contacts_at(run, rows)
        counts.append(Curve(run.engine, count, index, index))
        forces.append(Curve(run.engine, force, index, index))
    if any(curve.values.any() for curve in counts):
        yield Chart("Contact points", "", tuple(counts))
        yield Chart("Sum of the contacts' normal forces", "N", tuple(forces))


def _contacts_at(run: Run, rows: Rows) -> tuple[Numbers, Numbers]:
    """Number of contacts, and sum of their normal forces (N), at some rows of a recording that may be longer than memory."""
    row, force = run.arrays["contact.row"], run.arrays["contact.normal_force"]
    first, last = np.searchsorted(row, rows, side="left"), np.searchsorted(row, rows, side="right")
    sums = [float(np.sum(force[start:end])) for start, end in zip(first, last, strict=True)]
    return (last - first).astype(np.float64), np.array(sums)


def _tracking(world: World, runs: Sequence[Run], shown: Sequence[Rows]) -> Iterator[Chart]:
    """The largest distance of driven joints from their targets, hinges and slides apart."""
    for kind in SCALAR_JOINTS:
        curves = []
        for index, (run, rows) in enumerate(zip(runs, shown, strict=True)):
            kinds = {body.joint.name: body.joint.kind for body in world.bodies}
            joints = [joint for joint in driven_joints(run.provenance) if kinds.get(joint) == kind]
            if joints and "control.target" in run.arrays:
                errors = [np.abs(run.q(joint)[rows] - run.target(joint)[rows]) for joint in joints]
                curves.append(Curve(run.engine, np.max(errors, axis=0), index, index))
        if curves:
            yield Chart(f"Largest distance of a driven {kind} from its target", UNITS[kind], tuple(curves))
