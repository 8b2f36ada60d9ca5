"""Bodies as MJCF has them for MuJoCo: depth first, joints with their numbers, shapes of the classes of their materials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from simspec.control.native import natives
from simspec.dialects.mujoco.choices import (
    ACTUATOR,
    DEFAULT_COLOUR,
    GROUPS,
    MATERIAL_CLASS,
    PLANE_SIZE,
    SIZES,
    VISUAL_CLASS,
)
from simspec.dialects.mujoco.filter import Kind
from simspec.dialects.mujoco.names import NO_RATING, file_name
from simspec.formats.kit.passes import principal_axes
from simspec.formats.mjcf import tree
from simspec.formats.mjcf.tree import Attributes, Value
from simspec.world import frames
from simspec.world.kinematics import free_rigid, rigid_groups
from simspec.world.types import Body, Joint, Pose, Shape, World


def depth_first(world: World) -> list[tuple[Body, int]]:
    """The bodies in the order of the file, each with the number of bodies that it stands in."""
    children: dict[str | None, list[Body]] = {}
    for body in world.bodies:
        children.setdefault(body.joint.parent, []).append(body)
    order: list[tuple[Body, int]] = []
    waiting = [(body, 0) for body in reversed(children.get(None, []))]
    while waiting:
        body, depth = waiting.pop()
        order.append((body, depth))
        waiting.extend((child, depth + 1) for child in reversed(children.get(body.name, [])))
    return order


def lower_body(body: Body, depth: int, masks: Mapping[Kind, Attributes], restless: bool) -> tree.Body:
    """One body; ``masks`` by kind of shape, ``restless``: it must never fall asleep."""
    joint = body.joint
    place = Pose(joint.position[:3], joint.position[3:7]) if joint.kind == "free" else joint.origin  # type: ignore[arg-type]
    inertial = None
    if body.inertial.mass > 0.0:
        moments, turn = principal_axes(body.inertial.inertia)
        inertial = tree.Inertial(body.inertial.centre_of_mass, turn, body.inertial.mass, moments)
    return tree.Body(
        file_name(body.name),
        place.position,
        place.quaternion,
        depth,
        inertial,
        () if joint.kind == "fixed" else (_joint(joint),),
        tuple(_geom(shape, masks.get((body.collision_group, shape.material), ())) for shape in body.shapes),
        (("sleep", "never"),) if restless else (),
    )


def _joint(joint: Joint) -> tree.Joint:
    more: list[tuple[str, Value]] = []
    if joint.kind in ("hinge", "slide"):
        more.append(("axis", joint.axis))
    if joint.position_limits is not None:
        more += [("limited", True), ("range", joint.position_limits)]
    numbers = {
        "damping": joint.damping,
        "frictionloss": joint.dry_friction,
        "armature": joint.armature,
        "stiffness": joint.spring_stiffness,
        "springref": joint.spring_rest,
    }
    more.extend((name, value) for name, value in numbers.items() if value)
    ratings = (joint.velocity_limit, joint.effort_limit)
    if ratings != (None, None):
        more.append(("user", tuple(NO_RATING if rating is None else rating for rating in ratings)))
    return tree.Joint(joint.name, joint.kind, tuple(more))


def _geom(shape: Shape, mask: Attributes) -> tree.Geom:
    more: list[tuple[str, Value]] = []
    if shape.collision:
        more.extend(mask)
    group = GROUPS[shape.collision, shape.visual]
    if group:
        more.append(("group", group))
    if shape.colour != DEFAULT_COLOUR:
        more.append(("rgba", shape.colour))
    size: tuple[float, ...] = PLANE_SIZE
    if shape.kind != "plane":
        size = tuple(value * factor for value, factor in zip(shape.size, SIZES[shape.kind], strict=True))
    return tree.Geom(
        shape.name,
        shape.kind,
        size,
        shape.pose.position,
        shape.pose.quaternion,
        MATERIAL_CLASS + shape.material if shape.collision else VISUAL_CLASS,
        tuple(more),
    )


def keyframe_velocity(joint: Joint) -> tuple[float, ...]:
    """MuJoCo's velocity of a joint: a free one turns about its own axes."""
    if joint.kind != "free":
        return joint.velocity
    turn = frames.conjugate(joint.position[3:7])  # type: ignore[arg-type]
    return (*joint.velocity[:3], *frames.rotate(turn, joint.velocity[3:]))  # type: ignore[arg-type]


def actuators(world: World) -> Iterator[tree.Actuator]:
    """A position actuator for each natively driven joint; without kp a velocity actuator."""
    for controller in natives(world):
        for name, kp, kd, limit in zip(
            controller.joints, controller.kp, controller.kd, controller.effort_limits, strict=True
        ):
            more: list[tuple[str, Value]] = [("kp", kp)] if kp else []
            more += [("kv", kd), *ACTUATOR, ("forcelimited", limit is not None)]
            if limit is not None:
                more.append(("forcerange", (-limit, limit)))
            yield tree.Actuator("position" if kp else "velocity", name, name, tuple(more))


def restless_bodies(world: World) -> frozenset[str]:
    """The topmost moving body of each of MuJoCo's trees that must stay awake: all but single free bodies.

    A joint that nobody drives may stand still for ten steps and go on (a pendulum where it turns), and efforts of zero do not
    keep a tree awake.
    """
    allowed, groups = free_rigid(world), rigid_groups(world)
    return frozenset(
        body.name
        for body in world.bodies
        if groups[body.name] == body.name != "world"
        and (body.joint.parent is None or groups[body.joint.parent] == "world")
        and body.joint.kind != "fixed"
        and body.name not in allowed
    )
