"""Bodies that move freely in Rapier, without joints: their states, the wrenches on them, and how they turn.

A free body's frame is at its centre of mass, so that its coordinates are those of Rapier's body. Rapier steps by simspec's
law of motion, v before x, except for rotations: its gyroscopic torque is off, and −ω × Iω is applied before every step;
bodies that turn fast are turned by the rest of the rotation after it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from simspec.engines.rapier.units import SCALE, SQUARE, inertia_of, quaternion_of, states_of, turn_of
from simspec.world import frames
from simspec.world.rotations import exponential_of, multiply_of
from simspec.world.types import Quaternion, Vector3

# Rotation. Rapier's gyroscopic torque is implicit; simspec's law of motion has −ω × Iω at the beginning of the step. Rapier's
# rotation is the unit quaternion along q + ½ ω q dt, which lags by (|ω| dt)³ / 12. Both are computed per body with Python
# floats, which for three numbers take a tenth of numpy's time.

SLOW = 1e-3
"""|ω| dt (rad) up to which Rapier's rotation stays uncorrected: it lags by at most 8e-11 rad, a thousandth of a rounding."""


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


class LiveFreeBodies:
    """The free bodies of one of Rapier's worlds, by their handles. ``turned_by_contact``: the numbers of those that contact may
    turn; ``spins``: by number, the tensors of those with a gyroscopic torque."""

    def __init__(
        self,
        rapier: Any,
        world: Any,
        handles: Sequence[Any],
        turned_by_contact: Collection[int],
        spins: Sequence[tuple[int, frames.Matrix3]],
    ):
        self.rapier, self.world = rapier, world
        self.bodies = [world.rigid_bodies[handle] for handle in handles]
        self._touched, self._spins = frozenset(turned_by_contact), spins
        self._pushed: set[int] = set()
        """The numbers of the bodies that have forces or torques in Rapier."""
        self.watch(range(len(self.bodies)))

    @property
    def spins(self) -> bool:
        """Whether any body has a gyroscopic torque."""
        return bool(self._spins)

    @property
    def pushed(self) -> bool:
        """Whether any body has forces of an earlier step."""
        return bool(self._pushed)

    def watch(self, turning: Iterable[int]) -> None:
        """Correct the rotations of these bodies (numbers) alone after every step."""
        self._turning = frozenset(turning)
        self.watched = [self.bodies[number] for number in sorted(self._turning)]

    def place(self, poses: np.ndarray, velocities: np.ndarray) -> None:
        """Put the bodies to poses (n, 7) with velocities (n, 6) in world axes."""
        rapier = self.rapier
        places, speeds, spins = SCALE * poses[:, :3], SCALE * velocities[:, :3], velocities[:, 3:]
        rows = zip(self.bodies, places.tolist(), poses[:, 3:].tolist(), speeds.tolist(), spins.tolist(), strict=True)
        for body, place, turn, speed, spin in rows:
            body.position = rapier.Isometry3(rapier.Vec3(*place), rapier.Rotation3(*turn))
            body.linvel, body.angvel = rapier.Vec3(*speed), rapier.Vec3(*spin)
        turned = np.flatnonzero(spins.any(axis=1)).tolist()
        self.watch(self._touched.union((number for number, _ in self._spins), turned))

    def states(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) in world axes."""
        speeds = [(*body.linvel.to_tuple(), *body.angvel.to_tuple()) for body in self.bodies]
        velocities = np.array(speeds, dtype=float).reshape(-1, 6)
        velocities[:, :3] /= SCALE
        return states_of(self.bodies), velocities

    def turn_on(self) -> None:
        """Turn fast bodies by the rest of their rotation; their frames are at the centres of mass, which stay."""
        timestep = float(self.world.integration_parameters.dt)
        fast = (SLOW / timestep) ** 2
        for body in self.watched:
            spin = body.angvel
            if spin.norm_squared() > fast:
                body.rotation = self.rapier.Rotation3(*turned_on(body.rotation, spin, timestep))

    def push(self, wrenches: np.ndarray | None) -> None:
        """Apply wrenches (n, 6) in the next step, forces in world axes and torques in those of the bodies, and the gyroscopic
        torques."""
        vector = self.rapier.Vec3
        for number in self._pushed:
            self.bodies[number].reset_forces()
            self.bodies[number].reset_torques()
        self._pushed = set()
        torques: dict[int, Vector3] = {}
        for number, inertia in self._spins:
            if (local := gyroscopic(self.bodies[number], inertia)) is not None:
                torques[number] = local
        if wrenches is not None:
            for number in np.flatnonzero(wrenches.any(axis=1)).tolist():
                body, (force, torque) = self.bodies[number], (wrenches[number, :3], wrenches[number, 3:])
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
            self.watch(self._turning | torques.keys())

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J)."""
        gravity = self.world.gravity.to_tuple()
        kinetic = sum(body.kinetic_energy() for body in self.bodies)
        potential = -sum(
            body.gravity_scale * body.mass * frames.dot(gravity, tuple(body.center_of_mass)) for body in self.bodies
        )
        return kinetic / SQUARE, potential / SQUARE


def spinning(bodies: Sequence[Any]) -> list[tuple[int, frames.Matrix3]]:
    """The numbers and tensors of the bodies with a gyroscopic torque."""
    tensors = ((number, unequal_tensor(inertia_of(body))) for number, body in enumerate(bodies))
    return [(number, inertia) for number, inertia in tensors if inertia is not None]
