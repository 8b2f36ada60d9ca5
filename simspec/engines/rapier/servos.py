"""The motors of Rapier's multibodies as controllers of hinges and slides.

A motor of the model ``FORCE_BASED`` is a spring and a damper by the velocity after the step, within its largest force: kp (q* −
q − dt v' + dt v*) + kd (v* − v') for the targets q* and v*. Rapier clips v* to what brings the joint to its limits within the
step, and simspec moves the limits of a joint that is close to a stop (``stops.py``). So a motor with kp gets the target q* + kd
v*/kp and no speed, which is the law ``implicit_spring``. A joint has one motor: that of a joint with dry friction is its
friction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.engines.rapier.multibodies import AXIS_OF, effort_unit_of, inertia_unit_of, unit_of
from simspec.engines.rapier.units import LARGEST, NAME
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint
from simspec.world.types import EngineServo

if TYPE_CHECKING:
    from simspec.engines.rapier.simulation import RapierSimulation

NATIVE = (
    "Rapier's motors are implicit in time: clip(kp (q* − q − dt v') + kd (v* − v')), where v' is the velocity after the step. "
    "They sag under load by the effort over kp. Without kp a joint is also braked within 2 dt (v + 1000 dt) of a position limit"
)


def driven(sim: RapierSimulation) -> dict[int, AxisJoint]:
    """The joints that the document drives, by the number of their link."""
    links = enumerate(sim.built.multibodies.links)
    return {number: link.joint for number, link in links if getattr(link.joint, "servo", None) is not None}


def start_motors(sim: RapierSimulation, world: Any) -> None:
    """Give the joints of a world that the document drives their gains and largest efforts."""
    rapier = sim.rapier
    for number, joint in driven(sim).items():
        assert joint.servo is not None
        if joint.dry_friction:
            raise EngineError(NAME, f"has one motor for {joint.name!r}, which has dry friction and a controller")
        if not (joint.servo.kp or joint.servo.kd):
            continue
        axis, unit = getattr(rapier.JointAxis, AXIS_OF[joint.kind]), inertia_unit_of(joint.kind)
        limit = joint.servo.effort_limit
        most = LARGEST if limit is None else effort_unit_of(joint.kind) * limit
        numbers = (unit * joint.servo.kp, unit * joint.servo.kd, most)
        stiffness, damping, most = checked_singles(NAME, numbers, f"gains and limit of {joint.name}")
        data = world.multibody_joints[sim.built.multibodies.joints[number]].data
        data.set_motor_model(axis, rapier.MotorModel.FORCE_BASED)
        data.set_motor_max_force(axis, most)
        data.set_motor(axis, 0.0, 0.0, stiffness, damping)


def servos(sim: RapierSimulation) -> tuple[EngineServo, ...]:
    """The controllers as Rapier stores them in a world in which they act."""
    joints = driven(sim)
    if not joints:
        return ()
    world, found = sim.world_with_motors(), []
    for number, joint in joints.items():
        data = world.multibody_joints[sim.built.multibodies.joints[number]].data
        motor, unit = data.motor(getattr(sim.rapier.JointAxis, AXIS_OF[joint.kind])), inertia_unit_of(joint.kind)
        if motor is None:
            found.append(EngineServo(joint.name, 0.0, 0.0, joint.servo.effort_limit if joint.servo else None))
            continue
        limit = None if motor.max_force >= LARGEST else motor.max_force / effort_unit_of(joint.kind)
        found.append(EngineServo(joint.name, motor.stiffness / unit, motor.damping / unit, limit))
    return tuple(found)


class RapierJointServos:
    """The motors of the hinges and slides at the places ``v`` (n,)."""

    def __init__(self, sim: RapierSimulation, v: np.ndarray):
        self._sim = sim
        joints, number_of = driven(sim), sim.built.multibodies.number
        self._motors: list[tuple[int, Any, Any, float, float, float]] = []
        for place, row in enumerate(sim.rows_at(v)):
            joint = joints.get(number_of.get(row, -1))
            if joint is None or joint.servo is None:
                raise EngineError(NAME, f"holds no controller of {sim.names[row]!r}")
            kp, kd = joint.servo.kp, joint.servo.kd
            if kp or kd:
                axis = getattr(sim.rapier.JointAxis, AXIS_OF[joint.kind])
                handle = sim.built.multibodies.joints[number_of[row]]
                self._motors.append((place, handle, axis, unit_of(joint.kind), kp, kd))
        sim.start_motors()

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        world = self._sim.world
        for place, handle, axis, unit, kp, kd in self._motors:
            where, speed = float(position[place]), float(velocity[place])
            if kp:
                where, speed = where + kd / kp * speed, 0.0
            data = world.multibody_joints[handle].data
            motor = data.motor(axis)
            data.set_motor(axis, unit * where, unit * speed, motor.stiffness, motor.damping)
