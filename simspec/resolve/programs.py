"""Programs of tool moves, grips and waits, solved to points of joints."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from simspec.errors import Problem
from simspec.language.actions import FAR, MOST_NUMBERS, MOST_POINTS, MOST_SOLVED, Step, ToolPlace
from simspec.language.arrays import chosen
from simspec.language.document import Details, Key
from simspec.language.quantities import article
from simspec.language.shapes import Pose as SpecPose
from simspec.language.sources import Source
from simspec.language.strict import near, required
from simspec.resolve.actuators import ResolvedGrasp
from simspec.resolve.bodies import places_of
from simspec.world import frames
from simspec.world.canonical import to_plain
from simspec.world.kinematics import initial_state, layout, layout_of, trees
from simspec.world.types import Body, Pose, Quaternion, World

if TYPE_CHECKING:
    from simspec.dynamics.tool import Solution

PATH: tuple[Key, ...] = ("trajectory", "program")
LARGEST_JUMP = 0.5
"""rad or m between neighbouring points of a straight move; more is another branch of the arm, or a singular pose."""
FEWEST = 4
"""Points of a move or a grip at least: fewer do not show its minimum-jerk course."""
SETTLING = 8
"""Points at each end of a wait: the swing of a spline where a move ends is a quarter from point to point, but would last as
long as the wait without them."""
DECIMALS = 8
"""Of the ways from the initial positions (rad, m), and of efforts: 10 nm at a metre. Libraries of algebra round differently on
different processors, by some 1e-15; so the world is the same on nearly all machines (one number in ten million differs)."""


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """s(u) = 10 u³ − 15 u⁴ + 6 u⁵: from 0 to 1, at rest and without acceleration at both ends (T. Flash, N. Hogan, 1985)."""
    return share**3 * (10.0 + share * (-15.0 + 6.0 * share))


@dataclasses.dataclass
class Rows:
    """A trajectory as it grows: joints, times, a row of positions and of efforts for each time, the step of each row."""

    joints: tuple[str, ...]
    times: list[float]
    positions: list[np.ndarray]
    efforts: list[np.ndarray]
    steps: list[int]


class _Stop(Exception):
    """A step cannot be done; the following steps have no beginning."""

    def __init__(self, message: str, place: tuple[Key, ...] = (), **more: Unpack[Details]):
        super().__init__(message)
        self.place, self.more = place, more


class ProgramSolution:
    """A program being solved, step by step."""

    def __init__(self, source: Source, world: World, known: Mapping[str, ResolvedGrasp]):
        self._source, self._world, self._grasps = source, world, known
        self._given = required(source.content.trajectory)
        self._steps = required(self._given.program)
        self.problems: list[Problem] = []
        self._driven = {joint for controller in world.controllers for joint in controller.joints}
        self._grasp: ResolvedGrasp | None = None
        self._tool: Any = None

    def solve(self) -> Rows | None:
        """The points; None where something is wrong (see ``problems``)."""
        steps = self._steps
        moves = any(step.move is not None for step in steps)
        if any(step.grip is not None for step in steps) or self._given.grasp is not None:
            self._choose_grasp()
        if moves or self._given.tool is not None:
            self._choose_tool()
        if self.problems:
            return None
        counts = [self._count(step) for step in steps]
        rows = self._begin()
        self._not_too_many(counts, len(rows.joints))
        if self.problems:
            return None
        lasting = [step.wait if step.wait is not None else getattr(step, "in") for step in steps]
        ends = [float(end) for end in accumulate(Fraction(repr(value)) for value in lasting)]  # 0.1 + 0.2 = 0.3
        for index, (step, begun, ended) in enumerate(zip(steps, [0.0, *ends], ends, strict=False)):
            shares = np.arange(1, counts[index] + 1) / counts[index]
            if step.wait is not None:
                shares = _wait(step.wait, self._given.interval)
            times = begun + shares * (ended - begun)
            times[-1] = ended
            try:
                self._do(rows, index, step, times, shares)
            except _Stop as stop:
                place = (*PATH, index, *stop.place)
                self.problems.append(self._source.document.problem(place, str(stop), **stop.more))
                return None
        return rows

    def _count(self, step: Step) -> int:
        """How many points a step makes."""
        if step.wait is not None:
            return len(_wait(step.wait, self._given.interval))
        lasting: float = getattr(step, "in")
        return max(FEWEST, math.ceil(lasting / self._given.interval * (1.0 - 1e-9)))

    def _not_too_many(self, counts: Sequence[int], joints: int) -> None:
        total, solved = 1, 0
        for index, (step, count) in enumerate(zip(self._steps, counts, strict=True)):
            total += count
            if step.move is not None:
                solved += count if step.straight else FAR
            if solved > MOST_SOLVED:
                self._problem(
                    ("program", index),
                    "the program requires too many solutions of the inverse kinematics, counted from its beginning to here",
                    found=f"{solved} points of moves",
                    allowed=f"up to {MOST_SOLVED}; a move with straight: false counts for {FAR}",
                    hint="a larger interval, or straight: false",
                    code="S712",
                )
                return
            if total > MOST_POINTS or total * joints > MOST_NUMBERS:
                self._problem(
                    ("program", index),
                    "the program makes too many points",
                    found=f"{sum(counts) + 1} points of {joints} joints",
                    allowed=f"{MOST_POINTS} points, {MOST_NUMBERS} numbers",
                    hint="a larger interval",
                    code="S712",
                )
                return

    def _problem(self, path: Sequence[Key], message: str, **more: Unpack[Details]) -> None:
        self.problems.append(self._source.document.problem(("trajectory", *path), message, **more))

    # --- what moves ---

    def _choose_grasp(self) -> None:
        name, known = self._given.grasp, self._grasps
        if name is not None and name not in known:
            allowed = ", ".join(list(known)[:20]) or "the models have none: model: {grasps: ...}"
            self._problem(
                ("grasp",),
                f"there is no grasp {name!r}",
                found=name,
                allowed=allowed,
                hint=near(name, known),
                code="S302",
            )
            return
        if name is None and len(known) != 1:
            allowed = ", ".join(list(known)[:20]) or "the models have none: model: {grasps: ...}"
            message = "ambiguous grasp" if known else "grip requires a grasp"
            self._problem(("program",), message, key=True, allowed=allowed, hint="grasp: MODEL/GRASP", code="S713")
            return
        grasp = self._grasp = known[name] if name is not None else next(iter(known.values()))
        idle = [joint for joint in grasp.joints if joint not in self._driven]
        if idle:
            message = f"the grasp {grasp.name} moves {', '.join(idle[:6])}, which no controller drives"
            self._problem(("program",), message, key=True, hint="control: {NAME: {joints: [...]}}", code="S713")

    @property
    def _chosen_grasp(self) -> ResolvedGrasp:
        """The grasp; a program that has none, but grips, is refused before its way is worked out."""
        if self._grasp is None:
            raise ValueError("a program without a grasp does not grip")
        return self._grasp

    def _choose_tool(self) -> None:
        from simspec.dynamics.tool import Tool, joints_to, tree_of

        frame = self._given.tool
        if frame is None:
            self._problem(
                ("program",), "move requires a tool frame", key=True, hint="tool: {body: MODEL/BODY}", code="S713"
            )
            return
        places = places_of(self._world.bodies, self._world.frames)
        if frame.body not in places:
            hint = near(frame.body, places)
            self._problem(
                ("tool", "body"), f"there is no body {frame.body!r}", found=frame.body, hint=hint, code="S302"
            )
            return
        carrier, place = places[frame.body]
        bodies = tree_of(self._world, carrier)
        way = [body for body in joints_to(bodies, carrier) if body.joint.kind != "fixed"]
        loose = next((body for body in way if body.joint.name not in self._driven), None)
        if loose is not None:
            message = f"the tool is attached to {loose.joint.name}, {article(loose.joint.kind)} joint that no controller drives"
            hint = (
                "a model's root is fixed with fixed: true"
                if loose.joint.kind == "free"
                else "control: {NAME: {joints: [...]}}"
            )
            self._problem(("tool", "body"), message, found=frame.body, hint=hint, code="S713")
            return
        joints = [body.joint.name for body in way]
        if self._given.arm is not None:
            joints = self._arm(joints, self._given.arm)
        elif not joints:
            self._problem(("tool", "body"), "no joint moves this body", found=frame.body, code="S713")
        both = [name for name in joints if self._grasp is not None and name in self._grasp.joints]
        if both:
            message = f"{', '.join(both[:6])} would belong to both the arm and the grasp"
            self._problem(("program",), message, key=True, hint="arm: [the joints that move the tool]", code="S713")
        if self.problems:
            return
        offset = frame.pose
        if offset is not None:
            place = frames.compose(place, Pose(offset.xyz, _turn(offset)))
        self._tool = Tool(self._world, carrier, place, joints)

    def _arm(self, way: Sequence[str], entries: Sequence[str]) -> list[str]:
        wanted: set[str] = set()
        for index, entry in enumerate(entries):
            meant = chosen(entry, way)
            if not meant:
                message = f"{entry!r} is not a joint between the world and the tool"
                self._problem(
                    ("arm", index), message, found=entry, allowed=", ".join(way[:8]), hint=near(entry, way), code="S302"
                )
            wanted.update(meant)
        return [name for name in way if name in wanted]

    # --- the way ---

    def _begin(self) -> Rows:
        world = self._world
        joints = tuple(body.joint.name for body in world.bodies if body.joint.name in self._driven)
        start, _ = initial_state(world)
        places = {
            body.joint.name: part.start for body, part in zip(world.bodies, layout_of(world).position, strict=True)
        }
        self._columns = {name: column for column, name in enumerate(joints)}
        first = np.array([start[places[name]] for name in joints])
        if self._tool is not None:
            bodies = self._tool.bodies
            inside = dataclasses.replace(world, bodies=bodies)
            self._q = self._nominal = initial_state(inside)[0]
            local = {body.joint.name: part.start for body, part in zip(bodies, layout(bodies).position, strict=True)}
            self._of_tree = [(local[name], column) for name, column in self._columns.items() if name in local]
        if self._grasp is not None:
            self._press = self._full_efforts(first)
        if self._tool is not None:
            self._place = self._tool.place(self._q)
        return Rows(joints, [0.0], [first], [np.zeros(len(joints))], [0])

    def _full_efforts(self, first: np.ndarray) -> np.ndarray:
        """The efforts (columns,) of the grasp's forces at its closed posture; the arm's makes no difference to them."""
        from simspec.dynamics.tool import tree_of

        grasp = self._chosen_grasp
        bodies = tree_of(
            self._world, next(body.name for body in self._world.bodies if body.joint.name == grasp.joints[0])
        )
        q = initial_state(dataclasses.replace(self._world, bodies=bodies))[0]
        parts = layout(bodies).position
        local = {body.joint.name: part.start for body, part in zip(bodies, parts, strict=True)}
        for name, value in zip(grasp.joints, grasp.closed, strict=True):
            q[local[name]] = value
        full = np.zeros(len(first))
        full[[self._columns[name] for name in grasp.joints]] = grasp.efforts(self._world, q, bodies)
        return full

    def _do(self, rows: Rows, index: int, step: Step, times: np.ndarray, shares: np.ndarray) -> None:
        if step.wait is not None:
            for time in times:
                self._append(rows, index, time, rows.positions[-1], rows.efforts[-1])
        elif step.grip is not None:
            self._do_grip(rows, index, step, times, shares)
        else:
            self._do_move(rows, index, step, times, shares)

    def _append(self, rows: Rows, index: int, time: float, positions: np.ndarray, efforts: np.ndarray) -> None:
        rows.times.append(time)
        rows.positions.append(rows.positions[0] + np.round(positions - rows.positions[0], DECIMALS))
        rows.efforts.append(np.round(efforts, DECIMALS))
        rows.steps.append(index)

    def _do_grip(self, rows: Rows, index: int, step: Step, times: np.ndarray, shares: np.ndarray) -> None:
        before, pressed = rows.positions[-1], rows.efforts[-1]
        grasp = self._chosen_grasp
        goal = before.copy()
        columns = [self._columns[name] for name in grasp.joints]
        goal[columns] = grasp.open + step.grip * (grasp.closed - grasp.open)
        press = step.squeeze * self._press
        for time, share, way in zip(times, shares, minimum_jerk(shares), strict=True):
            posture = before + way * (goal - before)
            self._append(rows, index, time, posture, pressed + share * (press - pressed))
        if self._tool is not None:
            self._q = self._q.copy()
            for place, column in self._of_tree:
                self._q[place] = goal[column]

    def _row(self, q: np.ndarray, before: np.ndarray) -> np.ndarray:
        row = before.copy()
        for place, column in self._of_tree:
            row[column] = q[place]
        return row

    def _do_move(self, rows: Rows, index: int, step: Step, times: np.ndarray, shares: np.ndarray) -> None:
        before, pressed = rows.positions[-1], rows.efforts[-1]
        assert step.move is not None, "a step that neither waits nor grips moves"
        begun, turning = rows.times[-1], not step.move.free_orientation
        target = self._target(step.move)
        if not step.straight:
            self._q = self._reach(target, target, turning, far=True)
            goal = self._row(self._q, before)
            for time, way in zip(times, minimum_jerk(shares), strict=True):
                self._append(rows, index, time, before + way * (goal - before), pressed)
        else:
            for time, place in zip(times, self._line(target, minimum_jerk(shares)), strict=True):
                into = f" {time - begun:.3g} s into it" if time < times[-1] else ""
                solution = self._reach(place, target, turning, into)
                jump = np.abs(solution - self._q)
                if jump.max() > LARGEST_JUMP:
                    self._jumped(int(jump.argmax()), float(jump.max()), into)
                self._q = solution
                self._append(rows, index, time, self._row(solution, before), pressed)
        self._place = target if turning else self._tool.place(self._q)

    def _target(self, move: ToolPlace) -> Any:
        place = self._place.copy()
        if move.xyz is not None:
            place.translation = np.array(move.xyz)
        if move.rpy is not None or move.quat is not None:
            place.rotation = np.array(frames.matrix(_turn(move)))
        return place

    def _line(self, target: Any, ways: np.ndarray) -> list[Any]:
        """Places on the straight line, and on the shortest turn, from where the tool is to the target."""
        import pinocchio

        start = self._place
        turn = pinocchio.log3(start.rotation.T @ target.rotation)
        return [
            pinocchio.SE3(
                start.rotation @ pinocchio.exp3(way * turn),
                start.translation + way * (target.translation - start.translation),
            )
            for way in ways
        ]

    def _reach(self, place: Any, target: Any, turning: bool, into: str = "", far: bool = False) -> np.ndarray:
        """The positions of the tree at a place on the way to the ``target`` of a move. Raises _Stop with the distance by which
        the target is out of reach, or the straight path to it."""
        solution = self._tool.solve(place, self._q, turning=turning, nominal=self._nominal, far=far)
        if solution.reached:
            positions: np.ndarray = solution.positions
            return positions
        at = ", ".join(f"{value:.4g}" for value in target.translation)
        there = self._tool.solve(target, self._q, turning=turning, nominal=self._nominal, far=True)
        if there.reached:
            off = _off(solution, turning)
            message = f"the straight path to the target leaves the reach of the tool{into}: it stays {off} away"
            hint = "straight: false, another orientation, or several moves"
        else:
            message = f"the target is out of reach: the tool stays {_off(there, turning)} away"
            hint = "a nearer target, or another orientation (the pose of the tool's frame counts)"
        raise _Stop(message, ("move",), found=f"a target at [{at}] m", hint=hint, code="S711")

    def _jumped(self, coordinate: int, jump: float, into: str) -> None:
        parts = layout(self._tool.bodies).position
        body: Body = next(
            body for body, part in zip(self._tool.bodies, parts, strict=True) if part.start <= coordinate < part.stop
        )
        raise _Stop(
            f"{body.joint.name} jumps by {jump:.3g} between two points of this move{into}",
            ("move",),
            allowed=f"up to {LARGEST_JUMP:g}",
            hint="the straight path passes a singular configuration: use straight: false, another path, or a smaller interval",
            code="S711",
        )


def _off(solution: Solution, turning: bool) -> str:
    """How far a solution is from its place, and the joints at a limit."""
    turn = f" and {solution.angle:.3g} rad" if turning else ""
    stuck = f" (at a limit: {', '.join(solution.at_limit)})" if solution.at_limit else ""
    return f"{1e3 * solution.distance:.3g} mm{turn}{stuck}"


def _wait(lasting: float, interval: float) -> np.ndarray:
    """Shares of a wait at which points stand: at every interval, but not more than ``SETTLING`` at each end."""
    count = max(1, math.ceil(lasting / interval * (1.0 - 1e-9)))
    if count <= 2 * SETTLING:
        return np.arange(1, count + 1) / count
    edge = np.arange(1, SETTLING + 1) * interval / lasting
    return np.concatenate([edge, 1.0 - edge[::-1], [1.0]])


def _turn(written: ToolPlace | SpecPose) -> Quaternion:
    from simspec.resolve.shapes import orientation

    return orientation(written)


# Programs of moves, solved once for each distinct model and program: worlds that differ in their timestep, their loose bodies
# or their materials share the solution. Solving is nine tenths of the time that the library's robot takes to resolve.

MOST_KEPT = 8
"""Solutions that are kept; the largest of the library takes 1 MB."""
WITHOUT_MOTION: Mapping[str, Any] = {
    "velocity_limit": None,
    "effort_limit": None,
    "damping": 0.0,
    "dry_friction": 0.0,
    "armature": 0.0,
    "spring_stiffness": 0.0,
    "spring_rest": 0.0,
    "velocity": (),
    "angular_damping": 0.0,
    "angular_armature": 0.0,
    "written_armature": None,
}
"""Fields of a joint that kinematics do not depend on, with the values that stand for all; every other field counts."""
OF_PROGRAMS = ("tool", "arm", "interval", "grasp", "program")
"""Fields of a trajectory that a program is solved from."""

_SOLVED: dict[str, Rows] = {}
"""The latest solutions by the hash of what they were solved from."""


def solve(source: Source, world: World, known: Mapping[str, ResolvedGrasp]) -> tuple[Rows | None, list[Problem]]:
    """The points of a spec's program in its world (no caller changes them), or None with what is wrong. ``known``: the grasps
    of the models."""
    key = hash_of(source, world, known)
    rows = _SOLVED.pop(key, None)
    if rows is None:
        program = ProgramSolution(source, world, known)
        rows = program.solve()
        if rows is None or program.problems:
            return rows, program.problems
    _SOLVED[key] = rows
    while len(_SOLVED) > MOST_KEPT:
        _SOLVED.pop(next(iter(_SOLVED)), None)
    return rows, []


def hash_of(source: Source, world: World, known: Mapping[str, ResolvedGrasp]) -> str:
    """SHA-256 of all that a program's solution depends on: the program, and the kinematics and grasps of the driven trees."""
    driven = {joint for controller in world.controllers for joint in controller.joints}
    moved = [bodies for bodies in trees(world).values() if any(body.joint.name in driven for body in bodies)]
    names = {body.name for bodies in moved for body in bodies}
    trajectory = source.content.trajectory
    if trajectory is None:
        raise ValueError("a spec without a trajectory has no program")
    inputs = [
        trajectory.model_dump(include=set(OF_PROGRAMS)),
        [_kinematics(body) for body in world.bodies if body.name in names],
        to_plain(world.constraints),
        [to_plain(frame) for frame in world.frames if frame.body in names],
        sorted(driven),
        [_grasp(grasp) for grasp in known.values()],
    ]
    return hashlib.sha256(json.dumps(inputs, allow_nan=False).encode()).hexdigest()


def _kinematics(body: Body) -> list[Any]:
    return [
        body.name,
        to_plain(dataclasses.replace(body.joint, **WITHOUT_MOTION)),
        to_plain(body.inertial.centre_of_mass),
    ]


def _grasp(grasp: ResolvedGrasp) -> list[Any]:
    forces = [[body, point.tolist(), force.tolist()] for body, point, force in grasp.forces]
    return [grasp.name, grasp.joints, grasp.open.tolist(), grasp.closed.tolist(), forces]
