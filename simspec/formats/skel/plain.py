"""A world as plain .skel for any tool: bodies, joints and shapes. How bodies touch, the language does not say."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from simspec.formats.kit.plain import Fate, Loss
from simspec.formats.skel import tree
from simspec.formats.skel.from_world import KINDS, RESERVED, coordinates, file_name, zero_poses
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Level, Support, Table, approximate, exactly, for_each, never, shape_kinds
from simspec.support.features import COUPLED_CONTACT, Feature
from simspec.world import frames
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import Body, Pose, Quaternion, Vector3, World

_SURFACE = ".skel has no numbers of surfaces"
_FILTER = ".skel does not say what touches what"
_HARDNESS = ".skel has no hardness of contact"

SUPPORT: Final[Table] = {
    **exactly(
        *(Feature.JOINT_FIXED, Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_FREE),
        *(Feature.JOINT_SEVERAL, Feature.DRY_FRICTION),
        *(Feature.INITIAL_POSITION, Feature.INITIAL_VELOCITY),
        *(Feature.INERTIA, Feature.INERTIA_SINGULAR, Feature.MASSLESS, Feature.TREE_SIZE, Feature.TREE_DEPTH),
        *(Feature.SHAPE_VISUAL, Feature.SHAPES_PER_BODY),
        *(Feature.GRAVITY, Feature.TIMESTEP),
    ),
    **shape_kinds(".skel", KINDS),
    Feature.BALL_ARMATURE: never(".skel has no armature"),
    Feature.MARGIN_PAIRS: never(".skel has no margins"),
    Feature.SURFACE_VELOCITY: never(".skel has no surfaces that move by themselves"),
    Feature.FLUID: never(".skel has no fluids"),
    Feature.GRAVITY_SCALE: never("simspec writes no weights of single bodies into .skel"),
    Feature.FREE_DAMPING: never("simspec writes no damping of free bodies into .skel"),
    Feature.FREE_ARMATURE: never("simspec writes no armature of free bodies into .skel"),
    Feature.SHAPE_MARGIN: never(".skel has no margins"),
    Feature.INERTIA_FULL: Support(Level.EXACT, "the full tensor"),
    Feature.LIMIT_POSITION: approximate("the limits, but not that they are enforced"),
    Feature.LIMIT_VELOCITY: never(".skel has limits of velocity that are enforced, and no ratings"),
    Feature.LIMIT_EFFORT: never(".skel has limits of effort that are enforced, and no ratings"),
    Feature.DAMPING: approximate("the same number, implicit in time"),
    Feature.BALL_DAMPING: never(".skel has damping at hinges and slides only"),
    Feature.SPRING: approximate("the same numbers, implicit in time"),
    Feature.BALL_SPRING: never(".skel has springs at hinges and slides only"),
    Feature.ARMATURE: never(".skel has no armature"),
    **for_each(
        never(_SURFACE),
        *(Feature.MATERIALS_PER_BODY, Feature.FRICTION, Feature.FRICTION_PAIRS, Feature.RESTITUTION),
        *(Feature.RESTITUTION_PAIRS, Feature.RESTITUTION_THRESHOLD, Feature.TORSIONAL_FRICTION),
        *(Feature.ROLLING_FRICTION, Feature.IMPACT_FRICTION, Feature.CONE_ELLIPTIC),
        *COUPLED_CONTACT,
        *(Feature.CONE_PYRAMID_INSCRIBED, Feature.CONE_PYRAMID_CIRCUMSCRIBED),
    ),
    **for_each(
        never(_HARDNESS),
        *(Feature.HARDNESS_COMMON, Feature.HARDNESS_TIME_CONSTANT, Feature.HARDNESS_STIFFNESS),
        *(Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
    ),
    Feature.PASSING_PAIRS: never(_FILTER),
    Feature.COLLISION_GROUPS: never(_FILTER),
    Feature.EXCLUDED_PAIRS: never(_FILTER),
    Feature.TOUCHING_PAIRS: never(_FILTER),
    Feature.CONSTRAINT_LOOP: never(".skel has no constraints between bodies"),
    Feature.CONSTRAINT_COUPLING: never(".skel has no couplings of joints"),
    Feature.BALL_LIMIT: never(".skel has no limits of ball joints"),
    Feature.FRAME: never(".skel has no frames but those of bodies"),
    **for_each(
        never(".skel has nothing along sums of joint positions"),
        Feature.SUM,
        Feature.SUM_LIMITS,
        Feature.SUM_DRY_FRICTION,
    ),
    Feature.KINEMATIC: approximate("a free body of 1e5 times the mass of all that moves, without its motion"),
    Feature.FORCES: never(".skel has no forces on bodies"),
    Feature.CONTROL: never(".skel has no control laws"),
    Feature.CONTROL_NATIVE: never(".skel has no gains of controllers"),
}
"""What plain .skel carries of each feature."""


def plain_tree(world: World) -> tree.World:
    """The file of a world: a skeleton for each tree."""
    at_zero = zero_poses(world)
    static = {name for name, group in rigid_groups(world).items() if group == "world"}
    return tree.World(
        world.name,
        world.physics.timestep,
        world.physics.gravity,
        None,
        tuple(
            tree.Skeleton(
                root,
                not all(body.name in static for body in bodies),
                tuple(_body(body, at_zero[body.name]) for body in bodies),
                tuple(_joint(body) for body in bodies),
            )
            for root, bodies in trees(world).items()
        ),
    )


def renamed(world: World) -> Iterator[Loss]:
    """The body whose name the language gives to the world."""
    for body in world.bodies:
        if body.name in RESERVED:
            how = f"called {file_name(body.name)!r}: the world itself has its name"
            yield Loss("body.name", Fate.APPROXIMATED, how, (f"bodies.{body.name}",))


def _body(body: Body, at_zero: Pose) -> tree.Body:
    return tree.Body(
        file_name(body.name),
        at_zero,
        body.inertial,
        tuple(tree.Shape(shape.kind, shape.size, shape.pose, shape.colour) for shape in body.shapes if shape.visual),
        tuple(tree.Shape(shape.kind, shape.size, shape.pose) for shape in body.shapes if shape.collision),
    )


def _joint(body: Body) -> tree.Joint:
    joint = body.joint
    single = joint.kind in SCALAR_JOINTS
    position, velocity = coordinates(joint, _rotation_vector)
    return tree.Joint(
        joint.name,
        joint.kind,
        None if joint.parent is None else file_name(joint.parent),
        file_name(body.name),
        joint.axis if single else None,
        joint.position_limits,
        joint.dry_friction,
        position,
        velocity,
        joint.damping,
        joint.spring_stiffness,
        joint.spring_rest,
    )


def _rotation_vector(q: Quaternion) -> Vector3:
    w, x, y, z = q
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * frames.angle(sine, w) / sine if sine else 0.0
    return (x * factor, y * factor, z * factor)
