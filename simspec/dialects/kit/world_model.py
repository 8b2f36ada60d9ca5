"""From ``world.json`` and its sidecar back to the model they mean, in the world's frames (proof level L0).

What is shared with ``world_document.py``, which writes them, is the types of the document.
"""

from __future__ import annotations

from dataclasses import replace

from simspec.dialects.kit.passive import fluid_of, with_passive
from simspec.dialects.kit.world_sidecar import WorldSidecar
from simspec.formats.kit.contract import restore_frames
from simspec.formats.world import tree
from simspec.world import frames
from simspec.world.types import Body, EngineServo, Inertial, Joint, ReadBack, Shape, Surface


def world_model(document: tree.JsonWorld, sidecar: WorldSidecar) -> ReadBack:
    """The model of a document. Raises ValueError where document and sidecar are not of one world."""
    sidecar.check_document(document)
    return ReadBack(
        restore_frames(with_passive(tuple(_body(body) for body in document.bodies), sidecar.passive), sidecar.offsets),
        document.gravity,
        document.timestep,
        document.friction_cone,
        servos=_servos(document),
        constraints=sidecar.constraints or (),
        sums=sidecar.sums or (),
        fluid=fluid_of(sidecar.passive),
    )


def _servos(document: tree.JsonWorld) -> tuple[EngineServo, ...]:
    joints = (body.joint for body in document.bodies)
    return tuple(
        EngineServo(joint.name, joint.servo.kp, joint.servo.kd, joint.servo.effort_limit)
        for joint in joints
        if isinstance(joint, tree.AxisJoint) and joint.servo is not None
    )


def _body(body: tree.JsonBody) -> Body:
    inertial = Inertial(body.mass, body.centre_of_mass, body.inertia)
    shapes = tuple(_shape(shape) for shape in body.shapes)
    return Body(body.name, body.model, inertial, _joint(body.joint), shapes, body.group)


def _joint(joint: tree.Joint) -> Joint:
    if isinstance(joint, tree.FreeJoint):
        x, y, z, *turn = joint.position
        position = (x, y, z, *frames.normalise((turn[0], turn[1], turn[2], turn[3])))
        return Joint(joint.name, joint.kind, position=position, velocity=joint.velocity)
    weld = Joint(joint.name, joint.kind, joint.parent, joint.origin)
    if isinstance(joint, tree.FixedJoint):
        return weld
    springy = replace(weld, damping=joint.damping, spring_stiffness=joint.spring_stiffness, velocity=joint.velocity)
    if isinstance(joint, tree.BallJoint):
        return replace(springy, position=frames.normalise(joint.position))
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


def _shape(shape: tree.JsonShape) -> Shape:
    surfaces = tuple(
        Surface(copy.friction, copy.torsional_friction, copy.rolling_friction, copy.restitution, copy.hardness)
        for copy in shape.copies
    )
    read = Shape(shape.name, shape.kind, shape.size, shape.pose, collision=bool(surfaces), surfaces=surfaces)
    if shape.colour is None:
        return replace(read, visual=False)
    return replace(read, visual=True, colour=shape.colour)
