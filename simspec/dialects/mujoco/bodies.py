"""Bodies as MJCF has them for MuJoCo: depth first, joints with their numbers, shapes of the classes of their materials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from simspec.control.native import natives
from simspec.dialects.mujoco.apart import apart
from simspec.dialects.mujoco.choices import (
    ACTUATOR,
    MATERIAL_CLASS,
    VISUAL_CLASS,
)
from simspec.dialects.mujoco.names import NO_RATING
from simspec.formats.mjcf import tree
from simspec.formats.mjcf.bodies import DEFAULT_COLOUR, GROUPS, BodyRow, body_of, geom_of, joint_attributes
from simspec.formats.mjcf.contact import Kind
from simspec.formats.mjcf.tree import Attributes, Value
from simspec.world.kinematics import absorbed, free_rigid, rigid_groups
from simspec.world.types import Joint, Pose, Shape, World


def lower_body(
    row: BodyRow, masks: Mapping[Kind, Attributes], restless: bool, sites: tuple[tree.MjcfSite, ...] = ()
) -> tree.MjcfBody:
    """One body; ``masks`` by kind of shape, ``restless``: it must never fall asleep."""
    body = row.body
    geoms = tuple(_geom(shape, masks.get((body.collision_group, shape.material), ())) for shape in body.shapes)
    joints = tuple(_joint(joint, frame) for joint, frame in row.joints)
    return apart(body_of(row, joints, geoms, (("sleep", "never"),) if restless else (), sites))


def _joint(joint: Joint, frame: Pose) -> tree.MjcfJoint:
    more = joint_attributes(joint, frame)
    ratings = (joint.velocity_limit, joint.effort_limit)
    if ratings != (None, None):
        more.append(("user", tuple(NO_RATING if rating is None else rating for rating in ratings)))
    return tree.MjcfJoint(joint.name, joint.kind, tuple(more))


def _geom(shape: Shape, mask: Attributes) -> tree.MjcfGeom:
    more: list[tuple[str, Value]] = []
    if shape.collision:
        more.extend(mask)
        if shape.margin:
            more.append(("margin", shape.margin))
        if any(shape.surface_velocity):
            more.append(("surfacevel", shape.surface_velocity))
    group = GROUPS[shape.collision, shape.visual]
    if group:
        more.append(("group", group))
    if shape.colour != DEFAULT_COLOUR:
        more.append(("rgba", shape.colour))
    class_name = MATERIAL_CLASS + shape.material if shape.collision else VISUAL_CLASS
    return geom_of(shape, class_name, tuple(more))


def actuators(world: World) -> Iterator[tree.MjcfActuator]:
    """A position actuator for each natively driven joint; without kp a velocity actuator."""
    for controller in natives(world):
        for name, kp, kd, limit in zip(
            controller.joints, controller.kp, controller.kd, controller.effort_limits, strict=True
        ):
            more: list[tuple[str, Value]] = [("kp", kp)] if kp else []
            more += [("kv", kd), *ACTUATOR, ("forcelimited", limit is not None)]
            if limit is not None:
                more.append(("forcerange", (-limit, limit)))
            yield tree.MjcfActuator("position" if kp else "velocity", name, name, tuple(more))


def restless_bodies(world: World) -> frozenset[str]:
    """The topmost moving body of each of MuJoCo's trees that must stay awake: all but single free bodies.

    A joint that nobody drives may stand still for ten steps and go on (a pendulum where it turns), and efforts of zero do not
    keep a tree awake.
    """
    allowed, groups, inside = free_rigid(world), rigid_groups(world), absorbed(world)
    return frozenset(
        inside.get(body.name, body.name)
        for body in world.bodies
        if groups[body.name] == body.name != "world"
        and (body.joint.parent is None or groups[body.joint.parent] == "world")
        and body.joint.kind != "fixed"
        and body.name not in allowed
    )
