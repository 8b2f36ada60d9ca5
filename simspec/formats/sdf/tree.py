"""The content of an SDF file, in SI units, as :class:`simspec.formats.sdf.format.Sdf` writes it.

Links stand where their joints are at zero, each against its parent; joints are at their child's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

from simspec.world.types import Inertial, Pose, Vector3


@dataclass(frozen=True, slots=True)
class SdfSurface:
    """The numbers of one surface; lengths in m, the speed in m/s."""

    friction: float
    torsional_friction: float
    restitution: float
    restitution_threshold: float


@dataclass(frozen=True, slots=True)
class SdfShape:
    """A shape of a link; kind and size as :class:`simspec.world.types.Shape` has them. Without ``surface`` it does not collide,
    without ``colour`` it is not drawn."""

    name: str
    kind: str
    size: tuple[float, ...]
    pose: Pose
    surface: SdfSurface | None
    colour: tuple[float, float, float, float] | None


@dataclass(frozen=True, slots=True)
class SdfLink:
    """A link. ``relative_to`` None: the model's frame; ``inertial`` None: it says none."""

    name: str
    relative_to: str | None
    pose: Pose
    inertial: Inertial | None
    self_collide: bool
    shapes: tuple[SdfShape, ...]
    gravity: bool = True
    """Whether it has a weight."""


@dataclass(frozen=True, slots=True)
class SdfMimic:
    """That a joint follows another of its model: q = ``ratio`` × q of the leader + ``offset``."""

    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True, slots=True)
class SdfJoint:
    """A joint of one of the world's kinds. ``parent`` None is the world."""

    name: str
    kind: str
    parent: str | None
    child: str
    axis: Vector3 | None = None
    position_limits: tuple[float, float] | None = None
    effort_limit: float | None = None
    velocity_limit: float | None = None
    damping: float = 0.0
    dry_friction: float = 0.0
    spring_rest: float = 0.0
    spring_stiffness: float = 0.0
    mimic: SdfMimic | None = None
    place: Vector3 | None = None
    """Where it is in its child; None: at its frame."""


@dataclass(frozen=True, slots=True)
class SdfFrame:
    """A named frame on a link."""

    name: str
    attached_to: str
    pose: Pose


@dataclass(frozen=True, slots=True)
class SdfModel:
    """One tree of links, and the joints that close loops in it, after those of the tree. One that is ``static`` cannot move."""

    name: str
    pose: Pose
    static: bool
    self_collide: bool
    links: tuple[SdfLink, ...]
    joints: tuple[SdfJoint, ...]
    frames: tuple[SdfFrame, ...] = ()


@dataclass(frozen=True, slots=True)
class SdfSystem:
    """A system that a server loads with the world: the file of its plugin and the name of its class."""

    file: str
    name: str


@dataclass(frozen=True, slots=True)
class SdfWorld:
    """A whole file."""

    name: str
    timestep: float
    gravity: Vector3
    models: tuple[SdfModel, ...]
    systems: tuple[SdfSystem, ...] = ()
    real_time_factor: float = 1.0
    """How fast a server may step, against the clock; 0: as fast as it can."""
    version: str = ""
    """The version of the language; empty: the least that has all that the file says."""
