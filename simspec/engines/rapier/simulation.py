"""A world in Rapier: stepping, efforts, contact.

A free body's frame is at its centre of mass, so that its coordinates are those of Rapier's body. Rapier steps by simspec's
law of motion, v before x, except for rotations: its gyroscopic torque is off, and −ω × Iω is applied before every step;
bodies that turn fast are turned by the rest of the rotation after it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.kit.world import LawSidecar
from simspec.engines.kit.arrays import ContactRow, contact_arrays, demand_singles, empty_contacts
from simspec.engines.kit.world_simulation import FreeBodySimulation
from simspec.engines.rapier.building import NAME, SCALE, SQUARE, RapierBuild
from simspec.errors import EngineError
from simspec.formats.world import initial_coordinates
from simspec.world import frames
from simspec.world.rotations import exponential_of, matrices, multiply_of, rotate
from simspec.world.types import Pose, Quaternion, Vector3

# Rotation. Rapier's gyroscopic torque is implicit; simspec's law of motion has −ω × Iω at the beginning of the step. Rapier's
# rotation is the unit quaternion along q + ½ ω q dt, which lags by (|ω| dt)³ / 12. Both are computed per body with Python
# floats, which for three numbers take a tenth of numpy's time.

SLOW = 1e-3
"""|ω| dt (rad) up to which Rapier's rotation stays uncorrected: it lags by at most 8e-11 rad, a thousandth of a rounding."""


def quaternion_of(rotation: Any) -> Quaternion:
    """w x y z of one of Rapier's rotations, of unit length in double precision."""
    x, y, z, w = rotation.to_tuple()
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


def turn_of(rotation: Any) -> np.ndarray:
    """The matrix (3, 3) of one of Rapier's rotations."""
    return matrices(np.array(quaternion_of(rotation)))


def pose_of(pose: Any) -> Pose:
    """One of Rapier's poses in m, its quaternion of unit length."""
    x, y, z = (value / SCALE for value in pose.translation)
    return Pose((x, y, z), quaternion_of(pose.rotation))


def inertia_of(body: Any) -> np.ndarray:
    """The inertia (3, 3, kg m²) of a body about its centre of mass, in its own axes."""
    mass = body.mass_properties
    turn = turn_of(mass.principal_inertia_local_frame)
    inertia: np.ndarray = turn @ np.diag(tuple(mass.principal_inertia)) @ turn.T
    return inertia / SQUARE


def unequal_tensor(inertia: np.ndarray) -> frames.Matrix3 | None:
    """A tensor as Python floats; None where it is the same about every axis, without a gyroscopic torque."""
    if np.array_equal(inertia, inertia[0, 0] * np.eye(3)):
        return None
    entry, two, three = inertia.tolist()
    return (tuple(entry), tuple(two), tuple(three))


def gyroscopic(body: Any, inertia: frames.Matrix3) -> Vector3 | None:
    """−ω × Iω of a body in world axes; None where it does not turn."""
    x, y, z = body.angvel.to_tuple()
    if not (x or y or z):
        return None
    across, along, up = frames.matrix(quaternion_of(body.rotation))
    local = (
        across[0] * x + along[0] * y + up[0] * z,
        across[1] * x + along[1] * y + up[1] * z,
        across[2] * x + along[2] * y + up[2] * z,
    )
    momentum = (frames.dot(inertia[0], local), frames.dot(inertia[1], local), frames.dot(inertia[2], local))
    torque = frames.cross(momentum, local)
    return (frames.dot(across, torque), frames.dot(along, torque), frames.dot(up, torque))


def turned_on(rotation: Any, spin: Any, timestep: float) -> Quaternion:
    """The rotation of a body after a step with the velocity ``spin``, from that of Rapier: the rest is about the same axis."""
    angle = timestep * spin.norm()
    share = (angle - 2.0 * math.atan(0.5 * angle)) / angle * timestep
    rest = exponential_of((share * spin.x, share * spin.y, share * spin.z))
    return multiply_of(rest, (rotation.w, rotation.i, rotation.j, rotation.k))


LONG = 1.0
"""The step (s) that measures mass matrix and bias force: the change of a velocity in 1 ms has few digits."""


class RapierSimulation(FreeBodySimulation[LawSidecar]):
    """A loaded world."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        import rapier3d

        super().__init__(NAME, LawSidecar, folder, sidecar)
        self.rapier = rapier3d
        try:
            self.built = RapierBuild(rapier3d, self.walk, self.settings, self.typed.laws)
        except (KeyError, ValueError) as error:
            raise EngineError(NAME, f"the sidecar's settings lack, or have a wrong, {error}") from error
        self._pushed: set[int] = set()
        """The bodies, by their numbers, that have forces or torques in Rapier."""
        self._stepped = False
        self._pristine = self.built.world.snapshot()
        self._take(self.built.world)
        tensors = [(number, unequal_tensor(inertia_of(body))) for number, body in enumerate(self.bodies)]
        self._spins = [(number, inertia) for number, inertia in tensors if inertia is not None]
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def _take(self, world: Any) -> None:
        """Step this world from now on; Rapier's bodies are found once."""
        self.world = world
        world.set_num_threads(1)
        world.physics_hooks = self.built.laws
        self.bodies = [world.rigid_bodies[self.built.bodies[row]] for row in self.free]
        self._watch(range(len(self.bodies)))

    def _watch(self, turning: Iterable[int]) -> None:
        """Correct the rotations of these bodies (numbers) alone after every step."""
        self._turning = frozenset(turning)
        self._watched = [self.bodies[number] for number in sorted(self._turning)]

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v), as if it had been loaded in it: contacts of earlier steps are forgotten."""
        self._take(self.rapier.PhysicsWorld.restore(self._pristine))
        self.move_to(q, v)

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same with the contacts of earlier steps."""
        rapier = self.rapier
        demand_singles(NAME, SCALE * np.concatenate([q, v]), "state")
        poses, velocities = self.in_world(q, v)
        places, speeds, spins = SCALE * poses[:, :3], SCALE * velocities[:, :3], velocities[:, 3:]
        rows = zip(self.bodies, places.tolist(), poses[:, 3:].tolist(), speeds.tolist(), spins.tolist(), strict=True)
        for body, place, turn, speed, spin in rows:
            body.position = rapier.Isometry3(rapier.Vec3(*place), rapier.Rotation3(*turn))
            body.linvel, body.angvel = rapier.Vec3(*speed), rapier.Vec3(*spin)
        self._stepped = False
        touched = {number for number, row in enumerate(self.free) if row in self.built.turned_by_contact}
        self._watch(touched.union((number for number, _ in self._spins), np.flatnonzero(spins.any(axis=1)).tolist()))

    def moving(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6, in world axes) of the bodies that move."""
        rows = [
            (*body.translation.to_tuple(), *body.rotation.to_tuple(), *body.linvel.to_tuple(), *body.angvel.to_tuple())
            for body in self.bodies
        ]
        table = np.array(rows, dtype=float).reshape(-1, 13)
        poses, speeds = table[:, (0, 1, 2, 6, 3, 4, 5)], table[:, 7:]
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        poses[:, :3] /= SCALE
        speeds[:, :3] /= SCALE
        return poses, speeds

    def static_pose(self, row: int) -> Pose:
        return pose_of(self.world.rigid_bodies[self.built.bodies[row]].position)

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero."""
        world, step = self.world, self.world.step
        for _ in range(count):
            if effort is not None or self._spins or self._pushed:
                self._push(effort)
            step()
            if self._watched:
                self._turn_on()
        self._stepped = self._stepped or count > 0
        if count and len(world.islands) < len(self.bodies):  # Rapier silently removes bodies whose state is not finite
            wrong = [self.names[row] for row, body in zip(self.free, self.bodies, strict=True) if not body.is_enabled]
            raise EngineError(NAME, f"the state of {', '.join(wrong[:3]) or 'a shape'} is no longer finite")

    def _turn_on(self) -> None:
        """Turn fast bodies by the rest of their rotation; their frames are at the centres of mass, which stay."""
        timestep = float(self.world.integration_parameters.dt)
        fast = (SLOW / timestep) ** 2
        for body in self._watched:
            spin = body.angvel
            if spin.norm_squared() > fast:
                body.rotation = self.rapier.Rotation3(*turned_on(body.rotation, spin, timestep))

    def _push(self, effort: np.ndarray | None) -> None:
        """The forces and torques of the next step, in world axes."""
        vector = self.rapier.Vec3
        for number in self._pushed:
            self.bodies[number].reset_forces()
            self.bodies[number].reset_torques()
        self._pushed = set()
        torques: dict[int, Vector3] = {}
        for number, inertia in self._spins:
            if (local := gyroscopic(self.bodies[number], inertia)) is not None:
                torques[number] = local
        if effort is not None:
            demand_singles(NAME, SQUARE * np.asarray(effort, dtype=float), "effort")
            given = np.asarray(effort, dtype=float).reshape(-1, 6)
            for number in np.flatnonzero(given.any(axis=1)).tolist():
                body, (force, torque) = self.bodies[number], (given[number, :3], given[number, 3:])
                if force.any():
                    body.add_force(vector(*(SCALE * force).tolist()))
                    self._pushed.add(number)
                if torque.any():
                    turned = turn_of(body.rotation) @ torque
                    torques[number] = tuple((np.array(torques.get(number, (0.0, 0.0, 0.0))) + turned).tolist())
        for number, (x, y, z) in torques.items():
            self.bodies[number].add_torque(vector(SQUARE * x, SQUARE * y, SQUARE * z))
        self._pushed |= torques.keys()
        if not torques.keys() <= self._turning:
            self._watch(self._turning | torques.keys())

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) of the bodies that move."""
        gravity = self.world.gravity.to_tuple()
        kinetic = sum(body.kinetic_energy() for body in self.bodies)
        potential = -sum(body.mass * frames.dot(gravity, tuple(body.center_of_mass)) for body in self.bodies)
        return kinetic / SQUARE, potential / SQUARE

    def _probe(self) -> RapierSimulation:
        """A copy of this simulation in its present state, without contact, whose step is ``LONG``."""
        probe = object.__new__(RapierSimulation)
        probe.__dict__.update(self.__dict__)
        world = self.rapier.PhysicsWorld.restore(self.world.snapshot())
        world.integration_parameters.dt = LONG
        for handle in self.built.colliders:
            world.colliders[handle].is_enabled = False
        probe._pushed = set(range(len(self.bodies)))
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
        _, speeds = self.moving()
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
        if not self._stepped:
            return empty_contacts()
        rows: list[ContactRow] = []
        timestep = float(self.world.integration_parameters.dt)
        number = self.built.laws.number
        places = self._places()
        for pair in self.world.narrow_phase.contact_pairs():
            index, other = number[pair.collider1], number[pair.collider2]
            for manifold in pair.manifolds:
                x, y, z = manifold.data.normal.to_tuple()
                towards = (-x, -y, -z) if index < other else (x, y, z)  # from the second to the first
                for point in manifold.points:
                    if point.dist > 0.0 and not point.impulse > 0.0:
                        continue
                    here = self._at(places, index, point.local_p1)
                    there = self._at(places, other, point.local_p2)
                    x, y, z = (0.5 * (a + b) / SCALE for a, b in zip(here, there, strict=True))
                    force = max(0.0, point.impulse) / (SCALE * timestep)
                    ends = (min(index, other), max(index, other))
                    rows.append((ends, (x, y, z), towards, point.dist / SCALE, force))
        return contact_arrays(rows, [solid.owner.row for solid in self.walk.shapes])

    def _places(self) -> Callable[[Any], tuple[Vector3, Quaternion]]:
        """By handle where a body was, and how it was turned, before the last step."""
        timestep = float(self.world.integration_parameters.dt)

        def back(handle: Any) -> tuple[Vector3, Quaternion]:
            body = self.world.rigid_bodies[handle]
            (x, y, z), (vx, vy, vz) = body.translation.to_tuple(), body.linvel.to_tuple()
            a, b, c = body.angvel.to_tuple()
            turn = multiply_of(
                exponential_of((-timestep * a, -timestep * b, -timestep * c)), quaternion_of(body.rotation)
            )
            return (x - timestep * vx, y - timestep * vy, z - timestep * vz), turn

        return functools.cache(back)

    def _at(self, places: Callable[[Any], tuple[Vector3, Quaternion]], number: int, point: Any) -> Vector3:
        """Where a point of a collider is in the world (1/1024 m), of these ``places`` of bodies."""
        pose = self.world.colliders[self.built.colliders[number]].position_wrt_parent
        position, turn = places(self.built.bodies[self.walk.shapes[number].owner.row])
        return frames.add(position, frames.rotate(turn, tuple(pose.transform_point(point))))

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of shapes that touch at the present state."""
        q, v = self.get_state()
        probe = object.__new__(RapierSimulation)
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
