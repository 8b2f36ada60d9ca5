"""The oracle: Pinocchio, built from the world itself, never from a file.

Every joint is a Pinocchio joint in simspec's generalised coordinates (``world/kinematics.py``); a free root is a translation
and a spherical joint at the root's centre of mass, so that its position and velocity are those of the centre of mass in
world axes, and its angular velocity is in the body's axes. One step is semi-implicit Euler: v += dt a(q, v, τ), then
q ⊕ dt v, with rotations advanced by the exponential of the angular velocity.

Constraints act on each step by their law, J v⁺ = −φ/dt, on all trees that they join at once: after v* = v + dt a the velocity
is v* − M⁻¹ Jᵀ λ (``world/constraints.py``).

The oracle knows damping, springs (those along sums of joint positions too), armature, constraints and the fluid. It leaves out
contact, position limits and dry friction: motion probes stay away from limits, and have dry friction switched off (see
``proof/forces.py`` for its own).
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from simspec.dynamics.oracle_tree import OracleTree
from simspec.files import blocks
from simspec.language.vocabulary import QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.world.actions import Force, JointSum
from simspec.world.kinematics import constrained_trees, initial_state, layout_of, members, trees, within
from simspec.world.types import VELOCITY_SIZE, Body, Constraint, FollowConstraint, World

# Where probes of constrained worlds begin: positions at which the constraints hold, away from the limits of joints.

SETTLING_SEED = 20_212
ASTRAY = 0.3
"""rad or m that a closed loop is first moved away from where it begins, along a direction in which it may move; halved until
that leads somewhere."""
HALVINGS = 6
INWARDS = 150
"""Steps from the limits inwards: a leg of ten joints whose crank begins out of its range by 0.6 rad takes 20."""
STRIDE = 0.1
"""rad or m of the longest of these steps, halved where the constraints cannot be met from there ..."""
SHORTEST = 1e-3
"""... down to this."""
INSIDE = 0.2
"""Share of its range that a joint should be away from both limits."""
BEYOND = 0.02
"""Share of its range by which a step aims further, so that it arrives."""


def constrained_position(
    tree: OracleTree, wanted: np.ndarray, start: np.ndarray, generator: np.random.Generator
) -> np.ndarray:
    """A position (nq,) at which the constraints hold: near ``wanted`` where joints are coupled alone; where loops are closed
    some way from ``start``, at which they hold, towards anywhere."""
    if tree.violation is not None and all(
        isinstance(constraint, FollowConstraint) for constraint in tree.violation.constraints
    ):
        near = tree.settled(wanted)
        return start if near is None else near
    away = tree.constrained_velocity(start, generator.uniform(-1.0, 1.0, tree.nv))
    for halving in range(HALVINGS):
        near = tree.settled(tree.moved(start, away * ASTRAY / 2.0**halving))
        if near is not None:
            return near
    return start


def away_from_limits(tree: OracleTree, q: np.ndarray) -> np.ndarray:
    """A position (nq,) at which the constraints hold as they do at ``q``, with the joints as far inside their limits as steps
    along the constraints lead: ``q`` itself where all are, and what came nearest where some cannot be."""
    layout = layout_of(tree.world)
    parts = zip(tree.world.bodies, layout.position, layout.velocity, strict=True)
    limited = [
        (at_q.start, at_v.start, body.joint.position_limits)
        for body, at_q, at_v in parts
        if body.joint.position_limits is not None and body.joint.position_limits[0] < body.joint.position_limits[1]
    ]
    if not limited:
        return q
    at_q, at_v = (np.array([row[column] for row in limited]) for column in (0, 1))
    low, high = (np.array([row[2][side] for row in limited]) for side in (0, 1))
    best, least, stride = q, np.inf, STRIDE
    for _ in range(INWARDS):
        up, down = low + INSIDE * (high - low) - q[at_q], q[at_q] - high + INSIDE * (high - low)
        lacking = float(np.square(np.maximum(np.maximum(up, down), 0.0) / (high - low)).sum())
        if lacking < least:
            best, least = q, lacking
        if not lacking:
            return q
        aim = np.zeros(tree.nv)
        further = BEYOND * (high - low)
        aim[at_v] = np.where(up > 0.0, up + further, np.where(down > 0.0, -down - further, 0.0))
        step = tree.constrained_velocity(q, aim)
        longest = float(np.abs(step).max())
        if not longest or stride < SHORTEST:
            break
        near = tree.settled(tree.moved(q, step * min(1.0, stride / longest)))
        if near is None:
            stride /= 2.0
        else:
            q = near
    return best


MODEL_SIZE = 48
"""Coordinates of one Pinocchio model that several trees share: a step of many costs little more Python than a step of one,
while setting a model up grows faster than the square (216 free bodies, 2,000 steps: 6.5 s one by one, 1.6 s at 48 coordinates,
6.2 s at 300)."""


def _grouped(in_order: Sequence[tuple[Body, ...]]) -> list[tuple[Body, ...]]:
    """Trees joined to groups of up to ``MODEL_SIZE`` coordinates; a larger tree stands alone."""
    groups: list[tuple[Body, ...]] = []
    room = 0
    for bodies in in_order:
        size = sum(VELOCITY_SIZE[body.joint.kind] for body in bodies)
        if not groups or size > room:
            groups.append(bodies)
            room = MODEL_SIZE - size
        else:
            groups[-1] += bodies
            room -= size
    return groups


def model_key(bodies: Sequence[Body], constraints: Sequence[Constraint] = (), sums: Sequence[JointSum] = ()) -> object:
    """The inputs of the model of some bodies, with the constraints and sums between them: equal for copies, wherever they
    are and however they move."""
    index = {body.name: number for number, body in enumerate(bodies)}
    joints = {body.joint.name: number for number, body in enumerate(bodies)}
    models = tuple(
        (
            body.inertial,
            body.gravity_scale,
            body.box,
            index.get(body.joint.parent or "", -1),
            dataclasses.replace(body.joint, name="", parent=None, position=(), velocity=()),
        )
        for body in bodies
    )
    actual = tuple(
        (
            tuple(
                (joints if isinstance(constraint, FollowConstraint) else index)[name] for name in members(constraint)
            ),
            dataclasses.replace(constraint, name="", joint="", leader="")
            if isinstance(constraint, FollowConstraint)
            else dataclasses.replace(constraint, name="", first="", second=""),
        )
        for constraint in constraints
    )
    along = tuple(
        (
            tuple((joints[joint], coefficient) for joint, coefficient in sum_.joints),
            dataclasses.replace(sum_, name="", joints=()),
        )
        for sum_ in sums
    )
    return (models, actual, along) if actual or along else models


class Oracle:
    """Kinematics and dynamics of a world's bodies. States are (q (nq,), v (nv,)) in the world's own order.

    Trees do not act on each other without contact. Small ones share a Pinocchio model of up to ``MODEL_SIZE`` coordinates, and
    groups that are alike share one model.
    """

    def __init__(self, world: World):
        self.world = world
        self.layout = layout_of(world)
        self.nq, self.nv = self.layout.nq, self.layout.nv
        self.timestep = world.physics.timestep
        index = {body.name: number for number, body in enumerate(world.bodies)}
        self._parts: list[tuple[OracleTree, list[int], np.ndarray, np.ndarray]] = []
        models: dict[object, OracleTree] = {}
        for bodies in _grouped(constrained_trees(world)):
            rows = [index[body.name] for body in bodies]
            at_q = np.concatenate([np.r_[self.layout.position[row]] for row in rows]).astype(int)
            at_v = np.concatenate([np.r_[self.layout.velocity[row]] for row in rows]).astype(int)
            joined = world.constraints or world.sums
            part = within(world, bodies) if joined else dataclasses.replace(world, bodies=bodies)
            key = model_key(bodies, part.constraints, part.sums)
            if key not in models:
                models[key] = OracleTree(part, constrained=True)
            self._parts.append((models[key], rows, at_q, at_v))

    @property
    def leaves_out(self) -> list[str]:
        """The features of this world that the oracle's motion lacks, by name."""
        names = []
        if any(body.joint.dry_friction for body in self.world.bodies) or any(
            sum_.dry_friction for sum_ in self.world.sums
        ):
            names.append("joint.dry_friction")
        if any(body.joint.position_limits for body in self.world.bodies):
            names.append("joint.limits.position")
        if any(body.joint.angle_limit for body in self.world.bodies):
            names.append("joint.limits.angle")
        if any(sum_.position_limits for sum_ in self.world.sums):
            names.append("constraint.sum.limits")
        return names

    def body_poses(self, q: np.ndarray) -> np.ndarray:
        """Poses (bodies, 7) x y z w x y z of the world's body frames."""
        poses = np.empty((len(self.world.bodies), 7))
        for tree, rows, at_q, _ in self._parts:
            poses[rows] = tree.body_poses(q[at_q])
        return poses

    def body_velocities(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Velocities (bodies, 6): linear of the body frame's origin, then angular, both in world axes."""
        velocities = np.empty((len(self.world.bodies), 6))
        for tree, rows, at_q, at_v in self._parts:
            velocities[rows] = tree.body_velocities(q[at_q], v[at_v])
        return velocities

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M (nv, nv), armature included. For worlds of many bodies see :meth:`mass_blocks`."""
        full = np.zeros((self.nv, self.nv))
        for block, mass in zip(self.blocks, self.mass_blocks(q), strict=True):
            full[np.ix_(block, block)] = mass
        return full

    @functools.cached_property
    def blocks(self) -> list[np.ndarray]:
        """The places in v of each tree that has coordinates: M is zero between trees."""
        rows = {body.name: row for row, body in enumerate(self.world.bodies)}
        all_places = []
        for bodies in trees(self.world).values():
            parts = [np.r_[self.layout.velocity[rows[body.name]]] for body in bodies]
            places = np.concatenate(parts).astype(int)
            if len(places):
                all_places.append(places)
        return all_places

    def mass_blocks(self, q: np.ndarray) -> list[np.ndarray]:
        """M of each tree in ``blocks``, armature included."""
        where = np.zeros(self.nv, dtype=int)
        masses: list[np.ndarray] = []
        part_of = np.zeros(self.nv, dtype=int)
        for tree, _, at_q, at_v in self._parts:
            if len(at_v):
                where[at_v], part_of[at_v] = np.arange(len(at_v)), len(masses)
                masses.append(tree.mass_matrix(q[at_q]))
        return [masses[part_of[block[0]]][np.ix_(where[block], where[block])] for block in self.blocks]

    def mobility(self, q: np.ndarray) -> np.ndarray:
        """The diagonal of M⁻¹ (nv,): the acceleration that a unit effort on one coordinate alone gives it."""
        diagonal = np.zeros(self.nv)
        for block, mass in zip(self.blocks, self.mass_blocks(q), strict=True):
            diagonal[block] = np.diag(np.linalg.inv(mass))
        return diagonal

    def effort_for(self, q: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """M(q) v̇ (nv,)."""
        effort = np.zeros(self.nv)
        for block, mass in zip(self.blocks, self.mass_blocks(q), strict=True):
            effort[block] = mass @ acceleration[block]
        return effort

    def _by_tree(self, method: str, q: np.ndarray, v: np.ndarray, *more: np.ndarray) -> np.ndarray:
        values = np.zeros(self.nv)
        for tree, _, at_q, at_v in self._parts:
            if len(at_v):
                values[at_v] = getattr(tree, method)(q[at_q], v[at_v], *(value[at_v] for value in more))
        return values

    def bias_force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h (nv,) in M v̇ + h = τ: Coriolis, centrifugal and gravity; no damping, no springs."""
        return self._by_tree("bias_force", q, v)

    def joint_effort(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Damping, springs and the fluid (nv,), explicit: −d v − k (q − rest), for a ball −k log R in the child's axes."""
        return self._by_tree("joint_effort", q, v)

    def effort_of(self, q: np.ndarray, force: Force) -> np.ndarray:
        """Jᵀ F (nv,) of a force on a body as it acts at ``q``, whenever that is."""
        values = np.zeros(self.nv)
        for tree, rows, at_q, at_v in self._parts:
            if any(self.world.bodies[row].name == force.body for row in rows):
                name = tree.world.bodies[[self.world.bodies[row].name for row in rows].index(force.body)].name
                vectors = (np.array(vector) for vector in (force.at, force.force, force.torque))
                values[at_v] = tree.effort_of(q[at_q], name, *vectors)
        return values

    def settled(self, q: np.ndarray, start: np.ndarray) -> np.ndarray:
        """A position (nq,) at which the constraints hold: near ``q`` where joints are coupled alone; where loops are closed
        some way from ``start``, at which they hold, towards anywhere. ``q`` itself where there are no constraints."""
        if not self.world.constraints:
            return q
        q = q.copy()
        generator = np.random.default_rng(SETTLING_SEED)
        for tree, _, at_q, _ in self._parts:
            if tree.violation is not None:
                q[at_q] = constrained_position(tree, q[at_q], start[at_q], generator)
        return q

    def inwards(self, q: np.ndarray) -> np.ndarray:
        """A position (nq,) at which the constraints hold as at ``q``, with the joints that they are about as far inside their
        limits as these let them be."""
        q = q.copy()
        for tree, _, at_q, _ in self._parts:
            if tree.violation is not None:
                q[at_q] = away_from_limits(tree, q[at_q])
        return q

    def constrained_velocity(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The velocity (nv,) nearest to ``v`` with which the constraints go on to hold at ``q``; ``v`` itself without any."""
        if not self.world.constraints:
            return v
        return self._by_tree("constrained_velocity", q, v)

    def acceleration(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """v̇ (nv,) under an applied effort (nv,), with damping and springs, without constraints."""
        return self._by_tree("acceleration", q, v, effort)

    def energy(self, q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
        """Kinetic energy (armature included) and potential energy (J): gravity zero at the origin, springs at rest.

        Bodies fixed to the world do not count.
        """
        parts = [tree.energy(q[at_q], v[at_v]) for tree, _, at_q, at_v in self._parts if len(at_v)]
        return sum(kinetic for kinetic, _ in parts), sum(potential for _, potential in parts)

    def step(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One step of semi-implicit Euler; returns the new (q, v)."""
        (_, q), (_, v) = self.motion(q, v, effort, 1, 1)
        return q, v

    def motion(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray | None,
        steps: int,
        every: int,
        rounded: Callable[[np.ndarray], np.ndarray] | None = None,
        timestep: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (n, nq) and (n, nv) of ``steps`` steps under a constant effort, the initial one first, then every
        ``every``-th and the last. ``rounded``: a function of q and v after every step; None: no change. ``timestep`` (s): None:
        the world's."""
        parts = list(self.motion_by_blocks(q, v, effort, steps, every, rounded, timestep))
        return np.concatenate([states for states, _ in parts]), np.concatenate([speeds for _, speeds in parts])

    def motion_by_blocks(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray | None,
        steps: int,
        every: int,
        rounded: Callable[[np.ndarray], np.ndarray] | None = None,
        timestep: float | None = None,
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same, one block of rows after the other."""
        constant = np.zeros(self.nv) if effort is None else np.asarray(effort)
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        yield q[None].copy(), v[None].copy()
        for part in blocks(1 + -(-steps // every), q.nbytes + v.nbytes, first=1):
            count = part.stop - part.start
            all_q, all_v = np.tile(q, (count, 1)), np.tile(v, (count, 1))
            begin, end = (part.start - 1) * every, min((part.stop - 1) * every, steps)
            for tree, _, at_q, at_v in self._parts:
                if not len(at_v):
                    continue
                tree.timestep = self.timestep if timestep is None else timestep
                part_q, part_v = q[at_q], v[at_v]
                for row, done in enumerate(range(begin, end, every)):
                    ahead = min(every, end - done)
                    part_q, part_v = tree.advanced(part_q, part_v, constant[at_v], ahead, rounded)
                    all_q[row, at_q], all_v[row, at_v] = part_q, part_v
            if count:
                yield all_q, all_v
                q, v = all_q[-1].copy(), all_v[-1].copy()


# Seeded states of a world's bodies: where joints and roots may be, and how fast.

STATES_SEED = 20211


def angles_of(turns: np.ndarray) -> np.ndarray:
    """The angles (n,), 0 to π, of unit quaternions (n, 4)."""
    angles: np.ndarray = 2.0 * np.arctan2(np.linalg.norm(turns[:, 1:], axis=1), np.abs(turns[:, 0]))
    return angles


def shortened(turn: np.ndarray, share: float) -> np.ndarray:
    """The rotation (4,) about the same axis by a share of the angle."""
    w, axis = abs(float(turn[0])), turn[1:] * (1.0 if turn[0] >= 0.0 else -1.0)
    length = float(np.linalg.norm(axis))
    half = share * math.atan2(length, w)
    return np.array([math.cos(half), *(axis * (math.sin(half) / length if length else 0.0))])


def random_states(
    world: World, count: int, seed: int = STATES_SEED, speed: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """``count`` seeded states (count, nq), (count, nv): hinges anywhere within their limits (else ±π), slides within
    theirs (else ±0.5 m), any orientation that limits allow, free roots within 1 m of where they are, velocities within
    ±``speed``."""
    generator = np.random.default_rng(seed)
    start, _ = initial_state(world)
    states, velocities = [], []
    for _ in range(count):
        q: list[float] = []
        v: list[float] = []
        at = 0
        for body in world.bodies:
            joint = body.joint
            if joint.kind in SCALAR_JOINTS:
                reach = math.pi if joint.kind == "hinge" else 0.5
                low, high = joint.position_limits or (-reach, reach)
                low, high = max(low, -reach), min(high, reach)
                q.append(generator.uniform(low, high) if low < high else sum(joint.position_limits or (0.0, 0.0)) / 2)
            elif joint.kind in QUATERNION_JOINTS:
                if joint.kind == "free":
                    q.extend(start[at : at + 3] + generator.uniform(-1, 1, 3))
                turn = generator.normal(size=4)
                turn = turn / np.linalg.norm(turn) * (1.0 if turn[0] >= 0 else -1.0)
                q.extend(turn if joint.angle_limit is None else shortened(turn, joint.angle_limit / math.pi))
            at += len(joint.position)
            v.extend(generator.uniform(-speed, speed, len(joint.velocity)))
        states.append(q)
        velocities.append(v)
    shape = (count, -1) if states and states[0] else (count, 0)
    return np.array(states).reshape(shape), np.array(velocities).reshape((count, -1) if velocities[0] else (count, 0))
