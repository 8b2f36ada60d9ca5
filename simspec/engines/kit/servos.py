"""Controllers of the engine's own that ``world.json`` states: the joints that they drive, and their targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import checked_limit, checked_singles
from simspec.engines.kit.building import Walk
from simspec.engines.kit.world_simulation import WorldSimulation
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, JsonServo
from simspec.world.types import EngineServo


def implicit_spring(controllers: str, more: str = "") -> str:
    """The text of a native controller that follows the law ``implicit_spring``. ``controllers``: the engine's name for them."""
    return (
        f"{controllers} are implicit in time: clip(kp (q* − q − dt v') + kd (v* − v')), where v' is the velocity after the "
        f"step. They sag under load by the effort over kp{more}"
    )


def driven(walk: Walk) -> dict[int, tuple[AxisJoint, JsonServo]]:
    """The driven joints with their controllers, by the row of their body."""
    joints = ((placed.row, placed.body.joint) for placed in walk.bodies)
    return {
        row: (joint, joint.servo) for row, joint in joints if isinstance(joint, AxisJoint) and joint.servo is not None
    }


def driven_at(sim: WorldSimulation[Any], walk: Walk, v: np.ndarray) -> list[tuple[int, AxisJoint, JsonServo]]:
    """The rows, joints and controllers at the places ``v`` (n,) of their velocities. Raises EngineError where the document has
    no controller."""
    known, found = driven(walk), []
    for row in sim.rows_at(v):
        if row not in known:
            raise EngineError(sim.engine, f"holds no controller of {sim.names[row]!r}")
        found.append((row, *known[row]))
    return found


class ArrayDrives:
    """Gains and effort limits in the ``arrays`` of an engine, whose controllers act wherever there are gains: kp, kd, limits,
    by degree of freedom. ``dofs``: by row of the document's bodies the number of the first one of its joint. They are off at
    first."""

    def __init__(self, engine: str, walk: Walk, arrays: Sequence[np.ndarray], dofs: Sequence[int]):
        self._engine, self._walk, self._arrays, self._dofs, self.on = engine, walk, arrays, dofs, False

    def switch(self, on: bool) -> None:
        """Give the driven joints the gains and limits of their controllers, or no gains and their own limits."""
        self.on = on
        for row, (joint, servo) in driven(self._walk).items():
            what = f"controller of {joint.name}"
            gains = (servo.kp, servo.kd) if on else (0.0, 0.0)
            limit = checked_limit(self._engine, servo.effort_limit if on else joint.effort_limit, what)
            for array, value in zip(self._arrays, (*checked_singles(self._engine, gains, what), limit), strict=True):
                array[self._dofs[row]] = value

    def servos(self) -> tuple[EngineServo, ...]:
        """The controllers as the engine stores them where they act."""
        before, found = self.on, []
        self.switch(True)
        for row, (joint, _) in driven(self._walk).items():
            kp, kd, limit = (float(array[self._dofs[row]]) for array in self._arrays)
            found.append(EngineServo(joint.name, kp, kd, limit if math.isfinite(limit) else None))
        self.switch(before)
        return tuple(found)


class ArrayServos:
    """Controllers of an engine that takes targets in arrays: places ``q`` and ``v`` (n,) of the joints in these."""

    def __init__(self, positions: np.ndarray, velocities: np.ndarray, q: np.ndarray, v: np.ndarray):
        self._positions, self._velocities, self._q, self._v = positions, velocities, q, v

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._positions[self._q], self._velocities[self._v] = position, velocity
