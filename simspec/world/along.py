"""What springs and dampers along weighted sums of joint positions do to the joints, in simspec's generalised coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simspec.world.kinematics import layout
from simspec.world.sums import JointSum
from simspec.world.types import Body, World

Array = NDArray[np.float64]


class JointSums:
    """Some sums of the joints of some bodies, parents before children.

    ``weights`` (sums, nv): the coefficients, L̇ = weights v; ``stiffness``, ``rest``, ``damping`` (sums,).
    """

    def __init__(self, bodies: Sequence[Body], sums: Sequence[JointSum]):
        places = layout(bodies)
        row = {body.joint.name: index for index, body in enumerate(bodies)}
        self.sums = tuple(sums)
        self.weights = np.zeros((len(self.sums), places.nv))
        self._of_positions = np.zeros((len(self.sums), places.nq))
        for index, one in enumerate(self.sums):
            for joint, coefficient in one.joints:
                self.weights[index, places.velocity[row[joint]]] = coefficient
                self._of_positions[index, places.position[row[joint]]] = coefficient
        self.stiffness = np.array([one.stiffness for one in self.sums], dtype=float)
        self.rest = np.array([one.rest for one in self.sums], dtype=float)
        self.damping = np.array([one.damping for one in self.sums], dtype=float)

    @property
    def acts(self) -> bool:
        """Whether there is a spring or a damper among them."""
        return bool(self.stiffness.any() or self.damping.any())

    def lengths(self, q: Array) -> Array:
        """L (sums,) at positions ``q`` (nq,); of several states (n, nq) (n, sums)."""
        values: Array = q @ self._of_positions.T
        return values

    def effort(self, q: Array, v: Array) -> Array:
        """−Cᵀ (k (L − rest) + d L̇) (nv,)."""
        force = self.stiffness * (self.lengths(q) - self.rest) + self.damping * (self.weights @ v)
        effort: Array = -(force @ self.weights)
        return effort

    def energy(self, q: Array) -> float:
        """What the springs store (J)."""
        stretch = self.lengths(q) - self.rest
        return 0.5 * float(self.stiffness @ (stretch * stretch))

    def matrices(self) -> tuple[Array, Array]:
        """Cᵀ k C and Cᵀ d C (nv, nv)."""
        return (
            self.weights.T @ (self.stiffness[:, None] * self.weights),
            self.weights.T @ (self.damping[:, None] * self.weights),
        )


def beyond_limits(world: World, states: Array) -> str | None:
    """The name of a sum that is beyond its limits at one of some positions (n, nq); None where there is none."""
    along = JointSums(world.bodies, world.sums)
    for one, lengths in zip(along.sums, along.lengths(states).T, strict=True):
        limits = one.position_limits
        if limits is not None and (lengths.min() < limits[0] or lengths.max() > limits[1]):
            return one.name
    return None
