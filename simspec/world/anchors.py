"""At which point of two welded bodies their weld is best held.

A weld may be held at any point: it says the same. But solvers go through its six rows one after the other, or make them a
little soft, and what either leaves follows from how much the rows act on each other. With A = J M⁻¹ Jᵀ of a weld in blocks of
forces and torques, (L, C; Cᵀ, T), holding it at a point d further on makes L − [d] Cᵀ + C [d] − [d] T [d] of L. It is held
where forces move the bodies least, where the trace of that block is smallest: d = (tr T − T)⁺ a with
a = (C₃₂ − C₂₃, C₁₃ − C₃₁, C₂₁ − C₁₂). Of a free body that is welded to what is fixed this is its centre of mass, and C is zero
there.

That is for welds to what cannot move. Between bodies that turn, and whose joints let them part by an angle θ in a step, the law
J v⁺ = −φ/dt of another point is another by θ ω d: 2.7e-9 m in 2,000 steps, 3 m away (measured).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simspec.world import frames
from simspec.world.kinematics import constrained_trees, poses, rigid_groups, within
from simspec.world.tuples import quaternion
from simspec.world.types import VELOCITY_SIZE, Body, Inertial, Joint, Pose, Vector3, Weld, World
from simspec.world.violation import Violation

Array = NDArray[np.float64]
GROUND = "ground of the anchors/"
"""A body that does not move, beside those of the world; no name of a world ends so."""
RANK = 1e-10
"""Of the largest eigenvalue: directions in which nothing moves, but for round-off."""


def anchors(world: World) -> Mapping[str, Vector3]:
    """By the name of each weld to what cannot move the point at which to hold it, in the frame of its second body, from the
    initial positions."""
    place, groups = poses(world), rigid_groups(world)
    found: dict[str, Vector3] = {}
    for bodies in constrained_trees(world):
        welds = [
            one
            for one in within(world, bodies).constraints
            if isinstance(one, Weld) and "world" in (groups[one.first], groups[one.second])
        ]
        if not welds:
            continue
        at = np.array([(*place[body.name].position, *place[body.name].quaternion) for body in bodies])
        jacobian = Violation(bodies, welds).jacobian(at)
        moved = jacobian @ _inverse(mass_matrix(bodies, at)) @ jacobian.T
        for number, weld in enumerate(welds):
            own = slice(6 * number, 6 * number + 6)
            x, y, z = (float(part) for part in least_moved(moved[own, own]))
            found[weld.name] = frames.rotate(frames.conjugate(place[weld.second].quaternion), (x, y, z))
    return found


def least_moved(mobility: Array) -> Array:
    """The point d (3,), from where a weld of ``mobility`` A (6, 6) is held, at which forces move its bodies least."""
    across, turning = mobility[:3, 3:], mobility[3:, 3:]
    arm = np.array([across[2, 1] - across[1, 2], across[0, 2] - across[2, 0], across[1, 0] - across[0, 1]])
    point: Array = np.linalg.pinv(np.trace(turning) * np.eye(3) - turning, rcond=RANK, hermitian=True) @ arm
    return point


def mass_matrix(bodies: tuple[Body, ...], at: Array) -> Array:
    """M (nv, nv) of bodies, parents first, at poses ``at`` (bodies, 7): the sum of Jᵀ I J over those with mass, with J of their
    centres of mass."""
    heavy = [(body, pose) for body, pose in zip(bodies, at, strict=True) if body.inertial.mass > 0.0]
    ground = Body(GROUND, "", Inertial(0.0), Joint(GROUND, "fixed", None))
    welds = [Weld(body.name, body.name, GROUND, Pose(body.inertial.centre_of_mass)) for body, _ in heavy]
    jacobian = Violation((*bodies, ground), welds).jacobian(np.vstack([at, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)]))
    mass = np.diag([armature for body in bodies for armature in _armature(body)])
    for (body, pose), rows in zip(heavy, jacobian.reshape(len(heavy), 6, len(mass)), strict=True):
        turn = np.array(frames.matrix(quaternion(pose[3:].tolist())))
        xx, yy, zz, xy, xz, yz = body.inertial.inertia
        inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        mass = mass + body.inertial.mass * rows[:3].T @ rows[:3] + rows[3:].T @ inertia @ rows[3:]
    return mass


def _armature(body: Body) -> list[float]:
    """Of each coordinate of a body's joint."""
    count, joint = VELOCITY_SIZE[body.joint.kind], body.joint
    return [joint.armature] * 3 + [joint.angular_armature] * 3 if joint.kind == "free" else [joint.armature] * count


def _inverse(mass: Array) -> Array:
    """M⁻¹; zero in coordinates that move nothing, which worlds in error have."""
    scale = np.sqrt(np.diag(mass))
    scale[scale == 0.0] = 1.0
    inverse: Array = np.linalg.pinv(mass / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    return inverse
