"""A world in Rapier: its state, steps, efforts and contact."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.kit.world import LawSidecar
from simspec.engines.kit.arrays import ContactRow, checked_singles, contact_arrays, demand_singles, empty_contacts
from simspec.engines.kit.building import Walk
from simspec.engines.kit.world_simulation import WorldSimulation, unit_responses
from simspec.engines.rapier.building import RapierBuild, configure
from simspec.engines.rapier.coordinates import JointLosses, LinkPlaces, LinkWrenches, LiveMultibodies
from simspec.engines.rapier.free_bodies import LiveFreeBodies, spinning
from simspec.engines.rapier.multibodies import AXIS_OF, IDLE_SPEED, WHEEL_SPEED
from simspec.engines.rapier.servos import RapierJointServos, start_motors
from simspec.engines.rapier.stops import JointStops
from simspec.engines.rapier.units import NAME, SCALE, SQUARE, quaternion_of, states_of
from simspec.errors import EngineError
from simspec.formats.world import initial_coordinates
from simspec.world import frames
from simspec.world.rotations import cross, exponential_of, multiply_of, rotate
from simspec.world.types import Quaternion, Vector3

NATIVE_MOTION = "native_motion"
"""The setting that leaves the integration to Rapier."""
LONG = 1.0
"""The step (s) that measures accelerations: the change of a velocity in 1 ms has few digits."""
REFINEMENTS = 3
"""Steps by which the effort that holds everything is found, each nearer by the errors of mass matrix and acceleration."""


class RapierSimulation(WorldSimulation[LawSidecar]):
    """A loaded world. ``free``: the rows of the bodies that are Rapier's free bodies; all others that move are links."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        import rapier3d

        super().__init__(NAME, LawSidecar, folder, sidecar)
        if self.constraints:
            raise EngineError(NAME, "does not support constraints between bodies")
        self.rapier = rapier3d
        scales: dict[str, float] = {}
        if self.passive is not None:  # Rapier's own weights, in place of efforts
            scales = {entry.body: entry.scale for entry in self.passive.gravity_scales}
            self.passive = dataclasses.replace(self.passive, gravity_scales=())
        self.walk = Walk.of(self.document)
        try:
            self.built = RapierBuild(rapier3d, self.walk, self.settings, self.typed.laws, scales)
        except (KeyError, ValueError) as error:
            raise EngineError(NAME, f"the sidecar's settings lack, or have a wrong, {error}") from error
        built, links = self.built, self.built.multibodies
        self.free = [body.row for body in self.walk.bodies if body.carrier == body.row and body.row not in links.number]
        self.number = {row: index for index, row in enumerate(self.free)}
        self._free_q = _places([self.q_places[row].start for row in self.free], 7)
        self._free_v = _places([self.v_places[row].start for row in self.free], 6)
        self._places = LinkPlaces(links, self.q_places, self.v_places)
        self.native = bool(self.settings.get(NATIVE_MOTION, False))
        """Whether Rapier integrates by its own method."""
        self.losses = JointLosses(links, self.q_places, self.v_places, self.nv, damped=self.native)
        self._stops = JointStops(links)
        rigid = built.world.rigid_bodies
        self._spins = spinning([rigid[built.bodies[row]] for row in self.free])
        self._touched = [number for number, row in enumerate(self.free) if row in built.turned_by_contact]
        self._solid_links = any(solid.owner.carrier in links.number for solid in self.walk.shapes)
        self._stepped = False
        self._pushed_links: list[Any] = []
        """The links' bodies that have forces or torques in Rapier."""
        self._before: dict[Any, tuple[Vector3, Quaternion]] = {}
        """Where the links' bodies were, and how they were turned, before the last step, by handle (1/1024 m)."""
        self._pristine = self._common = built.world.snapshot()
        """The world as it was built, and by semi-implicit Euler."""
        if self.native:
            built.release()
            self._pristine = built.world.snapshot()
        self._take(built.world)
        self._wrenches = LinkWrenches(links, self.v_places, self.links.centres())
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def _take(self, world: Any) -> None:
        """Step this world from now on; Rapier's bodies are found once."""
        self.world = world
        world.set_num_threads(1)
        world.physics_hooks = self.built.laws
        handles = [self.built.bodies[row] for row in self.free]
        spins = () if self.native else self._spins
        self.bodies = LiveFreeBodies(self.rapier, world, handles, self._touched, spins)
        speed = IDLE_SPEED if self.native else WHEEL_SPEED
        self.links = LiveMultibodies(self.built.multibodies, self._places, world, speed)
        self._pushed_links = []

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v), as if it had been loaded in it: contacts of earlier steps are forgotten."""
        self._take(self.rapier.PhysicsWorld.restore(self._pristine))
        self.move_to(q, v)

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same with the contacts of earlier steps."""
        demand_singles(NAME, SCALE * np.concatenate([q, v]), "state")
        q, v = self.normalised(q), np.asarray(v, dtype=float)
        poses, velocities = q[self._free_q], v[self._free_v]
        velocities[:, 3:] = rotate(poses[:, 3:], velocities[:, 3:])
        self.bodies.place(poses, velocities)
        self.links.place(q, v)
        self._stepped = False

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        if self.free:
            poses, velocities = self.bodies.states()
            velocities[:, 3:] = rotate(poses[:, 3:] * (1.0, -1.0, -1.0, -1.0), velocities[:, 3:])
            q[self._free_q], v[self._free_v] = poses, velocities
        if self.links.bodies:
            self.links.read(q, v)
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        poses, velocities = np.zeros((len(self.names), 7)), np.zeros((len(self.names), 6))
        poses[self.free], velocities[self.free] = self.bodies.states()
        rows = [link.placed.row for link in self.built.multibodies.links]
        poses[rows] = self.links.poses()
        velocities[rows] = self.links.velocities(poses[rows])
        placed_rows = {*self.free, *rows}
        for body in self.walk.bodies:
            row = body.row
            if row in placed_rows:
                continue
            if not body.moves:
                poses[row] = states_of([self.world.rigid_bodies[self.built.bodies[row]]])[0]
                continue
            at, speed = poses[body.carrier], velocities[body.carrier]
            lever = rotate(at[3:], np.array(body.pose.position))
            poses[row, :3] = at[:3] + lever
            poses[row, 3:] = frames.multiply(tuple(at[3:].tolist()), body.pose.quaternion)
            velocities[row, :3], velocities[row, 3:] = speed[:3] + cross(speed[3:], lever), speed[3:]
        return poses, velocities

    def is_separate(self, row: int) -> bool:
        """Whether a body is one of Rapier's, not a part of another."""
        placed = self.walk.bodies[row]
        return not placed.moves or placed.carrier == row or row in self.built.multibodies.number

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        if effort is not None:
            demand_singles(NAME, SQUARE * np.asarray(effort, dtype=float), "effort")
        bouncing = self._solid_links and self.built.laws.bounces
        for left in range(count - 1, -1, -1):
            if effort is not None or self.bodies.spins or self.bodies.pushed:
                self.bodies.push(None if effort is None else np.asarray(effort, dtype=float)[self._free_v])
            if self.links.bodies:
                self._push_links(effort)
                if bouncing:
                    self.links.refresh()
                if not left and self._solid_links:
                    self._remember()
            self.world.step()
            if self.bodies.watched and not self.native:
                self.bodies.turn_on()
            if self._places.turning:
                self.links.shorten()
        self._stepped = self._stepped or count > 0
        if count:
            self._check_finite()

    def _check_finite(self) -> None:
        """Raise EngineError for a state that is not finite. Rapier silently removes such bodies."""
        moving = [(row, body) for row, body in zip(self.free, self.bodies.bodies, strict=True)]
        moving += [
            (link.placed.row, body) for link, body in zip(self.built.multibodies.links, self.links.bodies, strict=True)
        ]
        wrong: list[str] = []
        if len(self.world.islands) < len(moving) + len(self.built.multibodies.wheels):
            wrong = [self.names[row] for row, body in moving if not body.is_enabled] or ["a shape"]
        elif self.links.bodies and not self.links.are_finite():
            wrong = [self.names[row] for row, _ in moving[len(self.free) :]]
        if wrong:
            raise EngineError(NAME, f"the state of {', '.join(wrong[:3])} is no longer finite")

    def _push_links(self, effort: np.ndarray | None) -> None:
        """The wrenches of the next step on links, and their position limits."""
        self._let_go()
        self._stops.arm(self.links)
        total = None if effort is None else np.asarray(effort, dtype=float)
        if self.losses.act:
            losses = self.losses.effort(*self.get_state())
            total = losses if total is None else total + losses
        if total is not None and total.any():
            self._push_wrenches(total)

    def disarm(self) -> None:
        """Give all joints their position limits, which differ close to a stop in the next step."""
        self._stops.disarm(self.links)

    def _let_go(self) -> None:
        """Take the forces of the last step off the links."""
        for body in self._pushed_links:
            body.reset_forces()
            body.reset_torques()
        self._pushed_links = []

    def _push_wrenches(self, total: np.ndarray) -> None:
        """Apply an effort (nv,) to the links in the next step."""
        vector = self.rapier.Vec3
        forces, torques = self._wrenches.of(total, self.links.poses())
        for number in np.flatnonzero(forces.any(axis=1) | torques.any(axis=1)).tolist():
            body = self.links.bodies[number]
            body.add_force(vector(*forces[number].tolist()))
            body.add_torque(vector(*torques[number].tolist()))
            self._pushed_links.append(body)

    def _remember(self) -> None:
        """Store where links are, for the contacts of the next step."""
        self._before = {
            handle: (body.translation.to_tuple(), quaternion_of(body.rotation))
            for handle, body in zip(self.built.multibodies.bodies, self.links.bodies, strict=True)
        }

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) of the bodies that move, springs included."""
        kinetic, potential = self.bodies.energy()
        if self.links.bodies:
            moving, height = self.links.energy(np.array(self.world.gravity.to_tuple(), dtype=float) / SCALE)
            kinetic, potential = kinetic + moving, potential + height + self.losses.energy(self.get_state()[0])
        return kinetic, potential

    # --- dynamics ---------------------------------------------------------------------------------------------

    def _probe(self) -> RapierSimulation:
        """A copy of this simulation without contact, by semi-implicit Euler, whose step is ``LONG``."""
        probe = object.__new__(RapierSimulation)
        probe.__dict__.update(self.__dict__)
        probe.native = False
        world = self.rapier.PhysicsWorld.restore(self._common)
        world.integration_parameters.dt = LONG
        for handle in self.built.colliders:
            world.colliders[handle].is_enabled = False
        probe._take(world)
        return probe

    def _acceleration(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """v̇ (nv,) by one of Rapier's steps from a state under an effort, without damping, springs and limits; the state is
        another then."""
        self.move_to(q, v)
        if self.free:
            self.bodies.push(effort[self._free_v])
        if self.links.bodies:
            self._let_go()
            self._push_wrenches(effort)
        self.world.step()
        found = np.zeros(self.nv)
        if self.free:
            _, speeds = self.bodies.states()
            speeds[:, 3:] = rotate(q[self._free_q][:, 3:] * (1.0, -1.0, -1.0, -1.0), speeds[:, 3:])
            found[self._free_v] = (speeds - v[self._free_v]) / LONG
        if self.links.bodies:
            self.links.read_rates(q, found, self.links.accelerations())
        return found

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix as parts (places, M): of each free body the inverse of what unit efforts give, of each multibody by
        Rapier's Jacobians."""
        q, _ = self.get_state()
        parts = self.links.mass_matrices(q, self.nv) if self.links.bodies else []
        if not self.free:
            return parts
        probe, rest = self._probe(), np.zeros(self.nv)
        probe.world.gravity = self.rapier.Vec3(0.0, 0.0, 0.0)
        bodies = list(self._free_v)
        inverses = unit_responses(bodies, self.nv, lambda effort: probe._acceleration(q, rest, effort))
        for places, inverse in zip(bodies, inverses, strict=True):
            mass = np.linalg.inv(inverse)
            parts.append((places, 0.5 * (mass + mass.T)))
        return parts

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,): the effort under which nothing accelerates."""
        (q, v), parts, probe = self.get_state(), self.mass_parts(), self._probe()
        effort = np.zeros(self.nv)
        for _ in range(REFINEMENTS):
            acceleration = probe._acceleration(q, v, effort)
            for places, mass in parts:
                effort[places] -= mass @ acceleration[places]
        return effort

    # --- contact ----------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        if not self._stepped:
            return empty_contacts()
        rows: list[ContactRow] = []
        timestep = float(self.world.integration_parameters.dt)
        number = self.built.laws.number
        places = self._begins()
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

    def _begins(self) -> Callable[[Any], tuple[Vector3, Quaternion]]:
        """By handle where a body was, and how it was turned, before the last step."""
        timestep = float(self.world.integration_parameters.dt)

        def back(handle: Any) -> tuple[Vector3, Quaternion]:
            if handle in self._before:
                return self._before[handle]
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
        position, turn = places(self.built.carrier_of(self.walk.shapes[number]))
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

    def set_timestep(self, timestep: float) -> None:
        """Step by another timestep, now and after states that are set."""
        world = self.rapier.PhysicsWorld.restore(self._pristine)
        configure(self.rapier, world, checked_singles(NAME, (timestep,), "timestep")[0], self.settings)
        self._pristine = world.snapshot()
        self.set_state(*self.get_state())

    def track(self, v: np.ndarray) -> RapierJointServos:
        """Drive the joints with their velocities at the places ``v`` (n,)."""
        return RapierJointServos(self, v)

    def start_motors(self) -> None:
        """Let the motors act as controllers, now and after states that are set."""
        self._pristine = self.world_with_motors().snapshot()
        self.set_state(*self.get_state())

    def world_with_motors(self) -> Any:
        """A second world as it was built, in which the motors act as controllers."""
        world = self.rapier.PhysicsWorld.restore(self._pristine)
        start_motors(self, world)
        return world

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """The joints with their velocities at the places ``v`` have no dry friction, now and after states that are set."""
        rows, links = set(self.rows_at(v)), self.built.multibodies
        world = self.rapier.PhysicsWorld.restore(self._pristine)
        for handle, link in zip(links.joints, links.links, strict=True):
            if link.placed.row in rows and link.kind in AXIS_OF:
                axis = getattr(self.rapier.JointAxis, AXIS_OF[link.kind])
                if (data := world.multibody_joints[handle].data).motor(axis) is not None:
                    data.set_motor_max_force(axis, 0.0)
        self._pristine = world.snapshot()
        self.set_state(*self.get_state())


def _places(starts: list[int], size: int) -> np.ndarray:
    """Places (n, size) that begin at ``starts``."""
    return np.array(starts, dtype=np.intp)[:, None] + np.arange(size)
