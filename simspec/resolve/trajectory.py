"""The trajectory of a world, from points, a table or a program; held against the joints that it moves."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from simspec.errors import MOST_PROBLEMS, Problem
from simspec.language.actions import BY_JOINT, MOST_NUMBERS, TrajectoryPoint
from simspec.language.arrays import CLASH_HINT, chosen, clash_words, entry_of
from simspec.language.document import Details, Key
from simspec.language.sources import Source
from simspec.language.strict import Faults, near, required
from simspec.resolve.actuators import ResolvedGrasp, grasps
from simspec.resolve.tables import QUANTITIES, read_table
from simspec.world.actions import JointTrajectory
from simspec.world.types import World

BETWEEN = np.linspace(0.0, 1.0 - 1e-9, 17)
"""Where between two points positions and speeds are looked at. A cubic's speed is a parabola, a quintic's of fourth degree:
a thousandth of the largest can be missed. The end itself belongs to what follows, or to rest."""
AT_ONCE = 500_000
"""Numbers that are looked at together."""
SHORTEST = 1e-9
"""Seconds between two points: far below every timestep, far above round-off of times of some hours."""
EDGE = 1e-8
"""rad or m that a point may stand beyond a limit: round-off of degrees, and of a program's points."""
SWING = 1e-3
"""How far a curve may swing beyond a limit between its points, as a share of the joint's whole way: the overshoot of a spline
behind a point at the limit."""
SLACK = 1e-6
"""Relative: a speed that stands at its limit by intention is not above it for its round-off."""
MOST_REPORTED = 10
"""Joints whose worst excess is reported."""


@dataclasses.dataclass
class _TrajectoryDraft:
    """Joints, times and arrays by quantity, before they are checked. ``place``: the path in the spec of a row and a joint;
    ``label``: the name of a row in messages, besides its time."""

    joints: tuple[str, ...]
    times: np.ndarray
    values: Mapping[str, np.ndarray]
    place: Callable[[int, str], tuple[Key, ...]]
    label: Callable[[int], str] = lambda row: ""

    def made(self, world: World, interpolation: str) -> JointTrajectory:
        """The world's trajectory, columns in the order of the world's bodies."""
        columns = {name: column for column, name in enumerate(self.joints)}
        order = [columns[body.joint.name] for body in world.bodies if body.joint.name in columns]
        values = {name: self.values[name][:, order].tolist() for name in QUANTITIES if name in self.values}
        return JointTrajectory(
            joints=tuple(self.joints[column] for column in order),
            times=tuple(self.times.tolist()),
            interpolation=interpolation,
            **{name: tuple(map(tuple, rows)) for name, rows in values.items()},
        )


def trajectory(
    source: Source, world: World, velocity_limits: Mapping[str, float]
) -> tuple[JointTrajectory | None, list[Problem]]:
    """The trajectory of a spec for its ``world`` (controllers included), and what is wrong with it and with the grasps of
    the models. ``velocity_limits``: by the joint's full name (rad/s, m/s)."""
    known, problems = grasps(source, world)
    written = source.content.trajectory
    if written is None:
        return None, problems
    if not world.controllers:
        message = "a trajectory without a controller that follows it"
        hint = "control: {NAME: {joints: ...}}"
        return None, [*problems, source.document.problem(("trajectory",), message, key=True, hint=hint, code="S302")]
    try:
        if written.points is not None:
            draft = _of_points(source, world, problems)
        elif written.file is not None:
            draft = _of_table(source, world, problems)
        else:
            draft = None if problems else _of_program(source, world, known, problems)
        if draft is None or problems:
            return None, problems
        made = draft.made(world, written.interpolation)
        check = _Check(source, world, draft, made)
        problems += check.points() or check.between(velocity_limits)
    except ModuleNotFoundError as error:
        message = f"this trajectory needs a library that is not installed ({error.name})"
        hint = "pip install 'simspec-physics[pin]'"
        return None, [*problems, source.document.problem(("trajectory",), message, key=True, hint=hint, code="C110")]
    return made, problems


# --- three ways to say one -----------------------------------------------------------------------------------------


def _unusable(world: World, names: tuple[str, ...]) -> Iterator[tuple[str, str, Details]]:
    """Names that are no joints, and joints without a controller: (name, what is wrong, more)."""
    known = {body.joint.name for body in world.bodies}
    driven = {joint for controller in world.controllers for joint in controller.joints}
    for name in names:
        if name not in known:
            yield name, f"there is no joint {name!r}", {"code": "S302", "found": name, "hint": near(name, driven)}
        elif name not in driven:
            message = f"{name} moves here, but no controller drives it"
            yield name, message, {"code": "S717", "found": name, "hint": "control: {NAME: {joints: [...]}}"}


def _driven(world: World) -> list[str]:
    """Joints that controllers drive, in the order of the world's bodies."""
    driven = {joint for controller in world.controllers for joint in controller.joints}
    return [body.joint.name for body in world.bodies if body.joint.name in driven]


Entries = Mapping[str, str]
"""By joint the entry of a mapping that it has its value from."""


class _Entries:
    """Of every quantity of every point the entry that each joint has its value from. A pattern means driven joints; a name is
    taken as it is, and has precedence (:func:`simspec.language.arrays.entry_of`)."""

    def __init__(self, points: Sequence[TrajectoryPoint], world: World):
        self.driven = _driven(world)
        self.problems: list[tuple[int, str, str, str, Details]] = []
        """Point, quantity, entry (empty: all of it), what is wrong, and more."""
        self._known: dict[tuple[str, ...], Entries] = {}
        self._of: dict[tuple[int, str], Entries] = {}
        for row, point in enumerate(points):
            for quantity in QUANTITIES:
                if (values := getattr(point, quantity)) is not None:
                    self._of[row, quantity] = self._read(row, quantity, values)
        first = self._of[0, "positions"]
        for (row, quantity), entries in self._of.items():
            if unknown := sorted(entries.keys() ^ first.keys()):
                found: Details = {"code": "S707", "found": f"differs in {', '.join(unknown[:6])}"}
                self.problems.append((row, quantity, "", "not the joints of the first point", found))
        self.joints = tuple(first)

    def of(self, row: int, quantity: str) -> Entries:
        """By joint; empty where the point has no such quantity."""
        return self._of.get((row, quantity), {})

    def _read(self, row: int, quantity: str, values: Mapping[str, Any]) -> Entries:
        if not any("*" in entry for entry in values):
            return self._known.setdefault(tuple(values), dict(zip(values, values, strict=True)))
        entries, clashes = entry_of(values, lambda entry: chosen(entry, self.driven) if "*" in entry else [entry])
        for entry in values:
            if "*" in entry and not chosen(entry, self.driven):
                allowed: Details = {"code": "S302", "allowed": ", ".join(self.driven[:20])}
                self.problems.append((row, quantity, entry, f"no driven joint that {entry!r} could mean", allowed))
        for clash in clashes:
            self.problems.append((row, quantity, clash.other, clash_words(clash), {"code": "S304", "hint": CLASH_HINT}))
        return entries


def _of_points(source: Source, world: World, problems: list[Problem]) -> _TrajectoryDraft | None:
    points = required(required(source.content.trajectory).points)
    entries = _Entries(points, world)

    def path(row: int, joint: str, quantity: str = "positions") -> tuple[Key, ...]:
        return ("trajectory", "points", row, quantity, entries.of(row, quantity).get(joint, joint))

    for row, quantity, entry, message, more in entries.problems[:MOST_PROBLEMS]:
        place: tuple[Key, ...] = ("trajectory", "points", row, quantity, *([entry] if entry else []))
        at_entry: Details = {**more, "key": bool(entry)}
        problems.append(source.document.problem(place, message, **at_entry))
    for name, message, about in _unusable(world, entries.joints):
        details: Details = {**about, "key": True}
        problems.append(source.document.problem(path(0, name), message, **details))
    joints = entries.joints
    if len(points) * len(joints) > MOST_NUMBERS:
        found = f"{len(points)} points of {len(joints)} joints"
        allowed = f"up to {MOST_NUMBERS}"
        problems.append(
            source.document.problem(
                ("trajectory", "points"), "too many numbers", found=found, allowed=allowed, code="S109"
            )
        )
    if problems:
        return None
    kinds = {body.joint.name: body.joint.kind for body in world.bodies}
    values: dict[str, np.ndarray] = {}
    for quantity in QUANTITIES:
        if getattr(points[0], quantity) is None:
            continue
        array = np.zeros((len(points), len(joints)))
        for column, joint in enumerate(joints):
            number = BY_JOINT[quantity].number(kinds[joint])
            for row, point in enumerate(points):
                try:
                    array[row, column] = number.read(getattr(point, quantity)[entries.of(row, quantity)[joint]])
                except Faults as error:
                    place = path(row, joint, quantity)
                    problems += [
                        source.document.problem(
                            place, item.message, found=item.found, allowed=item.allowed, hint=item.hint, code=item.code
                        )
                        for item in error.faults
                    ]
        values[quantity] = array
    return _TrajectoryDraft(joints, np.array([point.at for point in points]), values, path)


def _of_table(source: Source, world: World, problems: list[Problem]) -> _TrajectoryDraft | None:
    place = ("trajectory", "file")
    if source.table is None:
        raise ValueError("a spec whose table is not found is not resolved")

    def refuse(message: str, **more: Unpack[Details]) -> None:
        problems.append(source.document.problem(place, message, **more))

    table = read_table(source.table)
    for message, found, allowed in table.wrong:
        refuse(message, found=found, allowed=allowed, code="S708")
    if table.wrong:
        return None
    for _, message, more in _unusable(world, table.joints):
        refuse(message, **more)
    later = np.flatnonzero(np.diff(table.times) <= 0.0)
    if len(later):
        row = int(later[0]) + 1
        refuse(
            "times must increase",
            found=f"{table.times[row]:g} s after {table.times[row - 1]:g} s in row {row + 1}",
            code="S706",
        )
    if table.times[0] < 0.0:
        refuse("times begin at 0 or later", found=f"{table.times[0]:g} s", code="S706")
    interpolation = required(source.content.trajectory).interpolation
    present = {name for name in ("velocities", "accelerations") if name in table.values}
    derivatives = {"cubic": {"velocities"}, "quintic": {"velocities", "accelerations"}}.get(interpolation, set())
    for name in sorted(present - derivatives):
        refuse(f"{name} are not allowed with interpolation {interpolation}", code="S707")
    if interpolation == "quintic" and len(present) == 1:
        refuse("quintic requires velocities and accelerations, or neither", code="S707")
    return _TrajectoryDraft(
        table.joints,
        table.times,
        table.values,
        lambda row, joint: place,
        lambda row: f", in row {row + 1} of the table",
    )


def _of_program(
    source: Source, world: World, known: Mapping[str, ResolvedGrasp], problems: list[Problem]
) -> _TrajectoryDraft | None:
    from simspec.resolve.programs import solve

    rows, wrong = solve(source, world, known)
    problems += wrong
    if rows is None:
        return None
    values = {"positions": np.array(rows.positions), "efforts": np.array(rows.efforts)}
    if not values["efforts"].any():
        del values["efforts"]
    return _TrajectoryDraft(
        rows.joints, np.array(rows.times), values, lambda row, joint: ("trajectory", "program", rows.steps[row])
    )


# --- what must hold ------------------------------------------------------------------------------------------------


class _Check:
    """The checks of a trajectory: at its points, and between them as it will be followed."""

    def __init__(self, source: Source, world: World, draft: _TrajectoryDraft, made: JointTrajectory):
        self._source, self._draft, self._made = source, draft, made
        by_name = {body.joint.name: body.joint for body in world.bodies}
        self._joints = [by_name[name] for name in made.joints]
        bounds = [joint.position_limits or (-np.inf, np.inf) for joint in self._joints]
        self._low, self._high = (np.array(side) for side in zip(*bounds, strict=True))
        self._times, self._values = np.array(made.times), np.array(made.positions)

    def points(self) -> list[Problem]:
        """Times that are too near to each other, positions outside of their joints' limits."""
        problems = []
        close = np.flatnonzero(np.diff(self._times) < SHORTEST)
        if len(close):
            row = int(close[0]) + 1
            gap = f"{self._times[row] - self._times[row - 1]:.3g} s before {self._times[row]:g} s"
            allowed = f"at intervals of at least {SHORTEST:g} s"
            problems.append(self._problem(row, 0, "points too close in time", found=gap, allowed=allowed, code="S706"))
        beyond = np.maximum(self._low - self._values, self._values - self._high)
        for column in np.flatnonzero(beyond.max(axis=0) > EDGE)[:MOST_REPORTED]:
            row = int(beyond[:, column].argmax())
            problems.append(self._outside(row, int(column), self._times[row], self._values[row, column]))
        return problems

    def between(self, velocity_limits: Mapping[str, float]) -> list[Problem]:
        """Positions and speeds beyond the joints' limits between points. A trajectory that is held from point to point
        jumps, and has no speed."""
        if len(self._times) == 1:
            return []
        slow = [velocity_limits.get(joint.name, np.inf) for joint in self._joints]
        fastest = np.array(slow) * (1.0 + SLACK) if self._made.interpolation != "hold" else np.full(len(slow), np.inf)
        swing = SWING * np.ptp(self._values, axis=0)
        outside, fast = _Worst(len(slow)), _Worst(len(slow))
        for times, positions, speeds in self._followed():
            if not (np.isfinite(positions).all() and np.isfinite(speeds).all()):
                row = self._row(times[0])
                return [self._problem(row, 0, "the interpolated values overflow from here on", code="S707")]
            outside.look(np.maximum(self._low - positions, positions - self._high) - swing, times, positions)
            fast.look(np.abs(speeds) - fastest, times, speeds)
        problems = []
        for column in np.flatnonzero(outside.excess > 0.0)[:MOST_REPORTED]:
            time = outside.times[column]
            problems.append(self._outside(self._row(time), int(column), time, outside.values[column]))
        for column in np.flatnonzero(fast.excess > 0.0)[:MOST_REPORTED]:
            problems.append(self._too_fast(int(column), fast.times[column], abs(fast.values[column]), slow[column]))
        return problems

    def _followed(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Times, positions and velocities on the way, some points' worth together."""
        from simspec.control.reference import positions

        course = positions(self._made)
        times = self._times
        begins, lasting = times[:-1], np.diff(times)
        together = max(1, AT_ONCE // (len(BETWEEN) * len(self._joints)))
        for first in range(0, len(begins), together):
            part = slice(first, first + together)
            times = (begins[part, None] + BETWEEN * lasting[part, None]).ravel()
            places, speeds = course.at(times, 1)
            yield times, places, speeds

    def _row(self, time: float) -> int:
        """The point that the trajectory is on its way to."""
        return min(int(np.searchsorted(self._times, time, side="right")), len(self._times) - 1)

    def _outside(self, row: int, column: int, time: float, value: float) -> Problem:
        joint = self._joints[column]
        allowed = f"{self._low[column]:g} to {self._high[column]:g} {_UNITS[joint.kind][0]}"
        return self._problem(
            row,
            column,
            f"{joint.name} exceeds its limits at {time:.4g} s{self._draft.label(row)}",
            found=f"{value:.6g} {_UNITS[joint.kind][0]}",
            allowed=allowed,
            hint=self._straight(row, column),
            code="S709",
        )

    def _straight(self, row: int, column: int) -> str | None:
        """The way out where the spline leaves the limits between points that are within them."""
        ends = self._values[max(0, row - 1) : row + 1, column]
        within = bool(np.all((ends >= self._low[column]) & (ends <= self._high[column])))
        smooth = self._made.interpolation in ("cubic", "quintic")
        return "interpolation: linear does not overshoot the points" if within and smooth else None

    def _too_fast(self, column: int, time: float, speed: float, limit: float) -> Problem:
        joint, row = self._joints[column], self._row(time)
        unit = _UNITS[joint.kind][1]
        return self._problem(
            row,
            column,
            f"{joint.name} exceeds its velocity limit at {time:.4g} s{self._draft.label(row)}",
            found=f"{speed:.4g} {unit}, {speed / limit:.3g} times its limit" if limit else f"{speed:.4g} {unit}",
            allowed=f"up to {limit:g} {unit}",
            hint="more time, or a shorter path",
            code="S710",
        )

    def _problem(self, row: int, column: int, message: str, **more: Unpack[Details]) -> Problem:
        return self._source.document.problem(self._draft.place(row, self._made.joints[column]), message, **more)


DWELL = 0.01
"""Share of a joint's whole way from which an overshoot between equal points is warned of. Right after a move of equal duration
a cubic spline passes them by 9 to 25 % of the move, two segments later by 1 %."""


def dwell_overshoots(spec: Source, world: World) -> Iterator[Problem]:
    """Warnings of points that follow each other with equal positions, between which the spline leaves these, one for each
    joint: the largest deviation, measured from the spline (rad, m)."""
    path, written = world.trajectory, spec.content.trajectory
    if path is None or written is None or written.program or path.velocities or len(path.times) < 3:
        return
    if path.interpolation not in ("cubic", "quintic"):
        return
    from simspec.control.reference import positions

    values, times = np.array(path.positions), np.array(path.times)
    equal, way = values[1:] == values[:-1], np.ptp(values, axis=0)
    columns = np.flatnonzero(equal.any(axis=0) & (way > 0.0))
    if not len(columns):
        return
    course = positions(path)
    worst = _Worst(len(path.joints))
    together = max(1, AT_ONCE // (len(BETWEEN) * len(path.joints)))
    for first in range(0, len(times) - 1, together):
        part = slice(first, first + together)
        at = (times[:-1][part, None] + BETWEEN * np.diff(times)[part, None]).ravel()
        begins, rests = (np.repeat(rows[part], len(BETWEEN), axis=0) for rows in (values[:-1], equal))
        away = np.where(rests, np.abs(course.at(at)[0] - begins), 0.0)
        worst.look(away, at, away)
    kinds = {body.joint.name: body.joint.kind for body in world.bodies}
    for column in columns:
        away, time = worst.excess[column], worst.times[column]
        if away <= DWELL * way[column]:
            continue
        joint, row = path.joints[column], int(np.searchsorted(times, time, side="right"))
        place: tuple[Key, ...] = ("trajectory", "file")
        if written.points is not None:
            entry = _Entries(written.points, world).of(row, "positions")[joint]
            place = ("trajectory", "points", row, "positions", entry)
        yield spec.document.problem(
            place,
            f"{joint} leaves two equal points by {away:.3g} {_UNITS[kinds[joint]][0]} at {time:.4g} s: between them the "
            f"{path.interpolation} spline overshoots",
            hint="interpolation: linear goes straight from point to point; or velocities in every point, 0 in these",
            code="W116",
        )


_UNITS = {"hinge": ("rad", "rad/s"), "slide": ("m", "m/s")}


class _Worst:
    """The largest excess of each joint so far, when, and the value there."""

    def __init__(self, count: int):
        self.excess, self.times, self.values = np.full(count, -np.inf), np.zeros(count), np.zeros(count)

    def look(self, excess: np.ndarray, times: np.ndarray, values: np.ndarray) -> None:
        """Take some more rows into account."""
        rows, columns = excess.argmax(axis=0), np.arange(excess.shape[1])
        worse = excess[rows, columns] > self.excess
        for name, looked_at in (
            ("excess", excess[rows, columns]),
            ("times", times[rows]),
            ("values", values[rows, columns]),
        ):
            setattr(self, name, np.where(worse, looked_at, getattr(self, name)))
