"""The law of ``world/fluid.py`` for many boxes at once, with numpy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simspec.world.fluid import Fluid

Array = NDArray[np.float64]


class Drag:
    """What ``fluid`` does to boxes with ``edges`` (n, 3), m."""

    def __init__(self, edges: ArrayLike, fluid: Fluid):
        own: Array = np.asarray(edges, dtype=float).reshape(-1, 3)
        second, third = np.roll(own, -1, axis=1), np.roll(own, -2, axis=1)
        size = own.mean(axis=1, keepdims=True)
        self._linear = 3.0 * np.pi * fluid.viscosity * size, np.pi * fluid.viscosity * size**3
        self._quadratic = 0.5 * fluid.density * second * third, fluid.density / 64.0 * own * (second**4 + third**4)

    def of(self, flow: Array, spin: Array) -> tuple[Array, Array]:
        """Forces at the centres of the boxes and torques (n, 3), for velocities of these against the fluid and angular
        velocities (n, 3), all along the axes of each box."""
        force, torque = (
            -(linear + quadratic * np.abs(own)) * own
            for own, linear, quadratic in zip((flow, spin), self._linear, self._quadratic, strict=True)
        )
        return force, torque
