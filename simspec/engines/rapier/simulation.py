"""A world in Rapier, in its initial state: stepping, efforts, contact.

A free body's frame is at its centre of mass, so that its coordinates are those of Rapier's body. Rapier steps as simspec's law
of motion does, v before x, but for the gyroscopic torque: it has an implicit one. So that is switched off, and −ω × Iω is given
as a torque before every step, from Rapier's own ω, R and I. Rapier's turn is the unit quaternion along q + ½ ω q dt, which lags
by (|ω| dt)³ / 12 (measured from 2 to 1,000 rad/s); what turns fast is turned on by the rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.kit.passive import Passive
from simspec.dialects.rapier.sidecar import RapierSidecar
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.rapier.building import NAME, Built, single
from simspec.errors import EngineError
from simspec.formats.world.format import WorldJson
from simspec.formats.world.tree import FreeJoint
from simspec.world import frames
from simspec.world.rotations import exponential_of, matrices, multiply_of, rotate, unit
from simspec.world.sums import JointSum
from simspec.world.types import Constraint

SLOW = 1e-3
"""rad, |ω| dt up to which Rapier's own turn is left: it lags by 8e-11 rad then, a thousandth of a rounding."""
LONG = 1.0
"""s, the step by which mass matrix and bias force are asked: what a step of 1 ms adds to a velocity has few digits in it."""


class Simulation:
    """A loaded world. ``free``: the rows of bodies that move by themselves, each with seven coordinates and six velocities."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        import rapier3d

        self.rapier = rapier3d
        try:
            self.document = WorldJson().read(folder)
            told = RapierSidecar.of(sidecar)
            told.check_document(self.document)
        except (ValueError, FileNotFoundError) as error:
            raise EngineError(NAME, str(error)) from error
        self.sidecar = sidecar
        self.passive: Passive | None = told.passive
        self.constraints: tuple[Constraint, ...] = told.constraints or ()
        self.sums: tuple[JointSum, ...] = told.sums or ()
        if self.constraints or self.sums:
            raise EngineError(NAME, "does not support constraints between bodies")
        try:
            self.built = Built(rapier3d, self.document, told)
        except (KeyError, ValueError) as error:
            raise EngineError(NAME, f"the sidecar's settings lack, or have a wrong, {error}") from error
        self.names = [body.name for body in self.document.bodies]
        self.offsets = np.array([body.frame_offset for body in told.bodies], dtype=float).reshape(-1, 3)
        self.free = [row for row, carrier in enumerate(self.built.carrier) if carrier == row]
        self._spins: list[tuple[int, np.ndarray]] = []
        self._given = False
        self._last: list[Any] = []
        """Rapier's poses of the bodies that move, before the last step."""
        self._pristine = self.built.world.snapshot()
        self._take(self.built.world)
        q, v = np.zeros((len(self.free), 7)), np.zeros((len(self.free), 6))
        for number, row in enumerate(self.free):
            joint = self.document.bodies[row].joint
            assert isinstance(joint, FreeJoint)
            turn = frames.normalise(joint.position[3:])
            q[number], v[number, :3] = (*joint.position[:3], *turn), joint.velocity[:3]
            v[number, 3:] = frames.rotate(frames.conjugate(turn), joint.velocity[3:])
        self.set_state(q.ravel(), v.ravel())

    def _take(self, world: Any) -> None:
        """Step this world from now on; Rapier's bodies are found once."""
        self.world = world
        world.set_num_threads(1)
        world.physics_hooks = self.built.laws
        self.bodies = [world.rigid_bodies[self.built.bodies[row]] for row in self.free]
        self._spins = []
        for number, body in enumerate(self.bodies):
            inertia = held_tensor(body)
            if not np.array_equal(inertia, inertia[0, 0] * np.eye(3)):
                self._spins.append((number, inertia))

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v), as if it had been loaded in it: contacts of earlier steps are forgotten."""
        self._take(self.rapier.PhysicsWorld.restore(self._pristine))
        self.move_to(q, v)

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same with the contacts of earlier steps."""
        rapier = self.rapier
        single(np.concatenate([q, v]).tolist(), "state")
        states, speeds = np.asarray(q, dtype=float).reshape(-1, 7), np.asarray(v, dtype=float).reshape(-1, 6)
        spins = rotate(states[:, 3:] / np.linalg.norm(states[:, 3:], axis=1, keepdims=True), speeds[:, 3:])
        rows = zip(self.bodies, states.tolist(), speeds.tolist(), spins.tolist(), strict=True)
        for body, state, speed, spin in rows:
            body.position = rapier.Isometry3(rapier.Vec3(*state[:3]), rapier.Rotation3(*state[3:]))
            body.linvel, body.angvel = rapier.Vec3(*speed[:3]), rapier.Vec3(*spin)
        self._last = []

    def _moving(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6, in world axes) of the bodies that move."""
        poses, speeds = np.empty((len(self.bodies), 7)), np.empty((len(self.bodies), 6))
        for row, body in enumerate(self.bodies):
            turn = body.rotation
            poses[row] = (*body.translation, turn.w, turn.i, turn.j, turn.k)
            speeds[row] = (*body.linvel, *body.angvel)
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        return poses, speeds

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        poses, speeds = self._moving()
        speeds[:, 3:] = rotate(poses[:, 3:] * (1.0, -1.0, -1.0, -1.0), speeds[:, 3:])
        return poses.ravel(), speeds.ravel()

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        moving, speeds = self._moving()
        number = {row: index for index, row in enumerate(self.free)}
        poses, velocities = np.zeros((len(self.names), 7)), np.zeros((len(self.names), 6))
        for row, carrier in enumerate(self.built.carrier):
            if carrier == row:
                poses[row], velocities[row] = moving[number[row]], speeds[number[row]]
                continue
            if carrier < 0:
                poses[row] = pose_of(self.world.rigid_bodies[self.built.bodies[row]].position)
                continue
            local, at = self.built.local[row], moving[number[carrier]]
            lever = rotate(at[3:], np.array(local.position))
            poses[row, :3] = at[:3] + lever
            poses[row, 3:] = frames.multiply(tuple(at[3:].tolist()), local.quaternion)
            speed = speeds[number[carrier]]
            velocities[row, :3], velocities[row, 3:] = speed[:3] + np.cross(speed[3:], lever), speed[3:]
        return poses, velocities

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero."""
        for left in range(count, 0, -1):
            self._give(effort)
            if left == 1 and self.built.shapes:
                self._last = [body.position for body in self.bodies]
            self.world.step()
            if (
                not self.world.quarantine.is_empty()
            ):  # Rapier switches such bodies off, in silence; the next step forgets which
                lost = self.world.quarantine.bodies
                wrong = [self.names[row] for row in self.free if self.built.bodies[row] in lost]
                raise EngineError(NAME, f"the state of {', '.join(wrong[:3]) or 'a shape'} is no longer finite")
            self._turn_on()

    def _turn_on(self) -> None:
        """Turn what turns fast by the rest of its turn, about the axis of both; frames are at centres of mass, which stay."""
        timestep = float(self.world.integration_parameters.dt)
        fast = (SLOW / timestep) ** 2
        for body in self.bodies:
            spin = body.angvel
            if spin.norm_squared() > fast:
                angle = timestep * spin.norm()
                share = (angle - 2.0 * math.atan(0.5 * angle)) / angle * timestep
                rest = exponential_of((share * spin.x, share * spin.y, share * spin.z))
                turn = body.rotation
                body.rotation = self.rapier.Rotation3(*multiply_of(rest, (turn.w, turn.i, turn.j, turn.k)))

    def _give(self, effort: np.ndarray | None) -> None:
        """The forces and torques of the next step, in world axes."""
        vector = self.rapier.Vec3
        if self._given:
            for body in self.bodies:
                body.reset_forces()
                body.reset_torques()
            self._given = False
        torques: dict[int, np.ndarray] = {}
        for number, inertia in self._spins:
            turn, spin = turn_of(self.bodies[number].rotation), np.array(tuple(self.bodies[number].angvel))
            if spin.any():
                own = spin @ turn
                torques[number] = turn @ np.cross(inertia @ own, own)
        if effort is not None:
            single(np.asarray(effort).tolist(), "effort")
            given = np.asarray(effort, dtype=float).reshape(-1, 6)
            for number in np.flatnonzero(given.any(axis=1)).tolist():
                body, (force, torque) = self.bodies[number], (given[number, :3], given[number, 3:])
                if force.any():
                    body.add_force(vector(*force.tolist()))
                    self._given = True
                if torque.any():
                    torques[number] = torques.get(number, 0.0) + turn_of(body.rotation) @ torque
        for number, torque in torques.items():
            self.bodies[number].add_torque(vector(*torque.tolist()))
            self._given = True

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) of the bodies that move."""
        gravity = np.array(tuple(self.world.gravity))
        kinetic = sum(body.kinetic_energy() for body in self.bodies)
        potential = -sum(body.mass * float(gravity @ np.array(tuple(body.center_of_mass))) for body in self.bodies)
        return kinetic, potential

    def _probe(self) -> Simulation:
        """A copy of this simulation in its present state, without contact, whose step is ``LONG``."""
        probe = object.__new__(Simulation)
        probe.__dict__.update(self.__dict__)
        world = self.rapier.PhysicsWorld.restore(self.world.snapshot())
        world.integration_parameters.dt = LONG
        for handle in self.built.colliders:
            world.colliders[handle].is_enabled = False
        probe._given = True
        probe._take(world)
        return probe

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix of each body that moves, with its places in v: the inverse of what unit efforts give."""
        probe, (q, v) = self._probe(), self.get_state()
        probe.world.gravity = self.rapier.Vec3(0.0, 0.0, 0.0)
        inverse = np.zeros((len(self.free), 6, 6))
        for column in range(6):
            probe.move_to(q, 0.0 * v)
            effort = np.zeros((len(self.free), 6))
            effort[:, column] = 1.0
            probe.advance(1, effort.ravel())
            inverse[:, :, column] = probe._turned(q).reshape(-1, 6) / LONG
        masses = np.linalg.inv(inverse)
        return [(np.arange(6 * row, 6 * row + 6), 0.5 * (mass + mass.T)) for row, mass in enumerate(masses)]

    def _turned(self, q: np.ndarray) -> np.ndarray:
        """Velocities (nv,) in the axes that bodies had in the state ``q``."""
        _, speeds = self._moving()
        turns = q.reshape(-1, 7)[:, 3:] * (1.0, -1.0, -1.0, -1.0)
        speeds[:, 3:] = rotate(turns, speeds[:, 3:])
        return speeds.ravel()

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,): −M v̇ of bodies left to themselves."""
        (q, v), parts, probe = self.get_state(), self.mass_parts(), self._probe()
        probe.advance(1, None)
        gained, bias = (probe._turned(q) - v) / LONG, np.zeros(len(v))
        for places, mass in parts:
            bias[places] = -mass @ gained[places]
        return bias

    # --- contact ----------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        rows: list[tuple[tuple[int, int], np.ndarray, np.ndarray, float, float]] = []
        timestep = float(self.world.integration_parameters.dt)
        number = self.built.laws.number
        for pair in self.world.narrow_phase.contact_pairs() if self._last else ():
            one, other = number[pair.collider1], number[pair.collider2]
            for manifold in pair.manifolds:
                normal = np.array(tuple(manifold.data.normal))
                for point in manifold.points:
                    if point.dist > 0.0 and not point.impulse > 0.0:
                        continue
                    at = 0.5 * (self._at(one, point.local_p1) + self._at(other, point.local_p2))
                    towards = -normal if one < other else normal  # from the second to the first
                    force = max(0.0, point.impulse) / timestep
                    rows.append(((min(one, other), max(one, other)), at, towards, point.dist, force))
        if not rows:
            return empty_contacts()
        rows.sort(key=lambda row: row[0])  # Rapier's own order is that in which they first touched
        units = np.array([row[0] for row in rows], dtype=np.int64)
        bodies = np.array([body for body, _ in self.built.shapes], dtype=np.int64)
        normals = np.array([row[2] for row in rows])
        return {
            "body": bodies[units],
            "unit": units,
            "position": np.array([row[1] for row in rows]),
            "normal": normals / np.linalg.norm(normals, axis=1, keepdims=True),
            "distance": np.array([row[3] for row in rows]),
            "normal_force": np.array([row[4] for row in rows]),
        }

    def _at(self, number: int, point: Any) -> np.ndarray:
        """Where a point of a collider was in the world before the last step."""
        row, collider = self.built.shapes[number][0], self.world.colliders[self.built.colliders[number]]
        own = collider.position_wrt_parent
        local = np.array(tuple(own.transform_point(point)))
        carrier = self.built.carrier[row]
        if carrier < 0:
            place = pose_of(self.world.rigid_bodies[self.built.bodies[row]].position)
        else:
            place = pose_of(self._last[self.free.index(carrier)])
        found: np.ndarray = place[:3] + rotate(place[3:], local)
        return found

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of shapes that touch at the present state."""
        q, v = self.get_state()
        probe = object.__new__(Simulation)
        probe.__dict__.update(self.__dict__)
        probe.set_state(q, v)
        probe.world.detect_collisions()
        number, found = self.built.laws.number, []
        for pair in probe.world.narrow_phase.contact_pairs():
            if any(point.dist <= 0.0 for manifold in pair.manifolds for point in manifold.points):
                found.append((number[pair.collider1], number[pair.collider2]))
        return np.array(found, dtype=np.int64).reshape(-1, 2)

    def disable_contact(self) -> None:
        """Nothing touches anything, now and after states that are set."""
        world = self.rapier.PhysicsWorld.restore(self._pristine)
        for handle in self.built.colliders:
            world.colliders[handle].is_enabled = False
        self._pristine = world.snapshot()
        self.set_state(*self.get_state())

    def messages(self) -> list[str]:
        """Rapier has nothing to say: what it cannot go on with it disables, which is an error."""
        return []

    def close(self) -> None:
        """Rapier's world is freed with this object."""


def turn_of(rotation: Any) -> np.ndarray:
    """The matrix (3, 3) of one of Rapier's rotations."""
    return matrices(unit(np.array((rotation.w, rotation.i, rotation.j, rotation.k))))


def held_tensor(body: Any) -> np.ndarray:
    """The inertia (3, 3) of a body about its centre of mass, in its own axes."""
    held = body.mass_properties
    turn = turn_of(held.principal_inertia_local_frame)
    found: np.ndarray = turn @ np.diag(tuple(held.principal_inertia)) @ turn.T
    return found


def pose_of(pose: Any) -> np.ndarray:
    """x y z w x y z of one of Rapier's poses, its quaternion of unit length."""
    turn = pose.rotation
    return np.array((*pose.translation, *unit(np.array((turn.w, turn.i, turn.j, turn.k)))))
