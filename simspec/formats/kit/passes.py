"""Normalisations that every format needs before its template prints: templates hold no arithmetic.

All passes are deterministic to the last bit (plain floats, no LAPACK), so that the same world gives the same bytes on
every machine.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

from simspec.world import frames
from simspec.world.gathering import gathered, told_gravity_scale
from simspec.world.types import Body, Pose, Quaternion, Vector3, World

FLAT_MARGIN = 1.0 - 2.0**-40
"""Share of λ1 + λ2 that the largest principal moment may reach. An inertia with λmax > λ1 + λ2, even by round-off, is
zeroed by one engine and refused by another (measured: 77 of 200 flat bodies); 2⁻⁴⁰ ≈ 9e-13 is inside the 1e-12 of proof
level L0."""


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)


def _quaternion(values: Sequence[float]) -> Quaternion:
    w, x, y, z = values
    return (w, x, y, z)


def gather(world: World) -> World:
    """The world with the inertia of rigid groups gathered on their topmost bodies where engines ask for it."""
    told = gathered(world)
    if not told:
        return world
    bodies = (
        dataclasses.replace(
            body, inertial=told.get(body.name, body.inertial), gravity_scale=told_gravity_scale(world, body)
        )
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=tuple(bodies))


def recentre_free_roots(world: World) -> tuple[World, dict[str, Vector3]]:
    """Put every free root's frame at its centre of mass, after gathering inertias (:func:`gather`).

    Returns the world with moved frames, and for each moved body the position of the new frame in the old one (its
    centre of mass). Axes stay parallel. Shapes, children and the initial state move along, so that the world is
    physically the same. Why: engines integrate the frame of a free root or its centre of mass; only when both are one
    point do all of them do the same (see ``world/kinematics.py``).
    """
    world = gather(world)
    offsets = {
        body.name: body.inertial.centre_of_mass
        for body in world.bodies
        if body.joint.kind == "free" and any(body.inertial.centre_of_mass)
    }
    if not offsets:
        return world, {}

    def moved(pose: Pose, offset: Vector3) -> Pose:
        return dataclasses.replace(pose, position=frames.subtract(pose.position, offset))

    bodies = []
    for body in world.bodies:
        joint = body.joint
        if joint.parent in offsets:
            body = dataclasses.replace(
                body, joint=dataclasses.replace(joint, origin=moved(joint.origin, offsets[joint.parent]))
            )
        if body.name in offsets:
            offset = offsets[body.name]
            lever = frames.rotate(_quaternion(joint.position[3:7]), offset)
            linear = frames.add(_vector(joint.velocity[:3]), frames.cross(_vector(joint.velocity[3:]), lever))
            body = dataclasses.replace(
                body,
                inertial=dataclasses.replace(body.inertial, centre_of_mass=(0.0, 0.0, 0.0)),
                shapes=tuple(dataclasses.replace(shape, pose=moved(shape.pose, offset)) for shape in body.shapes),
                joint=dataclasses.replace(
                    joint,
                    position=(*frames.add(_vector(joint.position[:3]), lever), *joint.position[3:7]),
                    velocity=(*linear, *joint.velocity[3:]),
                ),
            )
        bodies.append(body)
    return dataclasses.replace(world, bodies=tuple(bodies)), offsets


def restore_free_root(body: Body, offset: Vector3) -> Body:
    """Move a read-back body from the file's frame (at ``offset`` in the world's body frame) back to the world's frame."""
    return dataclasses.replace(
        body,
        inertial=dataclasses.replace(body.inertial, centre_of_mass=frames.add(body.inertial.centre_of_mass, offset)),
        shapes=tuple(
            dataclasses.replace(
                shape, pose=dataclasses.replace(shape.pose, position=frames.add(shape.pose.position, offset))
            )
            for shape in body.shapes
        ),
    )


def restore_frames(bodies: tuple[Body, ...], offsets: dict[str, Vector3]) -> tuple[Body, ...]:
    """Undo :func:`recentre_free_roots` on a read-back: bodies, their shapes, and the origins of their children.

    The initial state (``joint.position``, ``joint.velocity``) of free roots is moved back too where it is present.
    """
    restored = []
    for body in bodies:
        joint = body.joint
        if joint.parent in offsets:
            origin = dataclasses.replace(
                joint.origin, position=frames.add(joint.origin.position, offsets[joint.parent])
            )
            body = dataclasses.replace(body, joint=dataclasses.replace(joint, origin=origin))
        if body.name in offsets:
            body = restore_free_root(body, offsets[body.name])
            if joint.kind == "free" and joint.position:
                lever = frames.rotate(_quaternion(joint.position[3:7]), offsets[body.name])
                position = (*frames.subtract(_vector(joint.position[:3]), lever), *joint.position[3:7])
                velocity = joint.velocity
                if velocity:
                    linear = frames.subtract(_vector(velocity[:3]), frames.cross(_vector(velocity[3:]), lever))
                    velocity = (*linear, *velocity[3:])
                body = dataclasses.replace(body, joint=dataclasses.replace(joint, position=position, velocity=velocity))
        restored.append(body)
    return tuple(restored)


@functools.lru_cache(maxsize=65536)
def principal_axes(inertia: tuple[float, ...]) -> tuple[Vector3, Quaternion]:
    """Principal moments and axes of an inertia (xx, yy, zz, xy, xz, yz): I = R diag(moments) Rᵀ.

    Cyclic Jacobi rotations to the last bit. A diagonal tensor is returned as it is, unturned. The largest moment is
    clipped to ``FLAT_MARGIN`` × the sum of the other two, and a flat direction's round-off below zero to zero.
    """
    xx, yy, zz, xy, xz, yz = inertia
    a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for _ in range(60):
        if a[0][1] == 0.0 and a[0][2] == 0.0 and a[1][2] == 0.0:
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            _jacobi_rotation(a, r, p, q)
    else:
        raise ArithmeticError(f"Jacobi rotations did not converge on the inertia {inertia}")
    moments = _clip_flat((a[0][0], a[1][1], a[2][2]))
    turn = frames.from_matrix((tuple(r[0]), tuple(r[1]), tuple(r[2])))  # type: ignore[arg-type]
    return moments, turn


def _jacobi_rotation(a: list[list[float]], r: list[list[float]], p: int, q: int) -> None:
    """Turn the plane (p, q) so that a[p][q] becomes zero; ``r`` collects the rotations."""
    if a[p][q] == 0.0:
        return
    if abs(a[p][q]) < 1e-18 * math.sqrt(
        abs(a[p][p] * a[q][q])
    ):  # below the last bit of both diagonals: nothing to turn
        a[p][q] = a[q][p] = 0.0
        return
    theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q])
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    a[p][p], a[q][q] = a[p][p] - t * a[p][q], a[q][q] + t * a[p][q]
    a[p][q] = a[q][p] = 0.0
    k = 3 - p - q
    akp, akq = a[k][p], a[k][q]
    a[k][p] = a[p][k] = c * akp - s * akq
    a[k][q] = a[q][k] = s * akp + c * akq
    for i in range(3):
        rip, riq = r[i][p], r[i][q]
        r[i][p], r[i][q] = c * rip - s * riq, s * rip + c * riq


def _clip_flat(moments: Vector3) -> Vector3:
    clipped = [max(moment, 0.0) for moment in moments]
    largest = max(range(3), key=lambda i: clipped[i])
    bound = (sum(clipped) - clipped[largest]) * FLAT_MARGIN
    clipped[largest] = min(clipped[largest], bound)
    return (clipped[0], clipped[1], clipped[2])


def tensor(moments: Vector3, turn: Quaternion) -> tuple[float, float, float, float, float, float]:
    """The inverse of :func:`principal_axes`: (xx, yy, zz, xy, xz, yz) from principal moments and their axes."""
    return frames.turn_inertia(turn, (*moments, 0.0, 0.0, 0.0))
