"""A world in PhysX, in its initial state: stepping, efforts, contact."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.physx import PhysxSidecar
from simspec.engines.kit.arrays import demand_singles
from simspec.engines.kit.building import Walk
from simspec.engines.kit.world_simulation import WorldSimulation
from simspec.engines.physx.building import PhysxBuild
from simspec.engines.physx.contacts import PhysxDepths, PhysxRecovery, contact_rows, depths, pressed, touching_pairs
from simspec.engines.physx.servos import PhysxJointServos, start_drives
from simspec.engines.physx.singles import PhysxSingles
from simspec.engines.physx.trees import PhysxTrees
from simspec.engines.physx.units import FASTEST, LEAST, NAME, SCALE, inertia_of, pose_of, unit_of
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, initial_coordinates
from simspec.world import frames
from simspec.world.rotations import cross, logarithm, rotate
from simspec.world.types import Pose

TINY = 1e-6
"""s: the step that computes the contacts of a state."""
LONG = 1.0
"""s: the step that measures accelerations of articulations: PhysX's velocities after a step of any length are v + dt a, and in
those of a long step a has more digits."""


class PhysxSimulation(WorldSimulation[PhysxSidecar]):
    """A loaded world."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, PhysxSidecar, folder, sidecar)
        self.walk = Walk.of(self.document)
        self._probes: PhysxBuild | None = None
        self._bare: tuple[PhysxBuild, PhysxTrees] | None = None
        self._contact = True
        self._smooth: set[int] = set()
        """Rows of bodies whose joints' dry friction is switched off."""
        self._tracking = False
        """Whether drives act as controllers."""
        self._losses()
        try:
            self._take(self._build())
        except KeyError as error:
            raise EngineError(NAME, f"the sidecar's settings lack {error}") from error
        self.move_to(*map(np.array, initial_coordinates(self.document)))

    def _losses(self) -> None:
        """Damping, springs and their rest, of every coordinate of v; of a ball the same for all three."""
        self.damping, self.stiffness, self.rest = np.zeros((3, self.nv))
        scalar, balls = [], []
        for body, q, v in zip(self.document.bodies, self.q_places, self.v_places, strict=True):
            joint = body.joint
            if isinstance(joint, (AxisJoint, BallJoint)):
                self.damping[v], self.stiffness[v] = joint.damping, joint.spring_stiffness
            if isinstance(joint, AxisJoint):
                self.rest[v] = joint.spring_rest
                scalar.append((q.start, v.start))
            elif isinstance(joint, BallJoint):
                balls.append((q.start, v.start))
        self._scalar_q, self._scalar_v = np.array(scalar, dtype=np.intp).reshape(-1, 2).T
        starts = np.array(balls, dtype=np.intp).reshape(-1, 2)
        self._ball_q, self._ball_v = starts[:, :1] + np.arange(4), starts[:, 1:] + np.arange(3)
        self._losing = bool(self.damping.any() or self.stiffness.any())

    def _build(self, bare: bool = False) -> PhysxBuild:
        """A new scene."""
        built = PhysxBuild(self.walk, self.typed, bare)
        if not self._contact or bare:
            self._part(built)
        for row in () if bare else self._smooth:
            built.links.set_dry_friction(built.links.joints[row][0], 0.0)
        return built

    def _take(self, built: PhysxBuild) -> None:
        """Step this scene from now on."""
        self.built = built
        if self._tracking:
            start_drives(built)
        self.timestep = float(built.system.timestep)
        places = self.q_places, self.v_places
        self.singles = PhysxSingles(built, *places, self.timestep)
        self.trees = PhysxTrees(built, *places, self.timestep)
        self.linked = list(built.links.of)
        """The rows that are links."""
        self.bodies = self._moving_bodies(built)
        self.rows = {actor: index for index, actor in enumerate(self.bodies)}
        self._tree_of = [number for number, rows in enumerate(built.homes.trees) for _ in rows]
        self._unit_of = {shape: index for index, shape in enumerate(built.shapes)}
        self._fastest = np.full(len(self.bodies), LEAST)
        """m/s: how fast PhysX may push each body out of what it overlaps."""
        self._recovery = PhysxRecovery(len(self.bodies), self.timestep)
        self._begun = False
        """Whether a state was set since the last step."""
        self._found: list[Any] = []
        """PhysX's contacts of the last step."""
        self._touched = np.zeros(len(self.trees.trees), dtype=bool)
        """Articulations on which a contact acted in the last step."""
        self._effort = np.zeros(self.nv)
        """The effort that articulations were last given."""

    def _moving_bodies(self, built: PhysxBuild) -> list[Any]:
        """The actors that move, then the links of bodies."""
        return [built.actors[row] for row in (*built.homes.single, *built.links.of)]

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v), as if it had been loaded in it: contacts of earlier steps are forgotten."""
        self._take(self._build())
        self.move_to(q, v)

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same with the contacts of earlier steps."""
        q, v = self.normalised(q), np.array(v, dtype=float)
        demand_singles(NAME, SCALE * np.concatenate([q, v]), "state")
        self.singles.write(q, v)
        self.trees.write(q, v)
        self._found, self._begun = [], True
        self._touched[:] = False
        if self.walk.units and self._contact:
            self._recovery.begin(self._overlaps())

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        self.singles.read(q, v)
        self.trees.read(q, v)
        return q, v

    def static_pose(self, row: int) -> Pose:
        """The pose of a static body."""
        return pose_of(self.built.entities[row].pose)

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        poses, velocities = np.zeros((len(self.names), 7)), np.zeros((len(self.names), 6))
        poses[list(self.singles.rows)], velocities[list(self.singles.rows)] = self.singles.moving()
        for row in self.linked:
            poses[row], velocities[row] = self._link_state(row)
        for placed, home in zip(self.walk.bodies, self.built.homes.of, strict=True):
            row = placed.row
            if not placed.moves:
                pose = self.static_pose(row)
                poses[row] = (*pose.position, *pose.quaternion)
            elif home.row != row:
                at, speed = poses[home.row], velocities[home.row]
                lever = rotate(at[3:], np.array(home.pose.position))
                poses[row, :3] = at[:3] + lever
                poses[row, 3:] = frames.multiply(tuple(at[3:].tolist()), home.pose.quaternion)
                velocities[row, :3], velocities[row, 3:] = speed[:3] + cross(speed[3:], lever), speed[3:]
        return poses, velocities

    def _link_state(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Pose (7,) and velocity (6,) of a link's frame; PhysX has that of its centre of mass."""
        link, pose = self.built.links.of[row], self.built.entities[row].pose
        turn, spin = unit_of(pose.q), np.array(link.angular_velocity, dtype=float)
        lever = rotate(turn, np.array(link.cmass_local_pose.p, dtype=float) / SCALE)
        speed = np.array(link.linear_velocity, dtype=float) / SCALE - cross(spin, lever)
        return np.concatenate([np.array(pose.p, dtype=float) / SCALE, turn]), np.concatenate([speed, spin])

    def units(self) -> list[tuple[int, str]]:
        return [(unit.of.owner.row, unit.of.shape.name) for unit in self.walk.units]

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        if effort is not None:
            effort = np.asarray(effort, dtype=float)
            demand_singles(NAME, SCALE * SCALE * effort, "effort")
            effort = effort if effort.any() else None
        touching = self._contact and bool(self.walk.units)
        for _ in range(count):
            turning = self.singles.give(effort)
            if self.trees.trees:
                self._drive(effort)
            if touching:
                self._bound()
            self.built.system.step()
            self._begun = False
            self._found = self.built.system.get_contacts() if touching else []
            self._settle(turning)
        if count:
            self._check_finite()

    def _drive(self, effort: np.ndarray | None) -> None:
        """Give the articulations their efforts of the next step. PhysX keeps those of the last."""
        total = np.zeros(self.nv) if effort is None else effort
        if self._losing:
            q, v = self.get_state()
            stretch = np.zeros(self.nv)
            stretch[self._scalar_v] = q[self._scalar_q]
            stretch[self._ball_v] = logarithm(q[self._ball_q])
            total = total - self.damping * v - self.stiffness * (stretch - self.rest)
        if self.trees.turns.size or not np.array_equal(total, self._effort):
            self.trees.give(total)
            self._effort = np.array(total)
        self.trees.begin(self._touched)

    def _settle(self, turning: Any) -> None:
        """Turn what turned in the last step as by the law of motion."""
        count = len(self.singles.rows)
        requested = set() if turning is None else set(turning.rows.tolist())
        if self.trees.turns.size:
            requested |= set(range(count, len(self.bodies)))
        touched = pressed(self._found, self.rows, requested) if requested else set()
        if turning is not None:
            self.singles.turn(turning, touched)
        if self.trees.turns.size:
            self.trees.settle()
            self._touched[:] = False
            for index in touched:
                if index >= count:
                    self._touched[self._tree_of[index - count]] = True

    def _check_finite(self) -> None:
        """Raise EngineError where a state is none any more."""
        row = self.singles.lost()
        for tree in () if row is not None else self.trees.trees:
            rates = tree.rates()
            if not (np.isfinite(rates).all() and (np.abs(rates) < 0.5 * FASTEST).all()):
                row = tree.rows[0]
        if row is not None:
            raise EngineError(NAME, f"the state of {self.names[row]} is no longer finite")

    # --- contact ----------------------------------------------------------------------------------------------

    def _overlaps(self) -> PhysxDepths:
        """The overlaps of the present state, which the scene itself would tell after its next step."""
        probe = self._probe()
        rows = {actor: row for row, actor in enumerate(self._moving_bodies(probe))}
        return depths(probe.system.get_contacts(), rows)

    def _probe(self) -> PhysxBuild:
        """A second scene in the present state, of which PhysX has found the contacts."""
        if self._probes is None:
            self._probes = self._build()
            self._probes.system.timestep = TINY
        probe = self._probes
        for row, entity in zip(self.singles.rows, self.singles.entities, strict=True):
            probe.entities[row].pose = entity.pose
            probe.actors[row].linear_velocity = probe.actors[row].angular_velocity = (0.0, 0.0, 0.0)
        if self.trees.trees:
            q, v = self.get_state()
            PhysxTrees(probe, self.q_places, self.v_places, TINY).write(q, np.zeros_like(v))
        probe.system.step()
        return probe

    def _bound(self) -> None:
        """Bound the speed at which PhysX undoes overlaps in the next step. Its contacts are those at the beginning of the
        last step."""
        if not self._begun:
            self._recovery.go_on(depths(self._found, self.rows))
        speeds = self._recovery.speeds
        for row in np.flatnonzero(speeds != self._fastest).tolist():
            self.bodies[row].max_depenetration_velocity = SCALE * float(speeds[row])
        self._fastest = speeds

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        return contact_rows(self._found, self._unit_of, [body for body, _ in self.units()], self.timestep)

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of copies that touch at the present state."""
        if not self.walk.units or not self._contact:
            return np.zeros((0, 2), dtype=np.int64)
        probe = self._probe()
        return touching_pairs(probe.system.get_contacts(), {shape: row for row, shape in enumerate(probe.shapes)})

    def disable_contact(self) -> None:
        """Nothing touches anything, now and after states that are set."""
        self._contact = False
        self._part(self.built)
        self._probes = None

    def _part(self, built: PhysxBuild) -> None:
        for shape in built.shapes:
            shape.set_collision_groups([0, 0, 0, 0])

    def track(self, v: np.ndarray) -> PhysxJointServos:
        """Drive the joints with their velocities at the places ``v`` (n,)."""
        return PhysxJointServos(self, v)

    def start_drives(self) -> None:
        """Let the drives act as controllers, now and after states that are set."""
        self._tracking = True
        start_drives(self.built)

    def scene_with_drives(self) -> PhysxBuild:
        """A second scene, in which the drives act as controllers."""
        built = self._build()
        start_drives(built)
        return built

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Step without the dry friction of joints at the places ``v``, now and after states that are set."""
        self._smooth |= set(self.rows_at(v))
        self._probes = None
        for row in self._smooth:
            self.built.links.set_dry_friction(self.built.links.joints[row][0], 0.0)

    # --- mass properties --------------------------------------------------------------------------------------

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) of the bodies that move, with the springs of joints."""
        kinetic, potential = self.singles.energy(self.gravity)
        for row in self.linked:
            link = self.built.links.of[row]
            mass, turn = float(link.mass), unit_of(self.built.entities[row].pose.q)
            speed = np.array(link.linear_velocity, dtype=float) / SCALE
            spin = rotate(turn * (1.0, -1.0, -1.0, -1.0), np.array(link.angular_velocity, dtype=float))
            centre = np.array(self.built.entities[row].pose.p, dtype=float)
            centre = (centre + rotate(turn, np.array(link.cmass_local_pose.p, dtype=float))) / SCALE
            kinetic += 0.5 * (mass * float(speed @ speed) + float(spin @ inertia_of(link) @ spin))
            potential -= mass * float(centre @ self.gravity)
        for tree in self.trees.trees:
            kinetic += 0.5 * float(tree.armature @ tree.rates() ** 2)
        if self._losing:
            q, _ = self.get_state()
            stretch = q[self._scalar_q] - self.rest[self._scalar_v]
            potential += 0.5 * float(self.stiffness[self._scalar_v] @ stretch**2)
            potential += 0.5 * float((self.stiffness[self._ball_v] * logarithm(q[self._ball_q]) ** 2).sum())
        return kinetic, potential

    @property
    def gravity(self) -> np.ndarray:
        """As PhysX has it (3,), in m/s²."""
        return np.array(self.built.system.config.gravity, dtype=float) / SCALE

    def _measured(self) -> tuple[PhysxBuild, PhysxTrees]:
        """A scene without contact, limits and dry friction, which measures accelerations."""
        if self._bare is None:
            built = self._build(bare=True)
            self._bare = built, PhysxTrees(built, self.q_places, self.v_places, LONG)
        return self._bare

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix of each free body and articulation, with its places in v."""
        built, trees = self._measured()
        built.system.timestep = self.timestep
        q, _ = self.get_state()
        return [*self.singles.mass_parts(built), *trees.mass_parts(q)]

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,): PhysX's inverse dynamics of articulations."""
        q, v = self.get_state()
        found = np.zeros(self.nv)
        self.singles.bias(v, self.gravity, found)
        if self.trees.trees:
            turning = self.trees.turns.size and v.any()
            self.trees.bias(found, self._measured()[1].mass_parts(q) if turning else ())
        return found
