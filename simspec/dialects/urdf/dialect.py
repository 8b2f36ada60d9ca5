"""World to plain URDF and a sidecar, for engines that read the language as it is and have no dialect of their own.

One file for each distinct tree. Data without a place in URDF are in the sidecar (:class:`UrdfSidecar`): gravity, timestep,
initial state, springs, armature, shapes that the language lacks, contact and its filters. Which of it an engine can have, the
engine's own ``SUPPORT`` says. Ball joints have no place in either: they are refused.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import partial
from typing import ClassVar, Final

from simspec.contact import ContactPlan
from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import (
    SIDECAR,
    UNREADABLE,
    InitialCoordinates,
    Sidecar,
    Target,
    add_armature,
    add_springs,
    armature_of,
    common_fields,
    fluid_of,
    springs_of,
    with_passive,
)
from simspec.dialects.urdf.sidecar import SIDECAR_KINDS, Numbers, ShapePair, SidecarShape, UrdfInstance, UrdfSidecar
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import recentre_free_roots, restore_frames
from simspec.formats.urdf.reading import (
    DEFAULT_AXIS,
    WRITTEN,
    UrdfDocument,
    UrdfJointNode,
    UrdfLimitNode,
    UrdfLinkNode,
    UrdfRobotNode,
    check_empty,
    check_meshes,
    inertial_of,
    pose_of,
    shapes_of,
    size_of,
    unknown_parts,
)
from simspec.formats.urdf.robots import LANGUAGE_KINDS, UNLIMITED, RobotFiles, standard_robot
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import Table, exactly, for_each, never, shape_kinds, via_api
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.contact_pairs import excluded_pairs, meeting_laws, shape_pairs
from simspec.world.kinematics import trees
from simspec.world.types import (
    POSITION_SIZE,
    VELOCITY_SIZE,
    Body,
    EnginePair,
    Hardness,
    Joint,
    ReadBack,
    Shape,
    Surface,
    World,
)

# The model that plain URDF and its sidecar mean, in the world's frames and order (proof level L0).

KINDS: Final[Mapping[str, str]] = {
    "fixed": "fixed",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
}
"""The kind of joint that each type is."""
NO_LIMIT: Final = 1e9
"""A limit from here on stands for none."""


def raised(document: UrdfDocument, sidecar: UrdfSidecar) -> ReadBack:
    """The model of a document and its sidecar. Raises ValueError where they do not fit together, or a file has what simspec
    does not write."""
    for robot in document.robots.values():
        for unknown in unknown_parts(robot, WRITTEN):
            what = f"the attribute {unknown.name!r} of" if unknown.name is not None else "an element"
            raise unknown.node.error(f"{what} {unknown.path} that simspec does not write, or that is repeated")
    check_meshes(document)
    surfaces = {numbers.material: _surface(numbers) for numbers in sidecar.materials}
    alongside = {entry.shape: entry for entry in sidecar.alongside}
    first: dict[str, UrdfInstance] = {}
    bodies: dict[str, Body] = {}
    for instance in sidecar.instances:
        if instance.file not in document.robots:
            raise ValueError(f"the file {instance.file!r} is missing")
        pattern = first.setdefault(instance.file, instance)
        tree = _Tree(document.robots[instance.file], document.meshes, pattern, instance, surfaces, alongside)
        for body in tree.bodies():
            bodies[body.name] = body
    if unused := document.robots.keys() - first.keys():
        raise ValueError(f"the sidecar names no instance of {', '.join(sorted(unused))}")
    add_springs(bodies, sidecar.springs)
    add_armature(bodies, sidecar.armature)
    return ReadBack(
        restore_frames(
            with_passive(tuple(bodies[body.name] for body in sidecar.bodies), sidecar.passive), sidecar.offsets
        ),
        sidecar.gravity,
        sidecar.timestep,
        sidecar.friction_cone,
        dict(UNREADABLE),
        constraints=sidecar.constraints or (),
        sums=sidecar.sums or (),
        fluid=fluid_of(sidecar.passive),
        pairs=tuple(EnginePair(pair.first, pair.second, _surface(pair)) for pair in sidecar.pairs),
    )


def _surface(numbers: Numbers | ShapePair) -> Surface:
    return Surface(
        numbers.friction,
        numbers.torsional_friction,
        numbers.rolling_friction,
        numbers.restitution,
        numbers.hardness,
    )


class _Tree:
    """One tree: its file, the names that the file has (of the ``first`` instance that shares it), and those of this one."""

    def __init__(
        self,
        robot: UrdfRobotNode,
        meshes: Mapping[str, tuple[float, ...]],
        first: UrdfInstance,
        instance: UrdfInstance,
        surfaces: Mapping[str, Surface],
        alongside: Mapping[str, SidecarShape],
    ):
        links = robot.links if instance.free else robot.links[1:]
        if [link.name for link in links] != list(first.bodies) or robot.root != first.root_link:
            raise ValueError(f"{instance.file}: the links are not those of the sidecar, {list(first.bodies)}")
        if not robot.links or robot.links[0].name != robot.root or instance.free != first.free:
            raise ValueError(f"{instance.file}: its root is not the sidecar's")
        if len(first.bodies) != len(instance.bodies):
            raise ValueError(f"{instance.file}: two instances have other links")
        if not instance.free:
            check_empty(robot.links[0])
        self._links, self._first, self._instance, self._meshes = links, first, instance, meshes
        self._joints = {joint.child: joint for joint in robot.joints}
        self._name_of = dict(zip(first.bodies, instance.bodies, strict=True))
        self._surfaces, self._alongside = surfaces, alongside

    def bodies(self) -> list[Body]:
        """In the order of the file."""
        instance = self._instance
        bodies = []
        q, v = list(instance.position), list(instance.velocity)
        for place, link in enumerate(self._links):
            joint = self._joint_above(link)
            position = tuple(q[: POSITION_SIZE[joint.kind]])
            velocity = tuple(v[: VELOCITY_SIZE[joint.kind]])
            del q[: POSITION_SIZE[joint.kind]], v[: VELOCITY_SIZE[joint.kind]]
            if joint.kind == "free":
                # the sidecar has ω in body axes; the file's frame is at the centre of mass
                velocity = (*velocity[:3], *frames.rotate(position[3:7], velocity[3:]))  # type: ignore[arg-type]
            bodies.append(
                Body(
                    instance.bodies[place],
                    instance.model,
                    inertial_of(link.inertial),
                    dataclasses.replace(joint, name=instance.joints[place], position=position, velocity=velocity),
                    self._shapes(place, link),
                )
            )
        return bodies

    def _joint_above(self, link: UrdfLinkNode) -> Joint:
        read = self._joints.get(link.name)
        if read is None:
            return Joint("", "free")
        joint = _joint(read)
        if not self._instance.free and joint.parent == self._first.root_link:
            return dataclasses.replace(joint, parent=None)
        return dataclasses.replace(joint, parent=self._name_of[joint.parent or ""])

    def _shapes(self, place: int, link: UrdfLinkNode) -> tuple[Shape, ...]:
        """The shapes of a body, in the sidecar's order: of the file, or of the sidecar itself."""
        in_file = shapes_of(link, partial(size_of, meshes=self._meshes))
        names, local = self._first.shapes[place], self._instance.shapes[place]
        materials = self._instance.materials[place]
        whole = []
        for name_in_file, name, material in zip(names, local, materials, strict=True):
            entry = self._alongside.get(name)
            shape = _shape(entry) if entry is not None else in_file.pop(name_in_file, None)
            if shape is None:
                raise link.node.error(f"link {link.name!r} has no shape {name_in_file!r}, which the sidecar names")
            if shape.collision != bool(material):
                raise link.node.error(
                    f"shape {name_in_file!r} and the sidecar differ on whether it is a collision shape"
                )
            actual = (self._surfaces[material],) if shape.collision else ()
            whole.append(dataclasses.replace(shape, name=name, surfaces=actual))
        if in_file:
            raise link.node.error(f"link {link.name!r} has shapes that the sidecar does not name: {sorted(in_file)}")
        return tuple(whole)


def _shape(entry: SidecarShape) -> Shape:
    shape = Shape(entry.shape, entry.kind, entry.size, entry.pose, collision=entry.collision, visual=entry.visual)
    return dataclasses.replace(shape, colour=entry.colour) if entry.visual else shape


def _joint(joint: UrdfJointNode) -> Joint:
    if joint.type not in KINDS:
        raise joint.node.error(f"type={joint.type[:60]!r} of joint {joint.name!r} is not of the dialect")
    kind = KINDS[joint.type]
    moves = kind in SCALAR_JOINTS
    limits = joint.limit if moves else None
    dynamics = joint.dynamics
    if not moves and (joint.limit is not None or dynamics is not None):
        raise joint.node.error(f"joint {joint.name!r} of type {joint.type} has limits or dynamics")
    return Joint(
        joint.name,
        kind,
        joint.parent,
        pose_of(joint.origin),
        (joint.axis or DEFAULT_AXIS) if moves else (0.0, 0.0, 0.0),
        None if joint.type == "continuous" else _position_limits(joint, limits),
        _rating(limits.velocity if limits is not None else None),
        _rating(limits.effort if limits is not None else None),
        damping=(dynamics.damping or 0.0) if dynamics is not None else 0.0,
        dry_friction=(dynamics.friction or 0.0) if dynamics is not None else 0.0,
    )


def _position_limits(joint: UrdfJointNode, limits: UrdfLimitNode | None) -> tuple[float, float] | None:
    """The limits of a revolute or prismatic joint; URDF demands the element, and takes 0 for what it does not say."""
    if joint.type == "fixed":
        return None
    if limits is None:
        raise joint.node.error(f"joint {joint.name!r} of type {joint.type} has no <limit>")
    lower, upper = limits.lower or 0.0, limits.upper or 0.0
    return None if lower <= -NO_LIMIT and upper >= NO_LIMIT else (lower, upper)


def _rating(value: float | None) -> float | None:
    return None if value is None or value >= NO_LIMIT else value


_NO_BALL = "URDF has no ball joint"


class UrdfDialect(Dialect):
    """Plain URDF with a sidecar."""

    NAME: ClassVar[str] = "urdf"
    FORMAT: ClassVar[str] = "urdf"
    SIDECAR: ClassVar[type[Sidecar]] = UrdfSidecar
    SUPPORT: ClassVar[Table] = {
        **classes.with_sidecar("URDF", classes.SIDECAR),
        **shape_kinds("URDF", LANGUAGE_KINDS),
        **exactly(Feature.JOINT_SEVERAL, Feature.LIMIT_POSITION, *features.LIMIT_RATINGS, Feature.DAMPING),
        **for_each(
            via_api(classes.SIDECAR),
            *(Feature.SPRING, *features.INITIAL_STATE, Feature.SHAPE_CAPSULE, Feature.SHAPE_ELLIPSOID),
            *(Feature.SHAPE_PLANE, Feature.MATERIALS_PER_BODY, *features.FRICTIONS, *features.RESTITUTIONS),
            *(*features.HARDNESSES, Feature.CONE_PYRAMID_INSCRIBED, *features.PHYSICS),
        ),
        **for_each(never("simspec writes no margins in addition to URDF"), *features.MARGINS),
        Feature.SURFACE_VELOCITY: never("simspec writes no surface velocities in addition to URDF"),
        **for_each(
            never(_NO_BALL), Feature.JOINT_BALL, Feature.BALL_DAMPING, Feature.BALL_ARMATURE, Feature.BALL_SPRING
        ),
        Feature.BALL_LIMIT: never("URDF has no ball joints"),
    }

    def lower(self, world: World, target: Target) -> Lowered:
        _check(world, target.plan)
        moved, offsets = recentre_free_roots(world)
        coordinates = InitialCoordinates(world)
        files = RobotFiles({SIDECAR})
        instances = []
        for bodies in trees(moved).values():
            robot = standard_robot(bodies, LANGUAGE_KINDS)
            alongside = tuple(tuple(shape.kind in SIDECAR_KINDS for shape in body.shapes) for body in bodies)
            root = robot.links[0].name
            instances.append(_instance(files.add(robot, alongside), root, bodies, coordinates))
        sidecar = UrdfSidecar(
            **common_fields(self.NAME, self.FORMAT, world, target, offsets),
            gravity=world.physics.gravity,
            timestep=world.physics.timestep,
            instances=tuple(instances),
            alongside=tuple(
                _sidecar_shape(body, shape)
                for body in moved.bodies
                for shape in body.shapes
                if shape.kind in SIDECAR_KINDS
            ),
            springs=springs_of(world),
            armature=armature_of(world),
            materials=tuple(_numbers(world, target.plan)),
            pairs=tuple(_pairs(world, target.plan)),
            laws=world.contact.pairs,
            groups=tuple(body.collision_group for body in world.bodies),
            ignored_groups=world.contact.ignored_groups,
            excluded=excluded_pairs(world),
        )
        return Lowered(files.robots, sidecar)

    def raise_(self, document: UrdfDocument, sidecar: UrdfSidecar) -> ReadBack:
        return raised(document, sidecar)


def _check(world: World, plan: ContactPlan) -> None:
    """Raise UnsupportedError with all that neither the files nor the sidecar can have."""
    problems = []
    if plan.layered:
        problems.append(Problem("plain URDF does not support copies of shapes in layers", "contact.pairs", code="E104"))
    for body in world.bodies:
        joint, path = body.joint, f"bodies.{body.name}.joint"
        if joint.kind == "ball":
            problems.append(Problem(_NO_BALL, path, code="E104"))
        numbers = (*(joint.position_limits or ()), joint.velocity_limit or 0.0, joint.effort_limit or 0.0)
        if any(abs(number) >= UNLIMITED for number in numbers):
            problems.append(
                Problem(
                    "plain URDF has such a limit where a joint has none",
                    f"{path}.limits",
                    allowed=f"below {UNLIMITED:g}",
                    code="E104",
                )
            )
    if problems:
        raise UnsupportedError(problems)


def _instance(file: str, root_link: str, bodies: tuple[Body, ...], coordinates: InitialCoordinates) -> UrdfInstance:
    position, velocity = coordinates.of(bodies)
    return UrdfInstance(
        file=file,
        model=bodies[0].model,
        free=bodies[0].joint.kind == "free",
        root_link=root_link,
        bodies=tuple(body.name for body in bodies),
        joints=tuple(body.joint.name for body in bodies),
        shapes=tuple(tuple(shape.name for shape in body.shapes) for body in bodies),
        materials=tuple(tuple(shape.material if shape.collision else "" for shape in body.shapes) for body in bodies),
        position=position,
        velocity=velocity,
    )


def _sidecar_shape(body: Body, shape: Shape) -> SidecarShape:
    return SidecarShape(
        body.name, shape.name, shape.kind, shape.size, shape.pose, shape.collision, shape.visual, shape.colour
    )


def _numbers(world: World, plan: ContactPlan) -> Iterator[Numbers]:
    """The surface of the shapes of each material, in the single layer."""
    for material in world.contact.materials:
        (layer,) = plan.layers(material.name)
        surface = plan.numbers[material.name, layer]
        yield Numbers(
            material.name,
            surface.friction or 0.0,
            surface.torsional_friction or 0.0,
            surface.rolling_friction or 0.0,
            surface.restitution or 0.0,
            surface.hardness or Hardness(),
        )


def _pairs(world: World, plan: ContactPlan) -> Iterator[ShapePair]:
    """The pairs of shapes whose law no values of materials express."""
    laws = meeting_laws(world)
    wanted = plan.missed if plan.explicit is None else plan.explicit
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    for first, second in shape_pairs(world, wanted):
        name, other = sorted((material[first], material[second]))
        law = laws[name, other]
        yield ShapePair(
            first, second, law.friction, law.torsional_friction, law.rolling_friction, law.restitution, law.hardness
        )
