"""Bodies, joints, shapes and constraints of a world as parts of an MJCF model."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from simspec.formats.kit.text import DIGITS, hulls_of, mesh_file, mesh_name, numbers
from simspec.formats.mjcf import tree
from simspec.formats.mjcf.tree import (
    Attributes,
    MjcfEquality,
    MjcfHeightField,
    MjcfInertial,
    MjcfKey,
    MjcfMesh,
    MjcfSite,
    MjcfTendon,
    Value,
)
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world import frames
from simspec.world.actions import JointSum
from simspec.world.inertia import moments_along, principal_axes
from simspec.world.kinematics import carried
from simspec.world.shapes import field_of
from simspec.world.types import (
    Body,
    ConnectConstraint,
    Constraint,
    FollowConstraint,
    Joint,
    PairContact,
    Pose,
    Quaternion,
    Shape,
    Surface,
    Vector3,
    World,
)

_RESERVED: Final = {"world": "world."}
"""The static root is called ``world``; a body of that name gets one that no spec can give."""


def file_name(name: str) -> str:
    """The name of a body in the file."""
    return _RESERVED.get(name, name)


def world_name(name: str) -> str:
    """The inverse of :func:`file_name`."""
    return {there: here for here, there in _RESERVED.items()}.get(name, name)


# --- bodies: depth first, one body for all joints between it and its parent ---
# Joints of a body act in sequence, each about its place and axis in the body's frame with all joints at zero. With C_i the
# frame of joint i in the parent's body at zero and J_i its displacement, the world's O_1 J_1 O_2 J_2 … O_n J_n is C_n Π (D_i
# J_i D_i⁻¹), D_i = C_n⁻¹ C_i: a hinge or slide about the axis of frame D_i. The coordinates of a ball are turned by D_i: a ball
# is the last joint, and its D is the identity.


@dataclass(frozen=True, slots=True)
class BodyRow:
    """A body of the file.

    body    the body of the world
    depth   how many bodies it stands in
    place   its frame in its parent's, all joints at zero
    joints  its joints in order, each with its frame in the body's, all joints at zero; none where it is fixed
    """

    body: Body
    depth: int
    place: Pose
    joints: tuple[tuple[Joint, Pose], ...]


def depth_first(world: World) -> list[BodyRow]:
    """The bodies in the order of the file."""
    rows = carried(world)
    above = {body: row[0].joint.parent for body, row in rows.items()}
    inside = {carrier.name for row in rows.values() for carrier in row}
    children: dict[str | None, list[Body]] = {}
    for body in world.bodies:
        if body.name not in inside:
            children.setdefault(above.get(body.name, body.joint.parent), []).append(body)
    order: list[BodyRow] = []
    waiting = [(body, 0) for body in reversed(children.get(None, []))]
    while waiting:
        body, depth = waiting.pop()
        order.append(_row(body, depth, rows.get(body.name, ())))
        waiting.extend((child, depth + 1) for child in reversed(children.get(body.name, [])))
    return order


def _row(body: Body, depth: int, carriers: Sequence[Body]) -> BodyRow:
    joint = body.joint
    if joint.kind == "free":  # it stands where it begins
        place = Pose(joint.position[:3], joint.position[3:7])  # type: ignore[arg-type]
        return BodyRow(body, depth, place, ((joint, Pose()),))
    if not carriers:
        return BodyRow(body, depth, joint.origin, () if joint.kind == "fixed" else ((joint, Pose()),))
    joints = [*(carrier.joint for carrier in carriers), joint]
    placed = [joints[0].origin]
    for following in joints[1:]:
        placed.append(frames.compose(placed[-1], following.origin))
    # backwards from the body, so that a step that is zero stays zero
    in_body = [Pose()]
    for following in reversed(joints[1:]):
        in_body.insert(0, frames.compose(in_body[0], frames.inverse(following.origin)))
    return BodyRow(body, depth, placed[-1], tuple(zip(joints, in_body, strict=True)))


def carrier_frames(rows: Sequence[BodyRow], world: World) -> Mapping[str, Quaternion]:
    """The transform between two joints of one body, by name: the orientation of its frame in the body's, all joints at zero."""
    carriers = carried(world)
    return {
        carrier.name: frame.quaternion
        for row in rows
        for carrier, (_, frame) in zip(carriers.get(row.body.name, ()), row.joints[:-1], strict=True)
    }


# --- inertias, shapes, joints, keyframes ---

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
"""The factor of each number of ``Shape.size``: MJCF has half lengths."""
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


def inertial_of(body: Body) -> MjcfInertial | None:
    """Mass and principal moments; None without mass."""
    if not body.inertial.mass:
        return None
    moments, turn = principal_axes(body.inertial.inertia)
    if body.box is not None and (along := moments_along(body.inertial.inertia, body.box.quaternion)) is not None:
        moments, turn = along, body.box.quaternion  # of equal moments any axes would do, but for what a fluid does
    return MjcfInertial(body.inertial.centre_of_mass, turn, body.inertial.mass, moments)


def meshes_of(world: World) -> tuple[MjcfMesh, ...]:
    """The meshes of a world, each distinct hull once."""
    return tuple(MjcfMesh(mesh_name(hull), mesh_file(hull), hull, MESH) for hull in hulls_of(world))


def heightfields_of(world: World) -> tuple[MjcfHeightField, ...]:
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
            MjcfHeightField(
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
    row: BodyRow,
    joints: tuple[tree.MjcfJoint, ...],
    geoms: tuple[tree.MjcfGeom, ...],
    more: tree.Attributes = (),
    sites: tuple[tree.MjcfSite, ...] = (),
) -> tree.MjcfBody:
    """A body in its parent, with its inertia; without joints: welded to it."""
    return tree.MjcfBody(
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


def geom_of(shape: Shape, class_name: str, more: tree.Attributes) -> tree.MjcfGeom:
    """A shape of the class ``class_name``, with further attributes."""
    mesh = mesh_name(shape.size) if shape.kind == "mesh" else ""
    return tree.MjcfGeom(
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


GRAVCOMP = "simspec writes gravcomp = 1 − scale, for scales up to 1"
FRAME_SITE = "simspec writes a site"
SINGLE_NUMBER = "MJCF has one number for translation and rotation of a free joint, in SI units"
"""MJCF's support for damping and armature of free joints."""


def single_number(name: str, world: World) -> Refinement | None:
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


def keyframe(name: str, rows: Sequence[BodyRow]) -> MjcfKey:
    """The initial state of the joints."""
    joints = [joint for row in rows for joint, _ in row.joints]
    return MjcfKey(
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


# --- constraints: equalities of joints, and of sites in the bodies that they join ---

NOWHERE: Vector3 = (0.0, 0.0, 0.0)
SITE: Final = "constraint/"
"""Prefix of the two sites of a connect or a weld; behind it the constraint's name, and which of the two it is."""


def ends(constraint: Constraint, anchor: Vector3 = NOWHERE) -> tuple[Pose, Pose]:
    """The frames in the two bodies that a connect or a weld holds together, a weld at ``anchor`` in its second body."""
    if isinstance(constraint, FollowConstraint):
        raise TypeError(f"{constraint.name!r} couples joints, and holds no bodies")
    if isinstance(constraint, ConnectConstraint):
        return Pose(constraint.first_point), Pose(constraint.second_point)
    return frames.compose(constraint.pose, Pose(anchor)), Pose(anchor)


def sites_of(
    world: World, offsets: Mapping[str, Vector3], anchors: Mapping[str, Vector3] = MappingProxyType({})
) -> dict[str, tuple[MjcfSite, ...]]:
    """The sites of constraints on every body that has some; ``offsets``: where the file's frames of free roots stand in the
    world's; ``anchors``: by the name of a weld the point of its second body at which it is held (default: its origin)."""
    sites: dict[str, tuple[MjcfSite, ...]] = {}
    for constraint in world.constraints:
        if isinstance(constraint, FollowConstraint):
            continue
        bodies = (constraint.first, constraint.second)
        for number, (body, end) in enumerate(
            zip(bodies, ends(constraint, anchors.get(constraint.name, NOWHERE)), strict=True), start=1
        ):
            place = frames.subtract(end.position, offsets.get(body, NOWHERE))
            site = MjcfSite(f"{SITE}{constraint.name}/{number}", place, end.quaternion)
            sites[body] = (*sites.get(body, ()), site)
    return sites


def frame_sites(world: World, offsets: Mapping[str, Vector3]) -> dict[str, tuple[MjcfSite, ...]]:
    """The named frames on every body that has some, as sites; ``offsets`` as of :func:`sites_of`."""
    sites: dict[str, tuple[MjcfSite, ...]] = {}
    for frame in world.frames:
        place = frames.subtract(frame.pose.position, offsets.get(frame.body, NOWHERE))
        site = MjcfSite(frame.name, place, frame.pose.quaternion)
        sites[frame.body] = (*sites.get(frame.body, ()), site)
    return sites


def equalities(world: World, more: Attributes = ()) -> tuple[MjcfEquality, ...]:
    """One equality for each constraint, with further attributes."""
    written = []
    for constraint in world.constraints:
        if isinstance(constraint, FollowConstraint):
            coefficients = (constraint.offset, constraint.ratio, 0.0, 0.0, 0.0)
            attributes: Attributes = (
                ("joint1", constraint.joint),
                ("joint2", constraint.leader),
                ("polycoef", coefficients),
            )
            written.append(MjcfEquality("joint", constraint.name, (*attributes, *more)))
        else:
            attributes = (("site1", f"{SITE}{constraint.name}/1"), ("site2", f"{SITE}{constraint.name}/2"))
            written.append(MjcfEquality(constraint.kind, constraint.name, (*attributes, *more)))
    return tuple(written)


# --- sums of joint positions: fixed tendons ---


def tendons(world: World, limited: Attributes = (), rubbed: Attributes = ()) -> tuple[MjcfTendon, ...]:
    """One fixed tendon for each sum; ``limited``, ``rubbed``: attributes of those with limits, and with dry friction."""
    return tuple(
        MjcfTendon(
            sum_.name,
            sum_.joints,
            (*_acting(sum_), *(limited if sum_.position_limits else ()), *(rubbed if sum_.dry_friction else ())),
        )
        for sum_ in world.sums
    )


def _acting(joint_sum: JointSum) -> Attributes:
    """The attributes of forces along it. The length of a fixed tendon is the sum itself, of joint positions as the file counts
    them."""
    attributes: list[tuple[str, Value]] = [
        ("limited", joint_sum.position_limits is not None),
        ("range", joint_sum.position_limits or (0.0, 0.0)),
        ("stiffness", joint_sum.stiffness),
        ("springlength", joint_sum.rest),
        ("damping", joint_sum.damping),
        ("frictionloss", joint_sum.dry_friction),
        ("margin", 0.0),
    ]
    return tuple(attributes)
