"""For each feature of the language a small world that needs it, for tests of what an engine does not support."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial

from simspec.language.vocabulary import JOINT_KINDS
from simspec.proof.selftest_worlds import framed, sum_friction, sum_limits, sums
from simspec.support.features import Feature
from simspec.testing.worlds import (
    CONTACT_GAPS,
    ball_with_law,
    damped_springs,
    every_joint,
    gripper,
    ground,
    immersed,
    jointed,
    lifted,
    limits_and_armature,
    lying,
    point_mass,
    several_joints,
    shapes_world,
    tool_frame,
    touching_link,
    tree,
    with_cone,
    world,
)
from simspec.world.types import World


def boxes() -> World:
    """Two boxes above a floor, of one size, so that their edges may cross."""
    base = shapes_world(("box",))
    floor, box = base.bodies
    joint = dataclasses.replace(box.joint, name="other_joint", position=(1.0, *box.joint.position[1:]))
    shapes = tuple(dataclasses.replace(shape, name="other_0") for shape in box.shapes)
    other = dataclasses.replace(box, name="other", model="other", joint=joint, shapes=shapes)
    return dataclasses.replace(base, bodies=(floor, box, other))


def felt_at_a_distance() -> World:
    """A sphere and a box above a floor, all with margins, without friction."""
    world = shapes_world(("sphere", "box"), 0.0)
    bodies = tuple(
        dataclasses.replace(
            body, shapes=tuple(dataclasses.replace(shape, margin=0.001 * number) for shape in body.shapes)
        )
        for number, body in enumerate(world.bodies, 1)
    )
    return dataclasses.replace(world, bodies=bodies)


def belt() -> World:
    """A sphere on a box whose surface moves."""
    base = shapes_world(("sphere",))
    floor, *others = base.bodies
    (shape,) = floor.shapes
    moving = dataclasses.replace(shape, surface_velocity=(0.2, 0.0, 0.0, 0.0, 0.0, 0.1))
    return dataclasses.replace(base, bodies=(dataclasses.replace(floor, shapes=(moving,)), *others))


NEEDING: Mapping[Feature, Callable[[], World]] = {
    **{
        Feature(f"shape.{kind}"): partial(shapes_world, (kind,))
        for kind in ("mesh", "ellipsoid", "capsule", "cylinder", "sphere")
    },
    Feature.SHAPE_BOX: boxes,
    Feature.SHAPE_HEIGHTFIELD: ground,
    **{Feature(f"joint.{kind}"): partial(jointed, kind) for kind in JOINT_KINDS},
    **{
        feature: partial(with_cone, feature.value.removeprefix("contact.cone."))
        for feature in Feature
        if feature.value.startswith("contact.cone.")
    },
    **{feature: partial(ball_with_law, **law) for feature, law in CONTACT_GAPS.items()},
    Feature.HARDNESS_STIFFNESS: partial(lying, **CONTACT_GAPS[Feature.HARDNESS_STIFFNESS]),
    Feature.SHAPE_MARGIN: felt_at_a_distance,
    Feature.SURFACE_VELOCITY: belt,
    Feature.MARGIN_PAIRS: partial(ball_with_law, friction=0.0, margin=0.002),
    Feature.ARMATURE: partial(limits_and_armature, armature=0.1),
    Feature.DRY_FRICTION: partial(limits_and_armature, dry_friction=0.1),
    **dict.fromkeys((Feature.LIMIT_POSITION, Feature.LIMIT_VELOCITY, Feature.LIMIT_EFFORT), limits_and_armature),
    **dict.fromkeys((Feature.DAMPING, Feature.SPRING), damped_springs),
    Feature.BALL_DAMPING: partial(jointed, "ball", damping=0.1),
    Feature.BALL_ARMATURE: partial(jointed, "ball", armature=0.1),
    Feature.BALL_LIMIT: partial(jointed, "ball", angle_limit=1.0),
    Feature.GRAVITY_SCALE: lifted,
    Feature.FREE_DAMPING: partial(jointed, "free", damping=0.1, angular_damping=0.1),
    Feature.FREE_ARMATURE: partial(jointed, "free", armature=0.1, angular_armature=0.1),
    Feature.FLUID: immersed,
    Feature.BALL_SPRING: partial(jointed, "ball", spring_stiffness=0.1),
    Feature.FRAME: lambda: dataclasses.replace(framed(""), engines=()),
    Feature.SUM: lambda: dataclasses.replace(sums(""), engines=()),
    Feature.SUM_LIMITS: lambda: dataclasses.replace(sum_limits(""), engines=()),
    Feature.SUM_DRY_FRICTION: lambda: dataclasses.replace(sum_friction(""), engines=()),
    Feature.COLLISION_GROUPS: gripper,
    Feature.EXCLUDED_PAIRS: gripper,
    Feature.TOUCHING_PAIRS: touching_link,
    Feature.INERTIA_FULL: every_joint,
    Feature.INERTIA_SINGULAR: point_mass,
    Feature.JOINT_SEVERAL: several_joints,
    Feature.MASSLESS: tool_frame,
    Feature.TREE_SIZE: lambda: world(tree(["fixed"] + ["hinge"] * 130, 1)),
    Feature.TREE_DEPTH: lambda: world(tree(["fixed"] + ["hinge"] * 500, 1)),
}
"""For each feature a world that needs it."""
