"""The multibodies of a loaded world: their coordinates, the wrenches that give an effort, and position limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.rapier.multibodies import ANCHOR, WHEEL_SPEED, Multibodies, mark_of, unit_of
from simspec.engines.rapier.units import SCALE, SQUARE, inertia_of, quaternion_of, states_of
from simspec.formats.world import AxisJoint, BallJoint
from simspec.language.vocabulary import QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.world.rotations import conjugate, cross, logarithm, matrices, multiply, rotate, unit

Floats = NDArray[np.float64]
SHORTER, LONGER = 5.0e-4, 4.8e-4
"""Angles (rad) of turns by whose quaternion in single precision, there and back, a rotation becomes about 5.7e-8 shorter or
longer: the cosine of their halves is rounded down, and up to 1."""
STEP_OF_LENGTH = 5.7e-8
"""By so much these turns change a length."""
MOST_TURNS = 3
"""Of them in a step."""
AFTER_MARK = 41
"""Bytes from the mark of a joint to its rotation (x y z w), where Rapier's multibodies are serialised: the mark, whether the
joint is kinematic, six coordinates."""
SETTINGS_OF_A_STATE = 2
"""Passes in which displacements bring a multibody to a state: the second removes the round-off of the first."""


class LinkPlaces:
    """Where the joints of the links have their coordinates in q (nq,) and v (nv,), and in the coordinates of all multibodies,
    one after the other. ``scalar``: hinges and slides; ``turning``: balls and free bodies."""

    def __init__(self, built: Multibodies, q_places: Sequence[slice], v_places: Sequence[slice]):
        rows = [(number, link, built.places[number]) for number, link in enumerate(built.links)]
        scalar = [row for row in rows if row[1].kind in SCALAR_JOINTS]
        self.scalar = np.array([number for number, _, _ in scalar], dtype=np.intp)
        self.q = np.array([q_places[link.placed.row].start for _, link, _ in scalar], dtype=np.intp)
        self.v = np.array([v_places[link.placed.row].start for _, link, _ in scalar], dtype=np.intp)
        self.at = np.array([at for *_, at in scalar], dtype=np.intp)
        self.units = np.array([unit_of(link.kind) for _, link, _ in scalar])
        self.turning = [
            (number, link.kind == "free", q_places[link.placed.row].start, v_places[link.placed.row].start, at)
            for number, link, at in rows
            if link.kind in QUATERNION_JOINTS
        ]
        """Number of the link, whether it is free, its places in q and v, and among the coordinates."""
        self.size = sum(built.sizes)
        self.wheels = np.array(built.wheel_places, dtype=np.intp)
        count = len(built.links)
        self.ancestors = np.eye(count)
        """(n, n): 1 where a link (row) is moved by the joint of another, or of its own."""
        for number, link in enumerate(built.links):
            if link.parent != ANCHOR:
                self.ancestors[number] += self.ancestors[link.parent]
        self._axes = np.zeros((2, count, 3))
        for number, link, _ in scalar:
            self._axes[int(link.kind == "hinge"), number] = link.joint.axis
        self._origins = np.array([link.origin.quaternion for link in built.links]).reshape(-1, 4)
        self._parents = [link.parent for link in built.links]

    def by_velocity(self, q: Floats, count: int) -> Floats:
        """The matrix by which Rapier's velocities follow from v (``count``,) at ``q``; flywheels have none."""
        found = np.zeros((self.size, count))
        found[self.at, self.v] = self.units
        for _, free, at_q, at_v, at in self.turning:
            if free:
                found[at : at + 3, at_v : at_v + 3] = SCALE * np.eye(3)
            turn = matrices(unit(q[at_q + 3 * free :][:4]))
            found[at + 3 * free :, at_v + 3 * free :][:3, :3] = turn
        return found

    def relative(self, poses: Floats, rates: Floats) -> Floats:
        """The velocities (n, 6) of the links' frames, in world axes, against what they are connected to, for Rapier's
        velocities of the coordinates."""
        motion = np.zeros((len(self._parents), 6))
        turns = poses[:, 3:]
        along = np.zeros(len(motion))
        along[self.scalar] = rates[self.at] / self.units
        for kind, columns in enumerate((slice(0, 3), slice(3, 6))):
            motion[:, columns] = rotate(turns, self._axes[kind]) * along[:, None]
        for number, free, _, _, at in self.turning:
            if free:
                motion[number, :3], motion[number, 3:] = rates[at : at + 3] / SCALE, rates[at + 3 : at + 6]
                continue
            motion[number, 3:] = rotate(self._joint_axes(number, turns), rates[at : at + 3])
        return motion

    def _joint_axes(self, number: int, turns: Floats) -> Floats:
        """The orientation (4,) of the frame of a ball joint in what it is connected to."""
        parent, origin = self._parents[number], self._origins[number]
        found: Floats = origin if parent == ANCHOR else multiply(turns[parent], origin)
        return found


class LiveMultibodies:
    """The multibodies of one of Rapier's worlds. Rapier's views of them belong to that world."""

    def __init__(self, built: Multibodies, places: LinkPlaces, world: Any, wheel_speed: float = WHEEL_SPEED):
        self.built, self.places, self.world, self.wheel_speed = built, places, world, wheel_speed
        self.multibodies = [world.multibody_joints.multibody(handle) for handle in built.wheels]
        self.bodies = [world.rigid_bodies[handle] for handle in built.bodies]
        self.armed: set[int] = set()
        """The limited joints (numbers) whose limits in Rapier are those of the next step."""

    # --- coordinates --------------------------------------------------------------------------------------------

    def positions(self) -> Floats:
        """Rapier's coordinates of all multibodies; those of rotations are none (see :meth:`_turn`)."""
        return np.array([value for multibody in self.multibodies for value in multibody.generalized_position()])

    def rates(self) -> Floats:
        """Their velocities."""
        return np.array([value for multibody in self.multibodies for value in multibody.generalized_velocity()])

    def accelerations(self) -> Floats:
        """Their accelerations in the last step, without those by limits, motors and contact."""
        return np.array([value for multibody in self.multibodies for value in multibody.generalized_acceleration()])

    def are_finite(self) -> bool:
        """Whether the last step had finite results. Rapier silently replaces accelerations that are not by zeros, in a whole
        multibody; that of a flywheel is never zero."""
        return bool(np.isfinite(self.rates()).all() and self.accelerations()[self.places.wheels].all())

    def _turn(self, number: int) -> Floats:
        """The rotation of a ball or free body."""
        tree = self.built.links[number].tree
        return np.array(quaternion_of(self.multibodies[tree].get_link(self.built.numbers[number]).joint_rot))

    def read(self, q: Floats, v: Floats) -> None:
        """Write the present state into ``q`` (nq,) and ``v`` (nv,)."""
        places, positions = self.places, self.positions()
        q[places.q] = positions[places.at] / places.units
        for number, free, at_q, _, at in places.turning:
            if free:
                q[at_q : at_q + 3] = positions[at : at + 3] / SCALE
            q[at_q + 3 * free :][:4] = self._turn(number)
        self.read_rates(q, v, self.rates())

    def read_rates(self, q: Floats, v: Floats, rates: Floats) -> None:
        """Write velocities, or accelerations, in Rapier's coordinates into ``v`` (nv,), in the axes of the state ``q``."""
        places = self.places
        v[places.v] = rates[places.at] / places.units
        for _, free, at_q, at_v, at in places.turning:
            if free:
                v[at_v : at_v + 3] = rates[at : at + 3] / SCALE
            turn = conjugate(unit(q[at_q + 3 * free :][:4]))
            v[at_v + 3 * free :][:3] = rotate(turn, rates[at + 3 * free :][:3])

    def shorten(self) -> None:
        """Give the rotations of balls and free bodies quaternions of unit length, after each step.

        Rapier multiplies them by that of each step and never normalises them. Products with the cosine of a small angle are
        rounded to the same side in many steps: lengths, and with them all levers of what a ball or free body carries, would be
        3e-5 off after 400 steps (measured). Rapier's package has no call that sets them, and returns them normalised: their
        lengths are read from its serialised multibodies, and turns there and back correct them.
        """
        for _ in range(MOST_TURNS):
            off = self.lengths() - 1.0
            rows = np.flatnonzero(np.abs(off) > 0.5 * STEP_OF_LENGTH).tolist()
            if not rows:
                return
            away = np.zeros(self.places.size)
            for row in rows:
                _, free, *_, at = self.places.turning[row]
                away[at + 3 * free] = SHORTER if off[row] > 0.0 else LONGER
            for turn in (away, -away):
                for tree in {self.built.links[self.places.turning[row][0]].tree for row in rows}:
                    self.multibodies[tree].apply_displacements(self._part(turn, tree))

    def lengths(self) -> Floats:
        """The lengths of the quaternions of balls and free bodies, as Rapier stores them, each after the mark of its joint."""
        stored = self.world.multibody_joints.to_bytes()
        found = np.empty((len(self.places.turning), 4), dtype=np.float32)
        for row, (number, *_) in enumerate(self.places.turning):
            at = stored.index(mark_of(number).to_bytes(16, "little")) + AFTER_MARK
            found[row] = np.frombuffer(stored, dtype="<f4", count=4, offset=at)
        lengths: Floats = np.sqrt((found.astype(float) ** 2).sum(axis=1))
        return lengths

    def place(self, q: Floats, v: Floats) -> None:
        """Put the multibodies into a state (q, v)."""
        if not self.multibodies:
            return
        places, bodies = self.places, self.world.rigid_bodies
        for _ in range(SETTINGS_OF_A_STATE):
            positions, away = self.positions(), np.zeros(places.size)
            away[places.at] = places.units * q[places.q] - positions[places.at]
            for number, free, at_q, _, at in places.turning:
                if free:
                    away[at : at + 3] = SCALE * q[at_q : at_q + 3] - positions[at : at + 3]
                wanted = unit(q[at_q + 3 * free :][:4])
                away[at + 3 * free :][:3] = logarithm(multiply(wanted, conjugate(self._turn(number))))
            for tree, multibody in enumerate(self.multibodies):
                multibody.apply_displacements(self._part(away, tree))
        rates = np.zeros(places.size)
        rates[places.wheels] = self.wheel_speed
        rates[places.at] = places.units * v[places.v]
        for _, free, at_q, at_v, at in places.turning:
            if free:
                rates[at : at + 3] = SCALE * v[at_v : at_v + 3]
            turn = unit(q[at_q + 3 * free :][:4])
            rates[at + 3 * free :][:3] = rotate(turn, v[at_v + 3 * free :][:3])
        for tree, multibody in enumerate(self.multibodies):
            multibody.set_generalized_velocity(self._part(rates, tree))
            multibody.forward_kinematics(bodies, False)
            multibody.update_rigid_bodies(bodies, True)
        aside = self.built.rapier.Vec3(0.0, 0.0, 2.0 * SCALE)
        for body in self.bodies:  # their colliders follow a position that is set and differs from the last
            pose, body.translation = body.position, body.translation + aside
            body.position = pose

    def _part(self, values: Floats, tree: int) -> list[float]:
        part: list[float] = values[self.built.starts[tree] : self.built.starts[tree + 1]].tolist()
        return part

    # --- bodies -------------------------------------------------------------------------------------------------

    def poses(self) -> Floats:
        """x y z w x y z of the links' bodies (n, 7)."""
        return states_of(self.bodies)

    def velocities(self, poses: Floats, points: Floats | None = None) -> Floats:
        """Velocities (n, 6) of the links' frames, or of ``points`` (n, 3) on them, in world axes, from those of the joints at
        ``poses``. Rapier's own are of the beginning of its last step."""
        motion, at = self.places.relative(poses, self.rates()), poses[:, :3]
        carried = self.places.ancestors
        spins = carried @ motion[:, 3:]
        speeds = carried @ (motion[:, :3] - cross(motion[:, 3:], at))
        return np.concatenate([speeds + cross(spins, at if points is None else points), spins], axis=1)

    def at_centres(self, poses: Floats) -> Floats:
        """The same of the centres of mass."""
        return self.velocities(poses, poses[:, :3] + rotate(poses[:, 3:], self.centres()))

    def centres(self) -> Floats:
        """Centres of mass (n, 3) in the links' frames."""
        found = [body.mass_properties.local_com.to_tuple() for body in self.bodies]
        return np.array(found, dtype=float).reshape(-1, 3) / SCALE

    def refresh(self) -> None:
        """Give Rapier's bodies the velocities of their links, which the hook of restitution reads."""
        vector = self.built.rapier.Vec3
        rows = self.at_centres(self.poses())
        rows[:, :3] *= SCALE
        for body, row in zip(self.bodies, rows.tolist(), strict=True):
            body.linvel, body.angvel = vector(*row[:3]), vector(*row[3:])

    def mass_matrices(self, q: Floats, velocities: int) -> list[tuple[NDArray[Any], Floats]]:
        """For each multibody its places in v (``velocities``,) and its mass matrix, from Rapier's Jacobians at the present
        state ``q``, the masses of the links and the armature."""
        turns = matrices(self.poses()[:, 3:])
        found: list[tuple[NDArray[Any], Floats]] = []
        by_velocity = self.places.by_velocity(q, velocities)
        for tree, multibody in enumerate(self.multibodies):
            begin, end = self.built.starts[tree : tree + 2]
            mass = np.diag(np.array(multibody.armature(), dtype=float))
            for number, link in enumerate(self.built.links):
                if link.tree != tree:
                    continue
                body, turn = self.bodies[number], turns[number]
                jacobian = np.array(multibody.body_jacobian(self.built.numbers[number]), dtype=float)
                tensor = turn @ (SQUARE * inertia_of(body)) @ turn.T
                mass += (
                    body.mass_properties.mass * jacobian[:3].T @ jacobian[:3] + jacobian[3:].T @ tensor @ jacobian[3:]
                )
            local = by_velocity[begin:end]
            places = np.flatnonzero(local.any(axis=0))
            local = local[:, places]
            found.append((places, local.T @ mass @ local / SQUARE))
        return found

    def energy(self, gravity: Floats) -> tuple[float, float]:
        """Kinetic and potential energy (J) of the links under ``gravity`` (3,), m/s²."""
        poses = self.poses()
        velocities = self.at_centres(poses)
        masses = np.array([body.mass_properties.mass for body in self.bodies])
        weights = masses * np.array([body.gravity_scale for body in self.bodies])
        tensors = np.array([inertia_of(body) for body in self.bodies]).reshape(-1, 3, 3)
        spins = rotate(conjugate(poses[:, 3:]), velocities[:, 3:])
        moving = float(masses @ (velocities[:, :3] ** 2).sum(axis=1))
        turning = float(np.einsum("ni,nij,nj->", spins, tensors, spins))
        armature = np.array([value for multibody in self.multibodies for value in multibody.armature()])
        rotors = float(armature @ self.rates() ** 2) / SQUARE
        centres = poses[:, :3] + rotate(poses[:, 3:], self.centres())
        return 0.5 * (moving + turning + rotors), -float(weights @ (centres @ gravity))


class LinkWrenches:
    """The wrenches on the links' bodies by which Rapier has a generalised effort."""

    def __init__(self, built: Multibodies, v_places: Sequence[slice], centres: Floats):
        self._centres = centres
        self._parents = np.array([link.parent for link in built.links], dtype=np.intp)
        self._carried = self._parents != ANCHOR
        count = len(built.links)
        self._axes = np.zeros((count, 3))
        self._kinds = {kind: np.array([], dtype=np.intp) for kind in ("hinge", "slide", "ball", "free")}
        for kind in self._kinds:
            self._kinds[kind] = np.array(
                [number for number, link in enumerate(built.links) if link.kind == kind], dtype=np.intp
            )
        for number, link in enumerate(built.links):
            if isinstance(link.joint, AxisJoint):
                self._axes[number] = link.joint.axis
        starts = [v_places[link.placed.row].start for link in built.links]
        self._at = {kind: np.array([starts[n] for n in rows], dtype=np.intp) for kind, rows in self._kinds.items()}

    def of(self, effort: Floats, poses: Floats) -> tuple[Floats, Floats]:
        """Forces, and torques about the centres of mass (n, 3), in Rapier's units and world axes."""
        turns, count = poses[:, 3:], len(poses)
        forces, torques = np.zeros((2, count, 3))
        axes = rotate(turns, self._axes)
        hinges, slides, balls, free = (self._kinds[kind] for kind in ("hinge", "slide", "ball", "free"))
        torques[hinges] = axes[hinges] * effort[self._at["hinge"], None]
        forces[slides] = axes[slides] * effort[self._at["slide"], None]
        three = np.arange(3)
        of_balls, of_free = self._at["ball"][:, None] + three, self._at["free"][:, None] + three
        torques[balls] = rotate(turns[balls], effort[of_balls])
        forces[free] = effort[of_free]
        torques[free] = rotate(turns[free], effort[of_free + 3])
        back = self._carried.nonzero()[0]
        parents = self._parents[back]
        at = poses[:, :3] + rotate(turns, self._centres)
        given, turned = forces[back].copy(), torques[back].copy()
        arms = poses[back, :3] - at[parents]
        torques += cross(poses[:, :3] - at, forces)
        np.subtract.at(forces, parents, given)
        np.subtract.at(torques, parents, turned + cross(arms, given))
        return SCALE * forces, SQUARE * torques


class JointLosses:
    """Damping and springs of the links' joints, which simspec applies as explicit efforts. ``damped``: whether Rapier damps."""

    def __init__(
        self, built: Multibodies, q_places: Sequence[slice], v_places: Sequence[slice], nv: int, damped: bool = False
    ):
        self.damping, self.stiffness, self.rest = np.zeros((3, nv))
        self._balls: list[tuple[int, int]] = []
        scalar: list[tuple[int, int]] = []
        for link in built.links:
            row, joint = link.placed.row, link.joint
            at = v_places[row]
            if isinstance(joint, (AxisJoint, BallJoint)):
                self.damping[at], self.stiffness[at] = 0.0 if damped else joint.damping, joint.spring_stiffness
            if isinstance(joint, AxisJoint):
                self.rest[at] = joint.spring_rest
                scalar.append((q_places[row].start, at.start))
            elif isinstance(joint, BallJoint):
                self._balls.append((q_places[row].start, at.start))
        table = np.array(scalar, dtype=np.intp).reshape(-1, 2)
        self._q, self._v = table[:, 0], table[:, 1]
        self.act = bool(self.damping.any() or self.stiffness.any())
        """Whether any joint has any."""

    def _stretch(self, q: Floats) -> Floats:
        """q − rest of hinges and slides, log R of balls (nv,)."""
        found = np.zeros(len(self.damping))
        found[self._v] = q[self._q] - self.rest[self._v]
        for at_q, at_v in self._balls:
            found[at_v : at_v + 3] = logarithm(q[at_q : at_q + 4])
        return found

    def effort(self, q: Floats, v: Floats) -> Floats:
        """The effort (nv,) at a state."""
        return -self.damping * v - self.stiffness * self._stretch(q)

    def energy(self, q: Floats) -> float:
        """The energy (J) that the springs store."""
        return 0.5 * float(self.stiffness @ self._stretch(q) ** 2)
