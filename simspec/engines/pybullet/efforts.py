"""Efforts that simspec gives to PyBullet before a step: springs and armature, which it lacks, what acts along sums of joint
positions, and efforts from outside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simspec.dialects.kit.joints import Armature, Spring
from simspec.engines.pybullet.simulation import Simulation
from simspec.engines.pybullet.trees import Tree
from simspec.engines.pybullet.turns import told_turn
from simspec.world import frames
from simspec.world.rotations import from_xyzw_of, logarithm_of
from simspec.world.sums import JointSum


class Efforts:
    """Springs and armature of one loaded simulation, what acts along sums, and how efforts reach its joints.

    Springs are explicit: −k (q − rest), for a ball −k log R in the child's axes, from the state before the step; so are
    springs and dampers along sums. Armature A:
    PyBullet solves M v̇ = τ' − D v − h; with τ' = τ − A v̇, where (M + A) v̇ = τ − D v − h, it gets the v̇ of a joint with
    armature (trees of hinges and slides on a fixed base that nothing touches).
    """

    def __init__(
        self, sim: Simulation, springs: Sequence[Spring], armature: Sequence[Armature], sums: Sequence[JointSum] = ()
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
        self._along = [(one, [(*joints[joint], weight) for joint, weight in one.joints]) for one in sums]
        armed: dict[int, Tree] = {}
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

    def _dynamics_places(self, tree: Tree) -> tuple[list[int], np.ndarray, np.ndarray, tuple[float, ...]]:
        """Of a tree with armature: its joints, their places in v, their damping, and gravity in the base's inertial axes."""
        joints = [link.link for link in tree.movers]
        places = np.array([link.v.start for link in tree.movers], dtype=int)
        p, client = self._sim.bullet, self._sim.client
        damping = np.array([p.getJointInfo(tree.uid, joint, physicsClientId=client)[6] for joint in joints])
        _, raw = p.getBasePositionAndOrientation(tree.uid, physicsClientId=client)
        local_gravity = frames.rotate(frames.conjugate(told_turn(raw)), self._sim.sidecar.gravity)
        return joints, places, damping, local_gravity

    def total(self, given: np.ndarray) -> np.ndarray:
        """The effort (nv,) to apply at the present state, for an effort ``given`` from outside."""
        if not self.needed:
            return given
        p, client = self._sim.bullet, self._sim.client
        effort = given.copy()
        for tree, link, stiffness, rest in self._springs:
            if link.kind == "ball":
                state = p.getJointStateMultiDof(tree.uid, link.link, physicsClientId=client)
                turned = logarithm_of(from_xyzw_of(state[0]))
                effort[link.v] -= stiffness * np.array(frames.rotate(link.turn, turned))
            else:
                effort[link.v] -= stiffness * (p.getJointState(tree.uid, link.link, physicsClientId=client)[0] - rest)
        for one, parts in self._along:
            states = [p.getJointState(tree.uid, link.link, physicsClientId=client) for tree, link, _ in parts]
            length, speed = (
                sum(weight * state[k] for state, (_, _, weight) in zip(states, parts, strict=True)) for k in (0, 1)
            )
            force = one.stiffness * (length - one.rest) + one.damping * speed
            for _, link, weight in parts:
                effort[link.v] -= weight * force
        gravity = self._sim.sidecar.gravity
        for tree, joints, places, damping, local_gravity in self._armed:
            states = p.getJointStates(tree.uid, joints, physicsClientId=client)
            q, v = [state[0] for state in states], [state[1] for state in states]
            mass = np.array(p.calculateMassMatrix(tree.uid, q, physicsClientId=client))
            # calculateInverseDynamics takes gravity to be given in the axes of the base (measured)
            p.setGravity(*local_gravity, physicsClientId=client)
            bias = np.array(p.calculateInverseDynamics(tree.uid, q, v, [0.0] * len(q), physicsClientId=client))
            p.setGravity(*gravity, physicsClientId=client)
            armature = self.armature[places]
            force = effort[places] - damping * np.array(v) - bias
            effort[places] -= armature * np.linalg.solve(mass + np.diag(armature), force)
        return effort

    def apply(self, effort: np.ndarray) -> None:
        """Give ``effort`` (nv,) to the joints for the next step."""
        p, client = self._sim.bullet, self._sim.client
        for uid, root in self._free:
            if effort[root.v].any():
                self._sim.keep_awake(uid)  # PyBullet drops efforts on what sleeps
        for uid, singles, places, balls in self._movers:
            if singles:
                p.setJointMotorControlArray(
                    uid, singles, p.TORQUE_CONTROL, forces=effort[places].tolist(), physicsClientId=client
                )
            for link in balls:
                torque = frames.rotate(frames.conjugate(link.turn), tuple(effort[link.v].tolist()))
                p.setJointMotorControlMultiDof(
                    uid, link.link, controlMode=p.TORQUE_CONTROL, force=list(torque), physicsClientId=client
                )
        for uid, root in self._free:
            given = effort[root.v]
            if given.any():
                at, raw = p.getBasePositionAndOrientation(uid, physicsClientId=client)
                turn = frames.multiply(from_xyzw_of(raw), frames.conjugate(root.turn))
                torque = frames.rotate(turn, tuple(given[3:].tolist()))
                p.applyExternalForce(uid, -1, given[:3].tolist(), at, p.WORLD_FRAME, physicsClientId=client)
                p.applyExternalTorque(uid, -1, list(torque), p.WORLD_FRAME, physicsClientId=client)

    def energy(self) -> tuple[float, float]:
        """Kinetic energy of the armature and energy stored in the springs at the present state (J)."""
        if not self.needed:
            return 0.0, 0.0
        q, v = self._sim.get_state()
        potential = 0.0
        for _, link, stiffness, rest in self._springs:
            away = np.array(logarithm_of(q[link.q].tolist())) if link.kind == "ball" else q[link.q] - rest
            potential += 0.5 * stiffness * float(away @ away)
        for one, parts in self._along:
            stretch = sum(weight * float(q[link.q][0]) for _, link, weight in parts) - one.rest
            potential += 0.5 * one.stiffness * stretch**2
        return 0.5 * float(np.sum(self.armature * v**2)), potential
