"""The state of PhysX's articulations in simspec's coordinates (``world/kinematics.py``), and how balls and free roots turn.

Three hinges stand for a ball (``links.py``). Their angles are zero whenever a step begins: the ball's rotation R is in the
frame of the last hinge, in double precision on simspec's side, and has no singular place. The rates u of the hinges are then
the angular velocity in the axes of the parent's joint frame, and ω̇ = u̇ + c with c = (u₂u₃, −u₁u₃, u₁u₂). After a step ω is
u + dt c, and R becomes exp(dt ω) R. An articulation on which a contact acted in the last step receives dt c before the next
step instead, since a change after the step would undo a part of the contact's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import demand_singles
from simspec.engines.physx.building import PhysxBuild
from simspec.engines.physx.links import PhysxLinks, to_x
from simspec.engines.physx.units import NAME, SCALE, unit_of
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world.rotations import conjugate, exponential, matrices, multiply, rotate, unit

AXIS_OF_LAST = np.array(to_x((0.0, 0.0, 1.0)))
"""The turn of the last hinge's frame."""


class PhysxTree:
    """An articulation. ``q`` (n,): the place in q of each of its coordinates, −1 of the hinges of balls; ``v`` (n,): that in v;
    ``length`` (n,): PhysX's unit of each coordinate; ``inertia`` (n,): that of an inertia; ``balls``: numbers of its balls."""

    def __init__(self, articulation: Any, links: PhysxLinks, q_places: Sequence[slice], v_places: Sequence[slice]):
        self.articulation, self.joints = articulation, list(articulation.active_joints)
        coordinates = [links.coordinates[joint] for joint in self.joints]
        if len(coordinates) != articulation.dof:
            raise EngineError(NAME, f"has {articulation.dof} coordinates in an articulation, not {len(coordinates)}")
        document = links.built.walk.document.bodies
        self.rows = [coordinate.row for coordinate in coordinates]
        self.v = np.array([v_places[row].start + place for row, place, _ in coordinates], dtype=np.intp)
        self.length = np.array([SCALE if slides else 1.0 for _, _, slides in coordinates])
        self.inertia = np.array([1.0 if slides else SCALE * SCALE for _, _, slides in coordinates])
        self.q = np.array(
            [
                q_places[row].start + place if slides or isinstance(document[row].joint, AxisJoint) else -1
                for row, place, slides in coordinates
            ],
            dtype=np.intp,
        )
        self.straight = np.flatnonzero(self.q >= 0)
        self.armature = np.array([float(joint.armature[0]) for joint in self.joints]) / self.inertia
        self.balls: np.ndarray = np.zeros(0, dtype=np.intp)
        self.places = np.sort(self.v)
        self.links = articulation.links[1:]
        self._axes = [matrices(unit_of(link.cmass_local_pose.q)) for link in self.links]
        # mass three times, then the principal moments
        self.masses = np.array([[link.mass] * 3 + [*link.inertia / SCALE**2] for link in self.links], dtype=float)

    def read(self, q: np.ndarray, v: np.ndarray) -> None:
        """Write its coordinates into q (nq,) and v (nv,); of balls the rates of their hinges."""
        places = self.straight
        q[self.q[places]] = np.array(self.articulation.qpos, dtype=float)[places] / self.length[places]
        v[self.v] = self.rates()

    def link_velocities(self) -> np.ndarray:
        """Of each link but the first the velocity of its centre of mass in world axes, and its angular velocity in its
        principal axes (links, 6)."""
        rows = np.zeros((len(self.links), 6))
        for row, link, axes in zip(rows, self.links, self._axes, strict=True):
            turn = matrices(unit_of(link.entity_pose.q)) @ axes
            row[:3] = np.array(link.linear_velocity, dtype=float) / SCALE
            row[3:] = np.array(link.angular_velocity, dtype=float) @ turn
        return rows

    def rates(self) -> np.ndarray:
        """Its velocities (n,); of balls the rates of their hinges."""
        found: np.ndarray = np.array(self.articulation.qvel, dtype=float) / self.length
        return found

    def write(self, q: np.ndarray, v: np.ndarray) -> None:
        """Set its coordinates, for rates of hinges."""
        position = np.zeros(len(self.q))
        position[self.straight] = q[self.q[self.straight]]
        self.articulation.set_qpos((position * self.length).astype(np.float32))
        self.articulation.set_qvel((v[self.v] * self.length).astype(np.float32))


class PhysxTrees:
    """All articulations of a build."""

    def __init__(self, built: PhysxBuild, q_places: Sequence[slice], v_places: Sequence[slice], timestep: float):
        self._timestep = timestep
        self.trees = [PhysxTree(found, built.links, q_places, v_places) for found in built.links.articulations]
        turning: list[tuple[Any, int, int]] = []
        roots: list[int] = []
        for tree, rows in zip(self.trees, built.homes.trees, strict=True):
            numbers = []
            for row in rows:
                if built.walk.bodies[row].body.joint.kind == "free":
                    roots.append(q_places[row].start)
                if built.walk.bodies[row].body.joint.kind in QUATERNION_JOINTS:
                    numbers.append(len(turning))
                    turning.append((built.links.joints[row][-1], q_places[row].stop - 4, v_places[row].stop - 3))
            tree.balls = np.array(numbers, dtype=np.intp)
        self._roots = np.array(roots, dtype=np.intp).reshape(-1, 1) + np.arange(3)
        """Where the positions of free roots are in q."""
        self._hinges = [joint for joint, _, _ in turning]
        self._ball_q = np.array([at for _, at, _ in turning], dtype=np.intp).reshape(-1, 1) + np.arange(4)
        self._ball_v = np.array([at for _, _, at in turning], dtype=np.intp).reshape(-1, 1) + np.arange(3)
        self._pose = built.sapien.Pose
        self.turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(turning), 1))
        self._nq, self._nv = (places[-1].stop if places else 0 for places in (q_places, v_places))
        self._written = np.zeros(self._nv)
        """The rates that were last set from outside, in single precision."""
        self._rates = np.zeros((len(turning), 3))
        """Of the hinges of balls where a step begins."""
        self._ahead = np.zeros(len(turning), dtype=bool)
        """Balls whose rates have been given dt c."""

    def read(self, q: np.ndarray, v: np.ndarray) -> None:
        """Write the coordinates of all articulations into q (nq,) and v (nv,)."""
        for tree in self.trees:
            tree.read(q, v)
        if len(self.turns):
            q[self._ball_q] = self.turns
            v[self._ball_v] = rotate(conjugate(self.turns), v[self._ball_v])

    def write(self, q: np.ndarray, v: np.ndarray) -> None:
        """Set the coordinates of all articulations."""
        v = np.array(v, dtype=float)
        if len(self.turns):
            self.turns = unit(q[self._ball_q])
            v[self._ball_v] = rotate(self.turns, v[self._ball_v])
            self._rates = v[self._ball_v]
        self._place(q, v, self.trees)
        for tree in self.trees:
            self._written[tree.v] = tree.rates()

    def _place(self, q: np.ndarray, v: np.ndarray, trees: Sequence[PhysxTree]) -> None:
        frames = multiply(conjugate(self.turns), np.tile(AXIS_OF_LAST, (len(self.turns), 1)))
        for tree in trees:
            for number in tree.balls.tolist():
                self._hinges[number].set_pose_in_child(self._pose([0.0, 0.0, 0.0], frames[number].tolist()))
            tree.write(q, v)

    def give(self, effort: np.ndarray) -> None:
        """Apply an effort (nv,) from now on."""
        demand_singles(NAME, SCALE * SCALE * effort, "effort")
        if len(self.turns):
            effort = effort.copy()
            effort[self._ball_v] = rotate(self.turns, effort[self._ball_v])
        for tree in self.trees:
            tree.articulation.set_qf((effort[tree.v] * tree.inertia * tree.length).astype(np.float32))

    def begin(self, touched: np.ndarray) -> None:
        """Give the balls of articulations that are ``touched`` (trees,) dt c, before a step."""
        self._ahead[:] = False
        for tree, by_contact in zip(self.trees, touched.tolist(), strict=True):
            if by_contact and len(tree.balls):
                self._ahead[tree.balls] = True
                rates = np.zeros(self._nv)
                rates[tree.v] = tree.rates()
                rates[self._ball_v[tree.balls]] += self._timestep * quadratic(self._rates[tree.balls])
                tree.articulation.set_qvel((rates[tree.v] * tree.length).astype(np.float32))

    def settle(self) -> None:
        """Turn balls and free roots by the law of motion, after a step."""
        if not len(self.turns):
            return
        turning = [tree for tree in self.trees if len(tree.balls)]
        q, v = np.zeros(self._nq), np.zeros(self._nv)
        for tree in turning:
            tree.read(q, v)
        change = np.where(self._ahead[:, None], 0.0, self._timestep * quadratic(self._rates))
        self._rates = v[self._ball_v] + change
        v[self._ball_v] = self._rates
        self.turns = unit(multiply(exponential(self._timestep * self._rates), self.turns))
        self._place(q, v, turning)

    def accelerations(self, timestep: float) -> np.ndarray:
        """Those (nv,) of a step of ``timestep`` that has just been made from :meth:`write`, in simspec's coordinates."""
        found = np.zeros(self._nv)
        for tree in self.trees:
            found[tree.v] = (tree.rates() - self._written[tree.v]) / timestep
        if len(self.turns):
            found[self._ball_v] += quadratic(self._rates)
            found[self._ball_v] = rotate(conjugate(self.turns), found[self._ball_v])
        return found

    def mass_parts(self, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix of each articulation at q (nq,), with its places in v: that of PhysX's kinetic energy, from the
        masses and inertias of its links, their velocities with a unit of each coordinate, and the armatures."""
        q = q.copy()
        q[self._roots] = 0.0  # M does not depend on it, and lever arms of PhysX are differences of places in the world
        speeds = [np.zeros((len(tree.v), len(tree.links), 6)) for tree in self.trees]
        for column in range(max((len(tree.v) for tree in self.trees), default=0)):
            v = np.zeros(self._nv)
            v[[tree.places[column] for tree in self.trees if column < len(tree.places)]] = 1.0
            self.write(q, v)
            for tree, found in zip(self.trees, speeds, strict=True):
                if column < len(tree.places):
                    found[column] = tree.link_velocities()
        parts = []
        for tree, found in zip(self.trees, speeds, strict=True):
            mass = np.einsum("ali,li,bli->ab", found, tree.masses, found)
            order = np.searchsorted(tree.places, tree.v)
            mass[order, order] += tree.armature
            parts.append((tree.places, mass))
        return parts

    def bias(self, found: np.ndarray, parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
        """Write the bias force of the present state into h (nv,). ``parts``: the mass matrices of the articulations, where
        balls turn: that of a ball is h − M c of its hinges."""
        for tree in self.trees:
            force = np.array(tree.articulation.compute_passive_force(True, True), dtype=float)
            found[tree.v] = force / (tree.inertia * tree.length)
        if not len(self.turns):
            return
        change = np.zeros(self._nv)
        change[self._ball_v] = rotate(conjugate(self.turns), quadratic(self._rates))
        found[self._ball_v] = rotate(conjugate(self.turns), found[self._ball_v])
        for places, mass in parts:
            found[places] -= mass @ change[places]


def quadratic(rates: np.ndarray) -> np.ndarray:
    """c (n, 3) of rates (n, 3): ω̇ − u̇ of three hinges about x, y and z at zero."""
    first, second, third = rates.T
    found: np.ndarray = np.stack([second * third, -first * third, first * second], axis=1)
    return found
