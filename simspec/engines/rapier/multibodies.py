"""Trees of joints in Rapier, built as its multibodies, which step reduced coordinates.

Each tree is one multibody: a fixed body without shapes as its root, the *anchor*, and one link for each body that has a joint,
or a mass and a fixed joint. A free root is connected to the anchor by a joint that locks nothing, so that its velocity is that
of the body's frame.

Rapier solves (M + dt C) a = τ − h with a Coriolis matrix C, unless that adds more energy than forces do: it then solves M a = τ
− h, which is simspec's law of motion. So each multibody has a *flywheel*, a link on the anchor that acts on no other. A motor
turns it, and a damper brakes it so hard that Rapier counts energy in every step. The motion is then semi-implicit Euler to the
round-off of single precision: two hinges are 6e-7 off after 2,000 steps, without a flywheel 4e-4
(docs/records/rapier-joints.md). Where a spec selects Rapier's own method, the flywheel idles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.building import PlacedBody, Walk
from simspec.engines.rapier.units import NAME, SCALE, SQUARE, isometry, mass_properties
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint, JsonBody
from simspec.world import frames
from simspec.world.types import VELOCITY_SIZE, Pose, Quaternion, Vector3

ANCHOR = -1
"""The link that a link is connected to, where that is the anchor of its multibody."""
WHEEL_SPEED = 1e6
"""rad/s of a flywheel. Rapier's count of energy then exceeds a hundredth of any other energy, which is its margin."""
WHEEL_DAMPING = 1e12
"""The damping of a flywheel times the timestep (kg, 1/1024 m); its moment is 1."""
IDLE_SPEED = 1.0
"""rad/s of a flywheel that idles: its energy is 5e-7 J."""
IDLE_DAMPING = 1e-6
"""The damping (1/s) by which it still has an acceleration, which is zero where Rapier dropped those of a multibody."""
RIGID_MOTOR = 1e30
"""Damping of a motor that attains its velocity in one step, within its largest force."""
UNLIMITED = 1e30
"""In place of an infinite position."""
ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`), of contacts and of position limits."""
STIFF = 1e6
"""ω dt of position limits. The compliance that Rapier derives from it is 1e-12 of a joint's inertia at most."""
MARK = int.from_bytes(b"simspec's joint ", "little") >> 32 << 32
"""The marks of joints are this and their numbers."""
TURNS = 97
"""Turns about its axis that are tried for the frames of a joint."""
MASKS: Mapping[str, str] = {
    "hinge": "LOCKED_REVOLUTE_AXES",
    "slide": "LOCKED_PRISMATIC_AXES",
    "ball": "LOCKED_SPHERICAL_AXES",
    "fixed": "LOCKED_FIXED_AXES",
}
"""The axes that Rapier locks, by kind of joint; none of a free body."""
AXIS_OF: Mapping[str, str] = {"hinge": "ANG_X", "slide": "LIN_X"}
"""Rapier's name of the axis of a hinge or slide, which is x of the joint's frames."""


@dataclass(frozen=True, slots=True)
class MultibodyLink:
    """A body that is a link. ``parent``: the number of the link that it is connected to; ``tree``: of its multibody."""

    placed: PlacedBody
    parent: int
    tree: int
    part: Pose
    """The pose of the body's parent in the link that this link is connected to, or in the world."""

    @property
    def origin(self) -> Pose:
        """The pose of the joint's frame in the link's parent, or in the world."""
        joint = self.placed.body.joint
        return Pose() if isinstance(joint, FreeJoint) else frames.compose(self.part, joint.origin)

    @property
    def joint(self) -> Any:
        return self.placed.body.joint

    @property
    def kind(self) -> str:
        kind: str = self.placed.body.joint.kind
        return kind


def links_of(walk: Walk) -> list[MultibodyLink]:
    """The links of a document, every parent before its children. A tree that is a single rigid body, whose frame is at its
    centre of mass, has none: Rapier steps it as a body."""
    alone = _alone(walk)
    links: list[MultibodyLink] = []
    place: dict[
        int, tuple[int, int, Pose]
    ] = {}  # by row: link and multibody of the body that it is part of, pose in it
    trees = 0
    for placed in walk.bodies:
        joint = placed.body.joint
        if not placed.moves or placed.root in alone:
            continue
        part, tree, pose = place.get(placed.parent, (ANCHOR, -1, Pose()))
        if part == ANCHOR and placed.parent >= 0:
            pose = walk.bodies[placed.parent].pose  # of a body that cannot move, in the world
        if isinstance(joint, FixedJoint) and not placed.body.mass:
            place[placed.row] = (part, tree, frames.compose(pose, joint.origin))
            continue
        if part == ANCHOR:
            tree, trees = trees, trees + 1
        place[placed.row] = (len(links), tree, Pose())
        links.append(MultibodyLink(placed, part, tree, pose))
    return links


def _alone(walk: Walk) -> set[int]:
    """The roots of trees that are single rigid bodies whose mass is that of the root."""
    return {
        root
        for root, rows in walk.trees.items()
        if walk.bodies[root].body.joint.kind == "free"
        and all(walk.bodies[row].carrier == root and (row == root or not walk.bodies[row].body.mass) for row in rows)
    }


def mark_of(number: int) -> int:
    """A number of 16 bytes that marks the joint of a link in Rapier's serialised multibodies."""
    return MARK + number


def turn_to(axis: Vector3) -> Quaternion:
    """A rotation that brings x to a unit ``axis``."""
    x, y, z = axis
    if x < -0.5:  # by way of half a turn about y, which brings x to −x
        return frames.multiply(turn_to((-x, -y, -z)), (0.0, 0.0, 1.0, 0.0))
    return frames.normalise((1.0 + x, 0.0, -z, y))


def unit_of(kind: str) -> float:
    """Rapier's unit of the position and the velocity of a hinge or slide."""
    return SCALE if kind == "slide" else 1.0


def effort_unit_of(kind: str) -> float:
    """The same of an effort."""
    return SCALE if kind == "slide" else SQUARE


def inertia_unit_of(kind: str) -> float:
    """The same of an armature and a damping."""
    return 1.0 if kind == "slide" else SQUARE


class Multibodies:
    """The multibodies of a world that is being built. ``bodies``: the handles of the links' bodies; ``joints``: of their
    joints; ``wheels``: of the flywheels' joints, by multibody; ``places``: where the coordinates of each link begin among those
    of all multibodies, one after the other; ``sizes``: the number of coordinates of each multibody."""

    def __init__(self, rapier: Any, world: Any, walk: Walk, timestep: float):
        self.rapier, self.timestep, self.links = rapier, timestep, links_of(walk)
        self.number = {link.placed.row: number for number, link in enumerate(self.links)}
        """The number of each link, by the row of its body."""
        self._check()
        self.bodies = [world.add_body(self._builder(link.placed.body)) for link in self.links]
        trees = range(1 + max((link.tree for link in self.links), default=-1))
        self.anchors = [world.add_body(rapier.RigidBody.fixed()) for _ in trees]
        self.wheel_bodies = [world.add_body(self._wheel_builder()) for _ in trees]
        self.joints: list[Any] = []
        self.wheels: list[Any] = []
        self.sizes: list[int] = []
        self.places: list[int] = []
        self.wheel_places: list[int] = []
        self.numbers: list[int] = []
        """Rapier's number of each link in its multibody."""

    def _check(self) -> None:
        """Refuse trees whose mass matrix has no inverse: a last body without mass."""
        heavy = [bool(link.placed.body.mass) for link in self.links]
        for number in reversed(range(len(self.links))):
            link = self.links[number]
            if not heavy[number]:
                raise EngineError(NAME, f"does not support {link.placed.body.name!r}, which moves and has no mass")
            if link.parent != ANCHOR:
                heavy[link.parent] = True

    def _builder(self, body: JsonBody) -> Any:
        builder = self.rapier.RigidBody.dynamic()
        if body.mass or any(body.inertia):
            builder = builder.additional_mass_properties(mass_properties(self.rapier, body))
        return builder.can_sleep(False).gyroscopic_forces(False).allow_fast_rotation(True)

    def _wheel_builder(self) -> Any:
        rapier = self.rapier
        vector, turn = rapier.Vec3, rapier.Rotation3(1.0, 0.0, 0.0, 0.0)
        mass = rapier.MassProperties(vector(0.0, 0.0, 0.0), 1.0, vector(1.0, 1.0, 1.0), turn)
        builder = rapier.RigidBody.dynamic().additional_mass_properties(mass).gravity_scale(0.0)
        return builder.can_sleep(False).gyroscopic_forces(False).allow_fast_rotation(True)

    def connect(self, world: Any) -> None:
        """Insert the joints, once Rapier has the masses of all bodies: they are at their zero positions then."""
        rapier, joints = self.rapier, world.multibody_joints
        for tree, anchor in enumerate(self.anchors):
            axis, mask = rapier.JointAxis.ANG_X, rapier.JointAxesMask.LOCKED_REVOLUTE_AXES
            wheel = rapier.GenericJointBuilder(mask).motor_model(axis, rapier.MotorModel.ACCELERATION_BASED)
            wheel = wheel.motor_velocity(axis, WHEEL_SPEED, RIGID_MOTOR)
            self.wheels.append(joints.insert(anchor, self.wheel_bodies[tree], wheel.build(), True))
        for number, link in enumerate(self.links):
            parent = self.anchors[link.tree] if link.parent == ANCHOR else self.bodies[link.parent]
            joint = self._joint(link).user_data(mark_of(number)).build()
            self.joints.append(joints.insert(parent, self.bodies[number], joint, True))
        begins = 0
        for wheel in self.wheels:
            multibody = joints.multibody(wheel)
            multibody.forward_kinematics(
                world.rigid_bodies, False
            )  # which takes the six coordinates of the anchor away
            self.sizes.append(multibody.ndofs)
            self.wheel_places.append(begins + self._assembly(joints, wheel)[1])
            begins += multibody.ndofs
        starts = np.concatenate([[0], np.cumsum(self.sizes)]).astype(int).tolist()
        for handle, link in zip(self.joints, self.links, strict=True):
            number, place = self._assembly(joints, handle)
            self.numbers.append(number)
            self.places.append(starts[link.tree] + place)
        self.starts = starts
        for tree, wheel in enumerate(self.wheels):
            self._give(joints.multibody(wheel), tree)

    def release(self, world: Any) -> None:
        """Leave the integration to Rapier: flywheels idle, and Rapier damps the joints, implicitly."""
        for tree, wheel in enumerate(self.wheels):
            world.multibody_joints[wheel].data.set_motor_max_force(self.rapier.JointAxis.ANG_X, 0.0)
            damping = self._values(tree, "damping")
            damping[self.wheel_places[tree] - self.starts[tree]] = IDLE_DAMPING
            world.multibody_joints.multibody(wheel).set_damping(damping.tolist())

    @staticmethod
    def _assembly(joints: Any, handle: Any) -> tuple[int, int]:
        """Rapier's number of a link, and the place of its first coordinate, in its multibody."""
        multibody, number = joints.get(handle)
        return number, multibody.get_link(number).assembly_id

    def _joint(self, link: MultibodyLink) -> Any:
        rapier, joint, name = self.rapier, link.joint, f"origin of {link.joint.name}"
        mask = rapier.JointAxesMask.empty() if link.kind == "free" else getattr(rapier.JointAxesMask, MASKS[link.kind])
        builder = rapier.GenericJointBuilder(mask)
        along = Pose()  # the axes of the velocities of balls and free bodies
        if isinstance(joint, (AxisJoint, FixedJoint)):
            along = self._along(link, (1.0, 0.0, 0.0) if isinstance(joint, FixedJoint) else joint.axis)
        builder = builder.local_frame1(isometry(rapier, frames.compose(link.origin, along), name))
        builder = builder.local_frame2(isometry(rapier, along, name))
        if not isinstance(joint, AxisJoint):
            return builder
        axis = getattr(rapier.JointAxis, AXIS_OF[link.kind])
        if joint.dry_friction:
            force = effort_unit_of(link.kind) * joint.dry_friction
            force = checked_singles(NAME, (force,), f"dry friction of {joint.name}")[0]
            builder = builder.motor_model(axis, rapier.MotorModel.ACCELERATION_BASED)
            builder = builder.motor_velocity(axis, 0.0, RIGID_MOTOR).motor_max_force(axis, force)
        if joint.position_limits is not None:
            builder = builder.limits(axis, *limits_in_units(link.kind, joint.position_limits, joint.name))
            builder = builder.softness(limit_softness(rapier, self.timestep))
        return builder

    def _along(self, link: MultibodyLink, axis: Vector3) -> Pose:
        """The turn of the frames of a joint, whose x is its ``axis``. Rapier's quaternions are up to 7e-8 too long, and it
        multiplies those of a chain without normalising them: moments of the last link of an arm of six hinges are 4e-6 off
        (measured). So the turn about the axis, which is free, is that by which both frames have quaternions of unit length."""
        turn = turn_to(axis)

        def off(turned: Quaternion) -> float:
            both = (frames.multiply(link.origin.quaternion, turned), turned)
            return sum(abs(math.hypot(*self.rapier.Rotation3(*q).to_tuple()) - 1.0) for q in both)

        angles = (2.0 * math.pi * number / TURNS for number in range(TURNS))
        turns = (frames.multiply(turn, frames.from_axis_angle((1.0, 0.0, 0.0), angle)) for angle in angles)
        return Pose(quaternion=min(turns, key=off))

    def _give(self, multibody: Any, tree: int) -> None:
        """Armature and damping: Rapier gives 0.1 to every angular coordinate that is added."""
        damping = np.zeros(self.sizes[tree])
        damping[self.wheel_places[tree] - self.starts[tree]] = WHEEL_DAMPING / self.timestep
        multibody.set_damping(damping.tolist())
        multibody.set_armature(self._values(tree, "armature").tolist())

    def _values(self, tree: int, name: str) -> np.ndarray:
        """The armature or damping of every coordinate of a multibody, in Rapier's unit."""
        found, begin = np.zeros(self.sizes[tree]), self.starts[tree]
        for link, place in zip(self.links, self.places, strict=True):
            if link.tree == tree and isinstance(link.joint, (AxisJoint, BallJoint)):
                value = inertia_unit_of(link.kind) * (getattr(link.joint, name) or 0.0)
                value = checked_singles(NAME, (value,), f"{name} of {link.joint.name}")[0]
                found[place - begin : place - begin + VELOCITY_SIZE[link.kind]] = value
        return found


def limit_softness(rapier: Any, timestep: float) -> Any:
    """The softness of position limits: a step takes back the share ``ERROR_REDUCTION`` of what a joint is beyond its limit."""
    return rapier.SpringCoefficients(STIFF / (2.0 * math.pi * timestep), 0.5 * STIFF * (1.0 / ERROR_REDUCTION - 1.0))


def limits_in_units(kind: str, limits: Sequence[float], name: str) -> tuple[float, float]:
    """Position limits in Rapier's unit."""
    unit = unit_of(kind)
    low, high = (unit * end if math.isfinite(end) else math.copysign(UNLIMITED, end) for end in limits)
    lower, upper = checked_singles(NAME, (low, high), f"limits of {name}")
    return lower, upper
