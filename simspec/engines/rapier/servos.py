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

from simspec.engines.kit.arrays import LARGEST, checked_singles
from simspec.engines.kit.servos import driven, driven_at, implicit_spring
from simspec.engines.rapier.multibodies import AXIS_OF, effort_unit_of, inertia_unit_of, unit_of
from simspec.engines.rapier.units import NAME
from simspec.errors import EngineError
from simspec.world.types import EngineServo

if TYPE_CHECKING:
    from simspec.engines.rapier.simulation import RapierSimulation

NATIVE = implicit_spring(
    "Rapier's motors", ". Without kp a joint is also braked within 2 dt (v + 1000 dt) of a position limit"
)


def _handle(sim: RapierSimulation, row: int) -> Any:
    """Rapier's handle of the joint of a body."""
    links = sim.built.multibodies
    return links.joints[links.number[row]]


def _axis(sim: RapierSimulation, kind: str) -> Any:
    return getattr(sim.rapier.JointAxis, AXIS_OF[kind])


def start_motors(sim: RapierSimulation, world: Any) -> None:
    """Give the joints of a world that the document drives their gains and largest efforts."""
    for row, (joint, servo) in driven(sim.walk).items():
        if joint.dry_friction:
            raise EngineError(NAME, f"has one motor for {joint.name!r}, which has dry friction and a controller")
        if not (servo.kp or servo.kd):
            continue
        axis, unit = _axis(sim, joint.kind), inertia_unit_of(joint.kind)
        most = LARGEST if servo.effort_limit is None else effort_unit_of(joint.kind) * servo.effort_limit
        numbers = (unit * servo.kp, unit * servo.kd, most)
        stiffness, damping, most = checked_singles(NAME, numbers, f"controller of {joint.name}")
        data = world.multibody_joints[_handle(sim, row)].data
        data.set_motor_model(axis, sim.rapier.MotorModel.FORCE_BASED)
        data.set_motor_max_force(axis, most)
        data.set_motor(axis, 0.0, 0.0, stiffness, damping)


def servos(sim: RapierSimulation) -> tuple[EngineServo, ...]:
    """The controllers as Rapier stores them in a world in which they act; without gains they are those of the document."""
    joints, found = driven(sim.walk), []
    world = sim.world_with_motors() if joints else sim.world
    for row, (joint, servo) in joints.items():
        unit = inertia_unit_of(joint.kind)
        motor = world.multibody_joints[_handle(sim, row)].data.motor(_axis(sim, joint.kind))
        if motor is None:
            found.append(EngineServo(joint.name, 0.0, 0.0, servo.effort_limit))
            continue
        limit = None if motor.max_force >= LARGEST else motor.max_force / effort_unit_of(joint.kind)
        found.append(EngineServo(joint.name, motor.stiffness / unit, motor.damping / unit, limit))
    return tuple(found)


class RapierJointServos:
    """The motors of the hinges and slides at the places ``v`` (n,)."""

    def __init__(self, sim: RapierSimulation, v: np.ndarray):
        self._sim = sim
        self._motors = [
            (place, _handle(sim, row), joint.kind, servo.kp, servo.kd)
            for place, (row, joint, servo) in enumerate(driven_at(sim, sim.walk, v))
            if servo.kp or servo.kd
        ]
        sim.start_motors()

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        world = self._sim.world
        for place, handle, kind, kp, kd in self._motors:
            where, speed = float(position[place]), float(velocity[place])
            if kp:
                where, speed = where + kd / kp * speed, 0.0
            data, length, inertia = world.multibody_joints[handle].data, unit_of(kind), inertia_unit_of(kind)
            data.set_motor(_axis(self._sim, kind), length * where, length * speed, inertia * kp, inertia * kd)
