"""The Pinocchio model of one or several trees, from which the oracle is built."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.dynamics.oracle_rows import ConstraintRows, whole
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world import frames
from simspec.world.actions import Fluid
from simspec.world.constraints import JointSums, Violation, impulse
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import layout_of, within
from simspec.world.rotations import logarithm, logarithm_of
from simspec.world.types import Body, Pose, World

# The force of a fluid on one body, for the oracle: the law of ``world/actions.py``, written a second time and face by face.


@dataclass(frozen=True)
class Resisted:
    """A body in a fluid: the Pinocchio joint that it moves with; in that joint's frame the centre of its box (3,) and the axes
    of the box (3, 3), as columns; its edges (m); the fluid."""

    joint: int
    centre: np.ndarray
    axes: np.ndarray
    edges: tuple[float, float, float]
    fluid: Fluid

    @functools.cached_property
    def _wind(self) -> np.ndarray:
        return np.array(self.fluid.velocity)

    @functools.cached_property
    def _faces(self) -> list[tuple[np.ndarray, float, float]]:
        """By axis: it, and the factors of the squares of velocity (N s²/m²) and of angular velocity (N m s²/rad²)."""
        faces = []
        for index, axis in enumerate(self.axes.T):
            length, width, height = self.edges[index], self.edges[index - 1], self.edges[index - 2]
            stirred = length * (width**4 + height**4) / 64.0
            faces.append((axis, 0.5 * self.fluid.density * width * height, self.fluid.density * stirred))
        return faces

    @functools.cached_property
    def viscous(self) -> tuple[float, float]:
        """The resistance to velocity (N s/m) and to angular velocity (N m s/rad) that grows linearly with it."""
        diameter = sum(self.edges) / 3.0
        return 3.0 * math.pi * diameter * self.fluid.viscosity, math.pi * diameter**3 * self.fluid.viscosity

    def wrench(self, twist: np.ndarray, orientation: np.ndarray) -> np.ndarray:
        """Force and torque (6,) at the joint's origin, for the joint's velocity (linear, angular), all in its own axes;
        ``orientation`` (3, 3): of these axes in the world."""
        spin = twist[3:]
        through = twist[:3] + _cross(spin, self.centre) - orientation.T @ self._wind
        linear, angular = self.viscous
        force, torque = -linear * through, -angular * spin
        for axis, pushed, stirred in self._faces:
            along, about = float(axis @ through), float(axis @ spin)
            force = force - pushed * abs(along) * along * axis
            torque = torque - stirred * abs(about) * about * axis
        return np.concatenate([force, torque + _cross(self.centre, force)])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b (3,), to the bit what numpy's gives, which takes ten times as long for two vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _depth_first(bodies: Sequence[Body]) -> list[Body]:
    """``bodies`` with each one's descendants right behind it.

    Pinocchio's crba takes a joint's subtree to be the columns that follow it: in another order entries of M stay zero in
    silence (measured).
    """
    children: dict[str | None, list[Body]] = {}
    for body in bodies:
        children.setdefault(body.joint.parent, []).append(body)
    ordered: list[Body] = []
    ahead = children.get(None, [])[::-1]
    while ahead:
        ordered.append(ahead.pop())
        ahead.extend(children.get(ordered[-1].name, ())[::-1])
    return ordered


class OracleTree:
    """The Pinocchio model of one or several trees; the same methods as :class:`Oracle`, for their own coordinates. The world's
    constraints have a part in ``step`` and ``settled`` alone, and only where ``constrained``: all else is of the trees as such.

    ``model`` and ``data`` are Pinocchio's (module ``pin``). ``q_index``, ``v_index``: where the world's coordinates stand among
    Pinocchio's; ``body_joint``, ``body_placement``: the joint that each body moves with, and its frame's placement there.
    """

    def __init__(self, world: World, constrained: bool = False):
        import pinocchio

        self.pin: Any = pinocchio
        self.world = world
        self.layout = layout_of(world)
        self.nq, self.nv = self.layout.nq, self.layout.nv
        self.timestep = world.physics.timestep
        self.model = pinocchio.Model()
        self.model.gravity.linear = np.array(world.physics.gravity)
        self._joint_of: dict[str, tuple[int, Any]] = {}  # body -> (joint it moves with, placement of its frame there)
        self._lifted: list[tuple[int, np.ndarray, np.ndarray]] = []
        """By which force weights differ from mass × gravity: the joint, the centre of mass in its frame, the force."""
        self._resisted: list[Resisted] = []
        """The bodies on which the fluid acts."""
        added = {body.name: self._add(body) for body in _depth_first(world.bodies)}
        joints = [added[body.name] for body in world.bodies]
        self.model.armature = np.zeros(self.model.nv)
        self._order_coordinates(joints)
        self.body_joint = [self._joint_of[body.name][0] for body in world.bodies]
        self.body_placement = [self._joint_of[body.name][1] for body in world.bodies]
        self.data = self.model.createData()
        self._read_efforts()
        self.violation = Violation(world.bodies, world.constraints) if constrained and world.constraints else None
        """The constraints that act in a step; None: there are none."""
        places = {body.joint.name: at for body, at in zip(world.bodies, self.layout.velocity, strict=True)}
        acting = world.constraints if self.violation is not None else ()
        self._rows = ConstraintRows(pinocchio, self.model, self.data, self.v_index, acting, places, self._joint_of)

    def _placement(self, pose: Pose) -> Any:
        return self.pin.SE3(np.array(frames.matrix(pose.quaternion)), np.array(pose.position))

    def _add(self, body: Body) -> int:
        """Add one body; returns the index of its own joint, 0 when it has none (fixed)."""
        pin, joint = self.pin, body.joint
        above, placement = (0, pin.SE3.Identity()) if joint.parent is None else self._joint_of[joint.parent]
        placement = placement * self._placement(joint.origin)
        centre = np.array(body.inertial.centre_of_mass)
        if joint.kind == "fixed":
            index, identity = above, placement
        elif joint.kind == "free":
            composite = pin.JointModelComposite(2)
            composite.addJoint(pin.JointModelTranslation())
            composite.addJoint(pin.JointModelSpherical())
            index = self.model.addJoint(0, composite, pin.SE3.Identity(), body.name)
            identity = pin.SE3(np.eye(3), -np.array(lumped_inertial(self.world, body).centre_of_mass))
        else:
            axis = np.array(joint.axis)
            kinds = {
                "hinge": lambda: pin.JointModelRevoluteUnaligned(axis),
                "slide": lambda: pin.JointModelPrismaticUnaligned(axis),
                "ball": pin.JointModelSpherical,
            }
            index = self.model.addJoint(above, kinds[joint.kind](), placement, body.name)
            identity = pin.SE3.Identity()
        if index and body.inertial.mass and body.gravity_scale != 1.0:
            weight = (body.gravity_scale - 1.0) * body.inertial.mass * np.array(self.world.physics.gravity)
            self._lifted.append((index, identity.act(centre), weight))
        if index and body.box is not None and self.world.physics.fluid is not None:
            values = np.array(lumped_inertial(self.world, body).centre_of_mass)
            turn = identity.rotation @ np.array(frames.matrix(body.box.quaternion))
            self._resisted.append(Resisted(index, identity.act(values), turn, body.box.edges, self.world.physics.fluid))
        xx, yy, zz, xy, xz, yz = body.inertial.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if index and body.inertial.mass:
            self.model.appendBodyToJoint(index, pin.Inertia(body.inertial.mass, centre, tensor), identity)
        self._joint_of[body.name] = (index, identity)
        return 0 if joint.kind == "fixed" else index

    def _order_coordinates(self, joints: list[int]) -> None:
        """Index arrays between the world's coordinates and Pinocchio's (other order of joints, quaternions x y z w)."""
        q_index, v_index = np.zeros(self.nq, dtype=int), np.zeros(self.nv, dtype=int)
        for body, index, q, v in zip(
            self.world.bodies, joints, self.layout.position, self.layout.velocity, strict=True
        ):
            if not index:
                continue
            q_start, v_start = self.model.idx_qs[index], self.model.idx_vs[index]
            order = np.arange(q.stop - q.start)
            if body.joint.kind in QUATERNION_JOINTS:
                order[-4:] = np.roll(order[-4:], 1)  # w x y z is found at x y z w's positions 3 0 1 2
            q_index[q] = q_start + order
            v_index[v] = v_start + np.arange(v.stop - v.start)
        self.q_index, self.v_index = q_index, v_index

    def _read_efforts(self) -> None:
        """Damping, armature and springs, by coordinate, and what acts along sums."""
        # a sum over several trees acts where all of them are, as in the oracle's parts
        self._along = JointSums(self.world.bodies, within(self.world, self.world.bodies).sums)
        self._sums_act = self._along.acts
        self._damping = np.zeros(self.nv)
        self._stiffness, self._rest = np.zeros(self.nv), np.zeros(self.nv)
        self._sprung: list[tuple[int, int]] = []  # (q, v) of hinges and slides with a spring
        self._sprung_balls: list[tuple[slice, slice, float]] = []
        armature = np.zeros(self.nv)
        for body, q, v in zip(self.world.bodies, self.layout.position, self.layout.velocity, strict=True):
            joint = body.joint
            self._damping[v] = joint.damping
            armature[v] = joint.armature
            if joint.kind == "free":
                turns = slice(v.start + 3, v.stop)
                self._damping[turns], armature[turns] = joint.angular_damping, joint.angular_armature
            if joint.spring_stiffness and joint.kind == "ball":
                self._sprung_balls.append((q, v, joint.spring_stiffness))
            elif joint.spring_stiffness:
                self._sprung.append((q.start, v.start))
                self._stiffness[v], self._rest[v] = joint.spring_stiffness, joint.spring_rest
        spread = np.zeros(self.model.nv)
        spread[self.v_index] = armature
        self.model.armature = spread
        self._upper = np.triu(np.ones((self.model.nv, self.model.nv), dtype=bool))
        """The entries of M that Pinocchio computes."""
        self._entries = np.ix_(self.v_index, self.v_index)
        self._hinge_q = np.array([q for q, _ in self._sprung], dtype=int)
        self._hinge_v = np.array([v for _, v in self._sprung], dtype=int)

    def spread(self, q: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        ours_q, ours_v = np.zeros(self.model.nq), np.zeros(self.model.nv)
        ours_q[self.q_index] = q
        if v is not None:
            ours_v[self.v_index] = v
        return ours_q, ours_v

    def _jacobian_of(self, joint: int, frame: Any) -> np.ndarray:
        """(6, nv) in Pinocchio's order, by the Jacobians computed last."""
        return whole(self.pin.getJointJacobian(self.model, self.data, joint, frame))

    def body_poses(self, q: np.ndarray) -> np.ndarray:
        """See :meth:`Oracle.body_poses`."""
        return self._poses(self.spread(q)[0], range(len(self.world.bodies)))

    def _poses(self, q: np.ndarray, bodies: Sequence[int]) -> np.ndarray:
        """The same of some bodies at Pinocchio's ``q``; zeros of the others."""
        self.pin.forwardKinematics(self.model, self.data, q)
        poses = np.zeros((len(self.world.bodies), 7))
        for body in bodies:
            pose = self.data.oMi[self.body_joint[body]] * self.body_placement[body]
            x, y, z, w = self.pin.Quaternion(pose.rotation).coeffs()
            poses[body, :3], poses[body, 3:] = pose.translation, (w, x, y, z)
        return poses

    def effort_of(self, q: np.ndarray, body: str, at: np.ndarray, force: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """See :meth:`Oracle.effort_of`."""
        values, effort = self.spread(q)[0], np.zeros(self.nv)
        index, placement = self._joint_of[body]
        if not index:
            return effort
        self.pin.forwardKinematics(self.model, self.data, values)
        # in the joint's own axes
        jacobian = whole(self.pin.computeJointJacobian(self.model, self.data, values, index))
        turn = self.data.oMi[index].rotation.T
        point = placement.act(at)
        wrench = np.concatenate([turn @ force, np.cross(point, turn @ force) + turn @ torque])
        effort[:] = (jacobian.T @ wrench)[self.v_index]
        return effort

    def body_velocities(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Velocities (bodies, 6): linear of the body frame's origin, then angular, both in world axes."""
        self.pin.forwardKinematics(self.model, self.data, *self.spread(q, v))
        velocities = np.zeros((len(self.world.bodies), 6))
        for row, joint, placement in zip(velocities, self.body_joint, self.body_placement, strict=True):
            if joint:
                local = placement.actInv(self.data.v[joint])
                turn = (self.data.oMi[joint] * placement).rotation
                row[:3], row[3:] = turn @ local.linear, turn @ local.angular
        return velocities

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M (nv, nv), armature included."""
        return self._mass(self.spread(q)[0])

    def _mass(self, q: np.ndarray) -> np.ndarray:
        """The same at Pinocchio's ``q``."""
        full = self.pin.crba(self.model, self.data, q)
        full = np.where(self._upper, full, full.T)
        matrix: np.ndarray = full[self._entries]
        return matrix

    def bias_force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h (nv,) in M v̇ + h = τ: Coriolis, centrifugal and gravity."""
        bias: np.ndarray = self.pin_bias(*self.spread(q, v))[self.v_index].copy()
        return bias

    def pin_bias(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The same in Pinocchio's order."""
        bias: np.ndarray = self.pin.nonLinearEffects(self.model, self.data, q, v)
        return bias - self.pin_lift(q) if self._lifted else bias

    def pin_inverse(self, q: np.ndarray, v: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """M v̇ + h in Pinocchio's order."""
        effort: np.ndarray = self.pin.rnea(self.model, self.data, q, v, acceleration)
        return effort - self.pin_lift(q) if self._lifted else effort

    def pin_gravity(self, q: np.ndarray) -> np.ndarray:
        """h at rest, in Pinocchio's order."""
        gravity: np.ndarray = self.pin.computeGeneralizedGravity(self.model, self.data, q)
        return gravity - self.pin_lift(q) if self._lifted else gravity

    def pin_lift(self, q: np.ndarray) -> np.ndarray:
        """The effort by which weights differ from mass × gravity, in Pinocchio's order."""
        pin, lift = self.pin, np.zeros(self.model.nv)
        if not self._lifted:
            return lift
        pin.computeJointJacobians(self.model, self.data, q)
        for joint, centre, force in self._lifted:
            jacobian = self._jacobian_of(joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = self.data.oMi[joint].rotation @ centre
            lift += (jacobian[:3] - pin.skew(arm) @ jacobian[3:]).T @ force
        return lift

    def joint_effort(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Damping and springs (nv,), explicit: −d v − k (q − rest), for a ball −k log R in the child's axes; with those along
        sums, and the forces of the fluid."""
        effort: np.ndarray = -self._damping * v
        if len(self._hinge_v):
            effort[self._hinge_v] -= self._stiffness[self._hinge_v] * (q[self._hinge_q] - self._rest[self._hinge_v])
        for at_q, at_v, stiffness in self._sprung_balls:
            effort[at_v] -= stiffness * np.array(logarithm_of(q[at_q].tolist()))
        if self._sums_act:
            effort += self._along.effort(q, v)
        if self._resisted:
            effort += self._resistance(q, v)
        return effort

    def _resistance(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The force of the fluid (nv,), body by body, by the Jacobians of their joints in these joints' own axes."""
        pin, (local_q, local_v) = self.pin, self.spread(q, v)
        total = np.zeros(self.model.nv)
        pin.computeJointJacobians(self.model, self.data, local_q)
        for body in self._resisted:
            jacobian = self._jacobian_of(body.joint, pin.ReferenceFrame.LOCAL)
            total += jacobian.T @ body.wrench(jacobian @ local_v, self.data.oMi[body.joint].rotation)
        resistance: np.ndarray = total[self.v_index]
        return resistance

    def viscous(self, q: np.ndarray) -> np.ndarray:
        """D (nv, nv) of the fluid's resistance −D v that is linear in velocity, at ``q``."""
        pin, total = self.pin, np.zeros((self.model.nv, self.model.nv))
        pin.computeJointJacobians(self.model, self.data, self.spread(q)[0])
        for body in self._resisted:
            jacobian = self._jacobian_of(body.joint, pin.ReferenceFrame.LOCAL)
            linear, angular = body.viscous
            through = jacobian[:3] - pin.skew(body.centre) @ jacobian[3:]
            total += linear * through.T @ through + angular * jacobian[3:].T @ jacobian[3:]
        damping: np.ndarray = total[np.ix_(self.v_index, self.v_index)]
        return damping

    def energy(self, q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
        """Kinetic energy (armature included) and potential energy (J): gravity zero at the origin, springs at rest.

        Bodies fixed to the world do not count.
        """
        # Pinocchio's own kinetic energy counts the armature of some kinds of joints and not of others (measured)
        kinetic = 0.5 * float(v @ self.mass_matrix(q) @ v)
        ours_q, _ = self.spread(q)
        potential = self.pin.computePotentialEnergy(self.model, self.data, ours_q)  # leaves data.oMi at q
        for lifted, centre, force in self._lifted:
            potential -= float(force @ self.data.oMi[lifted].act(centre))
        at_v = self._hinge_v
        stretch = q[self._hinge_q] - self._rest[at_v]
        potential += 0.5 * float(self._stiffness[at_v] @ (stretch * stretch))
        for at_q, _, stiffness in self._sprung_balls:
            turn = logarithm(q[at_q])
            potential += 0.5 * stiffness * float(turn @ turn)
        potential += self._along.energy(q)
        return float(kinetic), float(potential)

    def acceleration(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """v̇ (nv,) under an applied effort (nv,), with damping and springs."""
        return self._accelerated(q, v, effort, *self.spread(q, v))

    def _accelerated(
        self, q: np.ndarray, v: np.ndarray, effort: np.ndarray, ours_q: np.ndarray, ours_v: np.ndarray
    ) -> np.ndarray:
        """The same, with q and v in Pinocchio's order too."""
        tau = np.zeros(self.model.nv)
        tau[self.v_index] = effort + self.joint_effort(q, v)
        if self._lifted:
            tau += self.pin_lift(ours_q)
        acceleration: np.ndarray = self.pin.aba(self.model, self.data, ours_q, ours_v, tau)[self.v_index]
        return acceleration

    def advanced(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        steps: int,
        rounded: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The state (q, v) after ``steps`` steps under a constant effort. ``rounded``: a function of q and v after every step.

        Where nothing acts but gravity, damping and the springs of hinges and slides, it stays in Pinocchio's order from step to
        step, but for rounding, which may draw a number for each coordinate: the same bits in a third of the time.
        """
        if self.violation is not None or self._resisted or self._sprung_balls or self._sums_act:
            for _ in range(steps):
                q, v = self.step(q, v, effort)
                if rounded is not None:
                    q, v = rounded(q), rounded(v)
            return q, v
        pin, model, data, timestep = self.pin, self.model, self.data, self.timestep
        local_q, local_v = self.spread(q, v)
        constant, damping = np.zeros(model.nv), np.zeros(model.nv)
        constant[self.v_index], damping[self.v_index] = effort, self._damping
        at_q, at_v = self.q_index[self._hinge_q], self.v_index[self._hinge_v]
        stiffness, rest = self._stiffness[self._hinge_v], self._rest[self._hinge_v]
        resists = bool(damping.any()) or len(at_v) > 0
        for _ in range(steps):
            tau = constant
            if resists:
                tau = -damping * local_v
                tau[at_v] -= stiffness * (local_q[at_q] - rest)
                tau = constant + tau
            if self._lifted:
                tau = tau + self.pin_lift(local_q)
            local_v = local_v + timestep * pin.aba(model, data, local_q, local_v, tau)
            local_q = pin.integrate(model, local_q, timestep * local_v)
            if rounded is not None:
                local_q[self.q_index] = rounded(local_q[self.q_index])
                local_v[self.v_index] = rounded(local_v[self.v_index])
        return local_q[self.q_index], local_v[self.v_index]

    def step(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One step of semi-implicit Euler; returns the new (q, v)."""
        ours_q, ours_v = self.spread(q, v)
        v = v + self.timestep * self._accelerated(q, v, effort, ours_q, ours_v)
        if self.violation is not None:
            violation = self._violated(self.violation, q, ours_q)
            v = v + impulse(self._mass(ours_q), self._rows.at(ours_q), v, violation, self.timestep)
        ours_v[self.v_index] = v
        return self.pin.integrate(self.model, ours_q, self.timestep * ours_v)[self.q_index], v

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """J (rows, nv) of the constraints (``world/constraints.py``), by Pinocchio's Jacobians of joints."""
        return self._rows.at(self.spread(q)[0])

    def _violated(self, violation: Violation, q: np.ndarray, ours_q: np.ndarray) -> np.ndarray:
        """φ (rows,) at ``q``, here in Pinocchio's order too, from the poses of the bodies that have constraints."""
        poses = self._poses(ours_q, violation.ends) if violation.ends else np.zeros((0, 7))
        return violation.of(q, poses)

    def settled(self, q: np.ndarray) -> np.ndarray | None:
        """A position near ``q`` (nq,) at which the constraints hold, by Gauss and Newton; None where that leads nowhere."""
        if self.violation is None:
            return q
        for _ in range(SETTLING):
            violation = self._violated(self.violation, q, self.spread(q)[0])
            step = -np.linalg.pinv(self.jacobian(q), rcond=SETTLED_RANK) @ violation
            if not np.isfinite(step).all():
                return None
            ours_q, ours_v = self.spread(q, step)
            q = np.asarray(self.pin.integrate(self.model, ours_q, ours_v)[self.q_index])
            if np.abs(step).max(initial=0.0) < SETTLED:
                close = np.abs(self._violated(self.violation, q, self.spread(q)[0])).max(initial=0.0) < SETTLED
                return q if close else None
        return None

    def constrained_velocity(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The velocity (nv,) nearest to ``v`` with which the constraints go on to hold at ``q``."""
        if self.violation is None:
            return v
        jacobian = self.jacobian(q)
        kept: np.ndarray = v - np.linalg.pinv(jacobian, rcond=SETTLED_RANK) @ (jacobian @ v)
        return kept

    def moved(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """q ⊕ ``step`` (nv,)."""
        ours_q, ours_v = self.spread(q, step)
        moved: np.ndarray = self.pin.integrate(self.model, ours_q, ours_v)[self.q_index]
        return moved


SETTLING, SETTLED = 60, 1e-13
"""Iterations of ``settled``, and the violation (rad, m) at which it is done: at 1 ms it is taken back at 1e-10 per second."""
SETTLED_RANK = 1e-8
"""Of the largest singular value of J: rows below it depend on others."""
