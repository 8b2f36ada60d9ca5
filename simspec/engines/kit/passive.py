"""Forces that act on bodies at all times and that an engine does not have: it is given them as an effort before every step.

A weight that is not mass × gravity differs from it by the force (s − 1) m g at the centre of mass, s ``gravity_scale``; damping
of a free body is −d v, −d ω of its own coordinates; what a fluid does says ``world/actions.py``. All follow from the engine's
own masses, poses and velocities before the step, and act in it as a constant effort, as its own gravity and explicit damping
would: exact, also in contact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simspec.dialects.kit.passive import Around, Passive, fluid_of, with_passive
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.outside import Outside
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import via_api
from simspec.world.actions import JointSum
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import layout_of
from simspec.world.passive_forces import Drag
from simspec.world.rotations import matrices
from simspec.world.types import Constraint, ReadBack, World

GIVEN_GRAVITY_SCALE = via_api("the difference as a force at the centre of mass before every step")
GIVEN_DAMPING = via_api("as an effort before every step, from the engine's own velocities")
GIVEN_FLUID = via_api("its forces on each body as an effort before every step, from the engine's own velocities")

Array = NDArray[np.float64]


class GivenForces:
    """What is given to a loaded engine before each of its steps, of what its sidecar says; and by which ``bias_force`` and
    ``energy`` differ from the engine's own."""

    def __init__(self, engine: Engine, passive: Passive):
        held = engine.read_back()
        world = World("", held.bodies)
        layout = layout_of(world)
        self._engine, self._nv = engine, layout.nv
        self._bodies, self._places = world.bodies, layout.velocity
        rows = {body.name: row for row, body in enumerate(world.bodies)}
        self._parents = [-1 if body.joint.parent is None else rows[body.joint.parent] for body in world.bodies]
        gravity = np.array(held.gravity)
        self._lifted = [
            (row, (entry.scale - 1.0) * body.inertial.mass * gravity, np.array(body.inertial.centre_of_mass))
            for entry in passive.gravity_scales
            for row in (rows[entry.body],)
            for body in (world.bodies[row],)
        ]
        self._damping = np.zeros(layout.nv)
        for damped in passive.free_damping:
            at = self._places[rows[damped.body]].start
            self._damping[at : at + 3], self._damping[at + 3 : at + 6] = damped.linear, damped.angular
        self._centres = [
            np.array(lumped_inertial(world, body).centre_of_mass if body.joint.kind == "free" else (0.0, 0.0, 0.0))
            for body in world.bodies
        ]
        self._axes = [np.array(body.joint.axis) for body in world.bodies]
        self._drag = None if passive.around is None else _Drag(world, passive.around)

    def weight(self) -> Array:
        """The effort (nv,) by which weights differ from mass × gravity, at the present state."""
        if not self._lifted:
            return np.zeros(self._nv)
        poses, _ = self._engine.body_states()
        turns = matrices(poses[:, 3:])
        forces, moments = np.zeros((2, len(poses), 3))  # of each body and all that it carries, about the world's origin
        for row, force, centre in self._lifted:
            forces[row] += force
            moments[row] += np.cross(poses[row, :3] + turns[row] @ centre, force)
        return self._efforts(poses[:, :3], turns, forces, moments)

    def _efforts(self, at: Array, turns: Array, forces: Array, moments: Array) -> Array:
        effort = np.zeros(self._nv)
        for row in range(len(at) - 1, -1, -1):
            kind, place, force = self._bodies[row].joint.kind, self._places[row], forces[row]
            about = moments[row] - np.cross(at[row] + turns[row] @ self._centres[row], force)
            if kind in SCALAR_JOINTS:
                effort[place] = turns[row] @ self._axes[row] @ (force if kind == "slide" else about)
            elif kind == "ball":
                effort[place] = about @ turns[row]
            elif kind == "free":
                effort[place] = np.concatenate([force, about @ turns[row]])
            if self._parents[row] >= 0:
                forces[self._parents[row]] += force
                moments[self._parents[row]] += moments[row]
        return effort

    def loss(self) -> Array:
        """The effort (nv,) of what takes energy, at the present state."""
        effort = np.zeros(self._nv)
        if self._damping.any():
            effort -= self._damping * self._engine.get_state()[1]
        if self._drag is not None:
            poses, velocities = self._engine.body_states()
            turns = matrices(poses[:, 3:])
            effort += self._efforts(poses[:, :3], turns, *self._drag.wrenches(poses[:, :3], turns, velocities))
        return effort

    def potential(self) -> float:
        """Energy (J) of the differences of weights, zero at the world's origin."""
        if not self._lifted:
            return 0.0
        poses, _ = self._engine.body_states()
        turns = matrices(poses[:, 3:])
        return -sum(float(force @ (poses[row, :3] + turns[row] @ centre)) for row, force, centre in self._lifted)


class _Drag:
    """What a fluid does to bodies that move in it, all at once. Rows of boxes have the bodies of ``rows``."""

    def __init__(self, world: World, around: Around):
        at = {body.name: row for row, body in enumerate(world.bodies)}
        self._rows = np.array([at[entry.body] for entry in around.boxes], dtype=np.intp)
        told = (lumped_inertial(world, world.bodies[row]) for row in self._rows)
        self._centres = np.array([inertial.centre_of_mass for inertial in told])
        self._turns = matrices(np.array([entry.box.quaternion for entry in around.boxes]))
        self._flow = np.array(around.fluid.velocity)
        self._drag = Drag([entry.box.edges for entry in around.boxes], around.fluid)

    def wrenches(self, at: Array, turns: Array, velocities: Array) -> tuple[Array, Array]:
        """Forces, and moments about the world's origin, on all bodies (n, 3), for the places, orientations and velocities of
        their frames in world axes."""
        rows = self._rows
        arms = np.einsum("nij,nj->ni", turns[rows], self._centres)
        axes = turns[rows] @ self._turns
        spin = velocities[rows, 3:]
        flow = velocities[rows, :3] + np.cross(spin, arms) - self._flow
        pushes = [
            np.einsum("nij,nj->ni", axes, push)
            for push in self._drag.of(*(np.einsum("nji,nj->ni", axes, moving) for moving in (flow, spin)))
        ]
        forces, moments = np.zeros((2, len(at), 3))
        forces[rows] = pushes[0]
        moments[rows] = pushes[1] + np.cross(at[rows] + arms, pushes[0])
        return forces, moments


class BeforeSteps:
    """What simspec computes for an engine before each of its steps: constraints, and forces that act at all times."""

    def __init__(
        self,
        engine: Engine,
        passive: Passive | None,
        constraints: Sequence[Constraint] = (),
        sums: Sequence[JointSum] = (),
    ):
        self._engine, self.passive = engine, passive
        self.given = None if passive is None else GivenForces(engine, passive)
        self.held = Outside(engine, constraints, sums) if constraints or sums else None

    @property
    def needed(self) -> bool:
        """Whether there is anything to compute."""
        return self.given is not None or self.held is not None

    def effort(self, effort: Array | None) -> Array:
        """The effort (nv,) to apply for one step, for one that the caller gives (None: zero)."""
        given = self.given
        total = np.zeros(len(self._engine.get_state()[1])) if effort is None else np.asarray(effort, dtype=float)
        if given is not None:
            total = total + given.loss()
        if self.held is not None:
            total = self.held.effort(total)
        # the bias force that constraints are computed from has the weights as they are: the difference comes after them
        return total if given is None else total + given.weight()

    def bias_force(self, own: Array) -> Array:
        """h (nv,) in M v̇ + h = τ, from the engine's ``own``."""
        return own if self.given is None else own - self.given.weight()

    def potential(self) -> float:
        """What the potential energy (J) differs by from the engine's own."""
        differs = 0.0 if self.given is None else self.given.potential()
        return differs if self.held is None else differs + self.held.energy()

    def told(self, held: ReadBack) -> ReadBack:
        """A read-back of what the engine itself holds, completed by what it is given."""
        held = dataclasses.replace(held, bodies=with_passive(held.bodies, self.passive), fluid=fluid_of(self.passive))
        return held if self.held is None else self.held.told(held)
