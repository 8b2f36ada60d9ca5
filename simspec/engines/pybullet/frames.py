"""Bodies that PyBullet is not told, since they are nothing but frames: where they are follows from what carries them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from simspec.dialects.pybullet.sidecar import Frame
from simspec.world import frames
from simspec.world.rotations import conjugate, cross, multiply, positive, rotate
from simspec.world.types import Body, Inertial, Joint, Pose

Array = np.ndarray


class Frames:
    """Frames on bodies that PyBullet has, each by its pose in the frame of that body; ``index``: of all bodies in the world."""

    def __init__(self, told: Sequence[Frame], index: Mapping[str, int]):
        self._told = tuple(told)
        on: dict[str, tuple[str, Pose]] = {}
        for frame in self._told:
            carrier, pose = on.get(frame.parent, (frame.parent, Pose()))
            on[frame.name] = (carrier, frames.compose(pose, frame.pose))
        self._own = np.array([index[name] for name in on], dtype=int)
        self._carrier = np.array([index[carrier] for carrier, _ in on.values()], dtype=int)
        self._position = np.array([pose.position for _, pose in on.values()], dtype=float).reshape(-1, 3)
        self._turn = np.array([pose.quaternion for _, pose in on.values()], dtype=float).reshape(-1, 4)

    def place(self, at: Array, turn: Array, linear: Array, angular: Array, centre: Array, axes: Array) -> None:
        """Fill in the rows of the frames, from those of the bodies that carry them.

        ``at`` (n, 3), ``turn`` (n, 4), ``linear`` and ``angular`` (n, 3): of every body's inertial frame in the world;
        ``centre`` (n, 3) and ``axes`` (n, 4): where that is in the body's own frame.
        """
        own, carrier = self._own, self._carrier
        turned = multiply(turn[carrier], conjugate(axes[carrier]))
        lever = rotate(turned, self._position - centre[carrier])
        at[own] = at[carrier] + lever
        turn[own] = positive(multiply(turned, self._turn))
        linear[own] = linear[carrier] + cross(angular[carrier], lever)
        angular[own] = angular[carrier]

    def bodies(self) -> dict[str, Body]:
        """The frames as bodies of a read-back, by name."""
        return {
            frame.name: Body(
                frame.name, frame.model, Inertial(0.0), Joint(frame.joint, "fixed", frame.parent, frame.pose)
            )
            for frame in self._told
        }
