"""A world in PhysX, in its initial state: stepping, efforts, contact.

A free body's frame is at its centre of mass, so that its coordinates are those of PhysX's actor. PhysX steps as simspec's law
of motion does, v before x, but for how bodies turn (``turning.py``).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.physx import PhysxSidecar
from simspec.engines.kit.arrays import ContactRow, contact_arrays, demand_singles
from simspec.engines.kit.world_simulation import FreeBodySimulation
from simspec.engines.physx.building import (
    FASTEST,
    FASTEST_LINEAR,
    LEAST,
    NAME,
    SCALE,
    PackedActors,
    PhysxBuild,
    inertia_of,
    mass_matrices,
    pose_of,
)
from simspec.errors import EngineError
from simspec.formats.world import initial_coordinates
from simspec.world.rotations import cross, exponential, matrices, multiply, rotate
from simspec.world.types import Pose

# Contacts as PhysX reports them, in its unit of length: of the beginning of its last step, with that step's impulses.

ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""


@dataclass(frozen=True)
class PhysxDepths:
    """Overlaps of pairs of bodies. ``rows`` (n, 2), sorted, of those that move, −1 of what cannot; ``depth`` (n,) in m, above
    zero: the deepest of each pair."""

    rows: np.ndarray
    depth: np.ndarray


class PhysxRecovery:
    """How fast each of ``count`` bodies may be pushed out of what it overlaps in the next step, by the common law.

    By the law an overlap d is (1 − β) d after the step. A deeper overlap is left over by PhysX's sweeps: it begins
    each step anew, so that a stack would sink in by a hundred times that. So the speed is (β d + what is left over) / dt, of
    the most demanding pair of each body. PhysX takes the slower of two bodies'.
    """

    def __init__(self, count: int, timestep: float):
        self._count, self._timestep = count, timestep
        self._pairs, self._owed = np.zeros(0, dtype=np.int64), np.zeros(0)
        self.speeds = np.full(count, LEAST)
        """m/s, of each body."""

    def begin(self, found: PhysxDepths) -> None:
        """Go by overlaps of the present state: all of them are as the law has them."""
        self._pairs, self._owed = self._keys(found.rows), found.depth
        self._set(found.rows, ERROR_REDUCTION * found.depth)

    def go_on(self, found: PhysxDepths) -> None:
        """Go by the overlaps ``found`` where the last step began."""
        keys = self._keys(found.rows)
        owed, known = found.depth.copy(), np.zeros(len(keys), dtype=bool)
        if len(self._pairs):
            at = np.minimum(np.searchsorted(self._pairs, keys), len(self._pairs) - 1)
            known = self._pairs[at] == keys
            owed[known] = np.minimum(self._owed[at[known]], owed[known])
        left = found.depth - owed
        # the last step has undone as much of what was not known as it was allowed to
        undone = np.append(self.speeds, np.inf)[found.rows].min(axis=1, initial=np.inf) * self._timestep
        owed = np.where(known, (1.0 - ERROR_REDUCTION) * owed, np.maximum(0.0, owed - undone))
        self._pairs, self._owed = keys, owed
        self._set(found.rows, ERROR_REDUCTION * owed + left)

    def _keys(self, rows: np.ndarray) -> np.ndarray:
        found: np.ndarray = (rows[:, 0] + 1) * (self._count + 1) + rows[:, 1] + 1
        return found

    def _set(self, rows: np.ndarray, way: np.ndarray) -> None:
        speeds = np.zeros(self._count + 1)
        np.maximum.at(speeds, rows[:, 0], way)
        np.maximum.at(speeds, rows[:, 1], way)
        self.speeds = np.maximum(LEAST, speeds[: self._count] / self._timestep)


def depths(contacts: Sequence[Any], rows: Mapping[Any, int]) -> PhysxDepths:
    """The overlaps among contacts; ``rows``: of the actors that move."""
    # most of a step's time after PhysX's: each call of SAPIEN costs 0.1 to 0.8 µs
    ends: list[int] = []
    least: list[float] = []
    row_of = rows.get
    for contact in contacts:
        deepest = 0.0
        for point in contact.points:
            deepest = min(deepest, point.separation)
        if deepest < 0.0:
            entry, other = contact.bodies
            ends += row_of(entry, -1), row_of(other, -1)
            least.append(deepest)
    pairs = np.sort(np.array(ends, dtype=np.int64).reshape(-1, 2), axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, separations = pairs[order], np.array(least, dtype=float)[order]
    if len(pairs) < 2:
        return PhysxDepths(pairs, -separations / SCALE)
    begins = np.flatnonzero(np.append(True, (pairs[1:] != pairs[:-1]).any(axis=1)))
    return PhysxDepths(pairs[begins], -np.minimum.reduceat(separations, begins) / SCALE)


def pressed(contacts: Sequence[Any], rows: Mapping[Any, int], requested: Collection[int]) -> set[int]:
    """Those of the ``asked`` rows on which some contact acts."""
    found: set[int] = set()
    open_rows = set(requested)
    for contact in contacts:
        mine = [row for body in contact.bodies if (row := rows.get(body, -1)) in open_rows]
        if mine and any(any(point.impulse.tolist()) for point in contact.points):
            found.update(mine)
            open_rows.difference_update(mine)
    return found


def contact_rows(
    contacts: Sequence[Any], units: Mapping[Any, int], bodies: Sequence[int], timestep: float
) -> dict[str, np.ndarray]:
    """The arrays of :meth:`Engine.contacts`; ``units``: the number of each shape, ``bodies``: by that, the row of its body."""
    rows: list[ContactRow] = []
    for contact in contacts:
        index, other = (units[shape] for shape in contact.shapes)
        for point in contact.points:
            normal = np.array(point.normal, dtype=float)
            force = max(0.0, float(normal @ np.array(point.impulse, dtype=float))) / (SCALE * timestep)
            if point.separation > 0.0 and not force > 0.0:
                continue
            towards = normal if index < other else -normal  # from the second to the first
            at = np.array(point.position, dtype=float) / SCALE
            rows.append(((min(index, other), max(index, other)), at, towards, point.separation / SCALE, force))
    return contact_arrays(rows, bodies)


def touching_pairs(contacts: Sequence[Any], units: Mapping[Any, int]) -> np.ndarray:
    """Pairs (n, 2) of the numbers of shapes that touch."""
    found = [
        tuple(units[shape] for shape in contact.shapes)
        for contact in contacts
        if any(point.separation <= 0.0 for point in contact.points)
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


# How bodies turn in a step: by simspec's law of motion, where PhysX has another gyroscopic term and few digits.
#
# After all else PhysX takes dt ω × L off a body's angular momentum L = I ω and gives it the length back that it had. So it is
# given the torque with which that comes out as dt (τ − ω × Iω). The result is 1e-7 off in every step and always to the same
# side: 9e-4 rad/s of a body that turns at 6 rad/s for 2 s, 23 times what the round-off of single precision makes (measured). So
# bodies without contact are then given the velocity and the turn of the law, which is 3 times that round-off off.

SOLVED, MOST_TRIES = 1e-12, 50
"""How near the gyroscopic term is solved for, relative, and after how many tries that is given up."""


@dataclass(frozen=True)
class Turns:
    """Of bodies ``rows``: the ``torque`` that PhysX is given in a step, and the ``spin`` and ``turn`` of the law after it;
    vectors (n, 3) in world axes, quaternions (n, 4)."""

    rows: np.ndarray
    torque: np.ndarray
    spin: np.ndarray
    turn: np.ndarray


def turns(
    rows: np.ndarray, turn: np.ndarray, spin: np.ndarray, torque: np.ndarray, tensors: np.ndarray, timestep: float
) -> Turns:
    """Of bodies at ``turn`` (n, 4) with ``spin`` (n, 3) in world axes, ``torque`` (n, 3) and ``tensors`` (n, 3, 3) in their
    own."""
    axes = matrices(turn)
    local = np.einsum("nji,nj->ni", axes, spin)
    begins = np.einsum("nij,nj->ni", tensors, local)
    wanted = begins + timestep * (torque - cross(local, begins))
    inverse = np.linalg.inv(tensors)
    given = (_before(wanted, begins, local, inverse, timestep) - begins) / timestep
    after = np.einsum("nij,njk,nk->ni", axes, inverse, wanted)
    return Turns(rows, np.einsum("nij,nj->ni", axes, given), after, multiply(exponential(timestep * after), turn))


def _before(
    wanted: np.ndarray, begins: np.ndarray, spin: np.ndarray, inverse: np.ndarray, timestep: float
) -> np.ndarray:
    """The momenta of which PhysX's gyroscopic term makes the ``wanted`` ones: N |L| / |N| with N = L − dt ω × L, by repetition,
    as dt ω is small against 1."""
    found = wanted + timestep * cross(spin, begins)
    scale = np.linalg.norm(wanted, axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    for _ in range(MOST_TRIES):
        turned = found - timestep * cross(np.einsum("nij,nj->ni", inverse, found), found)
        size = np.linalg.norm(turned, axis=1, keepdims=True)
        made = turned * np.linalg.norm(found, axis=1, keepdims=True) / np.where(size > 0.0, size, 1.0)
        found = found + (wanted - made)
        if np.max(np.linalg.norm(wanted - made, axis=1) / scale) < SOLVED:
            break
    return found


TINY = 1e-6
"""s: the step that computes the contacts of a state."""
SLOW = 1e-3
"""rad/s up to which PhysX turns a body by itself: the error is then 3e-7 rad after 2 s. Round-off in contacts without
friction turns balls at 3e-4."""
NO_FORCE = np.zeros(3)


class PhysxSimulation(FreeBodySimulation[PhysxSidecar]):
    """A loaded world."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, PhysxSidecar, folder, sidecar)
        self._probes: PhysxBuild | None = None
        self._contact = True
        try:
            self._take(self._build())
        except KeyError as error:
            raise EngineError(NAME, f"the sidecar's settings lack {error}") from error
        self.masses = np.array([actor.mass for actor in self.bodies], dtype=float)
        self.tensors = np.array([inertia_of(actor) for actor in self.bodies]).reshape(-1, 3, 3)
        self.move_to(*map(np.array, initial_coordinates(self.document)))

    def _build(self) -> PhysxBuild:
        """A new scene."""
        built = PhysxBuild(self.walk, self.typed)
        if not self._contact:
            self._part(built)
        return built

    def _take(self, built: PhysxBuild) -> None:
        """Step this scene from now on."""
        self.built = built
        self.timestep = float(built.system.timestep)
        self.bodies = self._actors(built)
        self.entities = [built.entities[row] for row in self.free]
        self.rows = {actor: index for index, actor in enumerate(self.bodies)}
        self._packed = PackedActors(built.system, self.bodies)
        self._unit_of = {shape: index for index, shape in enumerate(built.shapes)}
        self._fastest = np.full(len(self.free), LEAST)
        """m/s: how fast PhysX may push each body out of what it overlaps."""
        self._recovery = PhysxRecovery(len(self.free), self.timestep)
        self._begun = False
        """Whether a state was set since the last step."""
        self._found: list[Any] = []
        """PhysX's contacts of the last step."""

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v), as if it had been loaded in it: contacts of earlier steps are forgotten."""
        self._take(self._build())
        self.move_to(q, v)

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same with the contacts of earlier steps."""
        demand_singles(NAME, SCALE * np.concatenate([q, v]), "state")
        poses, velocities = self.in_world(q, v)
        velocities[:, :3] *= SCALE
        poses[:, :3] *= SCALE
        pose = self.built.sapien.Pose
        for entity, body, at, speed in zip(self.entities, self.bodies, poses, velocities, strict=True):
            entity.pose = pose(at[:3], at[3:])
            body.linear_velocity, body.angular_velocity = speed[:3], speed[3:]
        state = np.hstack([poses[:, :3], velocities]).astype(np.float32)
        actual, moving = self._packed.read()
        if not np.array_equal(np.hstack([actual[:, :3], moving]), state):
            raise EngineError(NAME, "holds another state than it was given")
        self._found, self._begun = [], True
        if self.walk.units and self._contact:
            self._recovery.begin(self._overlaps())

    def moving(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6, in world axes) of the bodies that move."""
        poses, speeds = self._packed.read()
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        poses[:, :3] /= SCALE
        speeds[:, :3] /= SCALE
        return poses, speeds

    def static_pose(self, row: int) -> Pose:
        return pose_of(self.built.entities[row].pose)

    def units(self) -> list[tuple[int, str]]:
        return [(unit.of.owner.row, unit.of.shape.name) for unit in self.walk.units]

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero."""
        wrench = None
        if effort is not None:
            demand_singles(NAME, SCALE * SCALE * np.asarray(effort, dtype=float), "effort")
            wrench = np.asarray(effort, dtype=float).reshape(-1, 6)
            wrench = wrench if wrench.any() else None
        touching = self._contact and bool(self.walk.units)
        for _ in range(count):
            turning = self._give(wrench)
            if touching:
                self._bound()
            self.built.system.step()
            self._begun = False
            self._found = self.built.system.get_contacts() if touching else []
            if turning is not None:
                self._turn(turning)
        if count:
            self._check_finite()

    def _check_finite(self) -> None:
        """Raise EngineError where a state is none any more: PhysX steps on, with no number or with its largest speeds."""
        poses, speeds = self._packed.read()
        bounds = np.repeat((FASTEST_LINEAR, FASTEST), 3)
        sound = np.isfinite(poses).all(axis=1) & (np.abs(speeds) < 0.5 * bounds).all(axis=1)
        if not sound.all():
            row = self.free[int(np.flatnonzero(~sound)[0])]
            raise EngineError(NAME, f"the state of {self.names[row]} is no longer finite")

    def _give(self, wrench: np.ndarray | None) -> Turns | None:
        """Give the forces and torques of the next step; how bodies turn in it."""
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
            turning = turns(rows, at, spins[rows], torque, self.tensors[rows], self.timestep)
            torques = dict(zip(rows.tolist(), SCALE * SCALE * turning.torque, strict=True))
        forces: dict[int, np.ndarray] = {}
        if wrench is not None:
            forces = {row: SCALE * wrench[row, :3] for row in np.flatnonzero(wrench[:, :3].any(axis=1)).tolist()}
        for row in torques.keys() | forces.keys():
            self.bodies[row].add_force_torque(forces.get(row, NO_FORCE), torques.get(row, NO_FORCE))
        return turning

    def _turn(self, turning: Turns) -> None:
        """Give what turned in the last step, and touched nothing in it, the velocity and orientation of the law."""
        turned = turning.rows.tolist()
        actual = pressed(self._found, self.rows, turned)
        pose = self.built.sapien.Pose
        for row, spin, turn in zip(turned, turning.spin, turning.turn, strict=True):
            if row not in actual:
                entity = self.entities[row]
                self.bodies[row].angular_velocity = spin
                entity.pose = pose(entity.pose.p, turn)

    # --- contact ----------------------------------------------------------------------------------------------

    def _overlaps(self) -> PhysxDepths:
        """The overlaps of the present state, which the scene itself would tell after its next step."""
        probe = self._probe()
        return depths(probe.system.get_contacts(), {actor: row for row, actor in enumerate(self._actors(probe))})

    def _actors(self, built: PhysxBuild) -> list[Any]:
        """Those that move."""
        return [built.actors[row] for row in self.free]

    def _probe(self) -> PhysxBuild:
        """A second scene in the present state, of which PhysX has found the contacts."""
        if self._probes is None:
            self._probes = self._build()
            self._probes.system.timestep = TINY
        probe = self._probes
        for row, entity in zip(self.free, self.entities, strict=True):
            probe.entities[row].pose = entity.pose
            probe.actors[row].linear_velocity = probe.actors[row].angular_velocity = (0.0, 0.0, 0.0)
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

    # --- mass properties --------------------------------------------------------------------------------------

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) of the bodies that move."""
        q, v = self.get_state()
        poses, speeds = q.reshape(-1, 7), v.reshape(-1, 6)
        turning = np.einsum("ni,nij,nj->", speeds[:, 3:], self.tensors, speeds[:, 3:])
        moving = self.masses @ (speeds[:, :3] ** 2).sum(axis=1)
        centres = poses[:, :3] + rotate(poses[:, 3:], self._centres())
        return 0.5 * float(moving + turning), -float(self.masses @ (centres @ self.gravity))

    @property
    def gravity(self) -> np.ndarray:
        """As PhysX has it (3,), in m/s²."""
        return np.array(self.built.system.config.gravity, dtype=float) / SCALE

    def _centres(self) -> np.ndarray:
        centres = [body.cmass_local_pose.p for body in self.bodies]
        return np.array(centres, dtype=float).reshape(-1, 3) / SCALE

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix of each body that moves, with its places in v."""
        probe = self._build()
        self._part(probe)
        poses = [entity.pose for entity in self.entities]
        bodies = [(probe.entities[row], probe.actors[row]) for row in self.free]
        masses = mass_matrices(probe.system, bodies, poses, np.trace(self.tensors, axis1=1, axis2=2))
        return [(np.arange(6 * row, 6 * row + 6), mass) for row, mass in enumerate(masses)]

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,): −m g as PhysX has both, and the ω × Iω that it is given."""
        _, v = self.get_state()
        spins = v.reshape(-1, 6)[:, 3:]
        found = np.zeros((len(self.free), 6))
        found[:, :3] = -self.masses[:, None] * self.gravity
        found[:, 3:] = cross(spins, np.einsum("nij,nj->ni", self.tensors, spins))
        return found.ravel()
