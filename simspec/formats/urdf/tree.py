"""What is written: robots of the URDF language as plain values, which ``templates/urdf/`` prints in this order.

Frames and units are URDF's: a link's frame is that of the joint above it, ``rpy`` are fixed-axis angles (rad) about x, y, z, a
box has full edge lengths, a cylinder lies along z. Elements that are not of the language are :class:`Element`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from simspec.world.types import Vector3

Attributes = tuple[tuple[str, float | tuple[float, ...] | str], ...]
"""Names and values, in the order of the file; several numbers stand beside each other with spaces."""

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
class Origin:
    """Where a frame stands in another: position (m), and turns about fixed x, then y, then z (rad)."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Element:
    """An element that is not of the language, printed as it is."""

    tag: str
    attributes: Attributes = ()
    children: tuple[Element, ...] = ()


@dataclass(frozen=True, slots=True)
class Inertial:
    """Mass (kg), and the inertia (ixx, iyy, izz, ixy, ixz, iyz; kg m²) about ``origin``, in its axes."""

    origin: Origin
    mass: float
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Geometry:
    """The element in a ``geometry``: one of ``GEOMETRIES``, or a dialect's own. ``mesh``: the vertices (flat, m) of the convex
    hull in the file that it names. ``field``: the size of the height field in it."""

    tag: str
    attributes: Attributes
    mesh: tuple[float, ...] = ()
    field: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Material:
    """A material of a visual: its name, and its colour (red, green, blue, opacity)."""

    name: str
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Visual:
    """A shape that is seen."""

    name: str
    geometry: Geometry
    origin: Origin | None = None
    material: Material | None = None


@dataclass(frozen=True, slots=True)
class Collision:
    """A shape that touches. ``more``: attributes that are not of the language."""

    name: str
    geometry: Geometry
    origin: Origin | None = None
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid body. ``extensions`` stand behind its ``inertial``."""

    name: str
    inertial: Inertial | None = None
    visuals: tuple[Visual, ...] = ()
    collisions: tuple[Collision, ...] = ()
    extensions: tuple[Element, ...] = ()


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Damping (N m s/rad, N s/m) and dry friction (N m, N) of a joint."""

    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True, slots=True)
class Mimic:
    """That a joint's position is ``multiplier`` times another's, plus ``offset`` (rad, m)."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint: ``origin`` is its frame in the parent's, which is the child's where the joint is at zero; ``axis`` is in that
    frame. ``limit``: attributes of the element, none: no such element."""

    name: str
    type: str
    parent: str
    child: str
    origin: Origin
    axis: Vector3 | None = None
    dynamics: Dynamics | None = None
    limit: tuple[tuple[str, float], ...] = ()
    mimic: Mimic | None = None


@dataclass(frozen=True, slots=True)
class Robot:
    """One file: a tree of links. The link that is no joint's child is its root."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...] = ()
    extensions: tuple[Element, ...] = ()
    """Elements that are not of the language, before the links."""


Robots = Mapping[str, Robot]
"""A whole tree of the format: robots by the name of their file."""


def nameless(robot: Robot) -> Robot:
    """The same robot with all names replaced by their places: equal ones can share a file."""
    links = {link.name: str(index) for index, link in enumerate(robot.links)}
    joints = {joint.name: str(index) for index, joint in enumerate(robot.joints)}

    def bare(mimic: Mimic | None) -> Mimic | None:
        return None if mimic is None else dataclasses.replace(mimic, joint=joints[mimic.joint])

    return Robot(
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
