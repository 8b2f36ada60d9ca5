"""Programs of tool moves, grips and waits, solved to points of joints."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simspec.errors import Problem
from simspec.resolve.grasps import Grasp, grasps
from simspec.spec.document import Key
from simspec.spec.joint_names import chosen
from simspec.spec.sources import Source
from simspec.spec.strict import near
from simspec.spec.trajectory import MOST_NUMBERS, MOST_POINTS
from simspec.world import frames
from simspec.world.kinematics import initial_state, layout
from simspec.world.types import Body, Pose, World

PATH: tuple[Key, ...] = ("trajectory", "program")
LARGEST_JUMP = 0.5
"""rad or m between neighbouring points of a straight move; more is another branch of the arm, or a singular pose."""
FEWEST = 4
"""Points of a move or a grip at least: fewer do not show its minimum-jerk course."""


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
    """A step cannot be done; what follows has no beginning."""

    def __init__(self, message: str, key: tuple[Key, ...] = (), **more: str | None):
        super().__init__(message)
        self.key, self.more = key, more


class Program:
    """A program being solved, step by step."""

    def __init__(self, source: Source, world: World):
        self._source, self._world = source, world
        self._given = source.file.trajectory
        self.problems: list[Problem] = []
        self._driven = {joint for one in world.controllers for joint in one.joints}
        self._grasp: Grasp | None = None
        self._tool: Any = None
        self._grip = self._squeeze = 0.0

    def solve(self) -> Rows | None:
        """The points; None where something is wrong (see ``problems``)."""
        steps = self._given.program
        moves = any(step.move is not None for step in steps)
        if any(step.grip is not None for step in steps) or self._given.grasp is not None:
            self._choose_grasp()
        if moves or self._given.tool is not None:
            self._choose_tool()
        if self.problems:
            return None
        rows = self._begin()
        for index, step in enumerate(steps):
            try:
                self._do(rows, index, step)
            except _Stop as stop:
                place = (*PATH, index, *stop.key)
                self.problems.append(self._source.document.problem(place, str(stop), **stop.more))
                return None
            if len(rows.times) > MOST_POINTS or len(rows.times) * len(rows.joints) > MOST_NUMBERS:
                message, allowed = (
                    "the program makes too many points",
                    f"{MOST_POINTS} points and {MOST_NUMBERS} numbers",
                )
                hint = "a larger interval"
                place = (*PATH, index)
                self.problems.append(self._source.document.problem(place, message, allowed=allowed, hint=hint))
                return None
        return rows

    def _problem(self, path: Sequence[Key], message: str, **more: Any) -> None:
        self.problems.append(self._source.document.problem(("trajectory", *path), message, **more))

    # --- what moves ---

    def _choose_grasp(self) -> None:
        found, problems = grasps(self._source, self._world)
        self.problems += problems
        name = self._given.grasp
        if name is not None and name not in found:
            if not problems:
                self._problem(("grasp",), f"there is no grasp {name!r}", found=name, hint=near(name, found))
            return
        if name is None and len(found) != 1:
            if not problems:
                allowed = ", ".join(found) or "the placed models have none: model: {grasps: ...}"
                message = "which grasp is meant?" if found else "grip without a grasp"
                self._problem(("program",), message, key=True, allowed=allowed, hint="grasp: MODEL/GRASP")
            return
        self._grasp = found[name] if name is not None else next(iter(found.values()))
        self._must_be_driven(self._grasp.joints, ("program",))

    def _must_be_driven(self, joints: Sequence[str], path: Sequence[Key]) -> None:
        idle = [joint for joint in joints if joint not in self._driven]
        if idle:
            message = f"{', '.join(idle[:6])} moves here, and no controller drives it"
            self._problem(path, message, key=True, hint="control: {NAME: {joints: [...]}}")

    def _choose_tool(self) -> None:
        from simspec.dynamics.tool import Tool, joints_to, tree_of

        given = self._given.tool
        if given is None:
            self._problem(("program",), "move: which frame?", key=True, hint="tool: {body: MODEL/BODY}")
            return
        names = {body.name for body in self._world.bodies}
        if given.body not in names:
            hint = near(given.body, names)
            self._problem(("tool", "body"), f"there is no body {given.body!r}", found=given.body, hint=hint)
            return
        bodies = tree_of(self._world, given.body)
        odd = next((body for body in bodies if body.joint.kind not in ("fixed", "hinge", "slide")), None)
        if odd is not None:
            message = (
                f"a tool's tree has hinges and slides on a fixed base alone; {odd.name} has a {odd.joint.kind} joint"
            )
            self._problem(("tool", "body"), message, found=given.body)
            return
        way = [body.joint.name for body in joints_to(bodies, given.body) if body.joint.kind in ("hinge", "slide")]
        joints = [name for name in way if name in self._driven]
        if self._given.arm is not None:
            joints = self._arm(way)
        if self.problems:
            return
        if not joints:
            self._problem(("tool", "body"), "no driven joint moves this body", found=given.body)
            return
        offset = given.pose
        place = Pose() if offset is None else Pose(offset.xyz, _turn(offset))
        self._tool = Tool(self._world, given.body, place, joints)

    def _arm(self, way: Sequence[str]) -> list[str]:
        wanted: set[str] = set()
        for index, entry in enumerate(self._given.arm):
            meant = chosen(entry, way)
            if not meant:
                message = f"{entry!r} is no joint between the world and the tool"
                self._problem(("arm", index), message, found=entry, allowed=", ".join(way[:8]), hint=near(entry, way))
            wanted.update(meant)
        joints = [name for name in way if name in wanted]
        self._must_be_driven(joints, ("arm",))
        return joints

    # --- the way ---

    def _begin(self) -> Rows:
        world = self._world
        moved = set(self._tool.joints if self._tool else ()) | set(self._grasp.joints if self._grasp else ())
        joints = tuple(body.joint.name for body in world.bodies if body.joint.name in moved)
        start, _ = initial_state(world)
        places = {
            body.joint.name: part.start for body, part in zip(world.bodies, layout(world.bodies).position, strict=True)
        }
        self._columns = {name: column for column, name in enumerate(joints)}
        first = np.array([start[places[name]] for name in joints])
        if self._tool is not None:
            bodies = self._tool.bodies
            inside = dataclasses.replace(world, bodies=bodies)
            self._q = initial_state(inside)[0]
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

        grasp = self._grasp
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

    def _do(self, rows: Rows, index: int, step: Any) -> None:
        begun, before = rows.times[-1], rows.positions[-1]
        if step.wait is not None:
            self._append(rows, index, begun + step.wait, before, rows.efforts[-1])
            return
        lasting = getattr(step, "in")
        count = max(FEWEST, math.ceil(lasting / self._given.interval - 1e-9))
        if count > MOST_POINTS:
            raise _Stop("this step makes too many points", (), allowed=f"{MOST_POINTS}", hint="a larger interval")
        shares = np.arange(1, count + 1) / count
        if step.grip is not None:
            self._do_grip(rows, index, step, lasting, shares)
        else:
            self._do_move(rows, index, step, lasting, shares)

    def _append(self, rows: Rows, index: int, time: float, positions: np.ndarray, efforts: np.ndarray) -> None:
        rows.times.append(time)
        rows.positions.append(positions)
        rows.efforts.append(efforts)
        rows.steps.append(index)

    def _do_grip(self, rows: Rows, index: int, step: Any, lasting: float, shares: np.ndarray) -> None:
        begun, before, pressed = rows.times[-1], rows.positions[-1], rows.efforts[-1]
        grasp = self._grasp
        goal = before.copy()
        columns = [self._columns[name] for name in grasp.joints]
        goal[columns] = grasp.open + step.grip * (grasp.closed - grasp.open)
        press = step.squeeze * self._press
        for share, way in zip(shares, minimum_jerk(shares), strict=True):
            posture = before + way * (goal - before)
            self._append(rows, index, begun + share * lasting, posture, pressed + share * (press - pressed))
        if self._tool is not None:
            self._take(goal)
            self._place = self._tool.place(self._q) if self._grasp_moves_tool() else self._place

    def _grasp_moves_tool(self) -> bool:
        return bool(set(self._grasp.joints) & set(self._tool.joints))

    def _take(self, posture: np.ndarray) -> None:
        """Put the tree where the columns say."""
        for place, column in self._of_tree:
            self._q[place] = posture[column]

    def _row(self, q: np.ndarray, before: np.ndarray) -> np.ndarray:
        row = before.copy()
        for place, column in self._of_tree:
            row[column] = q[place]
        return row

    def _do_move(self, rows: Rows, index: int, step: Any, lasting: float, shares: np.ndarray) -> None:
        begun, before, pressed = rows.times[-1], rows.positions[-1], rows.efforts[-1]
        target = self._target(step.move)
        turning = not step.move.free_orientation
        if not step.straight:
            found = self._reach(target, turning, lasting, lasting)
            goal = self._row(found, before)
            for share, way in zip(shares, minimum_jerk(shares), strict=True):
                self._append(rows, index, begun + share * lasting, before + way * (goal - before), pressed)
            self._q = found
        else:
            for share, place in zip(shares, self._line(target, minimum_jerk(shares)), strict=True):
                found = self._reach(place, turning, share * lasting, lasting)
                jump = np.abs(found - self._q)
                if jump.max() > LARGEST_JUMP:
                    self._jumped(int(jump.argmax()), float(jump.max()), share * lasting, lasting)
                self._q = found
                self._append(rows, index, begun + share * lasting, self._row(found, before), pressed)
        self._place = target if turning else self._tool.place(self._q)

    def _target(self, given: Any) -> Any:
        place = self._place.copy()
        if given.xyz is not None:
            place.translation = np.array(given.xyz)
        if given.rpy is not None or given.quat is not None:
            place.rotation = np.array(frames.matrix(_turn(given)))
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

    def _reach(self, target: Any, turning: bool, time: float, lasting: float) -> np.ndarray:
        found = self._tool.solve(target, self._q, turning=turning)
        if found.reached:
            return found.positions
        when = "" if time == lasting else f" {time:.3g} s into it"
        stuck = f"; {', '.join(found.at_limit)} at its limit" if found.at_limit else ""
        off = (
            f"{1e3 * found.distance:.3g} mm and {found.angle:.3g} rad" if turning else f"{1e3 * found.distance:.3g} mm"
        )
        at = ", ".join(f"{value:.4g}" for value in target.translation)
        raise _Stop(
            f"the tool cannot get there: it stays {off} away{when}{stuck}",
            ("move",),
            found=f"a place at [{at}] m",
            hint="a nearer place, another orientation, or a way there in several moves",
        )

    def _jumped(self, coordinate: int, jump: float, time: float, lasting: float) -> None:
        parts = layout(self._tool.bodies).position
        body: Body = next(
            body for body, part in zip(self._tool.bodies, parts, strict=True) if part.start <= coordinate < part.stop
        )
        raise _Stop(
            f"{body.joint.name} jumps by {jump:.3g} between two points, {time:.3g} s into a move of {lasting:.3g} s",
            ("move",),
            allowed=f"up to {LARGEST_JUMP:g}",
            hint="the straight way passes a singular pose: straight: false, a detour, or a smaller interval",
        )


def _turn(given: Any) -> frames.Quaternion:
    from simspec.resolve.poses import orientation

    return orientation(given)


def tables(rows: Rows) -> Mapping[str, np.ndarray]:
    """Positions and efforts as arrays."""
    return {"positions": np.array(rows.positions), "efforts": np.array(rows.efforts)}
