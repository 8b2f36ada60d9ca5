"""The second oracle: Simbody (Sherman, Seth and Delp, 2011), through OpenSim's package of Python, built from the world itself.

It has nothing from ``simspec/dynamics``, and of the world its types, its order of coordinates, and which point of a free body
is integrated. Rotations are scipy's. Poses, velocities, M, bias forces, accelerations, energies, springs and dampers of
coordinates, and what forces on bodies do to joints are Simbody's (OpenSim's, where it is a spring). Written here are

- the change of coordinates (``simbody_model.py``);
- what Simbody does not have: armature (added to M, with which accelerations are solved for by numpy then), springs of balls,
  the energy of springs, weighted sums of joints, the law of the fluid, parts of weights;
- the step of semi-implicit Euler, and in it the impulses of constraints, with Simbody's M and J.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from simspec.world.actions import Force
from simspec.world.inertia import lumped_inertial
from simspec.world.types import ConnectConstraint, FollowConstraint, WeldConstraint
from tests.dynamics.simbody_model import Model, opensim, turned, vector


def _ends(violation: ConnectConstraint | WeldConstraint) -> tuple[np.ndarray, np.ndarray]:
    """The points of the first and of the second body that are held together, in their frames."""
    if isinstance(violation, WeldConstraint):
        return np.array(violation.pose.position), np.zeros(3)
    return np.array(violation.first_point), np.array(violation.second_point)


class Simbody(Model):
    """A world's bodies in Simbody. States are (q (nq,), v (nv,)) in simspec's coordinates and the world's order."""

    def body_poses(self, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Position (3,) and rotation (3, 3) of each body's frame in the world."""
        self.put(q)
        self.model.realizePosition(self.state)
        places = [body.getTransformInGround(self.state).p().to_numpy().copy() for body in self.bodies.values()]
        return list(zip(places, map(self._turn, self.bodies), strict=True))

    def _turn(self, name: str) -> np.ndarray:
        """The rotation (3, 3) of a body in the state that Simbody is in."""
        matrix = self.bodies[name].getTransformInGround(self.state).R()
        return np.array([[matrix.get(row, column) for column in range(3)] for row in range(3)])

    def body_velocities(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Velocities (bodies, 6): linear of the body frame's origin, then angular, both in world axes."""
        self.put(q, v)
        self.model.realizeVelocity(self.state)
        found = [body.getVelocityInGround(self.state) for body in self.bodies.values()]
        return np.array([[*entry.get(1).to_numpy(), *entry.get(0).to_numpy()] for entry in found]).reshape(-1, 6)

    # --- dynamics -------------------------------------------------------------------------------------------------

    @functools.cached_property
    def armature(self) -> np.ndarray:
        """(nv,)"""
        values = np.zeros(self.nv)
        for body, at in zip(self.world.bodies, self.layout.velocity, strict=True):
            values[at] = body.joint.armature
            if body.joint.kind == "free":
                values[at.start + 3 : at.stop] = body.joint.angular_armature
        return values

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M (nv, nv), armature included."""
        turn = self.put(q)
        self.model.realizePosition(self.state)
        matrix = opensim().Matrix(self.nv, self.nv, 0.0)
        self.matter.calcM(self.state, matrix)
        return turn.T @ matrix.to_numpy() @ turn + np.diag(self.armature)

    def _weights(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """By how much weights differ from mass × gravity: the place on the body, and the force."""
        return {
            body.name: (
                np.array(body.inertial.centre_of_mass),
                (body.gravity_scale - 1.0) * body.inertial.mass * self.gravity,
            )
            for body in self.world.bodies
            if body.gravity_scale != 1.0 and body.name not in self.at_rest
        }

    def _wrenches(self, given: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> Any:
        """Forces on bodies for Simbody, from (place on the body, force, torque) by name, both in world axes."""
        osim = opensim()
        count = 1 + max(self.mobilized.values())
        none = osim.SpatialVec()
        none.setToZero()  # new memory has any content
        wrenches = osim.VectorOfSpatialVec(count, none)
        for name, (place, force, torque) in given.items():
            vec = osim.SpatialVec()
            vec.set(0, vector(torque + np.cross(self._turn(name) @ place, force)))
            vec.set(1, vector(force))
            wrenches.set(self.mobilized[name], vec)
        return wrenches

    def _generalised(self, given: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
        """Jᵀ F (nv,) in Simbody's speeds of forces on bodies, at the state that it is in."""
        found = opensim().Vector(self.nv, 0.0)
        if given:
            self.matter.multiplyBySystemJacobianTranspose(self.state, self._wrenches(given), found)
        return found.to_numpy().copy()

    def effort_of(self, q: np.ndarray, force: Force) -> np.ndarray:
        """Jᵀ F (nv,) of a force on a body."""
        turn = self.put(q)
        self.model.realizePosition(self.state)
        at, along, torque = (np.array(vector) for vector in (force.at, force.force, force.torque))
        return turn.T @ self._generalised({force.body: (at, along, torque)})

    def _lifts(self) -> np.ndarray:
        """The forces of differing weights (nv,), in Simbody's speeds, at the state that it is in."""
        return self._generalised({name: (at, force, np.zeros(3)) for name, (at, force) in self._weights().items()})

    def bias_force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h (nv,) in M v̇ + h = τ: Coriolis, centrifugal and gravity; no damping, no springs."""
        osim, turn = opensim(), self.put(q, v)
        self.model.realizeDynamics(self.state)
        residual, zero = osim.Vector(self.nv, 0.0), osim.Vector(self.nv, 0.0)
        # springs and dampers act on mobilities, which are left out here; on bodies only gravity does
        self.matter.calcResidualForceIgnoringConstraints(
            self.state, zero, self.model.getGravityBodyForces(self.state), zero, residual
        )
        return turn.T @ (residual.to_numpy() - self._lifts())

    def acceleration(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """v̇ (nv,) under an applied effort (nv,), with damping, springs and the fluid, without constraints.

        By Simbody's own O(n) forward dynamics, except with armature: M v̇ = τ − h is solved then.
        """
        osim, turn = opensim(), self.put(q, v)
        self.model.realizeDynamics(self.state)
        state = self.state
        local = self.model.getMobilityForces(state).to_numpy() + turn @ (effort + self._more(q, v))
        local = local + self._generalised(self._fluid())
        if self.armature.any():
            return np.linalg.solve(self.mass_matrix(q), turn.T @ local - self.bias_force(q, v))
        local = local + self._lifts()
        found, accelerations = osim.Vector(self.nv, 0.0), osim.VectorOfSpatialVec()
        self.matter.calcAccelerationIgnoringConstraints(
            state, osim.Vector.createFromMat(local), self.model.getRigidBodyForces(state), found, accelerations
        )
        return turn.T @ found.to_numpy()

    def _more(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Springs of balls, and what acts along sums of positions (nv,)."""
        effort = np.zeros(self.nv)
        places = {}
        for body, in_q, in_v in zip(self.world.bodies, self.layout.position, self.layout.velocity, strict=True):
            places[body.joint.name] = (in_q.start, in_v.start)
            if body.joint.kind == "ball" and body.joint.spring_stiffness:
                effort[in_v] -= body.joint.spring_stiffness * turned(q[in_q]).as_rotvec()
        for sum_ in self.world.sums:
            length = sum(share * q[places[joint][0]] for joint, share in sum_.joints)
            rate = sum(share * v[places[joint][1]] for joint, share in sum_.joints)
            for joint, share in sum_.joints:
                effort[places[joint][1]] -= share * (sum_.stiffness * (length - sum_.rest) + sum_.damping * rate)
        return effort

    def _fluid(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """The forces of the fluid on each body at the state of Simbody (``world/actions.py``)."""
        fluid, found = self.world.physics.fluid, {}
        if fluid is None:
            return found
        for body in self.world.bodies:
            if body.box is None or body.name in self.at_rest:
                continue
            edges, centre = np.array(body.box.edges), np.array(lumped_inertial(self.world, body).centre_of_mass)
            turn = self._turn(body.name)
            axes = turn @ turned(body.box.quaternion).as_matrix()
            velocity = self.bodies[body.name].getVelocityInGround(self.state)
            spin = velocity.get(0).to_numpy()
            through = velocity.get(1).to_numpy() + np.cross(spin, turn @ centre) - np.array(fluid.velocity)
            along, about = axes.T @ through, axes.T @ spin
            mean = edges.mean()
            faces = np.prod(edges) / edges
            fourth = edges**4
            force = (
                -3.0 * math.pi * mean * fluid.viscosity * along - 0.5 * fluid.density * faces * np.abs(along) * along
            )
            torque = -math.pi * mean**3 * fluid.viscosity * about
            torque -= fluid.density * edges * (fourth.sum() - fourth) / 64.0 * np.abs(about) * about
            found[body.name] = (centre, axes @ force, axes @ torque)
        return found

    def energy(self, q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
        """Kinetic energy (armature included) and potential energy (J): gravity zero at the origin, springs at rest."""
        self.put(q, v)
        self.model.realizeDynamics(self.state)
        kinetic = self.model.calcKineticEnergy(self.state) + 0.5 * float(self.armature @ (v * v))
        potential = self.model.calcPotentialEnergy(self.state)
        poses = dict(zip(self.bodies, self.body_poses(q), strict=True))
        for name, (at, force) in self._weights().items():
            place, turn = poses[name]
            potential -= float(force @ (place + turn @ at))
        lengths = {}
        for body, in_q in zip(self.world.bodies, self.layout.position, strict=True):
            lengths[body.joint.name] = in_q.start
            if body.joint.kind == "ball":
                potential += 0.5 * body.joint.spring_stiffness * float(turned(q[in_q]).magnitude()) ** 2
            elif body.joint.spring_stiffness:
                potential += 0.5 * body.joint.spring_stiffness * float(q[in_q.start] - body.joint.spring_rest) ** 2
        for sum_ in self.world.sums:
            length = sum(share * q[lengths[joint]] for joint, share in sum_.joints)
            potential += 0.5 * sum_.stiffness * (length - sum_.rest) ** 2
        return kinetic, potential

    # --- constraints ----------------------------------------------------------------------------------------------

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """J (rows, nv) of the constraints as ``world/constraints.py`` has them: of points and turns by the efforts of unit
        forces and torques (J is the transpose of what turns them into efforts)."""
        turn = self.put(q)
        self.model.realizePosition(self.state)
        at = {body.joint.name: slot for body, slot in zip(self.world.bodies, self.layout.velocity, strict=True)}
        rows: list[np.ndarray] = []
        for constraint in self.world.constraints:
            if isinstance(constraint, FollowConstraint):
                row = np.zeros(self.nv)
                row[at[constraint.joint]] += 1.0
                row[at[constraint.leader]] -= constraint.ratio
                rows.append(row)
                continue
            first, second = _ends(constraint)
            for unit in np.eye(6)[: 6 if isinstance(constraint, WeldConstraint) else 3]:
                values, other = (
                    self._generalised({name: (place, unit[:3], unit[3:])})
                    for name, place in ((constraint.first, first), (constraint.second, second))
                )
                rows.append(turn.T @ (values - other))
        return np.array(rows).reshape(-1, self.nv)

    def violation(self, q: np.ndarray) -> np.ndarray:
        """φ (rows,) of the constraints."""
        poses = dict(zip(self.bodies, self.body_poses(q), strict=True))
        at = {body.joint.name: slot for body, slot in zip(self.world.bodies, self.layout.position, strict=True)}
        found: list[float] = []
        for constraint in self.world.constraints:
            if isinstance(constraint, FollowConstraint):
                found.extend(q[at[constraint.joint]] - constraint.ratio * q[at[constraint.leader]] - constraint.offset)
                continue
            (values, turn), (other, array) = poses[constraint.first], poses[constraint.second]
            first, second = _ends(constraint)
            found.extend(values + turn @ first - other - array @ second)
            if isinstance(constraint, WeldConstraint):
                wanted = turn @ turned(constraint.pose.quaternion).as_matrix()
                found.extend(Rotation.from_matrix(wanted @ array.T).as_rotvec())
        return np.array(found)

    def _constraint_of(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The velocity (nv,) after the impulses of the constraints: J v⁺ = −φ/dt."""
        jacobian = self.jacobian(q)
        across = np.linalg.solve(self.mass_matrix(q), jacobian.T)
        wanted = jacobian @ v + self.violation(q) / self.world.physics.timestep
        impulse, *_ = np.linalg.lstsq(jacobian @ across, wanted, rcond=1e-10)  # rows may say the same
        return v - across @ impulse

    def motion(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """The state after ``steps`` steps of semi-implicit Euler under a constant effort."""
        q, v, dt = q.copy(), v.copy(), self.world.physics.timestep
        for _ in range(steps):
            v += dt * self.acceleration(q, v, effort)
            if self.world.constraints:
                v = self._constraint_of(q, v)
            for body, in_q, in_v in zip(self.world.bodies, self.layout.position, self.layout.velocity, strict=True):
                kind = body.joint.kind
                if kind in ("hinge", "slide"):
                    q[in_q] += dt * v[in_v]
                elif kind != "fixed":
                    x, y, z, w = (turned(q[in_q][-4:]) * Rotation.from_rotvec(dt * v[in_v][-3:])).as_quat()
                    q[in_q.stop - 4 : in_q.stop] = w, x, y, z
                    if kind == "free":
                        q[in_q.start : in_q.start + 3] += dt * v[in_v.start : in_v.start + 3]
        return q, v
