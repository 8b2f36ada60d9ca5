"""Hinges and slides of a PyBullet simulation, read and driven at every step with as few calls as it allows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from simspec.dialects.kit.sidecar import Armature, JointSpring
from simspec.engines.kit.arrays import motor_limit, motor_rate
from simspec.engines.kit.contract import Actuation, Engine
from simspec.engines.pybullet.simulation import PybulletSimulation
from simspec.engines.pybullet.trees import UNCLAMPED, PybulletTree, turn_of
from simspec.world import frames
from simspec.world.actions import JointSum
from simspec.world.rotations import from_xyzw_of, logarithm_of

NATIVE = (
    "PyBullet's POSITION_CONTROL drives a velocity motor of limited effort: errors decay with the time constant kd/kp for any "
    "inertia and without sag under gravity, and only the ratio of kp and kd counts. See docs/engines/pybullet.md"
)


def _driven(sim: PybulletSimulation, v: np.ndarray) -> Iterator[tuple[int, list[int], np.ndarray]]:
    """Of each tree its number, its links on the hinges and slides at the places ``v`` (n,), and where these stand in ``v``."""
    order = {int(place): index for index, place in enumerate(v)}
    for tree in sim.trees:
        links = [link for link in tree.movers if link.kind != "ball" and link.v.start in order]
        if links:
            yield tree.uid, [link.link for link in links], np.array([order[link.v.start] for link in links], dtype=int)


class PybulletJointArrays(Actuation):
    """One call for each tree to read, and one to drive. For simulations without springs and armature, which need more."""

    def __init__(self, engine: Engine, sim: PybulletSimulation, q: np.ndarray, v: np.ndarray):
        super().__init__(engine, q, v)
        self._sim = sim
        self._trees = []
        for uid, links, rows in _driven(sim, v):
            whole = len(links) == len(v) and (np.diff(rows) == 1).all()
            self._trees.append((uid, links, None if whole else rows))
        self._positions, self._velocities = np.zeros(len(v)), np.zeros(len(v))

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        query = self._sim.bullet.getJointStates
        positions, velocities = self._positions, self._velocities
        for uid, links, rows in self._trees:
            states = query(uid, links)
            at = slice(None) if rows is None else rows
            positions[at] = [state[0] for state in states]
            velocities[at] = [state[1] for state in states]
        return positions, velocities

    def give(self, effort: np.ndarray) -> None:
        p = self._sim.bullet
        for uid, links, rows in self._trees:
            forces = (effort if rows is None else effort[rows]).tolist()
            p.setJointMotorControlArray(uid, links, p.TORQUE_CONTROL, forces=forces)

    def step(self) -> None:
        self._sim.advance(1)


class PybulletJointServos:
    """Some hinges and slides with PyBullet's own position controller."""

    def __init__(
        self, sim: PybulletSimulation, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ):
        self._sim = sim
        gain = motor_rate(stiffness, damping, sim.sidecar.timestep) * sim.sidecar.timestep
        limit = np.minimum(motor_limit(stiffness, damping, limit), UNCLAMPED)
        self._trees = []
        for uid, links, rows in _driven(sim, v):
            fixed = {
                "positionGains": gain[rows].tolist(),
                "velocityGains": [1.0] * len(links),
                "forces": limit[rows].tolist(),
            }
            self._trees.append((uid, links, rows, fixed))

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        p = self._sim.bullet
        for uid, links, rows, fixed in self._trees:
            where, speed = position[rows].tolist(), velocity[rows].tolist()
            p.setJointMotorControlArray(
                uid, links, p.POSITION_CONTROL, targetPositions=where, targetVelocities=speed, **fixed
            )


# Efforts that simspec gives to PyBullet before a step: springs and armature, which it lacks, what acts along sums of joint
# positions, and efforts from outside.


class PybulletEfforts:
    """Springs and armature of one loaded simulation, what acts along sums, and how efforts reach its joints.

    Springs are explicit: −k (q − rest), for a ball −k log R in the child's axes, from the state before the step; so are
    springs and dampers along sums. Armature A:
    PyBullet solves M v̇ = τ' − D v − h; with τ' = τ − A v̇, where (M + A) v̇ = τ − D v − h, it gets the v̇ of a joint with
    armature (trees of hinges and slides on a fixed base that nothing touches).
    """

    def __init__(
        self,
        sim: PybulletSimulation,
        springs: Sequence[JointSpring],
        armature: Sequence[Armature],
        sums: Sequence[JointSum] = (),
    ):
        self._sim = sim
        self.armature = np.zeros(sim.nv)
        self.springs: dict[int, tuple[float, float]] = {}
        links = {link.index: (tree, link) for tree in sim.trees for link in tree.links}
        self._springs = []
        for spring in springs:
            index = sim.place[spring.body]
            self.springs[index] = (spring.stiffness, spring.rest)
            self._springs.append((*links[index], spring.stiffness, spring.rest))
        joints = {
            joint: (tree, link)
            for tree, instance in zip(sim.trees, sim.sidecar.instances, strict=True)
            for joint, link in zip(instance.joints, tree.links, strict=True)
        }
        self.sums = tuple(sums)
        self._along = [(sum_, [(*joints[joint], weight) for joint, weight in sum_.joints]) for sum_ in sums]
        armed: dict[int, PybulletTree] = {}
        for entry in armature:
            tree, link = links[sim.place[entry.body]]
            self.armature[link.v] = entry.armature
            armed[tree.uid] = tree
        self._armed = [(tree, *self._dynamics_places(tree)) for tree in armed.values()]
        self._movers = [
            (tree.uid, [link.link for link in single], [link.v.start for link in single], balls)
            for tree in sim.trees
            for single, balls in [
                (
                    [link for link in tree.movers if link.kind != "ball"],
                    [link for link in tree.movers if link.kind == "ball"],
                )
            ]
            if single or balls
        ]
        self._free = [(tree.uid, tree.links[0]) for tree in sim.trees if tree.root == "free"]

    @property
    def needed(self) -> bool:
        """Whether there is something to apply before every step even without an effort from outside."""
        return bool(self._springs or self._armed or self._along)

    def _dynamics_places(self, tree: PybulletTree) -> tuple[list[int], np.ndarray, np.ndarray, tuple[float, ...]]:
        """Of a tree with armature: its joints, their places in v, their damping, and gravity in the base's inertial axes."""
        joints = [link.link for link in tree.movers]
        places = np.array([link.v.start for link in tree.movers], dtype=int)
        p = self._sim.bullet
        damping = np.array([p.getJointInfo(tree.uid, joint)[6] for joint in joints])
        _, raw = p.getBasePositionAndOrientation(tree.uid)
        local_gravity = frames.rotate(frames.conjugate(turn_of(raw)), self._sim.sidecar.gravity)
        return joints, places, damping, local_gravity

    def total(self, given: np.ndarray) -> np.ndarray:
        """The effort (nv,) to apply at the present state, for an effort ``given`` from outside."""
        if not self.needed:
            return given
        p = self._sim.bullet
        effort = given.copy()
        for tree, link, stiffness, rest in self._springs:
            if link.kind == "ball":
                state = p.getJointStateMultiDof(tree.uid, link.link)
                turned = logarithm_of(from_xyzw_of(state[0]))
                effort[link.v] -= stiffness * np.array(frames.rotate(link.turn, turned))
            else:
                effort[link.v] -= stiffness * (p.getJointState(tree.uid, link.link)[0] - rest)
        for joint_sum, parts in self._along:
            states = [p.getJointState(tree.uid, link.link) for tree, link, _ in parts]
            length, speed = (
                sum(weight * state[k] for state, (_, _, weight) in zip(states, parts, strict=True)) for k in (0, 1)
            )
            force = joint_sum.stiffness * (length - joint_sum.rest) + joint_sum.damping * speed
            for _, link, weight in parts:
                effort[link.v] -= weight * force
        gravity = self._sim.sidecar.gravity
        for tree, joints, places, damping, local_gravity in self._armed:
            states = p.getJointStates(tree.uid, joints)
            q, v = [state[0] for state in states], [state[1] for state in states]
            mass = np.array(p.calculateMassMatrix(tree.uid, q))
            # calculateInverseDynamics takes gravity to be given in the axes of the base (measured)
            p.setGravity(*local_gravity)
            bias = np.array(p.calculateInverseDynamics(tree.uid, q, v, [0.0] * len(q)))
            p.setGravity(*gravity)
            armature = self.armature[places]
            force = effort[places] - damping * np.array(v) - bias
            effort[places] -= armature * np.linalg.solve(mass + np.diag(armature), force)
        return effort

    def apply(self, effort: np.ndarray) -> None:
        """Give ``effort`` (nv,) to the joints for the next step."""
        p = self._sim.bullet
        for uid, root in self._free:
            if effort[root.v].any():
                self._sim.keep_awake(uid)  # PyBullet drops efforts on what sleeps
        for uid, singles, places, balls in self._movers:
            if singles:
                p.setJointMotorControlArray(uid, singles, p.TORQUE_CONTROL, forces=effort[places].tolist())
            for link in balls:
                torque = frames.rotate(frames.conjugate(link.turn), tuple(effort[link.v].tolist()))
                p.setJointMotorControlMultiDof(uid, link.link, controlMode=p.TORQUE_CONTROL, force=list(torque))
        for uid, root in self._free:
            given = effort[root.v]
            if given.any():
                at, raw = p.getBasePositionAndOrientation(uid)
                turn = frames.multiply(from_xyzw_of(raw), frames.conjugate(root.turn))
                torque = frames.rotate(turn, tuple(given[3:].tolist()))
                p.applyExternalForce(uid, -1, given[:3].tolist(), at, p.WORLD_FRAME)
                p.applyExternalTorque(uid, -1, list(torque), p.WORLD_FRAME)

    def energy(self) -> tuple[float, float]:
        """Kinetic energy of the armature and energy stored in the springs at the present state (J)."""
        if not self.needed:
            return 0.0, 0.0
        q, v = self._sim.get_state()
        potential = 0.0
        for _, link, stiffness, rest in self._springs:
            away = np.array(logarithm_of(q[link.q].tolist())) if link.kind == "ball" else q[link.q] - rest
            potential += 0.5 * stiffness * float(away @ away)
        for joint_sum, parts in self._along:
            stretch = sum(weight * float(q[link.q][0]) for _, link, weight in parts) - joint_sum.rest
            potential += 0.5 * joint_sum.stiffness * stretch**2
        return 0.5 * float(np.sum(self.armature * v**2)), potential


# The mass matrix and bias force that PyBullet steps with, measured by stepping it.
#
# ``calculateMassMatrix`` is right for hinges and slides on a massless fixed base only (measured: ball joints differ in the
# second digit), ``calculateInverseDynamics`` takes gravity to be given in the base's axes, and neither is what a step
# uses. So a second
# simulation of the same files is stepped once per coordinate instead: from rest, without gravity, damping, motors, limits and
# contact, a unit effort for one step of 1 s leaves the velocity M⁻¹ e exactly.

PROBE_STEP = 1.0
"""Seconds: the velocity gained in one step is then the acceleration, with no digits lost."""


class DynamicsProbe:
    """A simulation in which nothing but the tree dynamics acts."""

    def __init__(self, sim: PybulletSimulation):
        self._sim = sim
        self._efforts = PybulletEfforts(sim, (), ())
        self._known: tuple[np.ndarray, list[np.ndarray]] | None = None
        p = sim.bullet
        sim.disable_contact()
        p.setTimeStep(PROBE_STEP)
        for tree in sim.trees:
            for link in tree.movers:
                p.changeDynamics(tree.uid, link.link, jointDamping=0.0)
                if link.kind != "ball":
                    p.changeDynamics(tree.uid, link.link, jointLowerLimit=-UNCLAMPED, jointUpperLimit=UNCLAMPED)
                    p.setJointMotorControl2(tree.uid, link.link, p.VELOCITY_CONTROL, targetVelocity=0.0, force=0.0)
        self._blocks = [
            np.concatenate([np.arange(link.v.start, link.v.stop) for link in tree.links]).astype(int)
            for tree in sim.trees
        ]

    def _gain(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray | None) -> np.ndarray:
        """v̇ (nv,) at the state (q, v) under ``effort``."""
        sim = self._sim
        sim.set_state(q, v)
        if effort is not None:
            self._efforts.apply(effort)
        sim.advance(1)
        after_q, after_v = sim.get_state()
        for link in (tree.links[0] for tree in sim.trees if tree.root == "free"):
            # ω is given in the axes after the step; the gain is wanted in those before it: d(Rᵀω)/dt = Rᵀ dω/dt
            world = frames.rotate(tuple(after_q[link.q][3:].tolist()), tuple(after_v[link.v][3:].tolist()))
            after_v[link.v][3:] = frames.rotate(frames.conjugate(tuple(q[link.q][3:].tolist())), world)
        gain: np.ndarray = (after_v - v) / PROBE_STEP
        return gain

    def _set_gravity(self, on: bool) -> None:
        gravity = self._sim.sidecar.gravity if on else (0.0, 0.0, 0.0)
        self._sim.bullet.setGravity(*gravity)

    def masses(self, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each tree its places in v, and its M, without armature. All trees are probed side by side; the last ones are kept,
        for the bias force."""
        if self._known is None or not np.array_equal(self._known[0], q):
            self._known = (q.copy(), self._measure_masses(q))
        return list(zip(self._blocks, self._known[1], strict=True))

    def _measure_masses(self, q: np.ndarray) -> list[np.ndarray]:
        self._set_gravity(False)
        sim = self._sim
        rest = np.zeros(sim.nv)
        inverses = [np.zeros((len(block), len(block))) for block in self._blocks]
        for column in range(max((len(block) for block in self._blocks), default=0)):
            effort = np.zeros(sim.nv)
            effort[[block[column] for block in self._blocks if column < len(block)]] = 1.0
            gain = self._gain(q, rest, effort)
            for block, inverse in zip(self._blocks, inverses, strict=True):
                if column < len(block):
                    inverse[:, column] = gain[block]
        found = []
        for inverse in inverses:
            # scaled to a unit diagonal first: a tree may hold kilograms and gram square millimetres side by side
            scale = np.sqrt(np.diag(inverse))
            found.append(np.linalg.inv(inverse / np.outer(scale, scale)) / np.outer(scale, scale))
        return found

    def bias_force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h (nv,) = −M v̇ of the unforced tree at (q, v)."""
        masses = self.masses(q)
        self._set_gravity(True)
        gain = self._gain(q, v, None)
        found = np.zeros(self._sim.nv)
        for places, mass in masses:
            found[places] = -mass @ gain[places]
        return found
