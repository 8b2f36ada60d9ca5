"""The format ``skel``: one XML file, ``world.skel``.

Poses are a position and intrinsic X-Y-Z Euler angles: of bodies in the world at zero configuration, of shapes in their body, of
joints in their child.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format, Loss, LossFate, PlainFiles, losses
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.kit.text import environment, mesh_file, mesh_files
from simspec.formats.skel.reading import SkelDocument
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import Table, approximate, exact, exactly, for_each, never, shape_kinds
from simspec.support.features import Feature
from simspec.world import frames, types
from simspec.world.damping import without_implicit_damping
from simspec.world.kinematics import poses, rigid_groups, trees
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, Vector3, World

# --- the written tree; SI units, bodies in the world at zero configuration, joints at their child's frame ---


@dataclass(frozen=True, slots=True)
class SkelShape:
    """A shape on a body; kind and size as :class:`simspec.world.types.Shape` has them. Colours are of visual shapes."""

    kind: str
    size: tuple[float, ...]
    pose: Pose
    colour: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class SkelBody:
    """A body with its pose in the world at zero configuration."""

    name: str
    pose: Pose
    inertial: Inertial
    visual: tuple[SkelShape, ...]
    collision: tuple[SkelShape, ...]


@dataclass(frozen=True, slots=True)
class SkelJoint:
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
    bodies: tuple[SkelBody, ...]
    joints: tuple[SkelJoint, ...]


@dataclass(frozen=True, slots=True)
class SkelWorld:
    """A whole file. ``collision_detector`` is the name of the program's detector that the file requests; None: none."""

    name: str
    timestep: float
    gravity: Vector3
    collision_detector: str | None
    skeletons: tuple[Skeleton, ...]


# --- names, poses, coordinates ---

JOINT_TYPES: Final[Mapping[str, str]] = {
    "fixed": "weld",
    "hinge": "revolute",
    "slide": "prismatic",
    "ball": "ball",
    "free": "free",
}
"""The name of each kind of joint in .skel."""

GEOMETRY: Final[Mapping[str, tuple[tuple[tuple[str, slice], ...], float]]] = {
    "sphere": ((("radius", slice(0, 1)),), 1.0),
    "box": ((("size", slice(0, 3)),), 1.0),
    "cylinder": ((("radius", slice(0, 1)), ("height", slice(1, 2))), 1.0),
    "capsule": ((("radius", slice(0, 1)), ("height", slice(1, 2))), 1.0),
    "ellipsoid": ((("size", slice(0, 3)),), 2.0),
}
"""For each kind of shape which part of its size goes into which element, and what it is multiplied with: an ellipsoid's size
are its diameters."""
KINDS: Final = ("plane", *GEOMETRY, "mesh")
"""The kinds of shapes that the language has."""
UNSCALED: Final = (1.0, 1.0, 1.0)
"""Of a mesh."""
PLANE: Final = (("normal", (0.0, 0.0, 1.0)), ("offset", (0.0,)))
RESERVED: Final = {"world": "world."}
"""A joint's parent ``world`` is the world; a body of that name gets one that no spec can give."""


def file_name(name: str) -> str:
    """The name of a body in the file."""
    return RESERVED.get(name, name)


def world_name(name: str) -> str:
    """The inverse of :func:`file_name`."""
    return {there: here for here, there in RESERVED.items()}.get(name, name)


def zero_poses(world: World) -> dict[str, Pose]:
    """Where the bodies stand in the world at zero configuration: a free root at its origin, unturned."""
    at_origin = dataclasses.replace(
        world,
        bodies=tuple(
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, position=(0.0, 0.0, 0.0, *frames.IDENTITY)))
            if body.joint.kind == "free"
            else body
            for body in world.bodies
        ),
    )
    return poses(at_origin, at_zero=True)


def coordinates(
    joint: Joint, rotation_vector: Callable[[Quaternion], Vector3]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A joint's initial position and velocity in the file's coordinates; of a free joint the rotation comes first."""
    if joint.kind == "ball":
        return rotation_vector(joint.position), joint.velocity  # type: ignore[arg-type]
    if joint.kind == "free":
        turn = rotation_vector(joint.position[3:7])  # type: ignore[arg-type]
        return (*turn, *joint.position[:3]), (*joint.velocity[3:], *joint.velocity[:3])
    return joint.position, joint.velocity


# --- plain files ---

_SURFACE = ".skel has no surface parameters"
_FILTER = ".skel does not say what touches what"
_HARDNESS = ".skel has no hardness of contact"

SUPPORT: Final[Table] = {
    **classes.file_language(".skel"),
    **exactly(Feature.JOINT_SEVERAL, Feature.DRY_FRICTION, *features.INITIAL_STATE),
    **shape_kinds(".skel", KINDS),
    Feature.GRAVITY_SCALE: never("simspec writes no gravity scale of single bodies into .skel"),
    Feature.FREE_DAMPING: never("simspec writes no damping of free joints into .skel"),
    Feature.FREE_ARMATURE: never("simspec writes no armature of free joints into .skel"),
    Feature.INERTIA_FULL: exact("the full tensor"),
    Feature.LIMIT_POSITION: approximate(".skel has the limits, but not their enforcement"),
    Feature.LIMIT_VELOCITY: never(".skel has enforced velocity limits, but no ratings"),
    Feature.LIMIT_EFFORT: never(".skel has enforced effort limits, but no ratings"),
    Feature.DAMPING: approximate("Readers of .skel integrate the same coefficients implicitly in time"),
    Feature.BALL_DAMPING: never(".skel has damping at hinges and slides only"),
    Feature.DAMPING_IMPLICIT: exact("Readers of .skel integrate damping implicitly in time"),
    Feature.SPRING: approximate("Readers of .skel integrate the same coefficients implicitly in time"),
    Feature.BALL_SPRING: never(".skel has springs at hinges and slides only"),
    **for_each(never(_SURFACE), Feature.MATERIALS_PER_BODY, *features.CONTACT_LAWS),
    **for_each(never(_HARDNESS), *features.HARDNESSES),
    **for_each(never(_FILTER), *features.FILTERS),
    Feature.CONSTRAINT_LOOP: never(".skel has no constraints between bodies"),
    Feature.CONSTRAINT_COUPLING: never(".skel has no couplings of joints"),
    Feature.FRAME: never(".skel has no frames other than those of bodies"),
    Feature.CONTROL: never(".skel has no control laws"),
}
"""What plain .skel carries of each feature."""


def plain_tree(world: World) -> SkelWorld:
    """The file of a world: a skeleton for each tree."""
    at_zero = zero_poses(world)
    static = {name for name, group in rigid_groups(world).items() if group == "world"}
    return SkelWorld(
        world.name,
        world.physics.timestep,
        world.physics.gravity,
        None,
        tuple(
            Skeleton(
                root,
                not all(body.name in static for body in bodies),
                tuple(_body(body, at_zero[body.name]) for body in bodies),
                tuple(_joint(body) for body in bodies),
            )
            for root, bodies in trees(world).items()
        ),
    )


def renamed(world: World) -> Iterator[Loss]:
    """The body whose name the language gives to the world."""
    for body in world.bodies:
        if body.name in RESERVED:
            how = f"called {file_name(body.name)!r}: the world itself has its name"
            yield Loss("body.name", LossFate.APPROXIMATED, how, (f"bodies.{body.name}",))


def _body(body: Body, at_zero: Pose) -> SkelBody:
    return SkelBody(
        file_name(body.name),
        at_zero,
        body.inertial,
        tuple(SkelShape(shape.kind, shape.size, shape.pose, shape.colour) for shape in body.shapes if shape.visual),
        tuple(SkelShape(shape.kind, shape.size, shape.pose) for shape in body.shapes if shape.collision),
    )


def _joint(body: Body) -> SkelJoint:
    joint = body.joint
    single = joint.kind in SCALAR_JOINTS
    position, velocity = coordinates(joint, _rotation_vector)
    return SkelJoint(
        joint.name,
        joint.kind,
        None if joint.parent is None else file_name(joint.parent),
        file_name(body.name),
        joint.axis if single else None,
        joint.position_limits,
        joint.dry_friction,
        position,
        velocity,
        joint.damping,
        joint.spring_stiffness,
        joint.spring_rest,
    )


def _rotation_vector(q: Quaternion) -> Vector3:
    w, x, y, z = q
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * frames.angle(sine, w) / sine if sine else 0.0
    return (x * factor, y * factor, z * factor)


WORLD: Final = "world.skel"


class Skel(Format):
    """The .skel language, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "skel"
    SUPPORT: ClassVar[Table] = SUPPORT

    def write(self, tree: SkelWorld) -> dict[str, str]:
        """``world.skel``, and the files of its meshes. Raises KeyError for kinds of joints and shapes that the language does
        not have, and ValueError for numbers that are not finite."""
        content = {
            "name": tree.name,
            "timestep": tree.timestep,
            "gravity": tree.gravity,
            "collision_detector": tree.collision_detector,
            "skeletons": [
                {
                    "name": skeleton.name,
                    "mobile": "true" if skeleton.mobile else "false",
                    "bodies": [_body_words(body) for body in skeleton.bodies],
                    "joints": [_joint_words(joint) for joint in skeleton.joints],
                }
                for skeleton in tree.skeletons
            ],
        }
        bodies = (body for skeleton in tree.skeletons for body in skeleton.bodies)
        shapes = (shape for body in bodies for shape in (*body.visual, *body.collision))
        meshes = mesh_files(shape.size for shape in shapes if shape.kind == "mesh")
        return {WORLD: environment().get_template("skel/world.skel.j2").render(content), **meshes}

    def plain(self, world: types.World) -> PlainFiles:
        """``world.skel``, without a collision detector's name."""
        world = without_implicit_damping(world)
        return PlainFiles(self.write(plain_tree(world)), losses(world, SUPPORT, renamed(world)))

    def read(self, folder: Path) -> SkelDocument:
        """The document of ``world.skel`` in ``folder``, with the files of meshes below it.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no
        .skel, or a mesh is no convex hull.
        """
        from simspec.formats.skel.reading import read_document

        return dataclasses.replace(read_document(folder / WORLD), meshes=read_meshes(folder))


def _transformation(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *frames.to_euler_xyz(pose.quaternion))


def _body_words(body: SkelBody) -> dict[str, Any]:
    return {
        "name": body.name,
        "pose": _transformation(body.pose),
        "mass": body.inertial.mass,
        "inertia": body.inertial.inertia,
        "centre_of_mass": body.inertial.centre_of_mass,
        "visual": [_shape(shape) for shape in body.visual],
        "collision": [_shape(shape) for shape in body.collision],
    }


def _shape(shape: SkelShape) -> dict[str, Any]:
    sizes: tuple[tuple[str, tuple[float, ...] | str], ...] = PLANE
    if shape.kind == "mesh":
        sizes = (("file_name", mesh_file(shape.size)), ("scale", UNSCALED))
    elif shape.kind != "plane":
        parts, factor = GEOMETRY[shape.kind]
        sizes = tuple((name, tuple(value * factor for value in shape.size[part])) for name, part in parts)
    return {"kind": shape.kind, "sizes": sizes, "pose": _transformation(shape.pose), "colour": shape.colour}


def _joint_words(joint: SkelJoint) -> dict[str, Any]:
    return {
        "name": joint.name,
        "type": JOINT_TYPES[joint.kind],
        "parent": "world" if joint.parent is None else joint.parent,
        "child": joint.child,
        "axis": joint.axis,
        "limits": joint.position_limits,
        "damping": joint.damping,
        "dry_friction": joint.dry_friction,
        "spring_rest": joint.spring_rest,
        "spring_stiffness": joint.spring_stiffness,
        "position": joint.position,
        "velocity": joint.velocity,
    }
