"""Engines that store trees in arrays, with a joint for each link: coordinates, springs, energies and steps.

Such engines have quaternions x y z w, and the angular velocities of free bodies and balls in the axes of the joint's parent
(or the world), where simspec has w x y z and the axes of the child. The velocity of a link is that of its centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simspec.engines.kit.arrays import checked_singles, demand_singles
from simspec.engines.kit.building import ShapeUnit, Walk, bound, range_of
from simspec.engines.kit.link_contacts import ContactRoom
from simspec.engines.kit.world_simulation import SidecarType, WorldSimulation, visual_shape
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, JsonWorld, initial_coordinates
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world import frames
from simspec.world.kinematics import layout_of_kinds
from simspec.world.rotations import cross, exponential, from_xyzw, logarithm, matrices, multiply, rotate, to_xyzw, unit
from simspec.world.types import Body, Inertial, Joint, Pose, Shape, Vector3

_BACK = (1.0, -1.0, -1.0, -1.0)


class LinkCoordinates:
    """Where the coordinates of simspec are among the engine's. ``q_starts`` and ``v_starts``: by row of the document's bodies
    the engine's first place of the joint in its positions and velocities, of which it has as many numbers as simspec."""

    def __init__(self, document: JsonWorld, q_starts: Sequence[int], v_starts: Sequence[int]):
        layout = layout_of_kinds(body.joint.kind for body in document.bodies)
        self.nq, self.nv = layout.nq, layout.nv
        q: list[tuple[int, int]] = []
        v: list[tuple[int, int]] = []
        turns: list[tuple[int, int, int, int]] = []
        places = zip(document.bodies, layout.position, layout.velocity, q_starts, v_starts, strict=True)
        for body, at_q, at_v, their_q, their_v in places:
            size_q, size_v = at_q.stop - at_q.start, at_v.stop - at_v.start
            if body.joint.kind in QUATERNION_JOINTS:
                size_q, size_v = size_q - 4, size_v - 3
                turns.append((at_q.start + size_q, at_v.start + size_v, their_q + size_q, their_v + size_v))
            q.extend((at_q.start + place, their_q + place) for place in range(size_q))
            v.extend((at_v.start + place, their_v + place) for place in range(size_v))
        self._q, self._v = (np.array(pairs, dtype=np.intp).reshape(-1, 2).T for pairs in (q, v))
        starts = np.array(turns, dtype=np.intp).reshape(-1, 4).T[:, :, None]
        self.turns, self.their_turns = starts[0] + np.arange(4), starts[2] + np.arange(4)
        """Places (n, 4) of quaternions in q and in the engine's."""
        self.spins, self.their_spins = starts[1] + np.arange(3), starts[3] + np.arange(3)
        """Places (n, 3) of angular velocities in v and in the engine's."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """The engine's positions (nq,)."""
        found = np.zeros(self.nq)
        found[self._q[1]] = q[self._q[0]]
        found[self.their_turns] = to_xyzw(q[self.turns])
        return found

    def velocities(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The engine's velocities (nv,), or efforts, of simspec's at the positions ``q`` (nq,)."""
        found = np.zeros(self.nv)
        found[self._v[1]] = v[self._v[0]]
        found[self.their_spins] = rotate(q[self.turns], v[self.spins])
        return found

    def positions_of(self, values: np.ndarray) -> np.ndarray:
        """q (nq,) of the engine's positions."""
        found = np.zeros(self.nq)
        found[self._q[0]] = values[self._q[1]]
        found[self.turns] = unit(from_xyzw(values[self.their_turns].astype(float)))
        return found

    def velocities_of(self, q: np.ndarray, values: np.ndarray) -> np.ndarray:
        """v (nv,), or efforts, of the engine's at the positions ``q`` (nq,)."""
        found = np.zeros(self.nv)
        found[self._v[0]] = values[self._v[1]]
        found[self.spins] = rotate(q[self.turns] * _BACK, values[self.their_spins].astype(float))
        return found

    def diagonal_of(self, values: np.ndarray) -> np.ndarray:
        """(nv,) of the engine's numbers of coordinates, which are the same about all axes of a rotation."""
        found = np.zeros(self.nv)
        found[self._v[0]], found[self.spins] = values[self._v[1]], values[self.their_spins]
        return found


class JointSprings:
    """Springs of hinges, slides and balls, of an engine that has none: their efforts and energies."""

    def __init__(self, document: JsonWorld):
        layout = layout_of_kinds(body.joint.kind for body in document.bodies)
        self.stiffness, self.rest = np.zeros((2, len(document.bodies)))
        """Of the joint of each body."""
        scalar: list[tuple[int, int, int]] = []
        balls: list[tuple[int, int, int]] = []
        for row, body in enumerate(document.bodies):
            joint = body.joint
            if not isinstance(joint, AxisJoint | BallJoint):
                continue
            self.stiffness[row] = joint.spring_stiffness
            self.rest[row] = joint.spring_rest if isinstance(joint, AxisJoint) else 0.0
            if not joint.spring_stiffness:
                continue
            rows = scalar if isinstance(joint, AxisJoint) else balls
            rows.append((row, layout.position[row].start, layout.velocity[row].start))
        self.any = bool(scalar or balls)
        self._scalar, self._balls = (np.array(rows, dtype=np.intp).reshape(-1, 3).T for rows in (scalar, balls))
        self._nv = layout.nv

    def _bent(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q − rest (n,) of hinges and slides, log R (n, 3) of balls."""
        (rows, at, _), balls = self._scalar, self._balls[1]
        return q[at] - self.rest[rows], logarithm(q[balls[:, None] + np.arange(4)])

    def effort(self, q: np.ndarray) -> np.ndarray:
        """−k (q − rest), and −k log R of balls (nv,)."""
        found, (bent, turned) = np.zeros(self._nv), self._bent(q)
        found[self._scalar[2]] = -self.stiffness[self._scalar[0]] * bent
        found[self._balls[2][:, None] + np.arange(3)] = -self.stiffness[self._balls[0]][:, None] * turned
        return found

    def energy(self, q: np.ndarray) -> float:
        """J."""
        bent, turned = self._bent(q)
        return 0.5 * float(
            self.stiffness[self._scalar[0]] @ bent**2 + self.stiffness[self._balls[0]] @ (turned**2).sum(axis=1)
        )


SOLVED, MOST_TRIES = 1e-10, 50
"""How near an engine's gyroscopic update is inverted, relative, and after how many tries that is given up."""


class Midpoint:
    """Single free bodies with unequal moments in an engine that replaces their gyroscopic term by the midpoint rule.

    It keeps the energy: u = ω + dt I⁻¹ τ becomes w with (I − S) w = (I + S) u, S = ½ dt [½ I (u + w)]×. So they are given the
    torque with which w is ω + dt I⁻¹ (τ − ω × I ω). In single precision w is 1e-7 off in each step, always to the same side
    (measured in one engine): bodies that touch nothing are given the velocity of the law.

    ``links``: the engine's numbers of single free bodies; by those ``tensors`` (n, 3, 3), and ``q_starts`` and ``v_starts``
    (n,): the first places of joints in the engine's positions and velocities.
    """

    def __init__(self, links: Sequence[int], tensors: np.ndarray, q_starts: np.ndarray, v_starts: np.ndarray):
        uneven = [link for link in links if not np.array_equal(tensors[link], tensors[link][0, 0] * np.eye(3))]
        tensors, q_starts, v_starts = tensors[uneven], q_starts[uneven], v_starts[uneven]
        self.any, self._links = bool(uneven), np.array(uneven, dtype=np.intp)
        self._tensors, self._inverse = tensors, np.linalg.inv(tensors)
        self._turns, self._spins = q_starts[:, None] + np.arange(3, 7), v_starts[:, None] + np.arange(3, 6)

    def correct(self, q: np.ndarray, v: np.ndarray, f: np.ndarray, timestep: float) -> np.ndarray | None:
        """Replace the torques in the engine's efforts ``f`` at its state (q, v). Returns the angular velocities (n, 3) after a
        step without contact, in world axes; None where nothing turns."""
        if not self.any or not (v[self._spins].any() or f[self._spins].any()):
            return None
        axes = matrices(unit(from_xyzw(q[self._turns].astype(float))))
        spin, torque = (np.einsum("nji,nj->ni", axes, x[self._spins].astype(float)) for x in (v, f))
        momentum = np.einsum("nij,nj->ni", self._tensors, spin)
        after = spin + timestep * np.einsum("nij,nj->ni", self._inverse, torque - cross(spin, momentum))
        given = np.einsum("nij,nj->ni", self._tensors, self._before(after, timestep) - spin) / timestep
        f[self._spins] = np.einsum("nij,nj->ni", axes, given)
        found: np.ndarray = np.einsum("nij,nj->ni", axes, after)
        return found

    def _before(self, after: np.ndarray, timestep: float) -> np.ndarray:
        """The angular velocities u (n, 3) of which the engine's update makes ``after``."""
        found, scale = after, float(np.abs(after).max(initial=1.0))
        for _ in range(MOST_TRIES):
            both = found + after
            kick = cross(np.einsum("nij,nj->ni", self._tensors, both), both)
            better = after - 0.25 * timestep * np.einsum("nij,nj->ni", self._inverse, kick)
            change, found = float(np.abs(better - found).max()), better
            if change < SOLVED * scale:
                break
        return found

    def settle(self, v: np.ndarray, after: np.ndarray, touched: np.ndarray) -> None:
        """Give the bodies that are not among the links ``touched`` the velocities ``after``, in the engine's ``v``."""
        alone = ~np.isin(self._links, touched)
        v[self._spins[alone]] = after[alone]


def tree_joint(
    given: AxisJoint | BallJoint | FixedJoint,
    parent: str | None,
    origin: Pose,
    state: tuple[Sequence[float], Sequence[float]],
    read: Callable[[str], float],
    axis: Vector3,
) -> Joint:
    """A joint of the kind of ``given`` as an engine stores it. ``state``: its position and velocity; ``read``: a number by the
    name of a field, ``limit_lower`` and ``limit_upper`` those of the position, infinite for none."""
    position, velocity = state
    found = Joint(given.name, given.kind, parent, origin, position=tuple(position), velocity=tuple(velocity))
    if isinstance(given, FixedJoint):
        return found
    found = replace(
        found, damping=read("damping"), armature=read("armature"), spring_stiffness=read("spring_stiffness")
    )
    if isinstance(given, BallJoint):
        return found
    return replace(
        found,
        axis=axis,
        position_limits=range_of(read("limit_lower"), read("limit_upper")),
        velocity_limit=bound(read("velocity_limit")),
        effort_limit=bound(read("effort_limit")),
        dry_friction=read("friction"),
        spring_rest=read("spring_rest"),
    )


@dataclass(frozen=True)
class LinkStates:
    """Poses (n, 7), with quaternions x y z w, and velocities (n, 6) of the links of an engine, of the centre of mass in world
    axes, as doubles."""

    at: np.ndarray
    speed: np.ndarray

    @property
    def turn(self) -> np.ndarray:
        """Quaternions (n, 4)."""
        return unit(from_xyzw(self.at[:, 3:]))

    @property
    def body_speeds(self) -> np.ndarray:
        """The velocities (n, 6) with angular parts in the axes of the links."""
        spin = rotate(self.turn * _BACK, self.speed[:, 3:])
        return np.concatenate([self.speed[:, :3], spin], axis=1)

    def frames(self, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the frames of links whose centres of mass are at ``centres`` (n, 3) in them."""
        turn = self.turn
        poses = np.concatenate([self.at[:, :3], turn], axis=1)
        speed, spin = self.speed[:, :3], self.speed[:, 3:]
        moving = speed - cross(spin, rotate(turn, centres))
        return poses, np.concatenate([moving, spin], axis=1)

    def energy(
        self, masses: np.ndarray, centres: np.ndarray, inertias: np.ndarray, gravity: np.ndarray
    ) -> tuple[float, float]:
        """Kinetic energy, and potential energy (J) in ``gravity`` (3,), zero at the origin. ``inertias`` (n, 3, 3) are in the
        axes of the links."""
        moving, spin = np.split(self.body_speeds, 2, axis=1)
        kinetic = masses @ (moving**2).sum(axis=1) + np.einsum("ni,nij,nj->", spin, inertias, spin)
        places = self.at[:, :3] + rotate(self.turn, centres)
        return 0.5 * float(kinetic), -float(masses @ (places @ gravity))


class LinkSimulation(WorldSimulation[SidecarType]):
    """A loaded ``world.json`` of such an engine in single precision. Its constructor calls :meth:`begin`."""

    walk: Walk
    timestep: float
    """s."""
    room: ContactRoom
    springs: JointSprings
    """Those that the engine does not have."""

    def begin(
        self,
        places: LinkCoordinates,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        midpoint: Midpoint | None = None,
    ) -> None:
        """Take the engine's own memory of positions, velocities and efforts, and enter the initial state."""
        self.places, self.their_q, self.their_v, self.their_effort = places, q, v, effort
        self.springs, self._midpoint, self.stepped = JointSprings(self.document), midpoint, False
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def place(self) -> None:
        """Let the engine compute the poses and velocities of its links from the coordinates."""
        raise NotImplementedError

    def launch(self) -> int | None:
        """One step of the engine; where contacts or rows had no room, for how many contacts it had."""
        raise NotImplementedError

    def make_anew(self) -> None:
        """Let the next step be made anew, with the present room and timestep."""
        raise NotImplementedError

    def touched(self) -> np.ndarray:
        """The links that the contacts of the last step are of."""
        raise NotImplementedError

    def link_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the links (:class:`LinkStates`), in the order of the bodies."""
        raise NotImplementedError

    def inertials(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Masses (n,), centres of mass (n, 3) and inertias (n, 3, 3) of the links, in the order of the bodies."""
        raise NotImplementedError

    @property
    def rotors(self) -> np.ndarray:
        """The armature (nv,) of the joints, in the engine's order."""
        raise NotImplementedError

    @property
    def gravity(self) -> np.ndarray:
        """As the engine has it (3,), in m/s²."""
        raise NotImplementedError

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        self.place()
        return LinkStates(*self.link_arrays()).frames(self.inertials()[1])

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J) by the engine's masses, poses and velocities; springs' by those of the joints."""
        self.place()
        kinetic, potential = LinkStates(*self.link_arrays()).energy(*self.inertials(), self.gravity)
        turning = 0.5 * float(self.rotors @ self.their_v.astype(float) ** 2)
        return kinetic + turning, potential + self.springs.energy(self.get_state()[0])

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The parts (places, M) of the mass matrix, one for each tree: by the kinetic energy of the links with a unit of each
        coordinate. Engines sum inertias about one point of a tree, where moments of links far from it lose digits."""
        before, q, (masses, _, inertias) = self.their_v.copy(), self.get_state()[0], self.inertials()
        trees, links = self.tree_places(), self.tree_rows()
        speeds = [np.zeros((len(places), len(rows), 6)) for places, rows in zip(trees, links, strict=True)]
        for column in range(max(map(len, trees), default=0)):
            unit_rates = np.zeros(self.nv)
            unit_rates[[places[column] for places in trees if column < len(places)]] = 1.0
            self.their_v[:] = self.places.velocities(q, unit_rates)
            self.place()
            found = LinkStates(*self.link_arrays()).body_speeds
            for speed, rows in zip(speeds, links, strict=True):
                if column < len(speed):
                    speed[column] = found[rows]
        self.their_v[:] = before
        self.place()
        rotors, parts = self.places.diagonal_of(self.rotors), []
        for places, rows, speed in zip(trees, links, speeds, strict=True):
            moving, spin = speed[..., :3], speed[..., 3:]
            mass = np.einsum("l,ali,bli->ab", masses[rows], moving, moving)
            mass += np.einsum("ali,lij,blj->ab", spin, inertias[rows], spin) + np.diag(rotors[places])
            parts.append((places, mass))
        return parts

    def with_single_bias(self, bias: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        """``bias`` (nv,) with Coriolis, centrifugal and gravity forces of the single free bodies at ``rows`` by the engine's
        masses."""
        found, v, (masses, _, inertias) = bias.copy(), self.get_state()[1], self.inertials()
        for row in rows:
            place = self.v_places[row].start
            spin = v[place + 3 : place + 6]
            found[place : place + 3] = -masses[row] * self.gravity
            found[place + 3 : place + 6] = np.cross(spin, inertias[row] @ spin)
        return found

    def forget_contacts(self) -> None:
        """Let the next step not depend on contacts of earlier steps, where the engine keeps them."""

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v)."""
        self.move_to(q, v)
        self.forget_contacts()

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same; an engine that keeps contacts of earlier steps keeps them here."""
        q, v = self.normalised(q), np.array(v, dtype=float)
        demand_singles(self.engine, np.concatenate([q, v]), "state")
        self.their_q[:], self.their_v[:] = self.places.positions(q), self.places.velocities(q, v)
        self.stepped = False
        self.place()

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        q = self.places.positions_of(self.their_q)
        return q, self.places.velocities_of(q, self.their_v)

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the springs of the joints."""
        if effort is not None:
            demand_singles(self.engine, np.asarray(effort, dtype=float), "effort")
        middle = self._midpoint
        each = effort is not None or self.springs.any or (middle is not None and middle.any)
        self.their_effort[:] = 0.0
        for _ in range(count):
            after = self._give(effort) if each else None
            before = self.their_q[self.places.their_turns].astype(float)
            self._step()
            if after is not None and middle is not None:
                middle.settle(self.their_v, after, self.touched())
            self._turn_on(before)
        self.stepped = self.stepped or count > 0
        if count and not (np.isfinite(self.their_q).all() and np.isfinite(self.their_v).all()):
            raise EngineError(self.engine, "the state is no longer finite")

    def _step(self) -> None:
        """One step, again with more room where contacts or rows had none."""
        begins = self.their_q.copy(), self.their_v.copy()
        while (found := self.launch()) is not None:
            self.grow(found)
            self.their_q[:], self.their_v[:] = begins

    def grow(self, found: int) -> None:
        """Make the next step with more room, after so many points of contact were ``found``."""
        self.room = self.room.larger(self.engine, found)
        self.make_anew()

    def set_timestep(self, timestep: float) -> None:
        """Step by another timestep (s), now and after states that are set."""
        self.timestep = checked_singles(self.engine, (timestep,), "timestep")[0]
        self.make_anew()

    def _give(self, effort: np.ndarray | None) -> np.ndarray | None:
        """Give the efforts of the next step; what :meth:`Midpoint.correct` returns."""
        total = np.zeros(self.nv) if effort is None else np.array(effort, dtype=float)
        q = self.places.positions_of(self.their_q)
        if self.springs.any:
            total += self.springs.effort(q)
        self.their_effort[:] = self.places.velocities(q, total)
        if self._midpoint is None:
            return None
        return self._midpoint.correct(self.their_q, self.their_v, self.their_effort, self.timestep)

    def _turn_on(self, before: np.ndarray) -> None:
        """Turn what turns fast by its last rotation exactly, from where it was ``before`` (n, 4)."""
        spin = self.timestep * self.their_v[self.places.their_spins].astype(float)
        fast = np.flatnonzero(np.einsum("ni,ni->n", spin, spin) > SLOW * SLOW)
        if len(fast):
            turned = multiply(exponential(spin[fast]), from_xyzw(before[fast]))
            self.their_q[self.places.their_turns[fast]] = to_xyzw(unit(turned))

    def units(self) -> list[tuple[int, str]]:
        return [(copy.of.owner.row, copy.of.shape.name) for copy in self.walk.units]

    def bodies(
        self,
        inertial: Callable[[int], Inertial],
        joint: Callable[[int], Joint],
        shape: Callable[[Sequence[ShapeUnit]], Shape],
    ) -> list[Body]:
        """The bodies of a read-back, from what is stored of a row, and of the copies of a shape."""
        copies: dict[tuple[int, int], list[ShapeUnit]] = {}
        for copy in self.walk.units:
            copies.setdefault((copy.of.owner.row, copy.of.place), []).append(copy)
        bodies = []
        for row, body in enumerate(self.document.bodies):
            shapes = tuple(
                shape(copies[row, place]) if (row, place) in copies else visual_shape(drawn)
                for place, drawn in enumerate(body.shapes)
            )
            bodies.append(Body(body.name, body.model, inertial(row), joint(row), shapes))
        return bodies


SLOW = 1e-3
"""|ω| dt (rad) up to which rotations of engines that take the unit quaternion along q + ½ ω q dt stay: they lag by
(|ω| dt)³ / 12."""


def pose_of_xyzw(row: np.ndarray) -> Pose:
    """A pose of x y z x y z w."""
    x, y, z, a, b, c, w = row.astype(float).tolist()
    return Pose((x, y, z), frames.normalise((w, a, b, c)))
