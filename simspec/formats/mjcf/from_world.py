"""What everybody who writes a world as MJCF has in common: order, frames, inertias, shapes, keyframes."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from typing import Final

from simspec.formats.kit.meshes import DIGITS, hulls_of, mesh_file, mesh_name
from simspec.formats.kit.text import numbers
from simspec.formats.mjcf import tree
from simspec.formats.mjcf.names import file_name
from simspec.formats.mjcf.rows import Row
from simspec.formats.mjcf.tree import Attributes, HeightField, Inertial, Key, Mesh, Value
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world import frames
from simspec.world.inertia import moments_along, principal_axes
from simspec.world.shapes import field_of
from simspec.world.types import Body, Joint, PairContact, Pose, Shape, Surface, World

DEFAULT_COLOUR: Final = (0.7, 0.7, 0.7, 1.0)
GROUPS: Final[Mapping[tuple[bool, bool], int]] = {
    (True, True): 0,
    (False, True): 2,
    (True, False): 3,
    (False, False): 4,
}
"""Geom group of (collision, visual): viewers show 0 to 2 and hide the rest; groups have no other meaning."""
SIZES: Final[Mapping[str, tuple[float, ...]]] = {
    "sphere": (1.0,),
    "box": (0.5, 0.5, 0.5),
    "cylinder": (1.0, 0.5),
    "capsule": (1.0, 0.5),
    "ellipsoid": (1.0, 1.0, 1.0),
}
"""What each number of ``Shape.size`` is multiplied with: MJCF has half lengths."""
HEIGHTFIELD: Final = "heightfield"
TYPES: Final = {HEIGHTFIELD: "hfield"}
"""The language's words for kinds of shapes that it calls otherwise."""
KINDS: Final = ("plane", *SIZES, "mesh", HEIGHTFIELD)
"""The kinds of shapes that the language has."""
MESH: Final[Attributes] = (("inertia", "convex"),)
"""Of every mesh. Masses are stated of bodies: this gives the frame that the vertices are moved to, by the one method that does
not depend on how round-off to single precision turns a face."""
PLANE_SIZE: Final = (0.0, 0.0, 1.0)
"""Infinite in x and y; the third number is the spacing of a viewer's grid."""

CONES: Final[Mapping[str, str]] = {"elliptic": "elliptic", "pyramid-inscribed": "pyramidal"}
"""The word for each cone; the pyramid is the inscribed one."""


def inertial_of(body: Body) -> Inertial | None:
    """Mass and principal moments; None without mass."""
    if not body.inertial.mass:
        return None
    moments, turn = principal_axes(body.inertial.inertia)
    if body.box is not None and (along := moments_along(body.inertial.inertia, body.box.quaternion)) is not None:
        moments, turn = along, body.box.quaternion  # of equal moments any axes would do, but for what a fluid does
    return Inertial(body.inertial.centre_of_mass, turn, body.inertial.mass, moments)


def meshes_of(world: World) -> tuple[Mesh, ...]:
    """The meshes of a world, each distinct hull once."""
    return tuple(Mesh(mesh_name(hull), mesh_file(hull), hull, MESH) for hull in hulls_of(world))


def heightfields_of(world: World) -> tuple[HeightField, ...]:
    """The height fields of a world, each distinct one once. Their elevations are shares of 1 from 0 to 1, so that what readers
    do to them (the least is taken away, all are divided by what the greatest then is) changes nothing."""
    sizes = dict.fromkeys(shape.size for body in world.bodies for shape in body.shapes if shape.kind == HEIGHTFIELD)
    made = []
    for size in sizes:
        field = field_of(size)
        rows, columns = field.shape
        shares = field.heights[::-1] / (field.span or 1.0)
        top = field.span or field.base  # a height of 0 is refused; of flat ground all elevations are 0
        made.append(
            HeightField(
                field_name(size),
                rows,
                columns,
                (0.5 * field.x, 0.5 * field.y, top, field.base),
                tuple(shares.ravel().tolist()),
            )
        )
    return tuple(made)


@functools.lru_cache(maxsize=256)
def field_name(size: tuple[float, ...]) -> str:
    """The name of a height field, by its numbers."""
    return f"field_{hashlib.sha256(numbers(size).encode()).hexdigest()[:DIGITS]}"


def size_of(shape: Shape) -> tuple[float, ...]:
    """The numbers of ``size``; none of a mesh or a height field."""
    if shape.kind == "plane":
        return PLANE_SIZE
    if shape.kind in ("mesh", HEIGHTFIELD):
        return ()
    return tuple(value * factor for value, factor in zip(shape.size, SIZES[shape.kind], strict=True))


def body_of(
    row: Row,
    joints: tuple[tree.Joint, ...],
    geoms: tuple[tree.Geom, ...],
    more: tree.Attributes = (),
    sites: tuple[tree.Site, ...] = (),
) -> tree.Body:
    """A body in its parent, with its inertia; without joints: welded to it."""
    return tree.Body(
        file_name(row.body.name),
        row.place.position,
        row.place.quaternion,
        row.depth,
        inertial_of(row.body),
        joints,
        geoms,
        (*weight_of(row.body), *more),
        sites,
    )


def geom_of(shape: Shape, class_name: str, more: tree.Attributes) -> tree.Geom:
    """A shape of the class ``class_name``, with further attributes."""
    mesh = mesh_name(shape.size) if shape.kind == "mesh" else ""
    return tree.Geom(
        shape.name,
        TYPES.get(shape.kind, shape.kind),
        size_of(shape),
        shape.pose.position,
        shape.pose.quaternion,
        class_name,
        more,
        mesh,
        field_name(shape.size) if shape.kind == HEIGHTFIELD else "",
    )


def margins_of(world: World) -> dict[str, float]:
    """The margin (m) of each shape, by its name: those of a pair are added."""
    return {shape.name: shape.margin for body in world.bodies for shape in body.shapes}


def dimensions(law: PairContact | Surface) -> int:
    """``condim``: the directions in which a contact has friction."""
    if law.rolling_friction:
        return 6
    if law.torsional_friction:
        return 4
    return 3 if law.friction else 1


ONE_NUMBER = "one number for all six coordinates: that of rotation is that of translation, in SI units"
"""What MJCF has of damping and armature of free joints."""


def one_number(name: str, world: World) -> Refinement | None:
    """Not supported where a free body's ``name`` (damping, armature) has two different numbers."""
    for body in world.bodies:
        if body.joint.kind == "free" and getattr(body.joint, name) != getattr(body.joint, f"angular_{name}"):
            return unsupported_if(
                f"{name} of {body.name!r}: MJCF has one number for translation and rotation of a free joint"
            )
    return None


def no_more_than_its_weight(world: World) -> Refinement | None:
    """Not supported where a body has more than its weight: a gravcomp below 0 may be left out (measured)."""
    heavier = next((body.name for body in world.bodies if body.gravity_scale > 1.0), None)
    return (
        None
        if heavier is None
        else unsupported_if(f"gravcomp of {heavier!r} would be below 0, which readers of MJCF may leave out")
    )


def weight_of(body: Body) -> Attributes:
    """The share of a body's weight that is taken away."""
    return (("gravcomp", 1.0 - body.gravity_scale),) if body.gravity_scale != 1.0 else ()


def joint_attributes(joint: Joint, frame: Pose) -> list[tuple[str, Value]]:
    """Place, axis, limits, and the joint's numbers that are not zero; ``frame``: its frame in the body's."""
    more: list[tuple[str, Value]] = []
    if any(frame.position):
        more.append(("pos", frame.position))
    if joint.kind in SCALAR_JOINTS:
        more.append(("axis", frames.rotate(frame.quaternion, joint.axis)))
    if joint.position_limits is not None:
        more += [("limited", True), ("range", joint.position_limits)]
    if joint.angle_limit is not None:
        more += [("limited", True), ("range", (0.0, joint.angle_limit))]
    values = {
        "damping": joint.damping,
        "frictionloss": joint.dry_friction,
        "armature": joint.armature,
        "stiffness": joint.spring_stiffness,
        "springref": joint.spring_rest,
    }
    more.extend((name, value) for name, value in values.items() if value)
    return more


def fluid_options(world: World) -> Attributes:
    """Density, viscosity and velocity of a fluid that some body feels; nothing where there is none."""
    fluid = world.physics.fluid
    if fluid is None or all(body.box is None for body in world.bodies):
        return ()
    return (("density", fluid.density), ("viscosity", fluid.viscosity), ("wind", fluid.velocity))


def keyframe(name: str, rows: Sequence[Row]) -> Key:
    """The initial state of the joints."""
    joints = [joint for row in rows for joint, _ in row.joints]
    return Key(
        name,
        tuple(value for joint in joints for value in joint.position),
        tuple(value for joint in joints for value in keyframe_velocity(joint)),
    )


def keyframe_velocity(joint: Joint) -> tuple[float, ...]:
    """The velocity of a joint in a keyframe: a free one turns about its own axes."""
    if joint.kind != "free":
        return joint.velocity
    turn = frames.conjugate(joint.position[3:7])  # type: ignore[arg-type]
    return (*joint.velocity[:3], *frames.rotate(turn, joint.velocity[3:]))  # type: ignore[arg-type]
