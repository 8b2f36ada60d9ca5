"""Trees of bodies, resolved in their own frames with short names."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

from simspec.language import trees
from simspec.language.joints import Joint as SpecJoint
from simspec.language.models import Body as SpecBody
from simspec.language.strict import required
from simspec.language.trees import Bodies
from simspec.resolve.shapes import PIECE, Resolved, ShapeFiles, fills, orientation, pose, resolved_shape
from simspec.world import frames, inertia
from simspec.world.frames import direction
from simspec.world.inertia import box_of
from simspec.world.kinematics import carrier_name, owner_of
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, Vector3


@dataclass(frozen=True)
class BodyTree:
    """A resolved tree with short names; the root stands first. ``placement`` is the root's own pose; ``positions`` and
    ``velocities``: the joints whose initial ones are stated."""

    bodies: tuple[Body, ...]
    given_names: frozenset[str]
    placement: Pose
    velocity: tuple[Vector3, Vector3]
    positions: frozenset[str] = frozenset()
    velocities: frozenset[str] = frozenset()


def resolved_trees(bodies: Bodies, only: str | None, files: ShapeFiles, boxes: bool = False) -> Iterator[BodyTree]:
    """The trees of ``bodies`` in the order of the file; ``only``: the material of shapes that name none; ``boxes``: whether
    bodies with mass get the box by which they would feel a fluid."""
    materials = bodies.source.file.contact.materials if bodies.source.file is not None else {}
    only = next(iter(materials)) if len(materials) == 1 else only
    shapes = (shape for spec in bodies.typed.values() if spec is not None for shape in spec.shapes)
    shape_names = {shape.name for shape in shapes if shape.name is not None}
    current: list[Body] = []
    named: set[str] = set()
    root: SpecBody | None = None
    for name in bodies.order():
        spec = bodies.content(name)
        if spec.parent is None:
            if root is not None:
                yield _tree(current, named, root, bodies)
            current, named, root = [], set(), spec
        if spec.joint is not None and spec.joint.name is not None:
            named.add(spec.joint.name)
        if spec.joints:  # an implied name is that of the body with an index: it is copied as a given one
            named.update(bodies.joint_names(name))
        moved = _bodies(name, spec, bodies, only, shape_names, files, boxes)
        given = {shape.name for shape in spec.shapes if shape.name is not None}
        named.update(shape.name for shape in moved[-1].shapes if shape.name.partition(PIECE)[0] in given)
        current += moved
    if root is not None:
        yield _tree(current, named, root, bodies)


def _tree(bodies: list[Body], named: set[str], root: SpecBody, written: Bodies) -> BodyTree:
    origin = root.pose
    if origin is None and (root.joint is not None or root.joints):
        origin = (root.joint or root.joints[0]).origin
    zero = (0.0, 0.0, 0.0)
    velocity = (zero, zero) if root.velocity is None else (root.velocity.linear, root.velocity.angular)
    owners = dict.fromkeys(owner_of(body.name) for body in bodies)
    joints = [
        (name, joint)
        for owner in owners
        for name, joint in zip(
            written.joint_names(owner),
            _written_joints(written.content(owner)),
            strict=True,
        )
    ]
    return BodyTree(
        tuple(bodies),
        frozenset(named),
        pose(origin),
        velocity,
        frozenset(name for name, joint in joints if joint is not None and joint.position is not None),
        frozenset(name for name, joint in joints if joint is not None and joint.velocity is not None),
    )


def _written_joints(spec: SpecBody) -> Sequence[SpecJoint | None]:
    """The joints of a body as they are written; None for an implied one."""
    return spec.joints or [spec.joint]


def _bodies(
    name: str,
    spec: SpecBody,
    bodies: Bodies,
    only: str | None,
    taken: Container[str],
    files: ShapeFiles,
    boxes: bool,
) -> list[Body]:
    """A body of the spec: itself, and before it one without mass and shapes for each of several joints but the last."""
    resolved = [
        resolved_shape(trees.unused(f"{name}_{index}", taken), shape, only, bodies.source, files)
        for index, shape in enumerate(spec.shapes)
    ]
    # further pieces of a mesh stand behind, so that the shapes before them have the indices that they have in the file
    shapes = (*(shape.shapes[0] for shape in resolved), *(piece for shape in resolved for piece in shape.shapes[1:]))
    written: Sequence[SpecJoint | None] = spec.joints or [spec.joint]
    names, kinds = bodies.joint_names(name), bodies.joint_types(name)
    parent, between = spec.parent, []
    for joint_name, kind, joint in zip(names[:-1], kinds[:-1], written[:-1], strict=True):
        carrier = carrier_name(name, joint_name)
        between.append(Body(carrier, "", Inertial(0.0), _joint(joint_name, kind, joint, parent)))
        parent = carrier
    last = _joint(names[-1], kinds[-1], written[-1], parent)
    inertial, axes = _inertial(spec, resolved)
    box = box_of(inertial, axes) if boxes and inertial.mass else None
    return [*between, Body(name, "", inertial, last, shapes, spec.collision_group, spec.gravity_scale, box)]


def _inertial(spec: SpecBody, shapes: Sequence[Resolved]) -> tuple[Inertial, Quaternion | None]:
    """Mass properties, and the principal axes in the body's frame where the spec says them, or one solid alone has them."""
    dense = [(shape.written.density, shape) for shape in shapes if shape.written.density]
    if dense:
        return _of_parts([fill.part(density * fill.volume) for density, shape in dense for fill in shape.fill()])
    if spec.inertia is not None:
        centre = spec.centre_of_mass or (0.0, 0.0, 0.0)
        if spec.inertia.tensor is not None:
            tensor = spec.inertia.tensor
            moments = (tensor.xx, tensor.yy, tensor.zz, tensor.xy, tensor.xz, tensor.yz)
            return Inertial(required(spec.mass), centre, moments), None
        axes = orientation(spec.inertia)
        return Inertial(
            required(spec.mass), centre, inertia.rotated_tensor(required(spec.inertia.principal), axes)
        ), axes
    if not spec.mass:
        return Inertial(0.0), None
    filled = [fill for shape in shapes if fills(spec, shape.written) for fill in shape.fill()]
    if not filled:
        return Inertial(spec.mass), None
    total = 0.0
    for fill in filled:
        total += fill.volume
    return _of_parts([fill.part(spec.mass * (fill.volume / total)) for fill in filled], spec.mass)


def _of_parts(parts: Sequence[inertia.Part], total: float | None = None) -> tuple[Inertial, Quaternion | None]:
    return inertia.combined_inertial(parts, total), parts[0].pose.quaternion if len(parts) == 1 else None


def _joint(name: str, kind: str, written: SpecJoint | None, parent: str | None) -> Joint:
    if written is None or kind in ("free", "fixed"):
        start = () if kind == "fixed" else (0.0,) * 7
        speed = () if kind == "fixed" else (0.0,) * 6
        damping, angular_damping = (written.damping if written else None) or (0.0, 0.0)
        armature, angular_armature = (written.armature if written else None) or (0.0, 0.0)
        return Joint(
            name,
            kind,
            parent,
            pose(written.origin if written else None),
            position=start,
            velocity=speed,
            damping=damping,
            armature=armature,
            angular_damping=angular_damping,
            angular_armature=angular_armature,
        )
    limits, spring = written.limits, written.spring
    position, velocity = _start(written)
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        origin=pose(written.origin),
        axis=direction(written.axis) if written.axis is not None else (0.0, 0.0, 0.0),
        position_limits=None if limits is None else limits.position,
        velocity_limit=None if limits is None else limits.velocity,
        effort_limit=None if limits is None else limits.effort,
        damping=written.damping or 0.0,
        dry_friction=written.dry_friction or 0.0,
        armature=written.armature or 0.0,
        spring_stiffness=0.0 if spring is None else spring.stiffness,
        spring_rest=0.0 if spring is None else spring.rest or 0.0,
        position=position,
        velocity=velocity,
        angle_limit=None if limits is None else limits.angle,
    )


def _start(written: SpecJoint) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Initial position and velocity of a hinge, a slide or a ball."""
    if written.type == "ball":
        turn = frames.IDENTITY if written.position is None else orientation(written.position)
        return turn, written.velocity or (0.0, 0.0, 0.0)
    return (written.position or 0.0,), (written.velocity or 0.0,)
