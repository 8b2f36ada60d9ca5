"""Passive forces explicit in time, in simspec's generalised coordinates: springs and dampers of joints and of weighted sums
of their positions, and the drag of a fluid.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.world.actions import Fluid, JointSum
from simspec.world.kinematics import layout, layout_of
from simspec.world.rotations import logarithm
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
        for index, joint_sum in enumerate(self.sums):
            for joint, coefficient in joint_sum.joints:
                self.weights[index, places.velocity[row[joint]]] = coefficient
                self._of_positions[index, places.position[row[joint]]] = coefficient
        self.stiffness = np.array([joint_sum.stiffness for joint_sum in self.sums], dtype=float)
        self.rest = np.array([joint_sum.rest for joint_sum in self.sums], dtype=float)
        self.damping = np.array([joint_sum.damping for joint_sum in self.sums], dtype=float)

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
        """The energy of the springs (J)."""
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
    for joint_sum, lengths in zip(along.sums, along.lengths(states).T, strict=True):
        limits = joint_sum.position_limits
        if limits is not None and (lengths.min() < limits[0] or lengths.max() > limits[1]):
            return joint_sum.name
    return None


class JointForces:
    """−d q̇ − k (q − rest) of hinges and slides, −d ω − k log R of balls, of ``bodies`` in the order of their coordinates.
    The damping of free bodies is not among them: engines receive it separately (``dialects/kit/joints.py``)."""

    def __init__(self, bodies: Sequence[Body]):
        layout = layout_of(World("", tuple(bodies)))
        self._damping, self._stiffness, self._rest = np.zeros((3, layout.nv))
        self._balls: list[tuple[slice, slice]] = []
        scalar: list[tuple[int, int]] = []
        for body, at_q, at_v in zip(bodies, layout.position, layout.velocity, strict=True):
            joint = body.joint
            if joint.kind in TREE_JOINTS:
                self._damping[at_v], self._stiffness[at_v] = joint.damping, joint.spring_stiffness
            if joint.kind in SCALAR_JOINTS:
                scalar.append((at_q.start, at_v.start))
                self._rest[at_v] = joint.spring_rest
            elif joint.kind == "ball":
                self._balls.append((at_q, at_v))
        at = np.array(scalar, dtype=np.intp).reshape(-1, 2)
        self._scalar_q, self._scalar_v = at[:, 0], at[:, 1]
        self.needed = bool(self._damping.any() or self._stiffness.any())
        """Whether any joint has any."""

    def effort(self, q: Array, v: Array) -> Array:
        """The effort (nv,) at the state ``q`` (nq,), ``v`` (nv,)."""
        found: Array = -self._damping * v
        at = self._scalar_v
        found[at] -= self._stiffness[at] * (q[self._scalar_q] - self._rest[at])
        for at_q, at_v in self._balls:
            found[at_v] -= self._stiffness[at_v] * logarithm(q[at_q])
        return found


class Drag:
    """The drag of ``fluid`` on boxes with ``edges`` (n, 3), m: the law of ``world/actions.py``."""

    def __init__(self, edges: ArrayLike, fluid: Fluid):
        sizes: Array = np.asarray(edges, dtype=float).reshape(-1, 3)
        second, third = np.roll(sizes, -1, axis=1), np.roll(sizes, -2, axis=1)
        size = sizes.mean(axis=1, keepdims=True)
        self._linear = 3.0 * np.pi * fluid.viscosity * size, np.pi * fluid.viscosity * size**3
        self._quadratic = 0.5 * fluid.density * second * third, fluid.density / 64.0 * sizes * (second**4 + third**4)

    def of(self, flow: Array, spin: Array) -> tuple[Array, Array]:
        """Forces at the centres of the boxes and torques (n, 3), for velocities of these against the fluid and angular
        velocities (n, 3), all along the axes of each box."""
        force, torque = (
            -(linear + quadratic * np.abs(speeds)) * speeds
            for speeds, linear, quadratic in zip((flow, spin), self._linear, self._quadratic, strict=True)
        )
        return force, torque
