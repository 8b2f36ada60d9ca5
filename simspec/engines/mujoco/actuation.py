"""How joints are driven in MuJoCo: its own position and velocity controllers, and efforts given at every step."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from simspec.engines.kit.contract import Actuation
from simspec.errors import EngineError
from simspec.formats.mjcf.format import MODEL
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.types import World

NATIVE = (
    "a position actuator for each joint (a velocity one without kp), explicit in time: clip(kp (q* − q) + kd (v* − v)) to the "
    "last digits, the law pd without feed-forward and gravity; refused where it diverges at the timestep"
)


def explicit_servos_hold(world: World) -> Refinement | None:
    """Not supported where MuJoCo's explicit actuators are unstable."""
    from simspec.control.stability import unstable

    given = tuple(dataclasses.replace(one, law="pd") if one.law == "native" else one for one in world.controllers)
    try:
        found = unstable(dataclasses.replace(world, controllers=given))
    except ModuleNotFoundError as error:
        return unsupported_if(
            f"whether its explicit actuators are stable takes Pinocchio ({error}): pip install 'simspec[pin]'"
        )
    if not found:
        return None
    one = found[0]
    return unsupported_if(
        f"its actuators are explicit in time, and the gains of {one.controller!r} diverge at {one.timestep:.6g} s; the largest "
        f"stable step is {one.largest_stable_step:.3g} s"
    )


class Drive:
    """MuJoCo's actuators of some degrees of freedom (``dofs``)."""

    def __init__(
        self, mujoco: Any, model: Any, data: Any, dofs: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
    ):
        joints = model.actuator_trnid[:, 0]
        of_dof = {int(model.jnt_dofadr[joint]): index for index, joint in enumerate(joints.tolist())}
        missing = [
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, int(model.dof_jntid[dof]))
            for dof in dofs.tolist()
            if dof not in of_dof
        ]
        if missing:
            raise EngineError("mujoco", f"{MODEL} has no actuator for {', '.join(missing)}")
        self._control = data.ctrl
        self._places = np.array([of_dof[dof] for dof in dofs.tolist()], dtype=int)
        # a position actuator has no wanted velocity of its own: its target leads by v* kd/kp. A velocity one has no position
        self._by_position = stiffness > 0.0
        self._lead = np.divide(damping, stiffness, out=np.ones_like(stiffness), where=self._by_position)

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._control[self._places] = np.where(self._by_position, position, 0.0) + self._lead * velocity


class JointArrays(Actuation):
    """Hinges and slides by MuJoCo's own arrays, at the places ``q`` and ``v`` in them."""

    def __init__(self, data: Any, advance: Callable[[int], None], q: np.ndarray, v: np.ndarray):
        self._advance = advance
        self._positions, self._velocities, self._forces = data.qpos, data.qvel, data.qfrc_applied
        self._q, self._v = q, v

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._positions[self._q], self._velocities[self._v]

    def give(self, effort: np.ndarray) -> None:
        self._forces[self._v] = effort

    def step(self) -> None:
        self._advance(1)
