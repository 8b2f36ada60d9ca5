"""Robots of URDF as plain values, which ``templates/urdf/`` prints in this order.

Frames and units are those of URDF: a link's frame is that of the joint above it, ``rpy`` are angles (rad) about fixed x, y,
z, a box has full edge lengths, a cylinder lies along z.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from simspec.formats.kit.text import field_file, mesh_file
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.world import frames
from simspec.world.inertia import principal_axes
from simspec.world.types import (
    Body,
    FollowConstraint,
    Frame,
    Pose,
    Shape,
    Vector3,
)
from simspec.world.types import (
    Inertial as TypesInertial,
)
from simspec.world.types import (
    Inertial as WorldInertial,
)

Attributes = tuple[tuple[str, float | tuple[float, ...] | str], ...]
"""Names and values, in the order of the file; several numbers are separated by spaces."""

JOINT_TYPES: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
"""The language's types of joints."""
GEOMETRIES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("filename", "scale"),
}
"""The language's geometries, with their attributes."""


@dataclass(frozen=True, slots=True)
class UrdfOrigin:
    """Where a frame stands in another: position (m), and turns about fixed x, then y, then z (rad)."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class UrdfExtension:
    """An element that is not of the language, printed as it is."""

    tag: str
    attributes: Attributes = ()
    children: tuple[UrdfExtension, ...] = ()


@dataclass(frozen=True, slots=True)
class UrdfInertial:
    """Mass (kg), and the inertia (ixx, iyy, izz, ixy, ixz, iyz; kg m²) about ``origin``, in its axes."""

    origin: UrdfOrigin
    mass: float
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class UrdfGeometry:
    """The element in a ``geometry``: one of ``GEOMETRIES``, or a dialect's own. ``mesh``: the vertices (flat, m) of the convex
    hull in the file that it names. ``field``: the size of the height field in it."""

    tag: str
    attributes: Attributes
    mesh: tuple[float, ...] = ()
    field: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class UrdfMaterial:
    """A material of a visual: its name, and its colour (red, green, blue, opacity)."""

    name: str
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class UrdfVisual:
    """A shape that is seen."""

    name: str
    geometry: UrdfGeometry
    origin: UrdfOrigin | None = None
    material: UrdfMaterial | None = None


@dataclass(frozen=True, slots=True)
class UrdfCollision:
    """A shape that touches. ``more``: attributes that are not of the language."""

    name: str
    geometry: UrdfGeometry
    origin: UrdfOrigin | None = None
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class UrdfLink:
    """A rigid body. ``extensions`` stand behind its ``inertial``."""

    name: str
    inertial: UrdfInertial | None = None
    visuals: tuple[UrdfVisual, ...] = ()
    collisions: tuple[UrdfCollision, ...] = ()
    extensions: tuple[UrdfExtension, ...] = ()


@dataclass(frozen=True, slots=True)
class UrdfDynamics:
    """Damping (N m s/rad, N s/m) and dry friction (N m, N) of a joint."""

    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True, slots=True)
class UrdfMimic:
    """That a joint's position is ``multiplier`` times another's, plus ``offset`` (rad, m)."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint: ``origin`` is its frame in the parent's, which is the child's where the joint is at zero; ``axis`` is in that
    frame. ``limit``: attributes of the element, none: no such element."""

    name: str
    type: str
    parent: str
    child: str
    origin: UrdfOrigin
    axis: Vector3 | None = None
    dynamics: UrdfDynamics | None = None
    limit: tuple[tuple[str, float], ...] = ()
    mimic: UrdfMimic | None = None


@dataclass(frozen=True, slots=True)
class UrdfRobot:
    """One file: a tree of links. The link that is no joint's child is its root."""

    name: str
    links: tuple[UrdfLink, ...]
    joints: tuple[UrdfJoint, ...] = ()
    extensions: tuple[UrdfExtension, ...] = ()
    """Elements that are not of the language, before the links."""


Robots = Mapping[str, UrdfRobot]
"""A whole tree of the format: robots by the name of their file."""


def nameless(robot: UrdfRobot) -> UrdfRobot:
    """The same robot with all names replaced by their places: equal ones can share a file."""
    links = {link.name: str(index) for index, link in enumerate(robot.links)}
    joints = {joint.name: str(index) for index, joint in enumerate(robot.joints)}

    def bare(mimic: UrdfMimic | None) -> UrdfMimic | None:
        return None if mimic is None else dataclasses.replace(mimic, joint=joints[mimic.joint])

    return UrdfRobot(
        "",
        tuple(
            dataclasses.replace(
                link,
                name=links[link.name],
                visuals=tuple(
                    dataclasses.replace(
                        visual,
                        name="",
                        material=None if visual.material is None else dataclasses.replace(visual.material, name=""),
                    )
                    for visual in link.visuals
                ),
                collisions=tuple(dataclasses.replace(collision, name="") for collision in link.collisions),
            )
            for link in robot.links
        ),
        tuple(
            dataclasses.replace(
                joint, name="", parent=links[joint.parent], child=links[joint.child], mimic=bare(joint.mimic)
            )
            for joint in robot.joints
        ),
        robot.extensions,
    )


GEOMETRY: Final[Mapping[str, tuple[str, tuple[tuple[str, slice], ...]]]] = {
    "sphere": ("sphere", (("radius", slice(0, 1)),)),
    "box": ("box", (("size", slice(0, 3)),)),
    "cylinder": ("cylinder", (("radius", slice(0, 1)), ("length", slice(1, 2)))),
}
"""For each kind of shape with a few sizes the element, and which part of ``Shape.size`` goes into which attribute."""
KINDS: Final = (*GEOMETRY, "mesh")
"""The kinds of shapes that the language has."""


UNLIMITED: Final = 1e9
"""The value written where the language demands a limit, and the world has none."""
WORLD_LINK: Final = "world"
"""The link without mass that stands for the world, where a tree is fixed to it."""


def origin_of(pose: Pose) -> UrdfOrigin:
    """A pose as URDF's position and fixed-axis angles."""
    return UrdfOrigin(pose.position, frames.to_rpy(pose.quaternion))


def principal_inertial(inertial: WorldInertial) -> UrdfInertial:
    """Mass and principal moments, in a frame of the principal axes: no product of inertia is left."""
    moments, turn = principal_axes(inertial.inertia)
    return UrdfInertial(origin_of(Pose(inertial.centre_of_mass, turn)), inertial.mass, (*moments, 0.0, 0.0, 0.0))


def full_inertial(inertial: WorldInertial) -> UrdfInertial:
    """Mass and the whole tensor, in axes parallel to the body's."""
    return UrdfInertial(UrdfOrigin(inertial.centre_of_mass), inertial.mass, inertial.inertia)


def geometry_of(shape: Shape) -> UrdfGeometry:
    """The geometry of a shape that the language has, and of a height field its closed surface. Raises KeyError for others."""
    if shape.kind == "mesh":
        return UrdfGeometry("mesh", (("filename", mesh_file(shape.size)),), shape.size)
    if shape.kind == "heightfield":
        return UrdfGeometry("mesh", (("filename", field_file(shape.size)),), field=shape.size)
    tag, parts = GEOMETRY[shape.kind]
    attributes: Attributes = tuple((name, shape.size[part]) for name, part in parts)
    return UrdfGeometry(tag, attributes)


def visual_of(shape: Shape, geometry: UrdfGeometry, material: str) -> UrdfVisual:
    """A shape that is seen, in a material of this name."""
    return UrdfVisual(shape.name, geometry, origin_of(shape.pose), UrdfMaterial(material, shape.colour))


def collision_of(shape: Shape, geometry: UrdfGeometry) -> UrdfCollision:
    """A shape that touches."""
    return UrdfCollision(shape.name, geometry, origin_of(shape.pose))


def unlike(name: str, taken: set[str]) -> str:
    """``name``, with as many underscores as make it unlike those ``taken``."""
    while name in taken:
        name += "_"
    return name


def limits_of(body: Body) -> tuple[tuple[str, float], ...]:
    """Attributes of a joint's ``limit``, as far as the world has them."""
    joint = body.joint
    limits: list[tuple[str, float]] = []
    if joint.position_limits is not None:
        limits += zip(("lower", "upper"), joint.position_limits, strict=True)
    if joint.effort_limit is not None:
        limits.append(("effort", joint.effort_limit))
    if joint.velocity_limit is not None:
        limits.append(("velocity", joint.velocity_limit))
    return tuple(limits)


class RobotFiles:
    """The robots of a folder by file: equal ones, apart from their names, share the file of the first."""

    def __init__(self, taken: set[str]) -> None:
        """``taken``: names of files that are there already, in small letters."""
        self.robots: dict[str, UrdfRobot] = {}
        self._taken = taken
        self._file_of: dict[Hashable, str] = {}

    def add(self, robot: UrdfRobot, variant: Hashable = None) -> str:
        """The name of the file that holds ``robot``, or one like it with the same ``variant``."""
        key = (nameless(robot), variant)
        file = self._file_of.get(key)
        if file is None:
            file = self._file_of[key] = self._file_name(robot.name)
            self.robots[file] = robot
        return file

    def _file_name(self, name: str) -> str:
        """A safe file name for a tree, unlike those taken (also where letters' case makes no difference)."""
        stem = re.sub(r"[^A-Za-z0-9_-]", ".", name).strip(".") or "tree"
        file, count = f"{stem}.urdf", 1
        while file.lower() in self._taken:
            count += 1
            file = f"{stem}.{count}.urdf"
        self._taken.add(file.lower())
        return file


# --- a tree of bodies as a robot of plain URDF ---
# A root that is not free hangs on a link for the world. A ball joint is three hinges, a capsule a cylinder and two spheres, a
# plane a large box; an ellipsoid is left out. Limits that the language demands are UNLIMITED.

PLANE_EDGE: Final = 200.0
"""Metres: length and width of the box that stands for a plane; its top is in the plane."""
PLANE_DEPTH: Final = 1.0
LANGUAGE_KINDS: Final = KINDS
"""The kinds of shapes that the language has."""
NOT_PUT: Final = tuple(kind for kind in SHAPE_KINDS if kind not in (*LANGUAGE_KINDS, "plane", "capsule"))
"""The kinds for which nothing stands."""
AXES: Final[tuple[tuple[str, Vector3], ...]] = (
    ("x", (1.0, 0.0, 0.0)),
    ("y", (0.0, 1.0, 0.0)),
    ("z", (0.0, 0.0, 1.0)),
)
"""Of the three hinges of a ball joint, from the parent on."""


def standard_robot(
    bodies: tuple[Body, ...],
    kinds: Collection[str] = (),
    follows: Iterable[FollowConstraint] = (),
    named: Iterable[Frame] = (),
) -> UrdfRobot:
    """The robot that a tree is; of shapes only those of ``kinds``, where some are given. Links stand in the order of the
    bodies, after the world's, and behind them those of frames. ``follows``, ``named``: the couplings and the frames within the
    tree that it is to say."""
    root = bodies[0]
    link_names = {body.name for body in bodies}
    joint_names = {body.joint.name for body in bodies}
    mimics = {follow.joint: UrdfMimic(follow.leader, follow.ratio, follow.offset) for follow in follows}
    links: list[UrdfLink] = []
    joints: list[UrdfJoint] = []
    world_link = unlike(WORLD_LINK, link_names)
    if root.joint.kind != "free":
        links.append(UrdfLink(world_link))
    for body in bodies:
        shapes = [shape for shape in body.shapes if not kinds or shape.kind in kinds]
        parts = [part for shape in shapes for part in parts_of(shape)]
        visuals = [_visual(part) for part in parts if part.visual]
        collisions = [_collision(part) for part in parts if part.collision]
        inertial = None if body.inertial == TypesInertial(0.0) else full_inertial(body.inertial)
        if body.joint.kind == "ball":
            for link, joint in _three_hinges(body, body.joint.parent or world_link, link_names, joint_names):
                links.extend(() if link is None else (link,))
                joints.append(joint)
        elif body.joint.kind != "free":
            joints.append(_joint(body, body.joint.parent or world_link, mimics.get(body.joint.name)))
        links.append(UrdfLink(body.name, inertial, tuple(visuals), tuple(collisions)))
    for frame in named:
        joint_name = unlike(f"{frame.name}_joint", joint_names)
        joint_names.add(joint_name)
        links.append(UrdfLink(frame.name))
        joints.append(UrdfJoint(joint_name, "fixed", frame.body, frame.name, origin_of(frame.pose)))
    return UrdfRobot(root.model, tuple(links), tuple(joints))


def parts_of(shape: Shape) -> tuple[Shape, ...]:
    """The shapes of the language that stand for a shape; together they are the same solid, but for a plane's edges."""
    if shape.kind in LANGUAGE_KINDS:
        return (shape,)
    if shape.kind == "plane":
        below = frames.compose(shape.pose, Pose((0.0, 0.0, -PLANE_DEPTH / 2.0)))
        return (dataclasses.replace(shape, kind="box", size=(PLANE_EDGE, PLANE_EDGE, PLANE_DEPTH), pose=below),)
    if shape.kind == "capsule":
        radius, length = shape.size
        ends = (("top", length / 2.0), ("bottom", -length / 2.0))
        return (
            dataclasses.replace(shape, kind="cylinder"),
            *(
                dataclasses.replace(
                    shape,
                    name=f"{shape.name}__{name}",
                    kind="sphere",
                    size=(radius,),
                    pose=frames.compose(shape.pose, Pose((0.0, 0.0, height))),
                )
                for name, height in ends
            ),
        )
    if shape.kind in NOT_PUT:
        return ()
    raise KeyError(f"URDF has no {shape.kind}, and nothing is said to stand for it")


def _visual(shape: Shape) -> UrdfVisual:
    return visual_of(shape, geometry_of(shape), f"{shape.name}_colour")


def _collision(shape: Shape) -> UrdfCollision:
    return collision_of(shape, geometry_of(shape))


def _joint(body: Body, parent: str, mimic: UrdfMimic | None) -> UrdfJoint:
    joint = body.joint
    limits = dict(limits_of(body))
    kind = "fixed"
    if joint.kind == "hinge":
        kind = "continuous" if joint.position_limits is None else "revolute"
    elif joint.kind == "slide":
        kind = "prismatic"
        limits = {"lower": -UNLIMITED, "upper": UNLIMITED, **limits}
    if limits:
        limits = {**limits, "effort": limits.get("effort", UNLIMITED), "velocity": limits.get("velocity", UNLIMITED)}
    moves = kind != "fixed"
    return UrdfJoint(
        joint.name,
        kind,
        parent,
        body.name,
        origin_of(joint.origin),
        joint.axis if moves else None,
        UrdfDynamics(joint.damping, joint.dry_friction) if moves else None,
        tuple(limits.items()) if moves else (),
        mimic,
    )


def _three_hinges(
    body: Body, parent: str, link_names: set[str], joint_names: set[str]
) -> Iterator[tuple[UrdfLink | None, UrdfJoint]]:
    """Hinges about x, y and z, each with the link below it; None for the body's own."""
    origin = origin_of(body.joint.origin)
    for name, axis in AXES:
        last = name == AXES[-1][0]
        child = body.name if last else unlike(f"{body.name}__{name}", link_names)
        joint = unlike(f"{body.joint.name}__{name}", joint_names)
        link_names.add(child)
        joint_names.add(joint)
        dynamics = UrdfDynamics(body.joint.damping)
        yield None if last else UrdfLink(child), UrdfJoint(joint, "continuous", parent, child, origin, axis, dynamics)
        parent, origin = child, UrdfOrigin()
