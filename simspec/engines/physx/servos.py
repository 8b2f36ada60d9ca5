"""The drives of PhysX as controllers of hinges and slides.

A drive is a spring and a damper by the velocity after the step, within its largest effort, which is the law
``implicit_spring``. A joint has one drive: that of a joint with dry friction is its friction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.engines.physx.units import LARGEST, NAME, SCALE
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint
from simspec.world.types import EngineServo

if TYPE_CHECKING:
    from simspec.engines.physx.building import PhysxBuild
    from simspec.engines.physx.simulation import PhysxSimulation

NATIVE = (
    "PhysX's drives are implicit in time: clip(kp (q* − q − dt v') + kd (v* − v')), where v' is the velocity after the step. "
    "They sag under load by the effort over kp, and are stable at any timestep"
)


def start_drives(built: PhysxBuild) -> None:
    """Give the joints that the document drives their gains and largest efforts."""
    for row, made in driven(built).items():
        joint = built.walk.bodies[row].body.joint
        assert isinstance(joint, AxisJoint)
        assert joint.servo is not None
        if joint.dry_friction:
            raise EngineError(NAME, f"has one drive for {joint.name!r}, which has dry friction and a controller")
        length, inertia = _units(joint)
        limit = joint.servo.effort_limit
        stiffness, damping = checked_singles(
            NAME, (inertia * joint.servo.kp, inertia * joint.servo.kd), f"gains of {joint.name}"
        )
        (most,) = checked_singles(
            NAME, (LARGEST if limit is None else inertia * length * limit,), f"limit of {joint.name}"
        )
        made.set_drive_properties(stiffness, damping, most, "force")


def driven(built: PhysxBuild) -> dict[int, Any]:
    """SAPIEN's joints that the document drives, by the row of their body."""
    rows = (placed.row for placed in built.walk.bodies if getattr(placed.body.joint, "servo", None) is not None)
    return {row: built.links.joints[row][-1] for row in rows}


def servos(sim: PhysxSimulation) -> tuple[EngineServo, ...]:
    """The controllers as PhysX stores them in a scene in which they act."""
    if not driven(sim.built):
        return ()
    built = sim.scene_with_drives()
    found = []
    for row, made in driven(built).items():
        joint = built.walk.bodies[row].body.joint
        length, inertia = _units(joint)
        most = float(made.force_limit)
        limit = None if most >= LARGEST else most / (inertia * length)
        found.append(EngineServo(joint.name, float(made.stiffness) / inertia, float(made.damping) / inertia, limit))
    return tuple(found)


def _units(joint: Any) -> tuple[float, float]:
    """PhysX's unit of a position of a joint, and that of its inertia and gains."""
    return (SCALE, 1.0) if joint.kind == "slide" else (1.0, SCALE * SCALE)


class PhysxJointServos:
    """The drives of the hinges and slides at the places ``v`` (n,)."""

    def __init__(self, sim: PhysxSimulation, v: np.ndarray):
        self._sim = sim
        self._rows = sim.rows_at(v)
        if missing := set(self._rows) - set(driven(sim.built)):
            raise EngineError(NAME, f"holds no controller of {sim.names[min(missing)]!r}")
        self._lengths = np.array([_units(sim.document.bodies[row].joint)[0] for row in self._rows])
        sim.start_drives()

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        joints = self._sim.built.links.joints
        targets = zip(self._rows, (self._lengths * position).tolist(), (self._lengths * velocity).tolist(), strict=True)
        for row, where, speed in targets:
            joints[row][-1].set_drive_target(where)
            joints[row][-1].set_drive_velocity_target(speed)
