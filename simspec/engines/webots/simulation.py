"""A world in Webots: begun anew in each state that it is put into, stepped under forces and torques on its Solids."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from simspec.dialects.webots.dialect import AT_REST, Twist, centres, moved, twists
from simspec.dialects.webots.nodes import WebotsSidecar, turn
from simspec.dialects.webots.raising import raised, solids_of
from simspec.engines.webots.program import NAME, Live
from simspec.errors import EngineError, SpecError
from simspec.formats.wbt.format import NODES, VERSION, Wbt, text_of
from simspec.formats.wbt.reading import Value, WbtDocument, WbtField, WbtNode
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.constraints import JointForces
from simspec.world.frames import quaternion, vector3
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import initial_state, layout_of, poses, rigid_groups
from simspec.world.types import Body, Constraint, Pose, Quaternion, ReadBack, Vector3, World

# States of a world in Webots: the file that begins in one, and the coordinates that follow from where its Solids are.
#
# A Supervisor cannot put a BallJoint into a place, and a joint that it moves by less than some limit stays (the sources of
# R2023b): so each state is written into a file, by the fields for the initial places and velocities of Solids.


class WebotsStates:
    """The coordinates of a document and its sidecar. Poses and velocities are those of the world's body frames.

    Raises ValueError, which names the place, where the two do not fit together or hold what simspec does not write.
    """

    def __init__(self, document: WbtDocument, node_data: WebotsSidecar):
        self.document = document
        self.model = raised(document, node_data)
        self.world = World("", self.model.bodies)
        self.turned = solids_of(document)[0]
        bodies = self.world.bodies
        self.layout = layout_of(self.world)
        rows = {body.name: row for row, body in enumerate(bodies)}
        self.parents = [-1 if body.joint.parent is None else rows[body.joint.parent] for body in bodies]
        self._offsets = [Pose(body.frame_offset) for body in node_data.bodies]
        self.levers = [
            lumped_inertial(self.world, body).centre_of_mass if body.joint.kind == "free" else (0.0, 0.0, 0.0)
            for body in bodies
        ]
        self.centres = {rows[name]: centre for name, centre in centres(bodies).items()}
        """The centre of mass of each rigid group that moves, in the frame of its topmost body, by that one's row."""
        groups = rigid_groups(self.world)
        self.tops = [rows[groups[body.name]] if groups[body.name] != "world" else -1 for body in bodies]
        """The row of the topmost body of each body's group; −1 of what cannot move."""
        self._nodes = {node.label: node for node in document.walk() if node.label}

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """The state in which the document begins."""
        return initial_state(self.world)

    # --- to a file ------------------------------------------------------------------------------------------------

    def text(self, q: np.ndarray, v: np.ndarray, contact: bool, smooth: Sequence[int]) -> str:
        """The file that begins in the state (q, v); without ``contact`` nothing is solid, and the joints of the rows ``smooth``
        have no dry friction."""
        world = dataclasses.replace(
            self.world, bodies=tuple(self._placed(row, q, v) for row in range(len(self.parents)))
        )
        placed, moving = poses(world), twists(world)
        changes: dict[tuple[WbtNode, str], Sequence[Value]] = {}
        for row, (body, parent) in enumerate(zip(world.bodies, self.parents, strict=True)):
            here = frames.compose(placed[body.name], self._offsets[row])
            around = Pose()
            if parent >= 0:
                around = frames.compose(placed[world.bodies[parent].name], self._offsets[parent])
            place = frames.compose(frames.inverse(around), here)
            node = self._nodes[f"body_{row}"]
            changes[node, "translation"], changes[node, "rotation"] = place.position, turn(place.quaternion)
            if row in self.centres:
                pose = placed[body.name]
                centre = frames.add(pose.position, frames.rotate(pose.quaternion, self.centres[row]))
                linear, angular = moved(moving[body.name], pose.position, centre)
                changes[node, "linearVelocity"] = frames.rotate(self.turned, linear)
                changes[node, "angularVelocity"] = frames.rotate(self.turned, angular)
            if body.joint.kind in SCALAR_JOINTS:
                parameters = self._parameters(row)
                changes[parameters, "position"] = (float(body.joint.position[0]),)
            if not contact:
                changes[node, "boundingObject"] = (None,)
        changes |= {(self._parameters(row), "staticFriction"): (0.0,) for row in smooth}
        return text_of(self.document, changes)

    def _parameters(self, row: int) -> WbtNode:
        joint = self._nodes[f"joint_{row}"]
        parameters = joint.node("jointParameters")
        if parameters is None:
            raise joint.refused("has no jointParameters")
        return parameters

    def _placed(self, row: int, q: np.ndarray, v: np.ndarray) -> Body:
        """A body whose joint is in a state."""
        body = self.world.bodies[row]
        position, velocity = q[self.layout.position[row]].tolist(), v[self.layout.velocity[row]].tolist()
        if body.joint.kind == "ball":
            position = frames.normalise(quaternion(position))
        elif body.joint.kind == "free":
            around = frames.normalise(quaternion(position[3:]))
            lever = frames.rotate(around, self.levers[row])
            angular = frames.rotate(around, vector3(velocity[3:]))
            position = (*frames.subtract(vector3(position[:3]), lever), *around)
            velocity = (*frames.subtract(vector3(velocity[:3]), frames.cross(angular, lever)), *angular)
        joint = dataclasses.replace(body.joint, position=tuple(position), velocity=tuple(velocity))
        return dataclasses.replace(body, joint=joint)

    # --- from where Solids are ------------------------------------------------------------------------------------

    def coordinates(
        self, placed: Sequence[Pose], moving: Sequence[tuple[Vector3, Vector3]], last: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) of bodies at ``placed`` that move with ``moving``, linear and angular, whose joints may have separated: motion
        that a joint does not permit is left out. Angles are the ones nearest to those of the state ``last`` (nq,)."""
        q, v = np.zeros(self.layout.nq), np.zeros(self.layout.nv)
        for row, body in enumerate(self.world.bodies):
            at_q, at_v, kind, here = self.layout.position[row], self.layout.velocity[row], body.joint.kind, placed[row]
            linear, angular = moving[row]
            if kind == "fixed":
                continue
            if kind == "free":
                lever = frames.rotate(here.quaternion, self.levers[row])
                q[at_q] = (*frames.add(here.position, lever), *positive(here.quaternion))
                speed = frames.add(linear, frames.cross(angular, lever))
                v[at_v] = (*speed, *frames.rotate(frames.conjugate(here.quaternion), angular))
                continue
            origin = body.joint.origin
            if (parent := self.parents[row]) >= 0:
                origin = frames.compose(placed[parent], origin)
                carried, turning = moved(moving[parent], placed[parent].position, here.position)
                linear, angular = frames.subtract(linear, carried), frames.subtract(angular, turning)
            relative = frames.compose(frames.inverse(origin), here)
            if kind == "ball":
                q[at_q] = positive(relative.quaternion)
                v[at_v] = frames.rotate(frames.conjugate(here.quaternion), angular)
                continue
            axis = body.joint.axis
            along = frames.rotate(here.quaternion, axis)
            if kind == "hinge":
                w, *vector = relative.quaternion
                angle = 2.0 * math.atan2(frames.dot(axis, vector3(vector)), w)
                before = float(last[at_q][0])
                q[at_q] = angle + math.tau * round((before - angle) / math.tau)
                v[at_v] = frames.dot(along, angular)
            else:
                q[at_q], v[at_v] = frames.dot(axis, relative.position), frames.dot(along, linear)
        return q, v


def positive(turned: tuple[float, float, float, float]) -> tuple[float, ...]:
    """The one of the two quaternions of a rotation with w ≥ 0."""
    return turned if turned[0] >= 0.0 else tuple(-part for part in turned)


TURN_STEPS = 8
"""Steps without a look at the angles of hinges, which are counted on from one look to the next: at 0.1 rad a step and less."""
ZERO: Vector3 = (0.0, 0.0, 0.0)


class WebotsPoses(NamedTuple):
    """Poses of the world's body frames, and the velocities, linear and angular, of their origins."""

    poses: list[Pose]
    twists: list[Twist]


class WebotsSimulation:
    """A loaded world. Webots starts on the first query: a state that is set is the file that the
    next one begins in."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        try:
            given = WebotsSidecar.of(sidecar)
            self.states = WebotsStates(Wbt().read(folder), given)
        except (ValueError, FileNotFoundError, SpecError) as error:
            raise EngineError(NAME, str(error)) from error
        self.typed = given
        self.passive, self.sums = given.passive, given.sums or ()
        self.constraints: tuple[Constraint, ...] = ()
        self.offsets = np.zeros((len(given.bodies), 3))
        """None: poses are taken back to the world's frames here."""
        self._shifts = [body.frame_offset for body in given.bodies]
        self.forces = JointForces(self.states.world.bodies)
        self._wanted = self.states.initial()
        self._last = self._wanted[0]
        """Positions (nq,) near the present ones, by which angles are counted on."""
        self._contact = True
        self._smooth: list[int] = []
        self._live: Live | None = None
        self._said: list[str] = []
        self._placed: WebotsPoses | None = None

    # --- state ------------------------------------------------------------------------------------------------

    def live(self) -> Live:
        """Webots at work, in the state that is wanted."""
        if self._live is None:
            states = self.states
            q, v = self._wanted
            text = states.text(q, v, self._contact, self._smooth)
            names = [f"body_{row}" for row in range(len(states.world.bodies))]
            self._live = Live(text, states.model.timestep, names, list(states.centres))
        return self._live

    def _stop(self) -> None:
        live, self._live, self._placed = self._live, None, None
        if live is not None:
            self._said += live.complaints()
            live.close()

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Begin in the state (q, v). Raises EngineError for one that is not finite."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise EngineError(NAME, "a state is not finite, which no .wbt can hold")
        self._stop()
        self._wanted, self._last = (q, v), q

    def placed(self) -> WebotsPoses:
        """Where the world's bodies are, and how they move."""
        if self._placed is None:
            states = self.states
            positions, turns, speeds = self.live().states()
            back = frames.conjugate(states.turned)
            poses = [
                _frame(back, *given) for given in zip(positions.tolist(), turns.tolist(), self._shifts, strict=True)
            ]
            twists = [AT_REST] * len(poses)
            of_top = dict(zip(states.centres, speeds.tolist(), strict=True))
            for row, top in enumerate(states.tops):
                if top >= 0:
                    linear, angular = (
                        frames.rotate(back, vector3(part)) for part in (of_top[top][:3], of_top[top][3:])
                    )
                    twists[row] = moved((linear, angular), self._centre(poses, top), poses[row].position)
            self._placed = WebotsPoses(poses, twists)
        return self._placed

    def _centre(self, poses: Sequence[Pose], top: int) -> Vector3:
        """The centre of mass of a rigid group in the world, by its topmost body."""
        pose = poses[top]
        return frames.add(pose.position, frames.rotate(pose.quaternion, self.states.centres[top]))

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        placed = self.placed()
        q, v = self.states.coordinates(placed.poses, placed.twists, self._last)
        self._last = q
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the world's body frames."""
        placed = self.placed()
        poses = np.array([(*pose.position, *pose.quaternion) for pose in placed.poses], dtype=float).reshape(-1, 7)
        return poses, np.array([(*linear, *angular) for linear, angular in placed.twists], dtype=float).reshape(-1, 6)

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        given = None if effort is None or not np.any(effort) else np.asarray(effort, dtype=float)
        live = self.live()
        if given is None and not self.forces.needed:
            turns = any(body.joint.kind == "hinge" for body in self.states.world.bodies)
            self._by_steps(live, count, TURN_STEPS if turns else count)
            return
        for _ in range(count):
            q, v = self.get_state()
            total = self.forces.effort(q, v) + (0.0 if given is None else given)
            live.step(1, self._wrenches(total))
            self._placed = None

    def _by_steps(self, live: Live, count: int, most: int) -> None:
        """Step so often, and look at the angles of hinges often enough to count their turns."""
        while count:
            some = min(count, most)
            live.step(some)
            self._placed = None
            count -= some
            if count:
                self.get_state()

    def _wrenches(self, effort: np.ndarray) -> np.ndarray:
        """An effort (nv,) as forces on the topmost bodies of rigid groups, at the centres of mass, and torques (tops, 6),
        in the file's world axes. A joint acts on both of its bodies with opposite signs."""
        states, poses = self.states, self.placed().poses
        wrenches = {top: np.zeros(6) for top in states.centres}

        def add(row: int, force: Vector3, at: Vector3, torque: Vector3, sign: float) -> None:
            top = states.tops[row] if row >= 0 else -1
            if top < 0:
                return
            about = frames.add(torque, frames.cross(frames.subtract(at, self._centre(poses, top)), force))
            turned = (*frames.rotate(states.turned, force), *frames.rotate(states.turned, about))
            wrenches[top] += sign * np.array(turned)

        for row, body in enumerate(states.world.bodies):
            local, pose, kind = effort[states.layout.velocity[row]].tolist(), poses[row], body.joint.kind
            if not any(local):
                continue
            force, torque, at = ZERO, ZERO, pose.position
            if kind == "free":
                at = frames.add(at, frames.rotate(pose.quaternion, states.levers[row]))
                force, torque = vector3(local[:3]), frames.rotate(pose.quaternion, vector3(local[3:]))
            elif kind == "ball":
                torque = frames.rotate(pose.quaternion, vector3(local))
            else:
                x, y, z = frames.rotate(pose.quaternion, body.joint.axis)
                along = (local[0] * x, local[0] * y, local[0] * z)
                force, torque = (along, ZERO) if kind == "slide" else (ZERO, along)
            add(row, force, at, torque, 1.0)
            if kind != "free":
                add(states.parents[row], force, at, torque, -1.0)
        return np.array(list(wrenches.values())).reshape(-1, 6)

    # --- what can be switched off -----------------------------------------------------------------------------

    def disable_contact(self) -> None:
        """Nothing is solid in the state that is begun next, which is the initial one where none is set."""
        self._stop()
        self._contact = False

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """The same of the dry friction of the joints at the places ``v`` (n,)."""
        self._stop()
        places = set(np.asarray(v, dtype=int).tolist())
        rows = enumerate(self.states.layout.velocity)
        self._smooth = [row for row, at in rows if at.stop > at.start and at.start in places]

    def note(self, fields: Iterable[str]) -> None:
        """Tell of fields that Webots has and simspec does not know."""
        said = (f"Webots has {name}, which is not compared" for name in fields)
        self._said += [line for line in said if line not in self._said]

    def messages(self) -> list[str]:
        """Errors and warnings of Webots."""
        return [*self._said, *(self._live.complaints() if self._live is not None else ())]

    def close(self) -> None:
        self._stop()


def _frame(
    back: Quaternion, position: Sequence[float], turn: Sequence[Sequence[float]], offset: Sequence[float]
) -> Pose:
    """The pose of a body's frame in the world, of that of the file's in the file's world."""
    rows = tuple(vector3(row) for row in turn)
    there = Pose(frames.rotate(back, vector3(position)), frames.multiply(back, frames.from_matrix(rows)))  # type: ignore[arg-type]
    x, y, z = offset
    return frames.compose(there, Pose((-x, -y, -z)))


# The model in Webots: all fields of its nodes, and the velocities of its bodies, read like a file (``raising.py``).

SOURCE: Final = "Webots"
"""The name in errors, in place of a file's."""
MOVES: Final = ("linearVelocity", "angularVelocity")
"""Fields of Solids that the manual does not have: velocities of Webots' bodies are queried."""
MOVING: Final = ("Solid", "Robot")


def read_back(sim: WebotsSimulation) -> ReadBack:
    """The model as Webots holds it, and its state. Raises EngineError, which names the node, for what simspec did not write.
    Fields that a newer Webots adds to those of R2023b are reported with its messages, and not compared."""
    live = sim.live()
    unexpected: dict[str, None] = {}
    try:
        actual = raised(read_document(live, list(sim.states.centres), unexpected), sim.typed)
    except ValueError as error:
        raise EngineError(NAME, f"has another world than the file: {error}") from error
    sim.note(unexpected)
    return actual


def read_document(live: Live, tops: Sequence[int], unexpected: dict[str, None]) -> WbtDocument:
    """The nodes that Webots holds, as a document; ``tops``: the numbers of bodies that move by themselves. ``strange`` becomes
    the fields that a node of simspec's does not have."""
    speeds = live.states()[2].tolist()
    velocities = {f"body_{row}": speed for row, speed in zip(tops, speeds, strict=True)}
    return WbtDocument(SOURCE, VERSION, tuple(_node(node, velocities, unexpected) for node in live.nodes()))


def _node(
    node_data: Mapping[str, Any], velocities: Mapping[str, Sequence[float]], unexpected: dict[str, None]
) -> WbtNode:
    kind, label = node_data["node"], node_data["label"]
    known = NODES.get(kind)
    if known is None:
        raise EngineError(NAME, f"holds a {kind} {label}, which simspec does not write")
    moves = MOVES if kind in MOVING else ()
    fields: list[WbtField] = []
    for name, field in node_data["fields"].items():
        if name not in known:
            unexpected[f"{kind}.{name}"] = None
        elif name not in moves:
            values: list[Value] = [
                _node(value, velocities, unexpected) if isinstance(value, dict) else value for value in field["values"]
            ]
            fields.append(WbtField(name, 0, tuple(values), field["kind"].startswith("MF")))
    speed = velocities.get(label, (0.0,) * 6)
    parts = (tuple(speed[:3]), tuple(speed[3:]))
    fields += [WbtField(name, 0, part, False) for name, part in zip(moves, parts, strict=False)]
    return WbtNode(SOURCE, kind, label, 0, tuple(fields))
