"""A tree of bodies as a robot of plain URDF, that every tool can read.

A root that is not free hangs on a link that stands for the world. What the language lacks is put otherwise, and the caller must
say so or refuse it: a ball joint becomes three hinges, a capsule a cylinder and two balls, a plane a large box; an ellipsoid is
left out. Where the language demands limits and the world has none, they are ``UNLIMITED``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator
from typing import Final

from simspec.formats.urdf.from_world import (
    KINDS,
    UNLIMITED,
    WORLD_LINK,
    collision_of,
    full_inertial,
    geometry_of,
    limits_of,
    origin_of,
    unlike,
    visual_of,
)
from simspec.formats.urdf.tree import Collision, Dynamics, Joint, Link, Mimic, Origin, Robot, Visual
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.world import frames
from simspec.world.types import Body, Follow, Frame, Inertial, Pose, Shape, Vector3

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
    follows: Iterable[Follow] = (),
    named: Iterable[Frame] = (),
) -> Robot:
    """The robot that a tree is; of shapes only those of ``kinds``, where some are given. Links stand in the order of the
    bodies, after the world's, and behind them those of frames. ``follows``, ``named``: the couplings and the frames within the
    tree that it is to say."""
    root = bodies[0]
    link_names = {body.name for body in bodies}
    joint_names = {body.joint.name for body in bodies}
    mimics = {follow.joint: Mimic(follow.leader, follow.ratio, follow.offset) for follow in follows}
    links: list[Link] = []
    joints: list[Joint] = []
    world_link = unlike(WORLD_LINK, link_names)
    if root.joint.kind != "free":
        links.append(Link(world_link))
    for body in bodies:
        shapes = [shape for shape in body.shapes if not kinds or shape.kind in kinds]
        parts = [part for shape in shapes for part in parts_of(shape)]
        visuals = [_visual(part) for part in parts if part.visual]
        collisions = [_collision(part) for part in parts if part.collision]
        inertial = None if body.inertial == Inertial(0.0) else full_inertial(body.inertial)
        if body.joint.kind == "ball":
            for link, joint in _three_hinges(body, body.joint.parent or world_link, link_names, joint_names):
                links.extend(() if link is None else (link,))
                joints.append(joint)
        elif body.joint.kind != "free":
            joints.append(_joint(body, body.joint.parent or world_link, mimics.get(body.joint.name)))
        links.append(Link(body.name, inertial, tuple(visuals), tuple(collisions)))
    for frame in named:
        joint_name = unlike(f"{frame.name}_joint", joint_names)
        joint_names.add(joint_name)
        links.append(Link(frame.name))
        joints.append(Joint(joint_name, "fixed", frame.body, frame.name, origin_of(frame.pose)))
    return Robot(root.model, tuple(links), tuple(joints))


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


def _visual(shape: Shape) -> Visual:
    return visual_of(shape, geometry_of(shape), f"{shape.name}_colour")


def _collision(shape: Shape) -> Collision:
    return collision_of(shape, geometry_of(shape))


def _joint(body: Body, parent: str, mimic: Mimic | None) -> Joint:
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
    return Joint(
        joint.name,
        kind,
        parent,
        body.name,
        origin_of(joint.origin),
        joint.axis if moves else None,
        Dynamics(joint.damping, joint.dry_friction) if moves else None,
        tuple(limits.items()) if moves else (),
        mimic,
    )


def _three_hinges(
    body: Body, parent: str, link_names: set[str], joint_names: set[str]
) -> Iterator[tuple[Link | None, Joint]]:
    """Hinges about x, y and z, each with the link below it; None for the body's own."""
    origin = origin_of(body.joint.origin)
    for name, axis in AXES:
        last = name == AXES[-1][0]
        child = body.name if last else unlike(f"{body.name}__{name}", link_names)
        joint = unlike(f"{body.joint.name}__{name}", joint_names)
        link_names.add(child)
        joint_names.add(joint)
        dynamics = Dynamics(body.joint.damping)
        yield None if last else Link(child), Joint(joint, "continuous", parent, child, origin, axis, dynamics)
        parent, origin = child, Origin()
