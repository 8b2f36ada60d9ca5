"""The drives of PhysX as controllers of hinges and slides.

A drive is a spring and a damper by the velocity after the step, within its largest effort, which is the law
``implicit_spring``. A joint has one drive: that of a joint with dry friction is its friction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simspec.engines.kit.arrays import LARGEST, checked_singles
from simspec.engines.kit.servos import driven, driven_at, implicit_spring
from simspec.engines.physx.units import NAME, SCALE
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint
from simspec.world.types import EngineServo

if TYPE_CHECKING:
    from simspec.engines.physx.building import PhysxBuild
    from simspec.engines.physx.simulation import PhysxSimulation

NATIVE = implicit_spring("PhysX's drives")


def start_drives(built: PhysxBuild) -> None:
    """Give the joints that the document drives their gains and largest efforts."""
    for row, (joint, servo) in driven(built.walk).items():
        if joint.dry_friction:
            raise EngineError(NAME, f"has one drive for {joint.name!r}, which has dry friction and a controller")
        length, inertia = _units(joint)
        most = LARGEST if servo.effort_limit is None else inertia * length * servo.effort_limit
        numbers = checked_singles(NAME, (inertia * servo.kp, inertia * servo.kd, most), f"controller of {joint.name}")
        built.links.joints[row][-1].set_drive_properties(*numbers, "force")


def servos(sim: PhysxSimulation) -> tuple[EngineServo, ...]:
    """The controllers as PhysX stores them in a scene in which they act."""
    joints, found = driven(sim.walk), []
    built = sim.scene_with_drives() if joints else sim.built
    for row, (joint, _) in joints.items():
        made, (length, inertia) = built.links.joints[row][-1], _units(joint)
        most = float(made.force_limit)
        limit = None if most >= LARGEST else most / (inertia * length)
        found.append(EngineServo(joint.name, float(made.stiffness) / inertia, float(made.damping) / inertia, limit))
    return tuple(found)


def _units(joint: AxisJoint) -> tuple[float, float]:
    """PhysX's unit of a position of a joint, and that of its inertia and gains."""
    return (SCALE, 1.0) if joint.kind == "slide" else (1.0, SCALE * SCALE)


class PhysxJointServos:
    """The drives of the hinges and slides at the places ``v`` (n,)."""

    def __init__(self, sim: PhysxSimulation, v: np.ndarray):
        self._sim = sim
        self._joints = [(row, _units(joint)[0]) for row, joint, _ in driven_at(sim, sim.walk, v)]
        sim.start_drives()

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        joints = self._sim.built.links.joints
        for (row, length), where, speed in zip(self._joints, position.tolist(), velocity.tolist(), strict=True):
            joints[row][-1].set_drive_target(length * where)
            joints[row][-1].set_drive_velocity_target(length * speed)
