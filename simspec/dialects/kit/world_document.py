"""A world and its contact plan as ``world.json``, for engines that are built by calls of their API.

The dialect of such an engine is a subclass of :class:`WorldDialect`. Its ``defects.py`` begins from
``world_defects.DEFECTS``, its table of mutations is ``world_mutations.table`` with the words of the engine's settings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from simspec.contact.plan import ContactPlan
from simspec.control.native import natives
from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar, common_fields
from simspec.dialects.kit.target import Target, known
from simspec.dialects.kit.world_sidecar import WorldSidecar
from simspec.formats.kit.contract import recentre_free_roots
from simspec.formats.world import tree
from simspec.formats.world.format import WorldJson
from simspec.support.declarations import LUMPED, Table
from simspec.world.contact_pairs import excluded_pairs, solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Joint, ReadBack, Shape, Surface, Vector3, World

NUMBERS = ("friction", "torsional_friction", "rolling_friction", "restitution")
"""Of a surface, in the order of :class:`simspec.formats.world.tree.ShapeCopy`."""


class WorldDialect(Dialect, abstract=True):
    """The document of a world with the copies of the target's plan, and a sidecar of the class ``SIDECAR``."""

    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = {**WorldJson.SUPPORT, **LUMPED}
    SIDECAR: ClassVar[type[Sidecar]] = WorldSidecar

    def fields(self, world: World, target: Target, document: tree.JsonWorld) -> Mapping[str, Any]:
        """The fields of the sidecar that are not common to all dialects."""
        return {}

    def lower(self, world: World, target: Target) -> Lowered:
        document, offsets = world_document(world, target)
        fields = common_fields(self.NAME, self.FORMAT, world, target, offsets)
        return Lowered(document, self.SIDECAR(**fields, **self.fields(world, target, document)))

    def raise_(self, document: tree.JsonWorld, sidecar: Any) -> ReadBack:
        """See ``dialects/kit/world_model.py``."""
        from simspec.dialects.kit.world_model import world_model

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
        for one in natives(world)
        for name, kp, kd, limit in zip(one.joints, one.kp, one.kd, one.effort_limits, strict=True)
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
        apart=tree.Apart(
            excluded_pairs(world),
            tuple(pair for pair in world.contact.ignored_groups if set(pair) <= used),
        ),
    )
    return document, offsets


def _body(body: Body, plan: ContactPlan, servo: tree.JsonServo | None) -> tree.JsonBody:
    # what cannot move may be written without mass and with moments, which engines refuse
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
    """A copy's numbers."""
    sliding, torsional, rolling, bounce = (known(numbers, name) for name in NUMBERS)
    return tree.ShapeCopy(layer, sliding, torsional, rolling, bounce, numbers.hardness)
