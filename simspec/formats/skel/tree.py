"""What a .skel file holds, in SI units: what :class:`simspec.formats.skel.format.Skel` writes.

At zero configuration every body stands where ``Body.pose`` puts it in the world; joints are at their child's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

from simspec.world.types import Inertial, Pose, Vector3


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape on a body; kind and size as :class:`simspec.world.types.Shape` has them. Colours are of visual shapes."""

    kind: str
    size: tuple[float, ...]
    pose: Pose
    colour: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Body:
    """A body with its pose in the world at zero configuration."""

    name: str
    pose: Pose
    inertial: Inertial
    visual: tuple[Shape, ...]
    collision: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint of one of the world's kinds. ``parent`` None is the world.

    ``position`` and ``velocity`` are the file's coordinates: of a ball a rotation vector, of a free joint a rotation vector and
    a position; velocities in the same order. Damping and spring are the file's, which are implicit in time.
    """

    name: str
    kind: str
    parent: str | None
    child: str
    axis: Vector3 | None = None
    position_limits: tuple[float, float] | None = None
    dry_friction: float = 0.0
    position: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    damping: float = 0.0
    spring_stiffness: float = 0.0
    spring_rest: float = 0.0


@dataclass(frozen=True, slots=True)
class Skeleton:
    """One tree of bodies. One that is not ``mobile`` cannot move."""

    name: str
    mobile: bool
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]


@dataclass(frozen=True, slots=True)
class World:
    """A whole file. ``collision_detector`` is the name of the program's detector that the file asks for; None: none."""

    name: str
    timestep: float
    gravity: Vector3
    collision_detector: str | None
    skeletons: tuple[Skeleton, ...]
