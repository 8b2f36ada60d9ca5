"""How joints are driven in MuJoCo: its own position and velocity controllers, and efforts given at every step."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.dialects.kit.sidecar import SidecarBody
from simspec.dialects.mujoco.sidecar import Chain, origins
from simspec.engines.kit.contract import Actuation
from simspec.engines.mujoco.readback import JOINT_KINDS
from simspec.errors import EngineError
from simspec.formats.mjcf.format import MODEL
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world import frames
from simspec.world.rotations import conjugate, cross, multiply, rotate, unit
from simspec.world.types import Pose, Vector3, World

NATIVE = (
    "MuJoCo's position actuators, or velocity actuators without kp, are explicit in time: clip(kp (q* − q) + "
    "kd (v* − v)). simspec rejects gains that diverge at the timestep"
)


def explicit_servos_hold(world: World) -> Refinement | None:
    """Not supported where MuJoCo's explicit actuators are unstable."""
    from simspec.control.stability import unstable

    given = tuple(
        dataclasses.replace(controller, law="pd") if controller.law == "native" else controller
        for controller in world.controllers
    )
    try:
        found = unstable(dataclasses.replace(world, controllers=given))
    except ModuleNotFoundError as error:
        return unsupported_if(
            f"simspec needs Pinocchio to check that explicit actuators are stable ({error}): pip install "
            "'simspec-physics[pin]'"
        )
    if not found:
        return None
    instability = found[0]
    return unsupported_if(
        f"MuJoCo's actuators are explicit in time, and the gains of {instability.controller!r} diverge at "
        f"{instability.timestep:.6g} s. Lower physics.timestep to {instability.largest_stable_step:.3g} s, the "
        "largest stable step"
    )


class MujocoDrive:
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


class MujocoJointArrays(Actuation):
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


# States of what stands between the joints of one body and is not in MuJoCo's model: back from the body, joint by joint.


@dataclass(frozen=True, slots=True)
class _JointRows:
    """A joint: the rows of the body that it moves and of the one that it moves against, its frame in that, its axis in its
    frame, and its first coordinate and velocity in the model."""

    kind: str
    child: int
    parent: int
    origin: Pose
    axis: Vector3
    position: int
    velocity: int


class Between:
    """The bodies between joints, of a model with the rows ``entries``."""

    def __init__(
        self, model: Any, entries: Sequence[SidecarBody], chains: Mapping[str, Chain], joints: Mapping[str, int]
    ):
        row = {entry.name: index for index, entry in enumerate(entries)}
        levels: dict[tuple[int, str], list[_JointRows]] = {}
        for chain in chains.values():
            if len(chain) == 1:
                continue
            numbers = [joints[name] for name, _ in chain]
            turns = [turn for _, turn in chain]
            in_body = [Pose(_vector(model.jnt_pos[joint]), turn) for joint, turn in zip(numbers, turns, strict=True)]
            steps = origins(Pose(), in_body)
            for level, place in enumerate(range(len(chain) - 1, 0, -1)):
                joint = numbers[place]
                kind = JOINT_KINDS[int(model.jnt_type[joint])]
                axis = frames.rotate(frames.conjugate(turns[place]), _vector(model.jnt_axis[joint]))
                child, parent = row[chain[place][0]], row[chain[place - 1][0]]
                at, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
                levels.setdefault((level, kind), []).append(
                    _JointRows(kind, child, parent, steps[place], axis, at, dof)
                )
        self._levels = [_Level(kind, steps) for (_, kind), steps in sorted(levels.items())]

    def add(
        self, values: np.ndarray, poses: np.ndarray, velocities: np.ndarray, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Poses (rows, 7) and velocities (rows, 6) of all bodies, from those that the model has, which ``held`` (rows,) marks,
        and its coordinates."""
        all_poses, all_velocities = np.empty((len(values), 7)), np.empty((len(values), 6))
        all_poses[values], all_velocities[values] = poses, velocities
        for level in self._levels:
            level.fill(all_poses, all_velocities, q, v)
        return all_poses, all_velocities


class _Level:
    """Joints of one kind whose bodies' states are known."""

    def __init__(self, kind: str, steps: Sequence[_JointRows]):
        self._kind = kind
        self._child = np.array([step.child for step in steps], dtype=np.intp)
        self._parent = np.array([step.parent for step in steps], dtype=np.intp)
        self._place = np.array([step.origin.position for step in steps])
        self._turn = np.array([step.origin.quaternion for step in steps])
        self._axis = np.array([step.axis for step in steps])
        self._q = np.array([step.position for step in steps], dtype=np.intp)
        self._v = np.array([step.velocity for step in steps], dtype=np.intp)

    def fill(self, poses: np.ndarray, velocities: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """The rows of what the joints move against: X_parent = X_child (O J)⁻¹, and the velocity that goes with it."""
        position, turn = poses[self._child, :3], poses[self._child, 3:]
        straight, spin = velocities[self._child, :3], velocities[self._child, 3:].copy()
        shift = np.zeros_like(position)
        slip = np.zeros_like(position)
        moved = self._turn
        if self._kind == "ball":
            three = self._q[:, None] + np.arange(4)
            moved = multiply(moved, unit(q[three]))
            spin -= rotate(turn, v[self._v[:, None] + np.arange(3)])
        else:
            along, rate = q[self._q][:, None], v[self._v][:, None]
            if self._kind == "hinge":
                half = 0.5 * along
                moved = multiply(moved, np.concatenate([np.cos(half), self._axis * np.sin(half)], axis=1))
                spin -= rotate(turn, self._axis) * rate
            else:
                shift = self._axis * along
                slip = rotate(turn, self._axis) * rate
        above = multiply(turn, conjugate(moved))
        lever = rotate(above, self._place + rotate(self._turn, shift))
        poses[self._parent, :3], poses[self._parent, 3:] = position - lever, above
        velocities[self._parent, :3] = straight - slip - cross(spin, lever)
        velocities[self._parent, 3:] = spin


def _vector(values: Any) -> Vector3:
    x, y, z = values.tolist()
    return (x, y, z)
