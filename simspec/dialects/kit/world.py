"""A world and its contact plan as ``world.json``, for engines that are built by calls of their API.

The dialect of such an engine is a subclass of :class:`WorldDialect`, if it has fields of its own with a subclass of
:class:`WorldSidecar`; its defects and mutations begin from the tables of ``world_defects.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from simspec.contact import ContactPlan
from simspec.control.reference import natives
from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar, Target, common_fields, fluid_of, known, with_passive
from simspec.formats import world as tree
from simspec.formats.kit.contract import recentre_free_roots, restore_frames
from simspec.formats.kit.forms import check_distinct, check_known
from simspec.formats.world import WORLD, JsonWorld, ShapeCopy, WorldJson
from simspec.language.vocabulary import HARDNESS_KINDS
from simspec.support import classes
from simspec.support.declarations import Table
from simspec.world import frames
from simspec.world.contact_pairs import excluded_pairs, solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import (
    Body,
    EngineServo,
    Inertial,
    Joint,
    PairContact,
    ReadBack,
    Shape,
    Surface,
    Vector3,
    World,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldSidecar(Sidecar):
    """Settings, and where the frames of free roots are."""

    def check(self) -> None:
        """Raise ValueError where the frame of another body than a free root is moved."""
        for body in self.bodies:
            if body.kind != "free" and any(body.frame_offset):
                raise ValueError(f"the sidecar moves the frame of {body.name!r}, which is not a free root")

    def check_document(self, document: JsonWorld) -> None:
        """Raise ValueError where the sidecar is of another world than ``document``."""
        if [(body.name, body.kind) for body in self.bodies] != [
            (body.name, body.joint.kind) for body in document.bodies
        ]:
            raise ValueError(f"the bodies of {WORLD} differ from those that the sidecar names")
        if self.friction_cone != document.friction_cone:
            raise ValueError(f"the friction cone of {WORLD} is not the sidecar's")


NUMBERS = ("friction", "torsional_friction", "rolling_friction", "restitution")
"""Of a surface, in the order of :class:`simspec.formats.world.ShapeCopy`."""


class WorldDialect(Dialect, abstract=True):
    """The document of a world with the copies of the target's plan, and a sidecar of the class ``SIDECAR``."""

    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = {**WorldJson.SUPPORT, **classes.LUMPED}
    SIDECAR: ClassVar[type[Sidecar]] = WorldSidecar

    def fields(self, world: World, target: Target, document: tree.JsonWorld) -> Mapping[str, Any]:
        """The fields of the sidecar that are not common to all dialects."""
        return {}

    def lower(self, world: World, target: Target) -> Lowered:
        document, offsets = world_document(world, target)
        fields = common_fields(self.NAME, self.FORMAT, world, target, offsets)
        return Lowered(document, self.SIDECAR(**fields, **self.fields(world, target, document)))

    def raise_(self, document: tree.JsonWorld, sidecar: Any) -> ReadBack:
        return world_model(document, sidecar)


def world_document(world: World, target: Target) -> tuple[tree.JsonWorld, Mapping[str, Vector3]]:
    """The document of ``world`` with the copies of the target's plan, and where the frames of free
    roots stand in the world's (m)."""
    moved, offsets = recentre_free_roots(world)
    plan = target.plan
    copies = {
        (shape.material, layer)
        for body in world.bodies
        for shape in solid_shapes(body)
        for layer in plan.layers(shape.material)
    }
    servos = {
        name: tree.JsonServo(kp, kd, limit)
        for native in natives(world)
        for name, kp, kd, limit in zip(native.joints, native.kp, native.kd, native.effort_limits, strict=True)
    }
    used = {body.collision_group for body in world.bodies if solid_shapes(body)}
    document = tree.JsonWorld(
        gravity=world.physics.gravity,
        timestep=world.physics.timestep,
        friction_cone=world.contact.friction_cone,
        bodies=tuple(_body(body, plan, servos.get(body.joint.name)) for body in moved.bodies),
        meets=tuple(
            (*pair, layer)
            for pair, layer in sorted(plan.layer_of.items())
            if {(material, layer) for material in pair} <= copies
        ),
        excluded=tree.Excluded(
            excluded_pairs(world), tuple(pair for pair in world.contact.ignored_groups if set(pair) <= used)
        ),
    )
    return document, offsets


def _body(body: Body, plan: ContactPlan, servo: tree.JsonServo | None) -> tree.JsonBody:
    # an immovable body may be written without mass and with moments, which engines refuse
    inertial = body.inertial if body.inertial.mass else NO_INERTIA
    return tree.JsonBody(
        body.name,
        body.model,
        body.collision_group,
        inertial.mass,
        inertial.centre_of_mass,
        inertial.inertia,
        _joint(body.joint, servo),
        tuple(_shape(shape, plan) for shape in body.shapes),
    )


def _joint(joint: Joint, servo: tree.JsonServo | None) -> tree.Joint:
    """Of a joint the fields that its kind has."""
    name, parent, origin = joint.name, joint.parent, joint.origin
    position, velocity = joint.position, joint.velocity
    match joint.kind:
        case "fixed":
            return tree.FixedJoint(name=name, parent=parent, origin=origin)
        case "free":
            return tree.FreeJoint(name=name, position=position, velocity=velocity)  # type: ignore[arg-type]
        case "ball":
            return tree.BallJoint(
                name=name,
                parent=parent,
                origin=origin,
                damping=joint.damping,
                spring_stiffness=joint.spring_stiffness,
                position=position,  # type: ignore[arg-type]
                velocity=velocity,  # type: ignore[arg-type]
                armature=joint.armature or None,
            )
    return tree.AxisJoint(
        name=name,
        kind=joint.kind,  # type: ignore[arg-type]
        parent=parent,
        origin=origin,
        axis=joint.axis,
        position_limits=joint.position_limits,
        velocity_limit=joint.velocity_limit,
        effort_limit=joint.effort_limit,
        damping=joint.damping,
        spring_stiffness=joint.spring_stiffness,
        spring_rest=joint.spring_rest,
        dry_friction=joint.dry_friction,
        armature=joint.armature,
        position=position,  # type: ignore[arg-type]
        velocity=velocity,  # type: ignore[arg-type]
        servo=servo,
    )


def _shape(shape: Shape, plan: ContactPlan) -> tree.JsonShape:
    """A shape; one that is not solid has no copies, one that cannot be seen no colour."""
    layers = plan.layers(shape.material) if shape.collision else ()
    return tree.JsonShape(
        shape.name,
        shape.kind,
        shape.size,
        shape.pose,
        shape.material if shape.collision else "",
        shape.colour if shape.visual else None,
        tuple(_copy(layer, plan.numbers[shape.material, layer]) for layer in layers),
    )


def _copy(layer: int, numbers: Surface) -> tree.ShapeCopy:
    sliding, torsional, rolling, bounce = (known(numbers, name) for name in NUMBERS)
    return tree.ShapeCopy(layer, sliding, torsional, rolling, bounce, numbers.hardness)


NOTHING = ShapeCopy(0, 0.0, 0.0, 0.0, 0.0)
"""The numbers of shapes: none, since the table has all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSidecar(WorldSidecar):
    """Settings, where the frames of free roots are, and laws of materials."""

    laws: tuple[PairContact, ...]
    """The law of every two materials that meet, by their sorted names."""

    def check(self) -> None:
        WorldSidecar.check(self)
        check_distinct(((law.first, law.second) for law in self.laws), "sidecar.laws")
        check_known((law.hardness.kind for law in self.laws), HARDNESS_KINDS, "sidecar.laws, kinds of hardness")
        for index, law in enumerate(self.laws):
            at = f"sidecar.laws.{index}"
            if law.first > law.second:
                raise ValueError(f"{at}: {law.first!r} and {law.second!r} are not sorted")
            if not law.collide:
                raise ValueError(f"{at} is of materials that pass through each other")

    def check_document(self, document: JsonWorld) -> None:
        """Raise ValueError where the sidecar is of another world than ``document``, or where shapes have numbers of their own,
        which nothing would go by."""
        WorldSidecar.check_document(self, document)
        given = {(law.first, law.second) for law in self.laws}
        meets = {(name, other) for name, other, _ in document.meets}
        if given != meets or any(layer for *_, layer in document.meets):
            raise ValueError(f"the materials that meet in {WORLD} are not those of sidecar.laws")
        for body in document.bodies:
            for shape in body.shapes:
                if shape.copies and shape.copies != (NOTHING,):
                    raise ValueError(
                        f"the shape {shape.name!r} of {WORLD} has numbers in addition to those of sidecar.laws"
                    )


class LawDialect(WorldDialect, abstract=True):
    """``world.json``, whose shapes have no surfaces, and the laws of pairs of materials in the sidecar."""

    SIDECAR: ClassVar[type[Sidecar]] = LawSidecar

    def fields(self, world: World, target: Target, document: JsonWorld) -> Mapping[str, Any]:
        # in a probe of two materials the plan may have more pairs than meet there
        laws = {(law.first, law.second): law for law in world.contact.pairs}
        return {"laws": tuple(laws[name, other] for name, other, _ in document.meets)}

    def raise_(self, document: JsonWorld, sidecar: LawSidecar) -> ReadBack:
        return replace(super().raise_(document, sidecar), laws=sidecar.laws)


def world_model(document: tree.JsonWorld, sidecar: WorldSidecar) -> ReadBack:
    """The model of a document. Raises ValueError where document and sidecar are not of one world."""
    sidecar.check_document(document)
    return ReadBack(
        restore_frames(
            with_passive(tuple(_raised_body(body) for body in document.bodies), sidecar.passive), sidecar.offsets
        ),
        document.gravity,
        document.timestep,
        document.friction_cone,
        servos=tuple(
            EngineServo(joint.name, joint.servo.kp, joint.servo.kd, joint.servo.effort_limit)
            for joint in (body.joint for body in document.bodies)
            if isinstance(joint, tree.AxisJoint) and joint.servo is not None
        ),
        constraints=sidecar.constraints or (),
        sums=sidecar.sums or (),
        fluid=fluid_of(sidecar.passive),
    )


def _raised_body(body: tree.JsonBody) -> Body:
    inertial = Inertial(body.mass, body.centre_of_mass, body.inertia)
    shapes = tuple(_raised_shape(shape) for shape in body.shapes)
    return Body(body.name, body.model, inertial, _raised_joint(body.joint), shapes, body.group)


def _raised_joint(joint: tree.Joint) -> Joint:
    if isinstance(joint, tree.FreeJoint):
        x, y, z, *turn = joint.position
        position = (x, y, z, *frames.normalise((turn[0], turn[1], turn[2], turn[3])))
        return Joint(joint.name, joint.kind, position=position, velocity=joint.velocity)
    weld = Joint(joint.name, joint.kind, joint.parent, joint.origin)
    if isinstance(joint, tree.FixedJoint):
        return weld
    springy = replace(weld, damping=joint.damping, spring_stiffness=joint.spring_stiffness, velocity=joint.velocity)
    if isinstance(joint, tree.BallJoint):
        return replace(springy, armature=joint.armature or 0.0, position=frames.normalise(joint.position))
    return replace(
        springy,
        axis=joint.axis,
        position_limits=joint.position_limits,
        velocity_limit=joint.velocity_limit,
        effort_limit=joint.effort_limit,
        dry_friction=joint.dry_friction,
        armature=joint.armature,
        spring_rest=joint.spring_rest,
        position=joint.position,
    )


def _raised_shape(shape: tree.JsonShape) -> Shape:
    surfaces = tuple(
        Surface(copy.friction, copy.torsional_friction, copy.rolling_friction, copy.restitution, copy.hardness)
        for copy in shape.copies
    )
    read = Shape(shape.name, shape.kind, shape.size, shape.pose, collision=bool(surfaces), surfaces=surfaces)
    if shape.colour is None:
        return replace(read, visual=False)
    return replace(read, visual=True, colour=shape.colour)
