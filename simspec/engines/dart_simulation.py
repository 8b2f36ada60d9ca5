"""A DART world loaded from ``world.skel``, with what the sidecar adds; states in and out, and the motion of steps.

State. DART has a ball joint's position as a rotation vector and its velocity in the child's axes; a free joint's position as
(rotation vector, position of the origin) and its velocity as (ω, velocity of the origin), both in world axes.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simspec.errors import EngineError
from simspec.formats.skel import SMALL_TURN, WORLD, file_name, world_name
from simspec.world import frames
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Quaternion

NAME = "dart"

JOINT_KINDS = {
    "WeldJoint": "fixed",
    "RevoluteJoint": "hinge",
    "PrismaticJoint": "slide",
    "BallJoint": "ball",
    "FreeJoint": "free",
}
"""DART's joint types."""

ZERO_MASS = "A negative or zero mass [0]"
"""DART warns of bodies without mass, which simspec has only where they cannot move: that is no news."""

_COLOUR = re.compile("\x1b\\[[0-9;]*m")


@contextlib.contextmanager
def captured_errors(lines: list[str]) -> Iterator[None]:
    """Catch what C++ code prints to standard error meanwhile, and add it to ``lines``."""
    if os.name != "posix":  # the C library's buffers cannot be flushed from here; nothing is caught
        yield
        return
    flush = ctypes.CDLL(None).fflush
    sys.stderr.flush()
    flush(None)
    kept = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            flush(None)
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            text = _COLOUR.sub("", file.read().decode(errors="replace"))
            lines.extend(line for line in text.splitlines() if line.strip() and ZERO_MASS not in line)


def turn_of(vector: Sequence[float]) -> Quaternion:
    """The rotation of a rotation vector, as a unit quaternion with w ≥ 0."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return frames.IDENTITY
    share = math.sin(angle / 2.0) / angle
    w = math.cos(angle / 2.0)
    if w < 0.0:
        w, share = -w, -share
    return (w, x * share, y * share, z * share)


def vector_of(q: Sequence[float]) -> tuple[float, float, float]:
    """log R of a unit quaternion; short turns the long way round (see ``formats/skel.py``, ``SMALL_TURN``)."""
    w, x, y, z = q
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return (0.0, 0.0, 0.0)
    turn = 2.0 * math.atan2(sine, w)
    if SMALL_TURN[0] < turn < SMALL_TURN[1]:
        turn -= 2.0 * math.pi
    factor = turn / sine
    return (x * factor, y * factor, z * factor)


def _multiply(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """The rotation ``a`` after ``b``, brought back to unit length."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


@dataclass(slots=True)
class Turner:
    """A ball or free joint: its kind, its place in its tree's coordinates and in q and v, and its rotation as it was
    last set or corrected (None: unknown, to be asked)."""

    joint: Any
    kind: str
    start: int
    q: slice
    v: slice
    turn: Quaternion | None = None


@dataclass(slots=True)
class Tree:
    """One skeleton with coordinates. ``order``, ``q`` and ``v``: where hinges and slides stand in the skeleton's
    coordinates and in the world's; ``block``: all of the tree's places in v; ``turners``: its ball and free joints.

    ``loss``, ``stiffness``, ``rest`` (dofs): the effort −loss v − stiffness (q − rest) that is applied from outside.
    """

    skeleton: Any
    order: np.ndarray
    q: np.ndarray
    v: np.ndarray
    block: np.ndarray
    turners: list[Turner]
    loss: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    driven: bool = False
    """Whether loss or stiffness are not all zero."""
    constant: np.ndarray | None = None
    """The given effort in the skeleton's coordinates, free torques still in the body's axes."""

    def velocity_map(self) -> np.ndarray:
        """T with v_skeleton = T v: a free joint's (velocity, ω in body axes) to (ω in world axes, velocity).

        T's rate times v is zero, Ṙ ω = R (ω × ω), so that M = Tᵀ M_skeleton T and h = Tᵀ h_skeleton.
        """
        place = {int(index): column for column, index in enumerate(self.block)}
        found = np.zeros((len(self.block), len(self.block)))
        for row, index in zip(self.order, self.v, strict=True):
            found[row, place[int(index)]] = 1.0
        for one in self.turners:
            first = place[one.v.start]
            if one.kind == "ball":
                found[one.start : one.start + 3, first : first + 3] = np.eye(3)
            else:
                turn = turn_of(self.skeleton.getPositions()[one.start : one.start + 3])
                found[one.start : one.start + 3, first + 3 : first + 6] = frames.matrix(turn)
                found[one.start + 3 : one.start + 6, first : first + 3] = np.eye(3)
        return found


class Simulation:
    """A loaded world. Facts marked *measured* were obtained with dartpy 6.20.0."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        try:
            import dartpy
        except ImportError as error:
            raise EngineError(NAME, f"not installed: pip install 'simspec[dart]' ({error})") from error
        self.dartpy = dartpy
        self.sidecar = sidecar
        self.settings = sidecar["settings"]
        self.log: list[str] = []
        path = folder / WORLD
        if not path.is_file():
            raise EngineError(NAME, f"the file {WORLD!r} is missing")
        with captured_errors(self.log):
            self.world = dartpy.utils.SkelParser.readWorld(str(path))
            if self.world is not None:
                self._set_solver()
        if self.world is None:
            raise EngineError(NAME, f"refuses {WORLD}: {' '.join(self.log) or 'no reason given'}")
        self.dt = self.world.getTimeStep()
        self.names = [entry["name"] for entry in sidecar["bodies"]]
        self.kinds = [entry["kind"] for entry in sidecar["bodies"]]
        self.offsets = np.array([entry["frame_offset"] for entry in sidecar["bodies"]], dtype=float).reshape(-1, 3)
        self.bodies = self._find_bodies()
        self.place = {file_name(name): index for index, name in enumerate(self.names)}
        self._lay_out()
        self._set_joints()
        self._set_surfaces()
        self._set_filter()
        self.touchable = any(body.isReactive() and self.collision_nodes(body) for body in self.bodies)
        self.exact_rotation = {"always": True, "never": False, "auto": not self.touchable}[
            self.settings["exact_rotation"]
        ]
        self.set_state(*self.get_state())

    # --- loading -----------------------------------------------------------------------------------------------

    def _set_solver(self) -> None:
        dartpy, world, given = self.dartpy, self.world, self.settings
        options = world.getDeactivationOptions()
        options.mEnabled = False  # on by default: resting bodies would be taken out of the simulation
        world.setDeactivationOptions(options)
        world.setNumSimulationThreads(1)
        kinds = dartpy.simulation.CollisionDetectorType
        world.setCollisionDetector(getattr(kinds, given["collision_detector"].upper()))
        self.solver = solver = world.getConstraintSolver()
        solver.setSplitImpulseEnabled(False)
        matrix_free = solver.getMatrixFreeContactSolverOptions()
        matrix_free.mEnabled = False  # another, approximate solver for many contacts
        solver.setMatrixFreeContactSolverOptions(matrix_free)
        if given["contact_solver"] == "dantzig":
            solver.setBoxedLcpSolver(dartpy.constraint.DantzigBoxedLcpSolver())
        else:
            kind = dartpy.constraint.NsgsFrictionSolver
            chosen = kind.Options()
            chosen.law = kind.Law.Coulomb if self.sidecar["friction_cone"] == "elliptic" else kind.Law.Box
            chosen.maxSweeps = given["iterations"]
            chosen.tolerance = given["tolerance"]
            solver.setBoxedLcpSolver(kind(chosen))

    def _find_bodies(self) -> list[Any]:
        held: dict[str, Any] = {}
        for index in range(self.world.getNumSkeletons()):
            for body in self.world.getSkeleton(index).getBodyNodes():
                held[body.getName()] = body
        missing = [name for name in self.names if file_name(name) not in held]
        more = sorted(set(held) - {file_name(name) for name in self.names})
        if missing or more:
            raise EngineError(NAME, f"{WORLD} has no bodies {missing}, and the sidecar has no bodies {more}")
        return [held[file_name(name)] for name in self.names]

    def _lay_out(self) -> None:
        nq = nv = 0
        rows: dict[str, list[tuple[Any, str, slice, slice]]] = {}
        self.q_places: list[slice] = []
        self.v_places: list[slice] = []
        for body, kind in zip(self.bodies, self.kinds, strict=True):
            joint = body.getParentJoint()
            held = JOINT_KINDS.get(joint.getType())
            if held is None:
                raise EngineError(NAME, f"holds the joint {joint.getName()!r} as {joint.getType()}, unknown here")
            if VELOCITY_SIZE[held] != VELOCITY_SIZE[kind]:
                raise EngineError(NAME, f"joint {joint.getName()!r} is a {held} joint, the sidecar says {kind}")
            q, v = slice(nq, nq + POSITION_SIZE[kind]), slice(nv, nv + VELOCITY_SIZE[kind])
            self.q_places.append(q)
            self.v_places.append(v)
            rows.setdefault(body.getSkeleton().getName(), []).append((joint, kind, q, v))
            nq, nv = q.stop, v.stop
        self.nq, self.nv = nq, nv
        self.trees = [
            self._tree(self.world.getSkeleton(name), entries)
            for name, entries in rows.items()
            if any(VELOCITY_SIZE[kind] for _, kind, _, _ in entries)
        ]

    def _tree(self, skeleton: Any, entries: list[tuple[Any, str, slice, slice]]) -> Tree:
        order, q_index, v_index, block, turners = [], [], [], [], []
        for joint, kind, q, v in entries:
            if kind == "fixed":
                continue
            start = joint.getIndexInSkeleton(0)
            block.extend(range(v.start, v.stop))
            if kind in ("hinge", "slide"):
                order.append(start)
                q_index.append(q.start)
                v_index.append(v.start)
            else:
                turners.append(Turner(joint, kind, start, q, v))
        dofs = skeleton.getNumDofs()
        arrays = [np.array(values, dtype=np.intp) for values in (order, q_index, v_index, block)]
        return Tree(skeleton, *arrays, turners, np.zeros(dofs), np.zeros(dofs), np.zeros(dofs))

    def _set_joints(self) -> None:
        """Limits and their enforcement, and the efforts that are applied from outside.

        Damping and springs are explicit in time, DART's own are implicit. Armature A is DART's implicit damping A / dt
        with the effort (A / dt) v against it: (M + A) v̇ = τ − h exactly.
        """
        joints = {name: body.getParentJoint() for name, body in zip(self.names, self.bodies, strict=True)}
        for name in self.sidecar["enforce_limits"]:
            joints[name].setLimitEnforcement(True)
        for entry in self.sidecar["effort_limits"]:
            joints[entry["body"]].setForceLowerLimit(0, -entry["value"])
            joints[entry["body"]].setForceUpperLimit(0, entry["value"])
        of = {tree.skeleton.getName(): tree for tree in self.trees}

        def dofs(name: str) -> tuple[Tree, slice]:
            joint = joints[name]
            start = joint.getIndexInSkeleton(0)
            return of[joint.getSkeleton().getName()], slice(start, start + joint.getNumDofs())

        for entry in self.sidecar["damping"]:
            tree, place = dofs(entry["body"])
            tree.loss[place] += entry["value"]
        for entry in self.sidecar["springs"]:
            tree, place = dofs(entry["body"])
            tree.stiffness[place] = entry["stiffness"]
            tree.rest[place] = entry["rest"]
        self.armature = np.zeros(self.nv)
        for entry in self.sidecar["armature"]:
            tree, place = dofs(entry["body"])
            joints[entry["body"]].setDampingCoefficient(0, entry["value"] / self.dt)
            tree.loss[place] -= entry["value"] / self.dt
            self.armature[self.v_places[self.names.index(entry["body"])]] = entry["value"]
        for tree in self.trees:
            tree.driven = bool(tree.loss.any() or tree.stiffness.any())

    def _set_surfaces(self) -> None:
        given: dict[str, list[Mapping[str, Any]]] = {}
        for shape in self.sidecar["shapes"]:
            if shape["collision"]:
                given.setdefault(shape["body"], []).append(shape)
        for name, body in zip(self.names, self.bodies, strict=True):
            nodes, shapes = self.collision_nodes(body), given.get(name, [])
            if len(nodes) != len(shapes):
                raise EngineError(
                    NAME, f"body {name!r} has {len(nodes)} collision shapes, the sidecar names {len(shapes)}"
                )
            for node, shape in zip(nodes, shapes, strict=True):
                friction, restitution = shape["surface"]
                node.getDynamicsAspect().setFrictionCoeff(friction)
                node.getDynamicsAspect().setRestitutionCoeff(restitution)

    @staticmethod
    def shape_nodes(body: Any) -> list[Any]:
        """A body's shape nodes; each is either a visual or a collision shape of the file."""
        return [body.getShapeNode(index) for index in range(body.getNumShapeNodes())]

    def collision_nodes(self, body: Any) -> list[Any]:
        """A body's collision shapes, in the order of the file."""
        return [node for node in self.shape_nodes(body) if node.hasCollisionAspect()]

    def _set_filter(self) -> None:
        """Every pair of bodies may touch, also in one tree, but for those that the sidecar excludes."""
        for index in range(self.world.getNumSkeletons()):
            skeleton = self.world.getSkeleton(index)
            skeleton.enableSelfCollisionCheck()
            skeleton.enableAdjacentBodyCheck()
        of = dict(zip(self.names, self.bodies, strict=True))
        # the option is a copy, the filter in it is the solver's own (measured)
        blacklist = self.solver.getCollisionOption().collisionFilter
        add, groups = blacklist.addBodyNodePairToBlackList, self.sidecar["groups"]
        for first, second in self.sidecar["ignored_groups"]:
            for one in groups[first]:
                for other in groups[second]:
                    if one != other:
                        add(of[one], of[other])
        for one, other in self.sidecar["excluded"]:
            add(of[one], of[other])

    def disable_contact(self) -> None:
        # the detectors do not ask a shape whether it may collide (measured); what is not in the solver's group cannot
        self.world.getConstraintSolver().getCollisionGroup().removeAllShapeFrames()
        if self.settings["exact_rotation"] != "never":
            self.exact_rotation = True

    # --- state -------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
        for tree in self.trees:
            dofs = tree.skeleton.getNumDofs()
            position, velocity = np.zeros(dofs), np.zeros(dofs)
            position[tree.order], velocity[tree.order] = q[tree.q], v[tree.v]
            for one in tree.turners:
                start, held = one.start, q[one.q].tolist()
                turn = frames.normalise(tuple(held[-4:]))
                one.turn = turn
                position[start : start + 3] = vector_of(turn)
                if one.kind == "ball":
                    velocity[start : start + 3] = v[one.v]
                else:
                    linear, angular = v[one.v][:3], v[one.v][3:]
                    position[start + 3 : start + 6] = held[:3]
                    velocity[start : start + 3] = frames.rotate(turn, tuple(angular.tolist()))
                    velocity[start + 3 : start + 6] = linear
            skeleton = tree.skeleton
            skeleton.setPositions(position)
            skeleton.setVelocities(velocity)
            skeleton.setAccelerations(np.zeros(dofs))
            skeleton.clearInternalForces()
            skeleton.clearExternalForces()
            skeleton.clearConstraintImpulses()
        self.solver.clearLastCollisionResult()

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        for tree in self.trees:
            position, velocity = tree.skeleton.getPositions(), tree.skeleton.getVelocities()
            q[tree.q], v[tree.v] = position[tree.order], velocity[tree.order]
            for one in tree.turners:
                start = one.start
                turn = turn_of(position[start : start + 3].tolist())
                if one.kind == "ball":
                    q[one.q] = turn
                    v[one.v] = velocity[start : start + 3]
                else:
                    q[one.q] = (*position[start + 3 : start + 6], *turn)
                    angular = frames.rotate(frames.conjugate(turn), tuple(velocity[start : start + 3].tolist()))
                    v[one.v] = (*velocity[start + 3 : start + 6], *angular)
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        poses, velocities = np.zeros((len(self.bodies), 7)), np.zeros((len(self.bodies), 6))
        for index, body in enumerate(self.bodies):
            place = body.getWorldTransform()
            poses[index, :3], poses[index, 3:] = place.translation(), place.quaternion().wxyz()
            velocities[index, :3], velocities[index, 3:] = body.getLinearVelocity(), body.getAngularVelocity()
        poses[poses[:, 3] < 0.0, 3:] *= -1.0
        return poses, velocities

    # --- contact -----------------------------------------------------------------------------------------------

    def touching(self, contact: Any) -> tuple[int, int]:
        """The world's indices of the two bodies of a contact."""
        first, second = (
            self.place[one.getShapeFrame().asShapeNode().getBodyNode().getName()]
            for one in (contact.collisionObject1, contact.collisionObject2)
        )
        return first, second

    def detect_contacts(self) -> np.ndarray:
        """Sorted pairs (n, 2) of bodies that touch at the present state."""
        result = self.dartpy.collision.CollisionResult()
        self.solver.getCollisionGroup().collide(self.solver.getCollisionOption(), result)
        pairs = {tuple(sorted(self.touching(contact))) for contact in result.getContacts()}
        return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)

    # --- steps -------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the efforts of the world's joints."""
        self._set_constant(effort)
        driven = [tree for tree in self.trees if tree.driven or tree.constant is not None]
        turners = [one for tree in self.trees for one in tree.turners]
        if self.exact_rotation and turners:
            for one in turners:
                if one.turn is None:
                    one.turn = turn_of(one.joint.getPositions()[:3].tolist())
        else:
            for one in turners:
                one.turn = None
            turners = []
        step = self.world.step
        if not driven and not turners:
            for _ in range(count):
                step()
            return
        for _ in range(count):
            for tree in driven:
                tree.skeleton.setForces(self._effort(tree))  # DART forgets them after the step
            step()
            for one in turners:
                self._correct(one)

    def _set_constant(self, effort: np.ndarray | None) -> None:
        for tree in self.trees:
            tree.constant = None
            if effort is None or not effort[tree.block].any():
                continue
            found = np.zeros(tree.skeleton.getNumDofs())
            found[tree.order] = effort[tree.v]
            for one in tree.turners:
                given = effort[one.v]
                found[one.start : one.start + 3] = given[-3:]
                if one.kind == "free":
                    found[one.start + 3 : one.start + 6] = given[:3]
            tree.constant = found

    def _effort(self, tree: Tree) -> np.ndarray:
        """The effort on a tree in its present state, in the skeleton's coordinates."""
        skeleton = tree.skeleton
        found = np.zeros(len(tree.loss)) if tree.constant is None else tree.constant.copy()
        if tree.driven:
            position = skeleton.getPositions()
            for one in tree.turners:
                if one.kind == "ball":
                    position[one.start : one.start + 3] = _shortest(position[one.start : one.start + 3])
            found -= tree.loss * skeleton.getVelocities() + tree.stiffness * (position - tree.rest)
        if tree.constant is not None:
            for one in tree.turners:
                if one.kind == "free":
                    place = slice(one.start, one.start + 3)
                    turn = one.turn or turn_of(one.joint.getPositions()[:3].tolist())
                    found[place] = frames.rotate(turn, tuple(tree.constant[place].tolist()))
        return found

    def _correct(self, one: Turner) -> None:
        """Put a joint's rotation where the exponential of its velocity takes it.

        DART's own is a Taylor form for turns below 1e-3 rad in a step, off by up to 1.7e-10 (measured).
        """
        velocity = one.joint.getVelocities()[:3].tolist()
        change = turn_of([x * self.dt for x in velocity])
        if one.turn is None:
            raise RuntimeError("a rotation is corrected that was never known")
        if one.kind == "ball":
            one.turn = _multiply(one.turn, change)
            one.joint.setPositions(vector_of(one.turn))
        else:
            one.turn = _multiply(change, one.turn)
            one.joint.setPositions([*vector_of(one.turn), *one.joint.getPositions()[3:].tolist()])

    def spring_energy(self) -> float:
        """Potential energy of the springs (J)."""
        total = 0.0
        for tree in self.trees:
            if tree.stiffness.any():
                position = tree.skeleton.getPositions()
                for one in tree.turners:
                    if one.kind == "ball":
                        position[one.start : one.start + 3] = _shortest(position[one.start : one.start + 3])
                total += 0.5 * float(np.sum(tree.stiffness * (position - tree.rest) ** 2))
        return total


def _shortest(vector: np.ndarray) -> np.ndarray:
    """The same rotation with an angle of at most π."""
    angle = float(np.linalg.norm(vector))
    return vector * (1.0 - 2.0 * math.pi / angle) if angle > math.pi else vector


__all__ = ["Simulation", "Tree", "captured_errors", "turn_of", "vector_of", "world_name"]
