"""World to URDF, in the dialect that PyBullet reads: one file for each distinct tree, and a sidecar for the rest.

The dialect: joints of type ``spherical``, geometries ``capsule`` and ``plane``, and a ``contact`` element in a link with its
friction and restitution. Data without a place in URDF (the pose of a tree, its initial state, springs, armature, collision
filters, solver settings) are in the sidecar.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, Final

from simspec.contact import CollisionPart
from simspec.dialects.kit.contract import Dialect, Lowered, NeededSetting
from simspec.dialects.kit.sidecar import (
    SIDECAR,
    InitialCoordinates,
    Sidecar,
    Target,
    armature_of,
    common_fields,
    springs_of,
)
from simspec.dialects.pybullet.raising import EXTRA_GEOMETRIES, raised
from simspec.dialects.pybullet.sidecar import (
    FIXED,
    FREE,
    LINK_MARGIN,
    MOST_LINKS,
    NO_LINKS,
    TREE_SIZE,
    WORLD_LINK,
    FixedFrame,
    PybulletInstance,
    PybulletLinkCopy,
    PybulletSidecar,
    collision_filter,
    contact_values,
    copy_name,
    frames_alongside,
    native_contact,
    problems,
    restitution_threshold,
    split,
    written_shapes,
)
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.urdf.reading import UrdfDocument
from simspec.formats.urdf.robots import (
    KINDS,
    RobotFiles,
    UrdfCollision,
    UrdfDynamics,
    UrdfExtension,
    UrdfGeometry,
    UrdfInertial,
    UrdfJoint,
    UrdfLink,
    UrdfOrigin,
    UrdfRobot,
    UrdfVisual,
    collision_of,
    geometry_of,
    limits_of,
    origin_of,
    principal_inertial,
    unlike,
    visual_of,
)
from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import Table, exact, exactly, for_each, never, shape_kinds, via_api
from simspec.support.features import Feature
from simspec.world.kinematics import free_rigid, trees
from simspec.world.types import POSITION_SIZE, Body, Pose, ReadBack, Shape, Surface, World

# A tree of bodies as a robot of PyBullet's URDF, and where it stands.

Parts = Mapping[str, tuple[CollisionPart, ...]]
"""Of each body its collision shapes, by link: its own, then those of further links."""

JOINT_TYPES: Final[Mapping[str, str]] = {
    "fixed": "fixed",
    "hinge": "continuous",
    "slide": "prismatic",
    "ball": "spherical",
}
"""The name of each joint kind; a hinge with position limits is ``revolute``."""

UNLIMITED_SLIDE: Final = (("lower", 1.0), ("upper", -1.0))
"""URDF has no unlimited prismatic joint; PyBullet takes lower > upper as one."""

PLANE: Final = UrdfGeometry("plane", (("normal", (0.0, 0.0, 1.0)),))

UNSEEN: Final = UrdfVisual("unseen", UrdfGeometry("sphere", (("radius", 0.0),)))
"""A visual of no size: PyBullet shows the collision shapes of a link that has no visual at all (measured)."""

CONCAVE: Final = (("concave", "yes"),)
"""Of a collision: its mesh is taken as the triangles that it is, not as their hull."""

NO_AXIS: Final = (1.0, 0.0, 0.0)
"""Of joints that have none: without one PyBullet warns and takes x."""

MASSLESS: Final = UrdfInertial(UrdfOrigin(), 0.0, (0.0,) * 6)

WORLD_SUFFIX: Final = "__world"
"""Added to a root's name for the massless base link that stands for the world."""


def has_world_link(root: Body) -> bool:
    """Whether a tree needs a massless base link that stands for the world.

    A root on a hinge, slide or ball has a joint to the world, and PyBullet drops the mass of a fixed base (measured:
    read back as 0), so that a fixed root with a mass must be a link as well.
    """
    return root.joint.kind in TREE_JOINTS or (root.joint.kind == "fixed" and root.inertial.mass > 0.0)


def frame_of(body: Body) -> FixedFrame:
    """A body that PyBullet does not receive, and where it is on the body that carries it."""
    parent = body.joint.parent
    if parent is None:
        raise ValueError(f"the frame {body.name!r} is on no body")
    return FixedFrame(body.name, body.model, body.joint.name, parent, body.joint.origin)


def instance_of(file: str, bodies: tuple[Body, ...], parts: Parts, coordinates: InitialCoordinates) -> PybulletInstance:
    """Where one tree stands and how it begins. ``bodies`` are in the order of the file's links (after the world link)."""
    root = bodies[0]
    q, v = coordinates.of(bodies)
    free = root.joint.kind == "free"
    return PybulletInstance(
        file=file,
        model=root.model,
        root=FREE if free else WORLD_LINK if has_world_link(root) else FIXED,
        base=Pose((q[0], q[1], q[2]), (q[3], q[4], q[5], q[6])) if free else root.joint.origin,
        bodies=tuple(body.name for body in bodies),
        joints=tuple(body.joint.name for body in bodies),
        shapes=tuple(tuple(shape.name for shape in body.shapes) for body in bodies),
        visual_only=tuple(tuple(i for i, shape in enumerate(body.shapes) if not shape.collision) for body in bodies),
        copies=tuple(
            PybulletLinkCopy(copy_name(part), body.name, part.layer, tuple(shape.name for shape in part.shapes))
            for body in bodies
            for part in parts[body.name][1:]
        ),
        layers=tuple(parts[body.name][0].layer for body in bodies),
        position=q,
        velocity=v,
    )


def robot_of(bodies: tuple[Body, ...], parts: Parts, base_margin: float) -> UrdfRobot:
    """The robot that a tree is: a world link where it needs one, the bodies' links, then the links of further shapes.
    ``base_margin``: PyBullet's margin around hulls on the first link (m)."""
    root = bodies[0]
    links: list[UrdfLink] = []
    joints: list[UrdfJoint] = []
    world_link = unlike(root.name + WORLD_SUFFIX, {body.name for body in bodies})
    if has_world_link(root):
        links.append(_carrier(world_link, Surface(), ()))
    shapes_by_body: dict[str, dict[str, Shape]] = {}
    for body in bodies:
        local = parts[body.name][0]
        margin = LINK_MARGIN if links else base_margin
        shapes = shapes_by_body[body.name] = written_shapes(body, parts[body.name], margin)
        links.append(
            UrdfLink(
                body.name,
                principal_inertial(body.inertial),
                *_shown(tuple(shapes.values()), tuple(shapes[shape.name] for shape in local.shapes)),
                extensions=(_contact(local.surface),),
            )
        )
        if body.joint.parent is not None:
            joints.append(_joint(body, body.joint.parent, body.joint.origin))
        elif has_world_link(root):
            joints.append(_joint(body, world_link, Pose()))
    for body in bodies:
        for part in parts[body.name][1:]:
            name = copy_name(part)
            carried = tuple(shapes_by_body[body.name][shape.name] for shape in part.shapes)
            links.append(_carrier(name, part.surface, carried))
            joints.append(UrdfJoint(f"{name}.joint", JOINT_TYPES["fixed"], body.name, name, UrdfOrigin(), NO_AXIS))
    return UrdfRobot(root.model, tuple(links), tuple(joints))


def _carrier(name: str, surface: Surface, shapes: tuple[Shape, ...]) -> UrdfLink:
    """A massless link, which carries shapes that touch and are not seen."""
    return UrdfLink(name, MASSLESS, *_shown((), shapes), extensions=(_contact(surface),))


def _contact(surface: Surface) -> UrdfExtension:
    values = contact_values(surface)
    return UrdfExtension("contact", (), tuple(UrdfExtension(name, (("value", value),)) for name, value in values))


def _shown(
    shapes: tuple[Shape, ...], solid: tuple[Shape, ...]
) -> tuple[tuple[UrdfVisual, ...], tuple[UrdfCollision, ...]]:
    """The visuals of ``shapes`` and the collisions of ``solid``."""
    visuals = tuple(visual_of(shape, _geometry(shape), f"{shape.name}_colour") for shape in shapes if shape.visual)
    collisions = tuple(_collision(shape) for shape in solid)
    return visuals or ((UNSEEN,) if collisions else ()), collisions


def _collision(shape: Shape) -> UrdfCollision:
    made = collision_of(shape, _geometry(shape))
    return dataclasses.replace(made, more=CONCAVE) if shape.kind == "heightfield" else made


def _geometry(shape: Shape) -> UrdfGeometry:
    if shape.kind == "plane":
        return PLANE
    if shape.kind == "capsule":
        return UrdfGeometry("capsule", (("radius", shape.size[:1]), ("length", shape.size[1:])))
    return geometry_of(shape)


def _joint(body: Body, parent: str, origin: Pose) -> UrdfJoint:
    joint = body.joint
    limits = limits_of(body)
    if joint.kind == "slide" and joint.position_limits is None:
        limits = (*UNLIMITED_SLIDE, *limits)
    limited_hinge = joint.kind == "hinge" and joint.position_limits is not None
    return UrdfJoint(
        joint.name,
        "revolute" if limited_hinge else JOINT_TYPES[joint.kind],
        parent,
        body.name,
        origin_of(origin),
        joint.axis if joint.kind in SCALAR_JOINTS else NO_AXIS,
        UrdfDynamics(joint.damping, joint.dry_friction) if joint.kind != "fixed" else None,
        limits,
    )


POSITION_NUMBERS = 128
"""Numbers that PyBullet exchanges of one tree's position, 7 of them for its base, fixed or not; beyond that it gives
states of some joints as empty, without a word (measured: 121 hinges work, 122 do not)."""

_EXTENSION = exact("simspec writes PyBullet's extension of URDF")
COPIES = via_api(
    "simspec writes further materials and copies of shapes on massless fixed links, and filters their contacts"
)
NO_BELTS = "PyBullet's surfaces move with their bodies only"
STIFFNESS_ONLY = "PyBullet's contact stiffness in N/m does not scale with mass. State stiffness and damping"


class PybulletDialect(Dialect):
    """URDF with PyBullet's extensions."""

    NAME: ClassVar[str] = "pybullet"
    FORMAT: ClassVar[str] = "urdf"
    SIDECAR: ClassVar[type[Sidecar]] = PybulletSidecar
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = {
        "sleeping": NeededSetting(bool, optional=True),
        "collision_margin": NeededSetting(float),
    }
    SUPPORT: ClassVar[Table] = {
        **classes.with_sidecar("PyBullet", classes.SIDECAR),
        Feature.JOINT_BALL: _EXTENSION,
        **exactly(
            Feature.LIMIT_POSITION, *features.LIMIT_RATINGS, Feature.DAMPING, Feature.BALL_DAMPING, Feature.FRICTION
        ),
        **for_each(
            via_api(classes.SIDECAR),
            *(*features.INITIAL_STATE, Feature.RESTITUTION_THRESHOLD, Feature.HARDNESS_NATIVE, *features.PHYSICS),
        ),
        **for_each(via_api(classes.EFFORTS), Feature.SPRING, Feature.BALL_SPRING),
        Feature.INERTIA_FULL: exact("as principal moments with an orientation"),
        Feature.TREE_SIZE: TREE_SIZE,
        Feature.TREE_DEPTH: never(NO_LINKS),
        **shape_kinds("PyBullet", (*KINDS, *EXTRA_GEOMETRIES, "heightfield")),
        **for_each(_EXTENSION, Feature.SHAPE_CAPSULE, Feature.SHAPE_PLANE),
        Feature.SURFACE_VELOCITY: never(NO_BELTS),
        **for_each(
            COPIES,
            *(Feature.MATERIALS_PER_BODY, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS, Feature.HARDNESS_PAIRS),
        ),
        Feature.HARDNESS_TIME_CONSTANT: never(STIFFNESS_ONLY),
        Feature.BALL_LIMIT: never("PyBullet's spherical joints have no limits"),
    }

    def lower(self, world: World, target: Target) -> Lowered:
        """Robots by file, and the sidecar. Raises UnsupportedError for a tree with too many joints for PyBullet."""
        _check(world, target)
        moved, offsets = recentre_free_roots(world)
        coordinates = InitialCoordinates(world)
        files = RobotFiles({SIDECAR})
        instances = []
        alongside = frames_alongside(world)
        for tree in trees(moved).values():
            bodies = tuple(body for body in tree if body.name not in alongside)
            parts = {body.name: split(body, target.plan) for body in bodies}
            robot = robot_of(bodies, parts, float(target.settings["collision_margin"]))
            instances.append(instance_of(files.add(robot), bodies, parts, coordinates))
        sidecar = PybulletSidecar(
            **common_fields(self.NAME, self.FORMAT, world, target, offsets),
            gravity=world.physics.gravity,
            timestep=world.physics.timestep,
            instances=tuple(instances),
            springs=springs_of(world),
            armature=armature_of(world),
            collision_filter=collision_filter(world, target.plan),
            restitution_threshold=restitution_threshold(world),
            native_contact=native_contact(world),
            frames=tuple(frame_of(body) for body in moved.bodies if body.name in alongside) or None,
            sleepers=tuple(sorted(free_rigid(world))) if target.settings.get("sleeping", False) else None,
        )
        return Lowered(files.robots, sidecar)

    def raise_(self, document: UrdfDocument, sidecar: PybulletSidecar) -> ReadBack:
        return raised(document, sidecar)


def _check(world: World, target: Target) -> None:
    """Raise UnsupportedError with all that PyBullet cannot have of this world."""
    refused = problems(world)
    alongside = frames_alongside(world)
    for root, tree in trees(world).items():
        bodies = [body for body in tree if body.name not in alongside]
        links = sum(len(split(body, target.plan)) for body in bodies)
        if links > MOST_LINKS:
            refused.append(
                Problem(
                    f"PyBullet supports at most {MOST_LINKS} links in one tree",
                    f"bodies.{root}",
                    found=f"{links}, of which {links - len(bodies)} carry further materials or copies of shapes",
                    hint="split the tree, use fewer materials in it, or run without this engine",
                    code="E104",
                )
            )
        numbers = 7 + sum(POSITION_SIZE[body.joint.kind] for body in bodies if body.joint.kind != "free")
        if numbers > POSITION_NUMBERS:
            refused.append(
                Problem(
                    "PyBullet does not support tree.size: it exchanges at most "
                    f"{POSITION_NUMBERS} position numbers of one tree, 7 of them for the base",
                    f"bodies.{root}",
                    found=f"{numbers}: a hinge or slide counts 1, a ball 4",
                    hint="split the tree, or run without this engine",
                    code="E104",
                )
            )
    if refused:
        raise UnsupportedError(refused)
