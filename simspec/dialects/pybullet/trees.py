"""A tree of bodies as a robot of PyBullet's URDF, and where it stands."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final

from simspec.contact.parts import Part
from simspec.dialects.kit.coordinates import Coordinates
from simspec.dialects.pybullet.contact import contact_values, copy_name
from simspec.dialects.pybullet.hulls import LINK_MARGIN, told_shapes
from simspec.dialects.pybullet.sidecar import FIXED, FREE, WORLD_LINK, Copy, Frame, Instance
from simspec.formats.urdf.from_world import (
    collision_of,
    geometry_of,
    limits_of,
    origin_of,
    principal_inertial,
    unlike,
    visual_of,
)
from simspec.formats.urdf.tree import (
    Collision,
    Dynamics,
    Element,
    Geometry,
    Inertial,
    Joint,
    Link,
    Origin,
    Robot,
    Visual,
)
from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.world.types import Body, Pose, Shape, Surface

Parts = Mapping[str, tuple[Part, ...]]
"""Of each body its collision shapes, by link: its own, then those of further links."""

JOINT_TYPES: Final[Mapping[str, str]] = {
    "fixed": "fixed",
    "hinge": "continuous",
    "slide": "prismatic",
    "ball": "spherical",
}
"""The name of each joint kind; a hinge with position limits is ``revolute``."""

UNLIMITED_SLIDE: Final = (("lower", 1.0), ("upper", -1.0))
"""URDF has no unlimited prismatic joint; PyBullet takes lower > upper as one."""

PLANE: Final = Geometry("plane", (("normal", (0.0, 0.0, 1.0)),))

UNSEEN: Final = Visual("unseen", Geometry("sphere", (("radius", 0.0),)))
"""A visual of no size: PyBullet shows the collision shapes of a link that has no visual at all (measured)."""

CONCAVE: Final = (("concave", "yes"),)
"""Of a collision: its mesh is taken as the triangles that it is, not as their hull."""

NO_AXIS: Final = (1.0, 0.0, 0.0)
"""Of joints that have none: without one PyBullet warns and takes x."""

MASSLESS: Final = Inertial(Origin(), 0.0, (0.0,) * 6)

WORLD_SUFFIX: Final = "__world"
"""Added to a root's name for the massless base link that stands for the world."""


def has_world_link(root: Body) -> bool:
    """Whether a tree needs a massless base link that stands for the world.

    A root on a hinge, slide or ball has a joint to the world, and PyBullet drops the mass of a fixed base (measured:
    read back as 0), so that a fixed root with a mass must be a link as well.
    """
    return root.joint.kind in TREE_JOINTS or (root.joint.kind == "fixed" and root.inertial.mass > 0.0)


def frame_of(body: Body) -> Frame:
    """A body that PyBullet is not told, and where it is on the body that carries it."""
    parent = body.joint.parent
    if parent is None:
        raise ValueError(f"the frame {body.name!r} is on no body")
    return Frame(body.name, body.model, body.joint.name, parent, body.joint.origin)


def instance_of(file: str, bodies: tuple[Body, ...], parts: Parts, coordinates: Coordinates) -> Instance:
    """Where one tree stands and how it begins. ``bodies`` are in the order of the file's links (after the world link)."""
    root = bodies[0]
    q, v = coordinates.of(bodies)
    free = root.joint.kind == "free"
    return Instance(
        file=file,
        model=root.model,
        root=FREE if free else WORLD_LINK if has_world_link(root) else FIXED,
        base=Pose((q[0], q[1], q[2]), (q[3], q[4], q[5], q[6])) if free else root.joint.origin,
        bodies=tuple(body.name for body in bodies),
        joints=tuple(body.joint.name for body in bodies),
        shapes=tuple(tuple(shape.name for shape in body.shapes) for body in bodies),
        visual_only=tuple(tuple(i for i, shape in enumerate(body.shapes) if not shape.collision) for body in bodies),
        copies=tuple(
            Copy(copy_name(part), body.name, part.layer, tuple(shape.name for shape in part.shapes))
            for body in bodies
            for part in parts[body.name][1:]
        ),
        layers=tuple(parts[body.name][0].layer for body in bodies),
        position=q,
        velocity=v,
    )


def robot_of(bodies: tuple[Body, ...], parts: Parts, base_margin: float) -> Robot:
    """The robot that a tree is: a world link where it needs one, the bodies' links, then the links of further shapes.
    ``base_margin``: what PyBullet keeps around hulls on the first link (m)."""
    root = bodies[0]
    links: list[Link] = []
    joints: list[Joint] = []
    world_link = unlike(root.name + WORLD_SUFFIX, {body.name for body in bodies})
    if has_world_link(root):
        links.append(_carrier(world_link, Surface(), ()))
    told: dict[str, dict[str, Shape]] = {}
    for body in bodies:
        own = parts[body.name][0]
        margin = LINK_MARGIN if links else base_margin
        shapes = told[body.name] = told_shapes(body, parts[body.name], margin)
        links.append(
            Link(
                body.name,
                principal_inertial(body.inertial),
                *_shown(tuple(shapes.values()), tuple(shapes[shape.name] for shape in own.shapes)),
                extensions=(_contact(own.surface),),
            )
        )
        if body.joint.parent is not None:
            joints.append(_joint(body, body.joint.parent, body.joint.origin))
        elif has_world_link(root):
            joints.append(_joint(body, world_link, Pose()))
    for body in bodies:
        for part in parts[body.name][1:]:
            name = copy_name(part)
            carried = tuple(told[body.name][shape.name] for shape in part.shapes)
            links.append(_carrier(name, part.surface, carried))
            joints.append(Joint(f"{name}.joint", JOINT_TYPES["fixed"], body.name, name, Origin(), NO_AXIS))
    return Robot(root.model, tuple(links), tuple(joints))


def _carrier(name: str, surface: Surface, shapes: tuple[Shape, ...]) -> Link:
    """A massless link, which carries shapes that touch and are not seen."""
    return Link(name, MASSLESS, *_shown((), shapes), extensions=(_contact(surface),))


def _contact(surface: Surface) -> Element:
    values = contact_values(surface)
    return Element("contact", (), tuple(Element(name, (("value", value),)) for name, value in values))


def _shown(shapes: tuple[Shape, ...], solid: tuple[Shape, ...]) -> tuple[tuple[Visual, ...], tuple[Collision, ...]]:
    """The visuals of ``shapes`` and the collisions of ``solid``."""
    visuals = tuple(visual_of(shape, _geometry(shape), f"{shape.name}_colour") for shape in shapes if shape.visual)
    collisions = tuple(_collision(shape) for shape in solid)
    return visuals or ((UNSEEN,) if collisions else ()), collisions


def _collision(shape: Shape) -> Collision:
    made = collision_of(shape, _geometry(shape))
    return dataclasses.replace(made, more=CONCAVE) if shape.kind == "heightfield" else made


def _geometry(shape: Shape) -> Geometry:
    if shape.kind == "plane":
        return PLANE
    if shape.kind == "capsule":
        return Geometry("capsule", (("radius", shape.size[:1]), ("length", shape.size[1:])))
    return geometry_of(shape)


def _joint(body: Body, parent: str, origin: Pose) -> Joint:
    joint = body.joint
    limits = limits_of(body)
    if joint.kind == "slide" and joint.position_limits is None:
        limits = (*UNLIMITED_SLIDE, *limits)
    limited_hinge = joint.kind == "hinge" and joint.position_limits is not None
    return Joint(
        joint.name,
        "revolute" if limited_hinge else JOINT_TYPES[joint.kind],
        parent,
        body.name,
        origin_of(origin),
        joint.axis if joint.kind in SCALAR_JOINTS else NO_AXIS,
        Dynamics(joint.damping, joint.dry_friction) if joint.kind != "fixed" else None,
        limits,
    )
