"""The trajectory of a world, from points, a table or a program; held against the joints that it moves."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from simspec.errors import Problem
from simspec.resolve.tables import QUANTITIES, read_table
from simspec.spec.document import Key
from simspec.spec.sources import Source
from simspec.spec.strict import Faults, near
from simspec.spec.trajectory import BY_JOINT
from simspec.world.control import Trajectory
from simspec.world.types import World

BETWEEN = np.linspace(0.0, 1.0, 9)
"""Where between two points speeds are looked at: a cubic's speed is a parabola, a quintic's of fourth degree."""
SLACK = 1e-6
"""Relative: a speed that stands at its limit by intention is not above it for its round-off."""
MOST_REPORTED = 10
"""Problems of one kind that are reported; the others are counted."""

Place = Callable[[int, str], tuple[Key, ...]]
"""Path in the spec of a row and a joint."""


@dataclasses.dataclass
class _Draft:
    """Joints, times and arrays by quantity, before they are checked; ``place`` and ``where`` say where a row comes from."""

    joints: tuple[str, ...]
    times: np.ndarray
    values: Mapping[str, np.ndarray]
    place: Place
    where: Callable[[int], str]


def trajectory(
    source: Source, world: World, velocity_limits: Mapping[str, float]
) -> tuple[Trajectory | None, list[Problem]]:
    """The trajectory of a spec for its ``world`` (controllers included), and what is wrong with it. ``velocity_limits``:
    by the joint's full name (rad/s, m/s)."""
    given = source.file.trajectory
    if given is None:
        return None, []
    if not world.controllers:
        message = "a trajectory, and no controller that follows it"
        return None, [
            source.document.problem(("trajectory",), message, key=True, hint="control: {NAME: {joints: ...}}")
        ]
    problems: list[Problem] = []
    if given.points is not None:
        draft = _of_points(source, world, problems)
    elif given.file is not None:
        draft = _of_table(source, world, problems)
    else:
        draft = _of_program(source, world, problems)
    if draft is None or problems:
        return None, problems
    made = Trajectory(
        joints=draft.joints,
        times=tuple(draft.times.tolist()),
        interpolation=given.interpolation,
        **{name: tuple(map(tuple, draft.values[name].tolist())) for name in QUANTITIES if name in draft.values},
    )
    check = _Check(source, world, draft, made)
    check.limits()
    check.speeds(velocity_limits)
    return made, check.problems


def _known_joints(world: World, names: tuple[str, ...], report: Callable[[str, str, dict], None]) -> None:
    """Report names that are no joints, joints that do not move so, and joints that nobody drives."""
    kinds = {body.joint.name: body.joint.kind for body in world.bodies}
    driven = {joint for one in world.controllers for joint in one.joints}
    for name in names:
        if name not in kinds:
            report(name, f"there is no joint {name!r}", {"found": name, "hint": near(name, driven)})
        elif name not in driven:
            message = f"{name} moves here, and no controller drives it"
            report(name, message, {"found": name, "hint": "control: {NAME: {joints: [...]}}"})


def _of_points(source: Source, world: World, problems: list[Problem]) -> _Draft | None:
    given = source.file.trajectory
    joints = tuple(given.points[0].positions)

    def path(row: int, joint: str, quantity: str = "positions") -> tuple[Key, ...]:
        return ("trajectory", "points", row, quantity, joint)

    def report(name: str, message: str, more: dict) -> None:
        problems.append(source.document.problem(path(0, name), message, key=True, **more))

    _known_joints(world, joints, report)
    if problems:
        return None
    kinds = {body.joint.name: body.joint.kind for body in world.bodies}
    values: dict[str, np.ndarray] = {}
    for quantity in QUANTITIES:
        if getattr(given.points[0], quantity) is None:
            continue
        array = np.zeros((len(given.points), len(joints)))
        for row, point in enumerate(given.points):
            for column, joint in enumerate(joints):
                try:
                    number = BY_JOINT[quantity].number(kinds[joint])
                    array[row, column] = number.read(getattr(point, quantity)[joint])
                except Faults as error:
                    place = path(row, joint, quantity)
                    problems += [
                        source.document.problem(place, one.message, found=one.found, allowed=one.allowed, hint=one.hint)
                        for one in error.faults
                    ]
        values[quantity] = array
    times = np.array([point.at for point in given.points])
    return _Draft(joints, times, values, path, lambda row: f"at {times[row]:g} s")


def _of_table(source: Source, world: World, problems: list[Problem]) -> _Draft | None:
    place = ("trajectory", "file")
    if source.table is None:
        return None  # reported where files are sought
    table = read_table(source.table)
    for message, found, allowed in table.wrong:
        problems.append(source.document.problem(place, message, found=found, allowed=allowed))
    if problems:
        return None
    _known_joints(
        world,
        table.joints,
        lambda _, message, more: problems.append(source.document.problem(place, message, **more)),
    )
    later = np.flatnonzero(np.diff(table.times) <= 0.0)
    if len(later):
        row = int(later[0]) + 1
        found = f"row {row + 1}: {table.times[row]:g} s after {table.times[row - 1]:g} s"
        problems.append(source.document.problem(place, "times must increase", found=found))
    if table.times[0] < 0.0:
        problems.append(source.document.problem(place, "times begin at 0 or later", found=f"{table.times[0]:g} s"))
    _needed(source, table.values, problems)
    return _Draft(
        table.joints,
        table.times,
        table.values,
        lambda row, joint: place,
        lambda row: f"in row {row + 1}, at {table.times[row]:g} s",
    )


def _needed(source: Source, values: Mapping[str, Any], problems: list[Problem]) -> None:
    """What an interpolation makes nothing of, in a table."""
    interpolation = source.file.trajectory.interpolation
    given = {name for name in ("velocities", "accelerations") if name in values}
    allowed = {"cubic": {"velocities"}, "quintic": {"velocities", "accelerations"}}.get(interpolation, set())
    for name in sorted(given - allowed):
        message = f"{name} mean nothing with interpolation {interpolation}"
        problems.append(source.document.problem(("trajectory", "file"), message))
    if interpolation == "quintic" and len(given) == 1:
        message = "quintic wants velocities and accelerations, or neither"
        problems.append(source.document.problem(("trajectory", "file"), message))


def _of_program(source: Source, world: World, problems: list[Problem]) -> _Draft | None:
    try:
        from simspec.resolve.moves import Program, tables

        program = Program(source, world)
        rows = program.solve()
    except ModuleNotFoundError as error:
        message = f"a program of moves needs a library that is not installed ({error.name})"
        hint = "pip install 'simspec[pin]'"
        problems.append(source.document.problem(("trajectory", "program"), message, key=True, hint=hint))
        return None
    problems += program.problems
    if rows is None:
        return None
    values = dict(tables(rows))
    if not values["efforts"].any():
        del values["efforts"]
    return _Draft(
        rows.joints,
        np.array(rows.times),
        values,
        lambda row, joint: ("trajectory", "program", rows.steps[row]),
        lambda row: f"at {rows.times[row]:.4g} s",
    )


class _Check:
    """What must hold of a trajectory as it will be followed, between its points too."""

    def __init__(self, source: Source, world: World, draft: _Draft, made: Trajectory):
        from simspec.control.reference import positions

        self._source, self._world, self._draft = source, world, draft
        self.problems: list[Problem] = []
        self._times = np.concatenate(
            [first + BETWEEN * (last - first) for first, last in zip(draft.times, draft.times[1:], strict=False)]
            or [draft.times]
        )
        self._row = np.minimum(np.arange(len(self._times)) // len(BETWEEN) + 1, len(draft.times) - 1)
        self._positions, self._speeds = positions(made).at(self._times, 1)

    def _report(self, exceeded: np.ndarray, message: Callable[[int, int], Mapping[str, str]]) -> None:
        """One problem for each joint that exceeds something, at its worst place; ``exceeded`` (times, joints), ≤ 0: it does
        not."""
        columns = np.flatnonzero((exceeded > 0.0).any(axis=0))
        for column in columns[:MOST_REPORTED]:
            worst = int(exceeded[:, column].argmax())
            row = int(self._row[worst])
            text = dict(message(worst, int(column)))
            path = self._draft.place(row, self._draft.joints[column])
            self.problems.append(self._source.document.problem(path, text.pop("message"), **text))

    def limits(self) -> None:
        """Positions beyond the joints' limits, also between points."""
        by_name = {body.joint.name: body.joint for body in self._world.bodies}
        bounds = [by_name[name].position_limits or (-np.inf, np.inf) for name in self._draft.joints]
        low, high = (np.array(side) for side in zip(*bounds, strict=True))
        beyond = np.maximum(low - self._positions, self._positions - high)
        # a spline swings over a point that stands at a limit by about a thousandth of its way
        swing = 1e-3 * np.ptp(self._positions, axis=0) if len(self._draft.times) > 1 else 0.0

        def message(at: int, column: int) -> dict[str, str]:
            name, value = self._draft.joints[column], self._positions[at, column]
            return {
                "message": f"{name} goes beyond its limits {self._when(at)}",
                "found": f"{value:.6g}",
                "allowed": f"{low[column]:g} to {high[column]:g}",
            }

        self._report(beyond - swing, message)

    def speeds(self, limits: Mapping[str, float]) -> None:
        """Speeds above the joints' limits."""
        if self._draft.values and self._source.file.trajectory.interpolation == "hold":
            return  # a jump has no speed; the controller sees its whole error at once
        allowed = np.array([limits.get(name, np.inf) for name in self._draft.joints])

        def message(at: int, column: int) -> dict[str, str]:
            name, value = self._draft.joints[column], abs(self._speeds[at, column])
            return {
                "message": f"{name} is faster than its velocity limit {self._when(at)}",
                "found": f"{value:.4g}",
                "allowed": f"up to {allowed[column]:g}",
                "hint": "more time, or a shorter way",
            }

        self._report(np.abs(self._speeds) - allowed * (1.0 + SLACK), message)

    def _when(self, at: int) -> str:
        if self._source.file.trajectory.file is not None:
            return self._draft.where(int(self._row[at]))
        return f"at {self._times[at]:.4g} s"
