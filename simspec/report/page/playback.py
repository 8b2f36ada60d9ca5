"""The playback of a page: shapes, motions, contact forces, and the targets of driven joints."""

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
from simspec.report.page.model import DIGITS, model_data
from simspec.report.page.packing import (
    FARTHEST,
    Numbers,
    PackedNumbers,
    Rows,
    ShownFrames,
    coded,
    drawable,
    turns,
    turns_unseen,
)
from simspec.report.page.shapes import Surfaces, drawn_shapes
from simspec.report.table import length
from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.runner.store import driven_joints
from simspec.world.kinematics import layout_of
from simspec.world.rotations import exponential, multiply, rotate
from simspec.world.types import Body, World

# Ghost: poses of bodies at the targets of driven joints.


def driven_bodies(world: World, run: Run) -> list[int]:
    """The bodies that a driven joint moves: those of the joints, and all that hang on them; parents first."""
    joints = set(driven_joints(run.provenance))
    driven: set[str] = set()
    for body in world.bodies:
        if body.joint.name in joints or body.joint.parent in driven:
            driven.add(body.name)
    return [index for index, body in enumerate(world.bodies) if body.name in driven]


def target_poses(world: World, run: Run, rows: Rows, bodies: list[int]) -> Numbers:
    """Poses (rows, all bodies, 7) in which ``bodies`` are where q* has them: driven joints at their targets, the others as the
    run had them. Bodies that do not depend on a driven joint are as the run had them."""
    poses = np.array(run.arrays["pose"][rows], dtype=np.float64)
    targets = np.asarray(run.arrays["control.target"][rows])
    q = np.asarray(run.arrays["q"][rows])
    column = {joint: index for index, joint in enumerate(driven_joints(run.provenance))}
    slots = layout_of(world).position
    index = {body.name: k for k, body in enumerate(world.bodies)}
    for k in bodies:
        body = world.bodies[k]
        joint = body.joint
        values = targets[:, column[joint.name], None] if joint.name in column else q[:, slots[k]]
        if joint.parent is None:
            start = np.broadcast_to(_row(body), (len(rows), 7))
        else:
            start = _after(poses[:, index[joint.parent]], _row(body))
        poses[:, k] = _after(start, _displacement(body, values))
    return poses


def _row(body: Body) -> Numbers:
    """The pose of a joint's frame in its parent's, (7,)."""
    return np.array([*body.joint.origin.position, *body.joint.origin.quaternion])


def _after(first: Numbers, second: Numbers) -> Numbers:
    """Poses (rows, 7): ``second``, given in the frames ``first``."""
    place = first[..., :3] + rotate(first[..., 3:], second[..., :3])
    return np.concatenate([place, multiply(first[..., 3:], second[..., 3:])], axis=-1)


def _displacement(body: Body, q: Numbers) -> Numbers:
    """Poses (rows, 7) of the body frame in its joint's, at joint positions (rows, n)."""
    rows = len(q)
    result = np.zeros((rows, 7))
    result[:, 3] = 1.0
    axis = np.array(body.joint.axis)
    if body.joint.kind == "hinge":
        result[:, 3:] = exponential(q * axis)
    elif body.joint.kind == "slide":
        result[:, :3] = q * axis
    elif body.joint.kind == "ball":
        result[:, 3:] = q
    return result


MOST_FORCES = 9_000
"""Contact forces of a run that are shown: about 0.1 MB packed. Where there are more, every second frame has them, or third …"""
LEAST_TURN = 1e-4
"""Change of a quaternion's parts below which a body is drawn as not turning."""


def scene_data(
    world: World, runs: Sequence[Run], frames: ShownFrames, packed: PackedNumbers, surfaces: Surfaces
) -> dict[str, Any]:
    """A scene as ``page/src/data.ts`` declares it, without its plots. ``runs``: those of ``frames``."""
    poses = [np.asarray(run.arrays["pose"][frames.rows[:shown]]) for run, shown in zip(runs, frames.shown, strict=True)]
    moving, turning = _movers(world, poses, frames)
    ghost = _ghost(world, runs, frames, packed)
    return {
        "name": visible(world.name),
        "times": packed.floats(frames.time),
        "frames": len(frames.rows),
        "bodies": [visible(body.name) for body in world.bodies],
        "shapes": drawn_shapes(world, packed, surfaces),
        "model": model_data(world),
        "low": frames.low.tolist(),
        "high": frames.high.tolist(),
        "rest": np.round(_rest(poses), DIGITS).tolist(),
        "moving": moving.tolist(),
        "turning": turning.tolist(),
        "runs": [
            {
                "engine": visible(run.engine),
                "label": visible(run.label),
                "colour": index,
                "frames": len(values),
                "motion": _motion(values, moving, turning, frames, packed),
                "forces": _forces(run, frames, len(values), packed),
            }
            for index, (run, values) in enumerate(zip(runs, poses, strict=True))
        ],
        "ghost": ghost,
        "view": {"centre": np.round(frames.centre, DIGITS).tolist(), "radius": round(frames.radius, DIGITS)},
    }


def _movers(world: World, poses: Sequence[Numbers], frames: ShownFrames) -> tuple[Rows, Rows]:
    """The bodies that are seen to move, and those of them that are seen to turn, in any of the runs."""
    changed = np.zeros(len(world.bodies), dtype=bool)
    turned = np.zeros(len(world.bodies), dtype=bool)
    for values in poses:
        changed |= np.ptp(values[..., :3], axis=0).max(axis=-1) > 0.5 * frames.step
        turned |= np.ptp(values[..., 3:], axis=0).max(axis=-1) > LEAST_TURN
    separate = np.ptp(np.stack([pose[0] for pose in poses]), axis=0).max(axis=-1) > 0.5 * frames.step
    unseen = np.array([turns_unseen(world, body) for body in range(len(world.bodies))], dtype=bool)
    moving = changed | turned | separate
    return np.flatnonzero(moving), np.flatnonzero(moving & ~unseen)


def _rest(poses: Sequence[Numbers]) -> Numbers:
    """The first poses (bodies, 7), for what does not move; 0 where even they cannot be drawn."""
    first = poses[0][0]
    return np.where(np.abs(first) < FARTHEST, first, 0.0)


def _motion(
    poses: Numbers, moving: Rows, turning: Rows, frames: ShownFrames, packed: PackedNumbers
) -> dict[str, Any] | None:
    """The motions of some bodies; None where not even the first poses can be drawn."""
    if not drawable(poses).all():
        return None
    places = coded(poses[:, moving, :3], frames.low, frames.high)
    return {
        "position": packed.series(_by_series(places)),
        "turn": packed.series(_by_series(turns(poses[:, turning, 3:]))) if len(turning) else None,
    }


def _by_series(codes: np.ndarray) -> np.ndarray:
    """Codes (frames, bodies, parts) as (bodies × parts, frames)."""
    return np.ascontiguousarray(codes.transpose(1, 2, 0)).reshape(-1, len(codes))


def _forces(run: Run, frames: ShownFrames, shown: int, packed: PackedNumbers) -> dict[str, Any] | None:
    """The contact forces of every few frames, a bar for each; None where none were recorded, or there were none."""
    arrays = run.arrays
    if "contact.row" not in arrays:
        return None
    row = arrays["contact.row"]
    first = np.searchsorted(row, frames.rows[:shown], side="left")
    end = np.searchsorted(row, frames.rows[:shown], side="right")
    counts = end - first
    every = 1
    while counts[::every].sum() > MOST_FORCES and every < shown:
        every += 1
    places = [np.arange(first[k], end[k]) for k in range(0, shown, every)]
    chosen = np.concatenate(places) if places else np.zeros(0, np.int64)
    frame = np.repeat(np.arange(0, shown, every), counts[::every])
    force = np.asarray(arrays["contact.normal_force"][chosen])
    position, normal = np.asarray(arrays["contact.position"][chosen]), np.asarray(arrays["contact.normal"][chosen])
    kept = (force > 0.0) & np.isfinite(force) & np.isfinite(position).all(axis=1) & np.isfinite(normal).all(axis=1)
    if not kept.any():
        return None
    force, position, normal, frame = force[kept], position[kept], normal[kept], frame[kept]
    largest = float(force.max())
    return {
        "frame": packed.codes(frame.astype(np.int16)),
        "position": packed.codes(np.ascontiguousarray(coded(position, frames.low, frames.high).T)),
        "normal": packed.add(
            np.ascontiguousarray(np.round(127.0 * np.clip(normal, -1, 1)).astype(np.int8).T).tobytes()
        ),
        "force": packed.add(np.round(255.0 * np.sqrt(force / largest)).astype(np.uint8).tobytes()),
        "count": len(force),
        "every": every,
        "largest": largest,
    }


def _ghost(world: World, runs: Sequence[Run], frames: ShownFrames, packed: PackedNumbers) -> dict[str, Any] | None:
    """The target poses of driven joints, from the run that has the most; None where none is driven."""
    run, shown = max(zip(runs, frames.shown, strict=True), key=lambda pair: pair[1])
    if "control.target" not in run.arrays:
        return None
    bodies = driven_bodies(world, run)
    poses = target_poses(world, run, frames.rows[:shown], bodies)
    every = np.array(bodies)
    if not drawable(poses).all():
        return None
    return {
        "bodies": bodies,
        "motion": _motion(poses[:, every], np.arange(len(bodies)), np.arange(len(bodies)), frames, packed),
    }


# Plots over time: differences and noise, energy, contacts, errors of driven joints.

LEAST = 1e-18
"""The value (m) that a logarithmic axis shows in place of zero: a thousandth of a double's last bit at 1 m."""
UNITS = {"hinge": "rad", "slide": "m"}


@dataclass(frozen=True)
class PlotCurve:
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
    curves: tuple[PlotCurve, ...]
    logarithmic: bool = False

    def data(self, packed: PackedNumbers) -> dict[str, Any]:
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


def charts(study: Study, runs: Sequence[Run], frames: ShownFrames) -> list[Chart]:
    """The plots of a study; ``runs``: those of ``frames``. A channel that no run recorded has no plot."""
    shown = [frames.rows[:count] for count in frames.shown]
    made = [_differences(study, runs, frames, shown), _energy(study.world, runs, shown), *_contacts(runs, shown)]
    made += _tracking(study.world, runs, shown)
    return [chart for chart in made if chart is not None and chart.curves]


def _differences(study: Study, runs: Sequence[Run], frames: ShownFrames, shown: Sequence[Rows]) -> Chart | None:
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
        curves.append(PlotCurve(label, np.maximum(largest, LEAST), number, number))
    if study.diffs:
        tolerance = study.diffs[0].tolerance
        if tolerance > 0.0:
            curves.append(
                PlotCurve(f"tolerance {length(tolerance)}", np.full(len(frames.rows), tolerance), kind="limit")
            )
    return Chart("Largest difference of any body's position", "m", tuple(curves), logarithmic=True)


def _largest_distances(a: Run, b: Run, rows: Rows, moving: Rows) -> Numbers:
    """The largest distance (m) of any moving body, (rows,)."""
    position, _ = deviations(a.arrays["pose"][rows][:, moving], b.arrays["pose"][rows][:, moving])
    largest: Numbers = position.max(axis=1)
    return largest


def _noise(study: Study, moving: Rows, rows: Rows) -> PlotCurve | None:
    """The level below which differences cannot be distinguished from round-off; None without floors."""
    if not study.floors:
        return None
    worst = np.zeros(len(rows))
    for floor in study.floors.values():
        full = np.full(len(rows), np.inf)
        inside = rows < len(floor.position)
        full[inside] = floor.position[rows[inside]][:, moving].max(axis=1)
        worst = np.maximum(worst, full)
    return PlotCurve(f"{FLOOR_FACTOR:g} × the engines' noise", np.maximum(FLOOR_FACTOR * worst, LEAST), kind="band")


def _part(run: Run, rows: Rows) -> dict[str, Numbers]:
    return {name: np.asarray(run.arrays[name][rows]) for name in ("q", "v", "pose", "velocity")}


def _energy(world: World, runs: Sequence[Run], shown: Sequence[Rows]) -> Chart:
    curves = [
        PlotCurve(run.engine, sum(metrics.energy(world, _part(run, rows)), np.zeros(len(rows))), index, index)
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
        counts.append(PlotCurve(run.engine, count, index, index))
        forces.append(PlotCurve(run.engine, force, index, index))
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
    """The largest distance of driven joints from their targets, hinges and slides separately."""
    for kind in SCALAR_JOINTS:
        curves = []
        for index, (run, rows) in enumerate(zip(runs, shown, strict=True)):
            kinds = {body.joint.name: body.joint.kind for body in world.bodies}
            joints = [joint for joint in driven_joints(run.provenance) if kinds.get(joint) == kind]
            if joints and "control.target" in run.arrays:
                errors = [np.abs(run.q(joint)[rows] - run.target(joint)[rows]) for joint in joints]
                curves.append(PlotCurve(run.engine, np.max(errors, axis=0), index, index))
        if curves:
            yield Chart(f"Largest distance of a driven {kind} from its target", UNITS[kind], tuple(curves))
