"""What ``world.json`` holds, in SI units and the world's frames and order: for engines that are built by calls of their API.

Bodies with their joints and shapes, of each collision shape the copies that the contact plan asks for with their numbers, which
materials meet in which layer, and which bodies and collision groups do not touch. Free roots have their frame at the centre
of mass, as in every format (``passes.recentre_free_roots``). The annotations are the form of the JSON (see
``formats/kit/forms.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from simspec.formats.kit.forms import NamePairs
from simspec.world import frames
from simspec.world.frames import quaternion, vector3
from simspec.world.types import Hardness, Pose, Vector3

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class ShapeCopy:
    """One copy of a collision shape and the numbers it holds in its layer; their meaning depends on how the engine combines
    those of two shapes. Sliding friction and restitution are ratios, torsional and rolling friction lengths (m)."""

    layer: int
    friction: float
    torsional_friction: float
    rolling_friction: float
    restitution: float
    hardness: Hardness | None = None


@dataclass(frozen=True, slots=True)
class JsonShape:
    """A shape as :class:`simspec.world.types.Shape` has it. Without copies it is no collision shape and its material is "";
    without a colour it is not visual."""

    name: str
    kind: str
    size: tuple[float, ...]
    pose: Pose
    material: str
    colour: tuple[float, float, float, float] | None
    copies: tuple[ShapeCopy, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedJoint:
    """A weld. ``parent`` None is the world; ``origin`` the joint's frame in the parent's."""

    name: str
    kind: Literal["fixed"] = "fixed"
    parent: str | None
    origin: Pose


@dataclass(frozen=True, slots=True)
class JsonServo:
    """The engine's own controller of a joint: gains as in :class:`simspec.world.actions.Controller`, and the largest effort."""

    kp: float
    kd: float
    effort_limit: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisJoint:
    """A hinge or a slide, with the fields of :class:`simspec.world.types.Joint`. ``servo`` None, which is left out of the text:
    no controller of the engine's own."""

    name: str
    kind: Literal["hinge", "slide"]
    parent: str | None
    origin: Pose
    axis: Vector3
    position_limits: tuple[float, float] | None
    velocity_limit: float | None
    effort_limit: float | None
    damping: float
    spring_stiffness: float
    spring_rest: float
    dry_friction: float
    armature: float
    position: tuple[float]
    velocity: tuple[float]
    servo: JsonServo | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BallJoint:
    """A ball: position a quaternion w x y z, velocity angular in the child's axes."""

    name: str
    kind: Literal["ball"] = "ball"
    parent: str | None
    origin: Pose
    damping: float
    spring_stiffness: float
    position: tuple[float, float, float, float]
    velocity: Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeJoint:
    """No joint: position x y z w x y z of the body, velocity linear and angular, in world axes."""

    name: str
    kind: Literal["free"] = "free"
    position: tuple[float, float, float, float, float, float, float]
    velocity: tuple[float, float, float, float, float, float]


Joint = FixedJoint | AxisJoint | BallJoint | FreeJoint


@dataclass(frozen=True, slots=True)
class JsonBody:
    """A rigid body; inertia about the centre of mass as (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""

    name: str
    model: str
    group: str
    mass: float
    centre_of_mass: Vector3
    inertia: tuple[float, float, float, float, float, float]
    joint: Joint
    shapes: tuple[JsonShape, ...]


@dataclass(frozen=True, slots=True)
class Apart:
    """Pairs of bodies, and of collision groups, that do not touch."""

    bodies: NamePairs
    groups: NamePairs


@dataclass(frozen=True, slots=True, kw_only=True)
class JsonWorld:
    """A whole ``world.json``."""

    schema: int = SCHEMA
    gravity: Vector3
    timestep: float
    friction_cone: str
    bodies: tuple[JsonBody, ...]
    """Every parent before its children."""
    meets: tuple[tuple[str, str, int], ...]
    """Two materials, and the one layer in which copies of both touch."""
    apart: Apart


def parent_of(joint: Joint) -> str | None:
    """The name of the body that a joint hangs on; None for the world."""
    return None if isinstance(joint, FreeJoint) else joint.parent


@dataclass(frozen=True, slots=True)
class BodyRows:
    """How bodies hang together, by their rows. ``parents``: -1 is the world; ``roots``: of the tree that a body is in;
    ``groups``: the body by whose joint a rigid group moves, -1 of what cannot move."""

    parents: tuple[int, ...]
    roots: tuple[int, ...]
    groups: tuple[int, ...]


def rows_of(bodies: Sequence[JsonBody]) -> BodyRows:
    """How ``bodies`` hang together, every parent before its children."""
    number = {body.name: row for row, body in enumerate(bodies)}
    parents = tuple(-1 if (above := parent_of(body.joint)) is None else number[above] for body in bodies)
    roots: list[int] = []
    groups: list[int] = []
    for row, (body, parent) in enumerate(zip(bodies, parents, strict=True)):
        roots.append(row if parent < 0 else roots[parent])
        group = -1 if parent < 0 else groups[parent]
        groups.append(group if isinstance(body.joint, FixedJoint) else row)
    return BodyRows(parents, tuple(roots), tuple(groups))


def state_of(joint: Joint) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A joint's initial position and velocity."""
    return ((), ()) if isinstance(joint, FixedJoint) else (joint.position, joint.velocity)


def initial_coordinates(document: JsonWorld) -> tuple[list[float], list[float]]:
    """The initial state (q (nq,), v (nv,)) in the coordinates of ``world/kinematics.py``."""
    q: list[float] = []
    v: list[float] = []
    for body in document.bodies:
        position, velocity = state_of(body.joint)
        q.extend(position)
        if isinstance(body.joint, FreeJoint):
            turn = frames.normalise(quaternion(position[3:7]))
            v.extend([*velocity[:3], *frames.rotate(frames.conjugate(turn), vector3(velocity[3:]))])
        else:
            v.extend(velocity)
    return q, v
