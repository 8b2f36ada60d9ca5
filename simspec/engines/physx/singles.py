"""The free bodies of a scene that are dynamic actors: their states, forces and masses.

A free body's frame is at its centre of mass, so that its coordinates are those of PhysX's actor. PhysX steps as simspec's law
of motion does, v before x, but for how bodies turn (``turning.py``).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from simspec.engines.physx.building import PhysxBuild
from simspec.engines.physx.measures import PackedActors, mass_matrices
from simspec.engines.physx.turning import Turns, turns
from simspec.engines.physx.units import FASTEST, FASTEST_LINEAR, NAME, SCALE, inertia_of
from simspec.errors import EngineError
from simspec.world.rotations import conjugate, cross, rotate, unit

SLOW = 1e-3
"""rad/s up to which PhysX turns a body by itself: the error is then 3e-7 rad after 2 s. Round-off in contacts without
friction turns balls at 3e-4."""
NO_FORCE = np.zeros(3)


class PhysxSingles:
    """The actors of ``rows``; ``q`` (n, 7) and ``v`` (n, 6): the places of their coordinates."""

    def __init__(self, built: PhysxBuild, q_places: Sequence[slice], v_places: Sequence[slice], timestep: float):
        self.rows, self._timestep, self._pose = built.homes.single, timestep, built.sapien.Pose
        self._built = built
        self.bodies = [built.actors[row] for row in self.rows]
        self.entities = [built.entities[row] for row in self.rows]
        self.q = np.array([q_places[row].start for row in self.rows], dtype=np.intp).reshape(-1, 1) + np.arange(7)
        self.v = np.array([v_places[row].start for row in self.rows], dtype=np.intp).reshape(-1, 1) + np.arange(6)
        self.masses = np.array([actor.mass for actor in self.bodies], dtype=float)
        self.tensors = np.array([inertia_of(actor) for actor in self.bodies]).reshape(-1, 3, 3)
        self._packed = PackedActors(
            built.system,
            self.bodies,
            len(built.links.articulations),
            sum(articulation.dof for articulation in built.links.articulations),
        )

    # --- state ------------------------------------------------------------------------------------------------

    def moving(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) in world axes."""
        poses, speeds = self._packed.read()
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        poses[:, :3] /= SCALE
        speeds[:, :3] /= SCALE
        return poses, speeds

    def read(self, q: np.ndarray, v: np.ndarray) -> None:
        """Write their coordinates into q (nq,) and v (nv,)."""
        poses, speeds = self.moving()
        speeds[:, 3:] = rotate(conjugate(poses[:, 3:]), speeds[:, 3:])
        q[self.q], v[self.v] = poses, speeds

    def write(self, q: np.ndarray, v: np.ndarray) -> None:
        """Set their coordinates. Raises EngineError where PhysX then stores others."""
        poses, speeds = q[self.q], v[self.v]
        poses[:, 3:] = unit(poses[:, 3:])
        speeds[:, 3:] = rotate(poses[:, 3:], speeds[:, 3:])
        poses[:, :3] *= SCALE
        speeds[:, :3] *= SCALE
        for entity, body, at, speed in zip(self.entities, self.bodies, poses, speeds, strict=True):
            entity.pose = self._pose(at[:3], at[3:])
            body.linear_velocity, body.angular_velocity = speed[:3], speed[3:]
        state = np.hstack([poses[:, :3], speeds]).astype(np.float32)
        actual, moving = self._packed.read()
        if not np.array_equal(np.hstack([actual[:, :3], moving]), state):
            raise EngineError(NAME, "holds another state than it was given")

    def lost(self) -> int | None:
        """The row of a body whose state is none any more: PhysX steps on, with no number or with its largest speeds."""
        poses, speeds = self._packed.read()
        bounds = np.repeat((FASTEST_LINEAR, FASTEST), 3)
        sound = np.isfinite(poses).all(axis=1) & (np.abs(speeds) < 0.5 * bounds).all(axis=1)
        return None if sound.all() else self.rows[int(np.flatnonzero(~sound)[0])]

    # --- steps ------------------------------------------------------------------------------------------------

    def give(self, effort: np.ndarray | None) -> Turns | None:
        """Give the forces and torques of the next step, of an effort (nv,); how bodies turn in it."""
        if not self.rows:
            return None
        wrench = None if effort is None else effort[self.v]
        poses, speeds = self._packed.read()
        spins = speeds[:, 3:]
        moved = np.abs(spins).max(axis=1, initial=0.0) > SLOW
        if wrench is not None:
            moved |= wrench[:, 3:].any(axis=1)
        rows, turning = np.flatnonzero(moved), None
        torques: dict[int, np.ndarray] = {}
        if len(rows):
            at = poses[rows, 3:]
            at /= np.linalg.norm(at, axis=1, keepdims=True)
            torque = np.zeros((len(rows), 3)) if wrench is None else wrench[rows, 3:]
            turning = turns(rows, at, spins[rows], torque, self.tensors[rows], self._timestep)
            torques = dict(zip(rows.tolist(), SCALE * SCALE * turning.torque, strict=True))
        forces: dict[int, np.ndarray] = {}
        if wrench is not None:
            forces = {row: SCALE * wrench[row, :3] for row in np.flatnonzero(wrench[:, :3].any(axis=1)).tolist()}
        for row in torques.keys() | forces.keys():
            self.bodies[row].add_force_torque(forces.get(row, NO_FORCE), torques.get(row, NO_FORCE))
        return turning

    def turn(self, turning: Turns, touched: Collection[int]) -> None:
        """Give what turned in the last step, and is not among the numbers that contact ``touched``, the velocity and
        orientation of the law."""
        for row, spin, turn in zip(turning.rows.tolist(), turning.spin, turning.turn, strict=True):
            if row not in touched:
                entity = self.entities[row]
                self.bodies[row].angular_velocity = spin
                entity.pose = self._pose(entity.pose.p, turn)

    # --- mass properties --------------------------------------------------------------------------------------

    def energy(self, gravity: np.ndarray) -> tuple[float, float]:
        """Kinetic and potential energy (J)."""
        poses, speeds = self.moving()
        speeds[:, 3:] = rotate(conjugate(poses[:, 3:]), speeds[:, 3:])
        turning = np.einsum("ni,nij,nj->", speeds[:, 3:], self.tensors, speeds[:, 3:])
        moving = self.masses @ (speeds[:, :3] ** 2).sum(axis=1)
        local = np.array([body.cmass_local_pose.p for body in self.bodies], dtype=float).reshape(-1, 3) / SCALE
        centres = poses[:, :3] + rotate(poses[:, 3:], local)
        return 0.5 * float(moving + turning), -float(self.masses @ (centres @ gravity))

    def mass_parts(self, bare: PhysxBuild) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix of each body, with its places in v, by a second scene."""
        if not self.rows:
            return []
        poses = [entity.pose for entity in self.entities]
        bodies = [(bare.entities[row], bare.actors[row]) for row in self.rows]
        masses = mass_matrices(bare.system, bodies, poses, np.trace(self.tensors, axis1=1, axis2=2))
        return list(zip(self.v, masses, strict=True))

    def bias(self, v: np.ndarray, gravity: np.ndarray, found: np.ndarray) -> None:
        """Write −m g as PhysX has both, and the ω × Iω that it is given, into h (nv,)."""
        spins = v[self.v][:, 3:]
        found[self.v[:, :3]] = -self.masses[:, None] * gravity
        found[self.v[:, 3:]] = cross(spins, np.einsum("nij,nj->ni", self.tensors, spins))
