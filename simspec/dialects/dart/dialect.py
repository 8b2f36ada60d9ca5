"""How a world is passed to DART: one ``world.skel`` with a skeleton for each tree, and a sidecar for what .skel cannot carry.

A free root stands at the world's origin at zero configuration, so that DART's coordinates of a free joint are those of the
world.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from simspec.contact import ContactPlan
from simspec.dialects.dart.contact import TINY_FRICTION, DartNode, DartNodePlan, class_name, detector_of, problems
from simspec.dialects.dart.sidecar import DartShapeCopy, DartShapeEntry, DartSidecar, NodeFilter, WeldedNode
from simspec.dialects.kit.contract import Dialect, Lowered, NeededSetting
from simspec.dialects.kit.sidecar import JointValue, Sidecar, Target, common_fields, known, springs_of
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.skel import format
from simspec.formats.skel.format import KINDS, coordinates, file_name, zero_poses
from simspec.formats.skel.reading import SkelDocument
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import Table, acceptance, for_each, never, shape_kinds, via_api
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.contact_pairs import excluded_pairs, frictionless, only_free_spheres, solid_shapes
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import Body, Inertial, Pose, Quaternion, ReadBack, Shape, Vector3, World

COPY = "{body}.{index}"
"""The name of a body's further nodes (see ``dialects/dart/contact.py``), and of the welds that hold them; no name in a spec has
a point."""

SOLVERS = ("dantzig", "nsgs")
"""The contact solvers that the setting ``contact_solver`` names; which of them ``auto`` stands for says
:func:`contact_solver`."""

SMALL_TURN = (1e-5, 1e-3)
"""Rotation vectors whose length lies in between are written as the same rotation the long way round (θ − 2π): DART turns
vectors shorter than 1e-3 by a Taylor form, which is off by θ³/6, up to 1.7e-10 (measured). Below 1e-5 that is 2e-16."""

COPIES = via_api(
    "simspec writes copies of shapes on massless welded bodies, and DART's collision filter lets one pair of copies touch"
)
LIMITS = via_api(
    "simspec enables the limits of the file through the API; joints then stop inelastically within the step"
)
NO_BELTS = never(".skel has no surface velocities")
ANGLE = never("DART limits the components of the rotation vector, not its angle")


class DartDialect(Dialect):
    """DART's own XML, for dartpy 6."""

    NAME: ClassVar[str] = "dart"
    FORMAT: ClassVar[str] = "skel"
    SUPPORT: ClassVar[Table] = {
        **classes.with_sidecar("DART", classes.SIDECAR),
        **shape_kinds("DART", KINDS),
        Feature.SURFACE_VELOCITY: NO_BELTS,
        Feature.LIMIT_POSITION: LIMITS,
        Feature.LIMIT_VELOCITY: via_api(
            "simspec keeps the rating in the sidecar: DART would enforce it together with the position limits"
        ),
        **for_each(via_api(classes.SIDECAR), Feature.LIMIT_EFFORT, Feature.FRICTION, Feature.RESTITUTION),
        **for_each(classes.explicit("DART"), *features.DAMPERS_AND_SPRINGS),
        Feature.BALL_ARMATURE: via_api(classes.SIDECAR),
        **for_each(COPIES, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.BALL_LIMIT: ANGLE,
    }

    SIDECAR: ClassVar[type[Sidecar]] = DartSidecar
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = {
        "contact_solver": NeededSetting(str, ("auto", *SOLVERS)),
        "collision_detector": NeededSetting(str),
    }

    def lower(self, world: World, target: Target) -> Lowered:
        """The skeletons of ``world`` and their sidecar. Raises UnsupportedError for what this world cannot have in DART."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        at_zero = zero_poses(moved)
        nodes = DartNodePlan(world, target.plan)
        static = {name for name, group in rigid_groups(moved).items() if group == "world"}
        skeletons = tuple(
            format.Skeleton(
                root,
                not all(body.name in static for body in bodies),
                tuple(
                    _body(body, node, at_zero[body.name], target.plan)
                    for body in bodies
                    for node in nodes.of[body.name]
                ),
                tuple(
                    _joint(body) if node.index == 0 else _weld(node) for body in bodies for node in nodes.of[body.name]
                ),
            )
            for root, bodies in trees(moved).items()
        )
        detector = collision_detector(world, target)
        tree = format.SkelWorld(world.name, world.physics.timestep, world.physics.gravity, detector, skeletons)
        return Lowered(tree, _sidecar(world, target, nodes, offsets))

    def raise_(self, document: SkelDocument, sidecar: DartSidecar) -> ReadBack:
        """See ``dialects/dart/raising.py``."""
        from simspec.dialects.dart.raising import raised

        return raised(document, sidecar)


def node_name(node: DartNode) -> str:
    """The name of a body's node in the file."""
    name = file_name(node.body)
    return name if node.index == 0 else COPY.format(body=name, index=node.index)


def contact_solver(world: World, target: Target) -> str:
    """The setting ``contact_solver``, with ``auto`` resolved: Dantzig's where nothing has friction, which it bounds by other
    normal forces than those that act, for free balls and under the pyramid."""
    chosen = str(target.settings["contact_solver"])
    if chosen != "auto":
        return chosen
    pyramid = world.contact.friction_cone == "pyramid-circumscribed"
    return "dantzig" if only_free_spheres(world) or (pyramid and frictionless(world)) else "nsgs"


def collision_detector(world: World, target: Target) -> str:
    """The setting ``collision_detector``, with ``auto`` resolved."""
    return detector_of(world, target.engine, str(target.settings["collision_detector"]))


def _check(world: World, target: Target) -> None:
    """Raise UnsupportedError for settings that would change the model, and for contact that DART gets wrong."""
    found = problems(world, collision_detector(world, target), target.engine)
    accepted = world.options(target.engine).accept
    found += [
        Problem(
            f"{target.engine} treats a friction coefficient of up to {TINY_FRICTION} as zero",
            f"contact.pairs.{pair.first}.{pair.second}.friction",
            found=f"{pair.friction}",
            allowed=f"0, or above {TINY_FRICTION}",
            hint=acceptance(target.engine, "material.friction"),
            code="E104",
        )
        for pair in world.contact.pairs
        if pair.collide and 0.0 < pair.friction <= TINY_FRICTION and "material.friction" not in accepted
    ]
    if found:
        raise UnsupportedError(found)


def rotation_vector(q: Quaternion) -> Vector3:
    """log R, in DART's coordinates (see ``SMALL_TURN``)."""
    w, x, y, z = q
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return (0.0, 0.0, 0.0)
    turn = 2.0 * frames.angle(sine, w)
    if SMALL_TURN[0] < turn < SMALL_TURN[1]:
        turn -= 2.0 * math.pi
    factor = turn / sine
    return (x * factor, y * factor, z * factor)


def _body(body: Body, node: DartNode, at_zero: Pose, plan: ContactPlan) -> format.SkelBody:
    """A body's own node with what is seen of it, or a further one, without mass."""
    copies = tuple(
        format.SkelShape(shape.kind, shape.size, shape.pose)
        for shape in solid_shapes(body)
        for layer in plan.layers(shape.material)
        if (shape.material, layer) in node.parts
    )
    if node.index > 0:
        return format.SkelBody(node_name(node), at_zero, Inertial(0.0), (), copies)
    visual = tuple(
        format.SkelShape(shape.kind, shape.size, shape.pose, shape.colour) for shape in body.shapes if shape.visual
    )
    return format.SkelBody(node_name(node), at_zero, body.inertial, visual, copies)


def _joint(body: Body) -> format.SkelJoint:
    joint = body.joint
    return format.SkelJoint(
        joint.name,
        joint.kind,
        None if joint.parent is None else file_name(joint.parent),
        file_name(body.name),
        joint.axis if joint.kind in SCALAR_JOINTS else None,
        joint.position_limits,
        joint.dry_friction,
        *coordinates(joint, rotation_vector),
    )


def _weld(node: DartNode) -> format.SkelJoint:
    """The joint between a further node and the body's node."""
    return format.SkelJoint(node_name(node), "fixed", file_name(node.body), node_name(node))


def _sidecar(world: World, target: Target, nodes: DartNodePlan, offsets: Mapping[str, Vector3]) -> DartSidecar:
    settings = {
        **target.settings,
        "contact_solver": contact_solver(world, target),
        "collision_detector": collision_detector(world, target),
    }
    groups: dict[str, list[str]] = {}
    for body in world.bodies:
        if solid_shapes(body):
            groups.setdefault(body.collision_group, []).append(body.name)
    ignored = tuple(pair for pair in world.contact.ignored_groups if pair[0] in groups and pair[1] in groups)
    named = {group for pair in ignored for group in pair}

    def values(field: str) -> tuple[JointValue, ...]:
        # forces that act on free bodies at all times are among the common fields
        found = ((body.name, getattr(body.joint, field)) for body in world.bodies if body.joint.kind != "free")
        none = (None,) if field.endswith("_limit") else (None, 0.0)  # a rating of 0 is another than none
        return tuple(JointValue(name, value) for name, value in found if value not in none)

    return DartSidecar(
        **common_fields(
            DartDialect.NAME, DartDialect.FORMAT, world, dataclasses.replace(target, settings=settings), offsets
        ),
        models=tuple(body.model for body in world.bodies),
        shapes=tuple(
            DartShapeEntry(
                shape.name,
                body.name,
                shape.visual,
                shape.material if shape.collision else "",
                _surfaces(shape, nodes.of[body.name], target.plan),
            )
            for body in world.bodies
            for shape in body.shapes
        ),
        enforce_limits=tuple(body.name for body in world.bodies if body.joint.position_limits is not None),
        velocity_limits=values("velocity_limit"),
        effort_limits=values("effort_limit"),
        damping=values("damping"),
        armature=values("armature"),
        springs=springs_of(world),
        ignored_groups=ignored,
        groups={group: tuple(names) for group, names in sorted(groups.items()) if group in named},
        excluded=excluded_pairs(world),
        copies=tuple(
            WeldedNode(node_name(node), body.name)
            for body in world.bodies
            for node in nodes.of[body.name]
            if node.index > 0
        ),
        filter=_filter(nodes),
    )


def _surfaces(shape: Shape, nodes: Sequence[DartNode], plan: ContactPlan) -> tuple[DartShapeCopy, ...]:
    """The copies of a shape in the order of their layers: the node each is on, and its numbers there."""
    if not shape.collision:
        return ()
    place = {part: node_name(node) for node in nodes for part in node.parts}
    return tuple(
        DartShapeCopy(
            place[shape.material, layer],
            layer,
            known(plan.numbers[shape.material, layer], "friction"),
            known(plan.numbers[shape.material, layer], "restitution"),
        )
        for layer in plan.layers(shape.material)
    )


def _filter(nodes: DartNodePlan) -> NodeFilter:
    """Only the classes that a pair names."""
    excluded = nodes.excluded_pairs()
    named = {parts for pair in excluded for parts in pair}
    return NodeFilter(
        {
            class_name(parts): tuple(node_name(node) for node in group)
            for parts, group in nodes.classes().items()
            if parts in named
        },
        tuple((class_name(first), class_name(second)) for first, second in excluded),
        tuple(nodes.layers()) if excluded else (),
    )
