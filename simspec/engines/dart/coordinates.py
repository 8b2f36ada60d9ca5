"""Between DART's coordinates and simspec's, and between its body nodes and the world's bodies.

DART has a ball joint's position as a rotation vector and its velocity in the child's axes; a free joint's position as
(rotation vector, position of the origin) and its velocity as (ω, velocity of the origin), both in world axes. Hinges and
slides are the same in both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.dialects.dart.dialect import SMALL_TURN
from simspec.dialects.dart.sidecar import DartSidecar
from simspec.errors import EngineError
from simspec.formats.skel.format import WORLD, file_name
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.rotations import conjugate, exponential, exponential_of, logarithm_of, rotate
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Quaternion, Vector3

NAME = "dart"

JOINT_KINDS = {
    "WeldJoint": "fixed",
    "RevoluteJoint": "hinge",
    "PrismaticJoint": "slide",
    "BallJoint": "ball",
    "FreeJoint": "free",
}
"""DART's joint types."""


def vector_of(q: Sequence[float]) -> Vector3:
    """log R of a unit quaternion; short turns the long way round (see ``SMALL_TURN`` in ``dialects/dart/dialect.py``)."""
    x, y, z = logarithm_of(q)
    turn = math.sqrt(x * x + y * y + z * z)
    if not SMALL_TURN[0] < turn < SMALL_TURN[1]:
        return (x, y, z)
    factor = 1.0 - 2.0 * math.pi / turn
    return (x * factor, y * factor, z * factor)


@dataclass(slots=True)
class Turner:
    """A ball or free joint: kind, first coordinate in its skeleton and among all, and places in q and v.

    ``turn`` is its rotation as it was last set or corrected; None when a step has been made since without that.
    """

    joint: Any
    kind: str
    start: int
    dof: int
    q: slice
    v: slice
    turn: Quaternion | None = None


@dataclass(frozen=True, slots=True)
class DartTree:
    """A skeleton that has coordinates: their places among all, the tree's places in v, its ball and free joints, and
    where its hinges and slides stand: (coordinate in the skeleton, place in v)."""

    skeleton: Any
    dofs: slice
    block: np.ndarray
    turners: tuple[Turner, ...]
    straight: tuple[tuple[int, int], ...]

    def velocity_map(self) -> np.ndarray:
        """T with v_skeleton = T v: a free joint's (velocity, ω in body axes) to (ω in world axes, velocity).

        T's rate times v is zero, as Ṙ ω = R (ω × ω), so that M = Tᵀ M_skeleton T and h = Tᵀ h_skeleton.
        """
        column = {int(place): index for index, place in enumerate(self.block)}
        found = np.zeros((len(self.block), len(self.block)))
        for row, place in self.straight:
            found[row, column[place]] = 1.0
        for turner in self.turners:
            row, first = turner.start, column[turner.v.start]
            if turner.kind == "ball":
                found[row : row + 3, first : first + 3] = np.eye(3)
            else:
                turn = exponential_of(turner.joint.getPositions()[:3].tolist())
                found[row : row + 3, first + 3 : first + 6] = frames.matrix(turn)
                found[row + 3 : row + 6, first : first + 3] = np.eye(3)
        return found


class DartCoordinates:
    """All coordinates of a world: DART's, one skeleton after the other, and simspec's q and v."""

    def __init__(self, bodies: Sequence[Any], kinds: Sequence[str]):
        """``bodies`` are DART's, in the order of the world's; ``kinds`` their joints' as the sidecar says."""
        self.q_places: list[slice] = []
        self.v_places: list[slice] = []
        self.nq = self.nv = self.count = 0
        self._straight: list[tuple[int, int, int]] = []  # hinges and slides: coordinate, place in q, place in v
        rows: dict[str, list[tuple[Any, str, slice, slice]]] = {}
        for body, kind in zip(bodies, kinds, strict=True):
            joint = body.getParentJoint()
            joint_kind = JOINT_KINDS.get(joint.getType())
            if joint_kind is None:
                raise EngineError(NAME, f"holds the joint {joint.getName()!r} as {joint.getType()}, unknown here")
            if joint_kind != kind:
                raise EngineError(NAME, f"joint {joint.getName()!r} is a {joint_kind} joint, the sidecar says {kind}")
            q = slice(self.nq, self.nq + POSITION_SIZE[kind])
            v = slice(self.nv, self.nv + VELOCITY_SIZE[kind])
            self.q_places.append(q)
            self.v_places.append(v)
            rows.setdefault(body.getSkeleton().getName(), []).append((joint, kind, q, v))
            self.nq, self.nv = q.stop, v.stop
        self.trees = [
            self._tree(entries) for entries in rows.values() if any(VELOCITY_SIZE[kind] for _, kind, _, _ in entries)
        ]
        self.turners = [turner for tree in self.trees for turner in tree.turners]
        self._index()

    def _tree(self, entries: list[tuple[Any, str, slice, slice]]) -> DartTree:
        skeleton = entries[0][0].getSkeleton()
        dofs = slice(self.count, self.count + skeleton.getNumDofs())
        self.count = dofs.stop
        block: list[int] = []
        straight, turners = [], []
        for joint, kind, q, v in entries:
            if kind == "fixed":
                continue
            start = joint.getIndexInSkeleton(0)
            block.extend(range(v.start, v.stop))
            if kind in SCALAR_JOINTS:
                straight.append((start, v.start, q.start))
            else:
                turners.append(Turner(joint, kind, start, dofs.start + start, q, v))
        self._straight.extend((dofs.start + start, q, v) for start, v, q in straight)
        places = tuple((start, v) for start, v, _ in straight)
        return DartTree(skeleton, dofs, np.array(block, dtype=np.intp), tuple(turners), places)

    def _index(self) -> None:
        """Index arrays for all joints of a kind at once."""
        table = np.array(self._straight, dtype=np.intp).reshape(-1, 3)
        self._dof, self._q, self._v = table[:, 0], table[:, 1], table[:, 2]
        balls = [turner for turner in self.turners if turner.kind == "ball"]
        free = [turner for turner in self.turners if turner.kind == "free"]

        def places(starts: list[int], count: int) -> np.ndarray:
            return np.array(starts, dtype=np.intp).reshape(-1, 1) + np.arange(count)

        self._ball_dof = places([ball.dof for ball in balls], 3)
        self._ball_q, self._ball_v = places([b.q.start for b in balls], 4), places([b.v.start for b in balls], 3)
        self._free_dof = places([turner.dof for turner in free], 6)
        self._free_q, self._free_v = places([f.q.start for f in free], 7), places([f.v.start for f in free], 6)

    def positions(self) -> np.ndarray:
        """DART's coordinates of all trees (count,)."""
        return self._gather("getPositions")

    def velocities(self) -> np.ndarray:
        """DART's velocities of all trees (count,)."""
        return self._gather("getVelocities")

    def _gather(self, method: str) -> np.ndarray:
        parts = [getattr(tree.skeleton, method)() for tree in self.trees]
        return np.concatenate(parts) if parts else np.zeros(0)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) of the present state."""
        values, rate = self.positions(), self.velocities()
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        q[self._q], v[self._v] = values[self._dof], rate[self._dof]
        if len(self._ball_q):
            q[self._ball_q], v[self._ball_v] = exponential(values[self._ball_dof]), rate[self._ball_dof]
        if len(self._free_q):
            place, motion = values[self._free_dof], rate[self._free_dof]
            turns = exponential(place[:, :3])
            q[self._free_q] = np.concatenate([place[:, 3:], turns], axis=1)
            v[self._free_v] = np.concatenate([motion[:, 3:], rotate(conjugate(turns), motion[:, :3])], axis=1)
        return q, v

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put all skeletons into the state (q, v), without accelerations, forces or impulses of before."""
        q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
        values, rate = np.zeros(self.count), np.zeros(self.count)
        values[self._dof], rate[self._dof] = q[self._q], v[self._v]
        for turner in self.turners:
            given = q[turner.q].tolist()
            turn = turner.turn = frames.normalise(tuple(given[-4:]))
            first, motion = turner.dof, v[turner.v]
            values[first : first + 3] = vector_of(turn)
            if turner.kind == "ball":
                rate[first : first + 3] = motion
            else:
                values[first + 3 : first + 6] = given[:3]
                rate[first : first + 3] = frames.rotate(turn, tuple(motion[3:].tolist()))
                rate[first + 3 : first + 6] = motion[:3]
        for tree in self.trees:
            skeleton = tree.skeleton
            skeleton.setPositions(values[tree.dofs])
            skeleton.setVelocities(rate[tree.dofs])
            skeleton.setAccelerations(np.zeros(tree.dofs.stop - tree.dofs.start))
            skeleton.clearInternalForces()
            skeleton.clearExternalForces()
            skeleton.clearConstraintImpulses()


# Efforts that DART does not have in this form, computed from its own state before every step.
#
# Damping and springs are explicit in time: −d v, −k (q − rest), for a ball −k log R. DART's own are implicit.
# Armature A is DART's implicit damping A / dt, with the effort (A / dt) v against it: (M + A) v̇ = τ − h exactly.


def shortest(vector: np.ndarray) -> np.ndarray:
    """The rotation vector of the same rotation with an angle of at most π."""
    angle = float(np.linalg.norm(vector))
    return vector * (1.0 - 2.0 * math.pi / angle) if angle > math.pi else vector


class DartEfforts:
    """The effort τ − loss v − stiffness (q − rest) on all of DART's coordinates; τ is what the caller gives."""

    def __init__(self, coordinates: DartCoordinates, joints: Mapping[str, Any], sidecar: DartSidecar, timestep: float):
        """``joints`` are DART's, by the name of the body. Gives DART the implicit part of the armature."""
        self._coordinates = coordinates
        self._first = {tree.skeleton.getName(): tree.dofs.start for tree in coordinates.trees}
        self.damping, self.armature, self.stiffness, self.rest = np.zeros((4, coordinates.count))

        for entry in sidecar.damping:
            self.damping[self.place(joints[entry.body])] = entry.value
        for entry in sidecar.armature:
            self.armature[self.place(joints[entry.body])] = entry.value
            for dof in range(joints[entry.body].getNumDofs()):
                joints[entry.body].setDampingCoefficient(dof, entry.value / timestep)
        for spring in sidecar.springs:
            at = self.place(joints[spring.body])
            self.stiffness[at], self.rest[at] = spring.stiffness, spring.rest
        self._loss = self.damping - self.armature / timestep
        self._driven = {
            tree.skeleton.getName()
            for tree in coordinates.trees
            if self._loss[tree.dofs].any() or self.stiffness[tree.dofs].any()
        }
        self._always = [tree for tree in coordinates.trees if tree.skeleton.getName() in self._driven]
        self._given: dict[str, np.ndarray] = {}

    def place(self, joint: Any) -> slice:
        """Where a joint's coordinates stand among all."""
        start = self._first[joint.getSkeleton().getName()] + joint.getIndexInSkeleton(0)
        return slice(start, start + joint.getNumDofs())

    def give(self, effort: np.ndarray | None) -> list[DartTree]:
        """Take τ = ``effort`` (nv,), None = zero, for the steps to come. Returns the trees that need an effort."""
        self._given = {}
        if effort is None:
            return self._always
        needed = []
        for tree in self._coordinates.trees:
            name = tree.skeleton.getName()
            if np.any(effort[tree.block]):
                self._given[name] = self._in_skeleton(tree, np.asarray(effort, dtype=float))
            if name in self._given or name in self._driven:
                needed.append(tree)
        return needed

    @property
    def driven(self) -> bool:
        """Whether there is something to apply before every step even without an effort from outside."""
        return bool(self._always)

    @staticmethod
    def _in_skeleton(tree: DartTree, effort: np.ndarray) -> np.ndarray:
        """The effort in the skeleton's coordinates; torques on free joints still in the body's axes."""
        found = np.zeros(tree.dofs.stop - tree.dofs.start)
        for start, place in tree.straight:
            found[start] = effort[place]
        for turner in tree.turners:
            given = effort[turner.v]
            found[turner.start : turner.start + 3] = given[-3:]
            if turner.kind == "free":
                found[turner.start + 3 : turner.start + 6] = given[:3]
        return found

    def apply(self, tree: DartTree) -> None:
        """Set the forces of one tree for the next step, after which DART forgets them."""
        name, skeleton, dofs = tree.skeleton.getName(), tree.skeleton, tree.dofs
        given = self._given.get(name)
        if given is None:
            total = np.zeros(dofs.stop - dofs.start)
        else:
            total = given.copy()
            for turner in tree.turners:
                if turner.kind == "free":
                    turn = turner.turn or exponential_of(turner.joint.getPositions()[:3].tolist())
                    place = slice(turner.start, turner.start + 3)
                    total[place] = frames.rotate(turn, tuple(given[place].tolist()))
        if name in self._driven:
            total -= self._loss[dofs] * skeleton.getVelocities()
            total -= self.stiffness[dofs] * self._stretch(tree)
        skeleton.setForces(total)

    def _stretch(self, tree: DartTree) -> np.ndarray:
        """q − rest of one tree, in DART's coordinates: of a ball joint log R."""
        found: np.ndarray = tree.skeleton.getPositions() - self.rest[tree.dofs]
        for turner in tree.turners:
            if turner.kind == "ball":
                found[turner.start : turner.start + 3] = shortest(found[turner.start : turner.start + 3])
        return found

    def energy(self) -> tuple[float, float]:
        """Kinetic energy of the armatures and potential energy of the springs (J)."""
        kinetic = potential = 0.0
        for tree in self._coordinates.trees:
            if self.armature[tree.dofs].any():
                kinetic += 0.5 * float(np.sum(self.armature[tree.dofs] * tree.skeleton.getVelocities() ** 2))
            if self.stiffness[tree.dofs].any():
                potential += 0.5 * float(np.sum(self.stiffness[tree.dofs] * self._stretch(tree) ** 2))
        return kinetic, potential


# DART's body nodes: the world's bodies, and the welded nodes that hold further copies of their shapes. DART holds friction and
# restitution per shape, but filters collision per body node (``dialects/dart/contact.py``). Facts marked *measured*: dartpy
# 6.20.0.


def shape_nodes(node: Any) -> list[Any]:
    """A node's shapes; each is either a visual or a collision shape of the file."""
    return [node.getShapeNode(index) for index in range(node.getNumShapeNodes())]


def collision_nodes(node: Any) -> list[Any]:
    """A node's collision shapes, in the order of the file."""
    return [shape for shape in shape_nodes(node) if shape.hasCollisionAspect()]


class DartNodes:
    """The nodes of a world.

    names     of the world's bodies, in its order
    bodies    DART's own node of each
    place     index of a body, by the name of any of its nodes
    place_of_body  the same, by the body's own name in the world
    """

    def __init__(self, world: Any, sidecar: DartSidecar):
        self._sidecar = sidecar
        self.names = [entry.name for entry in sidecar.bodies]
        nodes: dict[str, Any] = {}
        for index in range(world.getNumSkeletons()):
            for node in world.getSkeleton(index).getBodyNodes():
                nodes[node.getName()] = node
        file_names = [file_name(name) for name in self.names]
        copies = {copy.node: file_name(copy.body) for copy in sidecar.copies}
        wanted = {*file_names, *copies}
        missing, more = sorted(wanted - set(nodes)), sorted(set(nodes) - wanted)
        if missing or more:
            raise EngineError(NAME, f"{WORLD} has no bodies {missing}, and the sidecar has no bodies {more}")
        self.bodies = [nodes[name] for name in file_names]
        self.place = {name: index for index, name in enumerate(file_names)}
        self.place_of_body = {name: index for index, name in enumerate(self.names)}
        self._of: list[list[Any]] = [[body] for body in self.bodies]
        for name, body in copies.items():
            place = self.place[name] = self.place[body]
            self._of[place].append(nodes[name])
        self._nodes = nodes
        self._copies = self._find_copies()
        self._layer_of = {frozenset((name, other)): layer for name, other, layer in sidecar.filter.layers}

    def of(self, index: int) -> Sequence[Any]:
        """All nodes of a body, its own first."""
        return self._of[index]

    def solid(self, index: int) -> bool:
        """Whether a body has collision shapes."""
        return any(collision_nodes(node) for node in self._of[index])

    def _find_copies(self) -> dict[str, tuple[int, int]]:
        """Of every collision shape of DART, by its name and its node's, the sidecar's entry and the number of the copy."""
        left = {name: collision_nodes(node) for name, node in self._nodes.items()}
        found = {}
        for number, shape in enumerate(self._sidecar.shapes):
            for index, copy in enumerate(shape.surfaces):
                if not left.get(copy.node):
                    raise EngineError(NAME, f"{WORLD} has too few collision shapes on {copy.node!r}")
                shape = left[copy.node].pop(0)
                found[_key(shape)] = (number, index)
        extra = sorted(name for name, shapes in left.items() if shapes)
        if extra:
            raise EngineError(NAME, f"{extra} have collision shapes that the sidecar does not name")
        return found

    def copy(self, shape: Any) -> tuple[int, int]:
        """The place in the sidecar's list of the shape that a collision shape of DART is a copy of, and which copy."""
        return self._copies[_key(shape)]

    def wrong_meeting(self, shape: Any, other: Any) -> str:
        """The fault where two collision shapes touch that are not the intended copies; "" for the intended ones.

        The filter is DART's own and cannot be listed; a contact shows what it lets through.
        """
        shapes, copies = self._sidecar.shapes, (self.copy(shape), self.copy(other))
        pair = frozenset(shapes[number].material for number, _ in copies)
        layers = {shapes[number].surfaces[index].layer for number, index in copies}
        if pair in self._layer_of and layers != {self._layer_of[pair]}:
            names = " and ".join(repr(shapes[number].name) for number, _ in copies)
            return f"lets copies of {names} touch that are in layers {sorted(layers)}, not {self._layer_of[pair]}"
        return ""

    def set_surfaces(self) -> None:
        """Give every copy of a shape its numbers."""
        for node in self._nodes.values():
            for shape in collision_nodes(node):
                number, index = self.copy(shape)
                numbers, aspect = self._sidecar.shapes[number].surfaces[index], shape.getDynamicsAspect()
                aspect.setFrictionCoeff(numbers.friction)
                aspect.setRestitutionCoeff(numbers.restitution)

    def without_friction(self) -> bool:
        """Whether no collision shape has friction in DART."""
        nodes = self._nodes.values()
        return not any(
            shape.getDynamicsAspect().getFrictionCoeff() for node in nodes for shape in collision_nodes(node)
        )

    def excluded_pairs(self) -> Iterator[tuple[Any, Any]]:
        """The pairs of nodes that must not touch; a pair may come twice."""
        sidecar = self._sidecar
        of = dict(zip(self.names, self._of, strict=True))
        for class_ in self._of:  # a body does not touch itself
            yield from ((node, other) for index, node in enumerate(class_) for other in class_[index + 1 :])
        bodies = list(sidecar.excluded)
        for first, second in sidecar.ignored_groups:
            bodies.extend(
                (name, other) for name in sidecar.groups[first] for other in sidecar.groups[second] if name != other
            )
        for item, other in bodies:
            yield from ((a, b) for a in of[item] for b in of[other])
        classes = {name: [self._nodes[node] for node in class_] for name, class_ in sidecar.filter.classes.items()}
        for first, second in sidecar.filter.excluded:
            if first == second:
                class_ = classes[first]
                yield from ((node, other) for index, node in enumerate(class_) for other in class_[index + 1 :])
            else:
                yield from ((node, other) for node in classes[first] for other in classes[second])


def _key(shape: Any) -> str:
    return f"{shape.getBodyNodePtr().getName()}/{shape.getName()}"
