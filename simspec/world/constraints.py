"""How far constraints outside the tree are from holding, and how that changes as the bodies move; and passive forces.

φ (rows,) and its Jacobian J (rows, nv), φ̇ = J v, in simspec's generalised coordinates (``world/kinematics.py``):

follow    φ = q of the joint − ratio × q of its leader − offset
connect   φ = the first body's point − the second's, in world axes
weld      the same for the origin of the second body's frame, then the rotation vector, in world axes, from where the second
          body is to where the first holds it
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.world import frames
from simspec.world.actions import Fluid, JointSum
from simspec.world.frames import quaternion
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import constrained_trees, layout, layout_of, poses, rigid_groups, within
from simspec.world.rotations import conjugate, logarithm_of, matrices, multiply
from simspec.world.types import (
    VELOCITY_SIZE,
    Body,
    Constraint,
    FollowConstraint,
    Inertial,
    Joint,
    Pose,
    Vector3,
    WeldConstraint,
    World,
)

Array = NDArray[np.float64]
ROWS = {"follow": 1, "connect": 3, "weld": 6}
"""Rows of each kind of constraint."""


class Violation:
    """φ and J of some constraints of some bodies, parents before children."""

    def __init__(self, bodies: Sequence[Body], constraints: Sequence[Constraint]):
        self.constraints = tuple(constraints)
        places = layout(bodies)
        self.nv = places.nv
        self.count = sum(ROWS[constraint.kind] for constraint in self.constraints)
        row = {body.name: index for index, body in enumerate(bodies)}
        joint = {body.joint.name: index for index, body in enumerate(bodies)}
        self._identity = len(bodies)
        self._linear = np.zeros((self.count, self.nv))
        follows: list[tuple[int, int, int, float, float]] = []
        ends: list[tuple[int, Vector3, int]] = []
        self._welds: list[tuple[int, int, int, Array]] = []
        start = 0
        for constraint in self.constraints:
            if isinstance(constraint, FollowConstraint):
                follower, lead = joint[constraint.joint], joint[constraint.leader]
                self._linear[start, places.velocity[follower]] += 1.0
                self._linear[start, places.velocity[lead]] -= constraint.ratio
                at = (places.position[follower].start, places.position[lead].start)
                follows.append((start, *at, constraint.ratio, constraint.offset))
            else:
                first, second = row[constraint.first], row[constraint.second]
                if isinstance(constraint, WeldConstraint):
                    points: tuple[Vector3, Vector3] = (constraint.pose.position, (0.0, 0.0, 0.0))
                    self._welds.append((start + 3, first, second, np.array(constraint.pose.quaternion)))
                else:
                    points = (constraint.first_point, constraint.second_point)
                ends += [(first, points[0], start), (second, points[1], start)]
            start += ROWS[constraint.kind]
        columns = list(zip(*follows, strict=True)) if follows else [()] * 5
        self._follow_rows, self._follower_row, self._leader_row = (
            np.array(column, dtype=np.intp) for column in columns[:3]
        )
        self._ratio, self._offset = (np.array(column, dtype=float) for column in columns[3:])
        self.ends = sorted({body for body, _, _ in ends})
        """The bodies whose poses matter, by number."""
        self._end_body = np.array([body for body, _, _ in ends], dtype=np.intp)
        self._end_point = np.array([point for _, point, _ in ends], dtype=float).reshape(-1, 3)
        self._end_rows = np.array([begin for _, _, begin in ends], dtype=np.intp)[::2, None] + np.arange(3)
        welded = {begin - 3 for begin, _, _, _ in self._welds}
        self._columns(bodies, row, places.velocity, ends, welded)

    def _columns(
        self,
        bodies: Sequence[Body],
        row: Mapping[str, int],
        velocity: Sequence[slice],
        ends: Sequence[tuple[int, Vector3, int]],
        welded: Container[int],
    ) -> None:
        """Of every end and every coordinate that moves it: the place in J, and the axis about or along which it does."""
        world = World("", tuple(bodies))
        entries: list[tuple[int, int, int, Vector3, bool, Vector3, int, int, float]] = []
        for end, (body, _, begin) in enumerate(ends):
            above: int | None = body
            while above is not None:
                joint, at = bodies[above].joint, velocity[above].start
                nowhere, sign = (0.0, 0.0, 0.0), -1.0 if end % 2 else 1.0
                turning: Sequence[Vector3] = UNIT
                if joint.kind == "free":
                    nowhere = lumped_inertial(world, bodies[above]).centre_of_mass
                    for index, axis in enumerate(UNIT):  # along the world's axes
                        entries.append((end, above, self._identity, axis, True, nowhere, begin, at + index, sign))
                    at += 3
                elif joint.kind in SCALAR_JOINTS:
                    turning = (joint.axis,)
                for index, axis in enumerate(turning if joint.kind != "fixed" else ()):
                    along = joint.kind == "slide"
                    entries.append((end, above, above, axis, along, nowhere, begin, at + index, sign))
                above = None if joint.parent is None else row[joint.parent]
        columns = list(zip(*entries, strict=True)) if entries else [()] * 9
        self._end, self._above, self._frame = (np.array(column, dtype=np.intp) for column in columns[:3])
        self._axis = np.array(columns[3], dtype=float).reshape(-1, 3)
        self._along = np.array(columns[4], dtype=bool)
        self._centre = np.array(columns[5], dtype=float).reshape(-1, 3)
        begins, self._column = (np.array(column, dtype=np.intp) for column in columns[6:8])
        self._sign = np.array(columns[8], dtype=float)
        self._rows = begins[:, None] + np.arange(3)
        self._turned = np.array(
            [begin in welded and not along for begin, along in zip(begins, self._along, strict=True)], bool
        )

    def of(self, q: Array, poses: Array) -> Array:
        """φ (rows,) at positions ``q`` (nq,), where bodies are at ``poses`` (bodies, 7) x y z w x y z."""
        violation = np.zeros(self.count)
        violation[self._follow_rows] = q[self._follower_row] - self._ratio * q[self._leader_row] - self._offset
        if len(self._end_body):
            points = self._points(poses, matrices(poses[:, 3:]))
            violation[self._end_rows] = points[::2] - points[1::2]
        for start, first, second, turn in self._welds:
            wanted = multiply(poses[first, 3:], turn)
            violation[start : start + 3] = logarithm_of(multiply(wanted, conjugate(poses[second, 3:])).tolist())
        return violation

    def _points(self, poses: Array, turns: Array) -> Array:
        """The points of all ends, in the world."""
        points: Array = poses[self._end_body, :3] + _turned(turns[self._end_body], self._end_point)
        return points

    def jacobian(self, poses: Array) -> Array:
        """J (rows, nv) where bodies are at ``poses`` (bodies, 7)."""
        full = self._linear.copy()
        if not len(self._end_body):
            return full
        turns = np.concatenate([matrices(poses[:, 3:]), np.eye(3)[None]])
        axes = _turned(turns[self._frame], self._axis) * self._sign[:, None]
        centres = poses[self._above, :3] + _turned(turns[self._above], self._centre)
        arms = self._points(poses, turns)[self._end] - centres
        moved = np.where(self._along[:, None], axes, np.cross(axes, arms))
        np.add.at(full, (self._rows, self._column[:, None]), moved)
        if self._welds:
            at = self._turned
            np.add.at(full, (self._rows[at] + 3, self._column[at, None]), axes[at])
        return full


UNIT: tuple[Vector3, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _turned(turns: Array, vectors: Array) -> Array:
    """Vectors (n, 3) turned by matrices (n, 3, 3)."""
    turned: Array = (turns @ vectors[:, :, None])[:, :, 0]
    return turned


def impulse(mass: Array, jacobian: Array, velocity: Array, violation: Array, timestep: float) -> Array:
    """The change of a velocity (nv,) by the law J v⁺ = −φ/dt: −M⁻¹ Jᵀ λ, with J M⁻¹ Jᵀ λ = J v + φ/dt. Rows that say the same
    twice count once: of λ the smallest. Not finite where M has no inverse, as in motion that has diverged: slides that are
    1e100 m away leave no digit of the other coordinates."""
    try:
        moved = np.linalg.solve(mass, jacobian.T)
    except np.linalg.LinAlgError:
        return np.full(len(velocity), np.nan)
    return -moved @ multipliers(jacobian @ moved, jacobian @ velocity + violation / timestep)


def multipliers(mobility: Array, wanted: Array) -> Array:
    """λ (rows,) with A λ = ``wanted``, the smallest where A = J M⁻¹ Jᵀ (rows, rows) has no inverse; not finite where A is not,
    as in motion that has diverged. Rows that nothing moves, but for round-off, have no part in it."""
    if not np.isfinite(mobility).all():
        return np.full(len(wanted), np.nan)
    moved = np.diag(mobility)
    scale = np.sqrt(np.maximum(moved, max(UNMOVED * float(moved.max(initial=0.0)), 1e-300)))
    # numpy's pinv of a symmetric matrix, bit for bit, without its checks
    values, axes = np.linalg.eigh(mobility / (scale[:, None] * scale))
    order = np.argsort(np.abs(values))[::-1]
    values, axes = values[order], axes[:, order]
    sizes = np.abs(values)
    kept = sizes > RANK * sizes.max(initial=0.0)
    shares = np.divide(1.0, sizes, where=kept, out=np.zeros(len(sizes)))
    inverse = (axes * np.sign(values)) @ (shares[:, None] * axes.T)
    found: Array = (inverse @ (wanted / scale)) / scale
    return found


RANK = 1e-10
"""Of the largest eigenvalue: rows are scaled to the same mobility, and a share below this says nothing that others do not."""
UNMOVED = 1e-16
"""Of the largest mobility of a row: one below 1e-26 of that (UNMOVED × RANK) is round-off of J, some 1e-32, as of the third
axis of a planar loop. Scaled like others it would be taken for motion; real rows are within 1e-12 of each other."""

# At which point of two welded bodies their weld is best held.
#
# A weld may be held at any point: it says the same. But solvers go through its six rows one after the other, or make them a
# little soft, and what either leaves follows from how much the rows act on each other. With A = J M⁻¹ Jᵀ of a weld in blocks of
# forces and torques, (L, C; Cᵀ, T), holding it at a point d further on makes L − [d] Cᵀ + C [d] − [d] T [d] of L. It is held
# where forces move the bodies least, where the trace of that block is smallest: d = (tr T − T)⁺ a with
# a = (C₃₂ − C₂₃, C₁₃ − C₃₁, C₂₁ − C₁₂). Of a free body that is welded to what is fixed this is its centre of mass, and C is
# zero there.
#
# That is for welds to what cannot move. Between bodies that turn, and whose joints let them part by an angle θ in a step, the
# law J v⁺ = −φ/dt of another point is another by θ ω d: 2.7e-9 m in 2,000 steps, 3 m away (measured).

GROUND = "ground of the anchors/"
"""A body that does not move, in addition to those of the world; no name of a world ends so."""


def anchors(world: World) -> Mapping[str, Vector3]:
    """By the name of each weld to what cannot move the point at which to hold it, in the frame of its second body, from the
    initial positions."""
    place, groups = poses(world), rigid_groups(world)
    found: dict[str, Vector3] = {}
    for bodies in constrained_trees(world):
        welds = [
            constraint
            for constraint in within(world, bodies).constraints
            if isinstance(constraint, WeldConstraint)
            and "world" in (groups[constraint.first], groups[constraint.second])
        ]
        if not welds:
            continue
        at = np.array([(*place[body.name].position, *place[body.name].quaternion) for body in bodies])
        jacobian = Violation(bodies, welds).jacobian(at)
        moved = jacobian @ _inverse(mass_matrix(bodies, at)) @ jacobian.T
        for number, weld in enumerate(welds):
            rows = slice(6 * number, 6 * number + 6)
            x, y, z = (float(part) for part in least_moved(moved[rows, rows]))
            found[weld.name] = frames.rotate(frames.conjugate(place[weld.second].quaternion), (x, y, z))
    return found


def least_moved(mobility: Array) -> Array:
    """The point d (3,), from where a weld of ``mobility`` A (6, 6) is held, at which forces move its bodies least."""
    across, turning = mobility[:3, 3:], mobility[3:, 3:]
    arm = np.array([across[2, 1] - across[1, 2], across[0, 2] - across[2, 0], across[1, 0] - across[0, 1]])
    point: Array = np.linalg.pinv(np.trace(turning) * np.eye(3) - turning, rcond=RANK, hermitian=True) @ arm
    return point


def mass_matrix(bodies: tuple[Body, ...], at: Array) -> Array:
    """M (nv, nv) of bodies, parents first, at poses ``at`` (bodies, 7): the sum of Jᵀ I J over those with mass, with J of their
    centres of mass."""
    heavy = [(body, pose) for body, pose in zip(bodies, at, strict=True) if body.inertial.mass > 0.0]
    ground = Body(GROUND, "", Inertial(0.0), Joint(GROUND, "fixed", None))
    welds = [WeldConstraint(body.name, body.name, GROUND, Pose(body.inertial.centre_of_mass)) for body, _ in heavy]
    jacobian = Violation((*bodies, ground), welds).jacobian(np.vstack([at, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)]))
    mass = np.diag([armature for body in bodies for armature in _armature(body)])
    for (body, pose), rows in zip(heavy, jacobian.reshape(len(heavy), 6, len(mass)), strict=True):
        turn = np.array(frames.matrix(quaternion(pose[3:].tolist())))
        xx, yy, zz, xy, xz, yz = body.inertial.inertia
        inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        mass = mass + body.inertial.mass * rows[:3].T @ rows[:3] + rows[3:].T @ inertia @ rows[3:]
    return mass


def _armature(body: Body) -> list[float]:
    """Of each coordinate of a body's joint."""
    count, joint = VELOCITY_SIZE[body.joint.kind], body.joint
    return [joint.armature] * 3 + [joint.angular_armature] * 3 if joint.kind == "free" else [joint.armature] * count


def _inverse(mass: Array) -> Array:
    """M⁻¹; zero in coordinates that move nothing, which worlds in error have."""
    scale = np.sqrt(np.diag(mass))
    scale[scale == 0.0] = 1.0
    inverse: Array = np.linalg.pinv(mass / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    return inverse


# Passive forces explicit in time, in the same coordinates: springs and dampers of joints and of weighted sums of their
# positions, and the drag of a fluid.

PassiveForcesArray = NDArray[np.float64]


class JointSums:
    """Some sums of the joints of some bodies, parents before children.

    ``weights`` (sums, nv): the coefficients, L̇ = weights v; ``stiffness``, ``rest``, ``damping`` (sums,).
    """

    def __init__(self, bodies: Sequence[Body], sums: Sequence[JointSum]):
        places = layout(bodies)
        row = {body.joint.name: index for index, body in enumerate(bodies)}
        self.sums = tuple(sums)
        self.weights = np.zeros((len(self.sums), places.nv))
        self._of_positions = np.zeros((len(self.sums), places.nq))
        for index, joint_sum in enumerate(self.sums):
            for joint, coefficient in joint_sum.joints:
                self.weights[index, places.velocity[row[joint]]] = coefficient
                self._of_positions[index, places.position[row[joint]]] = coefficient
        self.stiffness = np.array([joint_sum.stiffness for joint_sum in self.sums], dtype=float)
        self.rest = np.array([joint_sum.rest for joint_sum in self.sums], dtype=float)
        self.damping = np.array([joint_sum.damping for joint_sum in self.sums], dtype=float)

    @property
    def acts(self) -> bool:
        """Whether there is a spring or a damper among them."""
        return bool(self.stiffness.any() or self.damping.any())

    def lengths(self, q: PassiveForcesArray) -> PassiveForcesArray:
        """L (sums,) at positions ``q`` (nq,); of several states (n, nq) (n, sums)."""
        values: PassiveForcesArray = q @ self._of_positions.T
        return values

    def effort(self, q: PassiveForcesArray, v: PassiveForcesArray) -> PassiveForcesArray:
        """−Cᵀ (k (L − rest) + d L̇) (nv,)."""
        force = self.stiffness * (self.lengths(q) - self.rest) + self.damping * (self.weights @ v)
        effort: PassiveForcesArray = -(force @ self.weights)
        return effort

    def energy(self, q: PassiveForcesArray) -> float:
        """The energy of the springs (J)."""
        stretch = self.lengths(q) - self.rest
        return 0.5 * float(self.stiffness @ (stretch * stretch))

    def matrices(self) -> tuple[PassiveForcesArray, PassiveForcesArray]:
        """Cᵀ k C and Cᵀ d C (nv, nv)."""
        return (
            self.weights.T @ (self.stiffness[:, None] * self.weights),
            self.weights.T @ (self.damping[:, None] * self.weights),
        )


def beyond_limits(world: World, states: PassiveForcesArray) -> str | None:
    """The name of a sum that is beyond its limits at one of some positions (n, nq); None where there is none."""
    along = JointSums(world.bodies, world.sums)
    for joint_sum, lengths in zip(along.sums, along.lengths(states).T, strict=True):
        limits = joint_sum.position_limits
        if limits is not None and (lengths.min() < limits[0] or lengths.max() > limits[1]):
            return joint_sum.name
    return None


class JointForces:
    """−d q̇ − k (q − rest) of hinges and slides, −d ω − k log R of balls, of ``bodies`` in the order of their coordinates.
    The damping of free bodies is not among them: engines receive it separately (``dialects/kit/sidecar.py``)."""

    def __init__(self, bodies: Sequence[Body]):
        layout = layout_of(World("", tuple(bodies)))
        self._damping, self._stiffness, self._rest = np.zeros((3, layout.nv))
        self._balls: list[tuple[slice, slice]] = []
        scalar: list[tuple[int, int]] = []
        for body, at_q, at_v in zip(bodies, layout.position, layout.velocity, strict=True):
            joint = body.joint
            if joint.kind in TREE_JOINTS:
                self._damping[at_v], self._stiffness[at_v] = joint.damping, joint.spring_stiffness
            if joint.kind in SCALAR_JOINTS:
                scalar.append((at_q.start, at_v.start))
                self._rest[at_v] = joint.spring_rest
            elif joint.kind == "ball":
                self._balls.append((at_q, at_v))
        at = np.array(scalar, dtype=np.intp).reshape(-1, 2)
        self._scalar_q, self._scalar_v = at[:, 0], at[:, 1]
        self.needed = bool(self._damping.any() or self._stiffness.any())
        """Whether any joint has any."""

    def effort(self, q: PassiveForcesArray, v: PassiveForcesArray) -> PassiveForcesArray:
        """The effort (nv,) at the state ``q`` (nq,), ``v`` (nv,)."""
        found: PassiveForcesArray = -self._damping * v
        at = self._scalar_v
        found[at] -= self._stiffness[at] * (q[self._scalar_q] - self._rest[at])
        for at_q, at_v in self._balls:
            found[at_v] -= self._stiffness[at_v] * np.array(logarithm_of(q[at_q].tolist()))
        return found


class Drag:
    """The drag of ``fluid`` on boxes with ``edges`` (n, 3), m: the law of ``world/actions.py``."""

    def __init__(self, edges: ArrayLike, fluid: Fluid):
        sizes: PassiveForcesArray = np.asarray(edges, dtype=float).reshape(-1, 3)
        second, third = np.roll(sizes, -1, axis=1), np.roll(sizes, -2, axis=1)
        size = sizes.mean(axis=1, keepdims=True)
        self._linear = 3.0 * np.pi * fluid.viscosity * size, np.pi * fluid.viscosity * size**3
        self._quadratic = 0.5 * fluid.density * second * third, fluid.density / 64.0 * sizes * (second**4 + third**4)

    def of(self, flow: PassiveForcesArray, spin: PassiveForcesArray) -> tuple[PassiveForcesArray, PassiveForcesArray]:
        """Forces at the centres of the boxes and torques (n, 3), for velocities of these against the fluid and angular
        velocities (n, 3), all along the axes of each box."""
        force, torque = (
            -(linear + quadratic * np.abs(speeds)) * speeds
            for speeds, linear, quadratic in zip((flow, spin), self._linear, self._quadratic, strict=True)
        )
        return force, torque
