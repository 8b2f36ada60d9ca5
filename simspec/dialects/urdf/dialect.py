"""World to plain URDF and a sidecar, for engines that read the language as it is and have no dialect of their own.

One file for each distinct tree. Data without a place in URDF are in the sidecar (:class:`UrdfSidecar`): gravity, timestep,
initial state, springs, armature, shapes that the language lacks, contact and its filters. Which of it an engine can have, the
engine's own ``SUPPORT`` says. Ball joints have no place in either: they are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from simspec.contact.plan import ContactPlan
from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.joints import InitialCoordinates, armature_of, springs_of
from simspec.dialects.kit.sidecar import SIDECAR, Sidecar, Target, common_fields
from simspec.dialects.urdf.raising import raised
from simspec.dialects.urdf.sidecar import SIDECAR_KINDS, Numbers, ShapePair, SidecarShape, UrdfInstance, UrdfSidecar
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.urdf.reading import UrdfDocument
from simspec.formats.urdf.robots import LANGUAGE_KINDS, UNLIMITED, RobotFiles, standard_robot
from simspec.support import classes, features
from simspec.support.declarations import Table, exactly, for_each, never, shape_kinds, via_api
from simspec.support.features import Feature
from simspec.world.contact_pairs import excluded_pairs, meeting_laws, shape_pairs
from simspec.world.kinematics import trees
from simspec.world.types import Body, Hardness, ReadBack, Shape, World

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
        Feature.FREE_ARMATURE: never("simspec writes no armature of free bodies in addition to URDF"),
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
        problems.append(Problem("plain URDF does not support copies of shapes in layers", "contact.pairs"))
    for body in world.bodies:
        joint, path = body.joint, f"bodies.{body.name}.joint"
        if joint.kind == "ball":
            problems.append(Problem(_NO_BALL, path))
        numbers = (*(joint.position_limits or ()), joint.velocity_limit or 0.0, joint.effort_limit or 0.0)
        if any(abs(number) >= UNLIMITED for number in numbers):
            problems.append(
                Problem(
                    "plain URDF has such a limit where a joint has none",
                    f"{path}.limits",
                    allowed=f"below {UNLIMITED:g}",
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
