"""What a fluid does to one body, for the oracle: the law of ``world/actions.py``, written a second time and face by face."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simspec.world.actions import Fluid


@dataclass(frozen=True)
class Resisted:
    """A body in a fluid: the Pinocchio joint that it moves with; in that joint's frame the centre of its box (3,) and the axes
    of the box (3, 3), as columns; its edges (m); the fluid."""

    joint: int
    centre: np.ndarray
    axes: np.ndarray
    edges: tuple[float, float, float]
    fluid: Fluid

    @property
    def viscous(self) -> tuple[float, float]:
        """The resistance to velocity (N s/m) and to angular velocity (N m s/rad) that grows linearly with it."""
        diameter = sum(self.edges) / 3.0
        return 3.0 * math.pi * diameter * self.fluid.viscosity, math.pi * diameter**3 * self.fluid.viscosity

    def wrench(self, twist: np.ndarray, orientation: np.ndarray) -> np.ndarray:
        """Force and torque (6,) at the joint's origin, for the joint's velocity (linear, angular), all in its own axes;
        ``orientation`` (3, 3): of these axes in the world."""
        spin = twist[3:]
        through = twist[:3] + _cross(spin, self.centre) - orientation.T @ np.array(self.fluid.velocity)
        linear, angular = self.viscous
        force, torque = -linear * through, -angular * spin
        for index, axis in enumerate(self.axes.T):
            length = self.edges[index]
            width, height = self.edges[index - 1], self.edges[index - 2]
            along, about = float(axis @ through), float(axis @ spin)
            force = force - 0.5 * self.fluid.density * width * height * abs(along) * along * axis
            stirred = length * (width**4 + height**4) / 64.0
            torque = torque - self.fluid.density * stirred * abs(about) * about * axis
        return np.concatenate([force, torque + _cross(self.centre, force)])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b (3,), to the bit what numpy's gives, which takes ten times as long for two vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
