"""Inertia: principal axes, bodies made of solid shapes, rigid groups whose inertia is lumped, boxes of equal inertia.

Plain floats, the same bits on every machine.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from simspec.language.moments import principal_moments
from simspec.world import frames
from simspec.world.actions import LEAST_MOMENT, InertiaBox
from simspec.world.canonical import derived
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Inertial, Pose, Quaternion, Vector3, World

# Principal moments and axes of a tensor of inertia, in plain floats: the same bits on every machine.

FLAT_MARGIN = 1.0 - 2.0**-40
"""Share of λ1 + λ2 that the largest principal moment may reach. An inertia with λmax > λ1 + λ2, even by round-off, is
zeroed by one engine and refused by another (measured: 77 of 200 flat bodies); 2⁻⁴⁰ ≈ 9e-13 is inside the 1e-12 of proof
level L0."""


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
    moments = clip_flat((a[0][0], a[1][1], a[2][2]))
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


def clip_flat(moments: Vector3) -> Vector3:
    """Principal moments of which none is below zero, and the largest at most ``FLAT_MARGIN`` × the sum of the others."""
    clipped = [max(moment, 0.0) for moment in moments]
    largest = max(range(3), key=lambda i: clipped[i])
    bound = (sum(clipped) - clipped[largest]) * FLAT_MARGIN
    clipped[largest] = min(clipped[largest], bound)
    return (clipped[0], clipped[1], clipped[2])


# Mass properties of bodies made of solid shapes (``world/shapes.py``); plain floats, the same bits on every machine.

Inertia6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Part:
    """A solid of a body: its mass, the pose of its centre and principal axes in the body frame, its moments there."""

    mass: float
    pose: Pose
    moments: Vector3


def shape_part(kind: str, size: Sequence[float], pose: Pose, mass: float) -> Part:
    """A shape of ``mass`` at ``pose`` in the body frame."""
    return Part(mass, pose, SHAPES[kind].moments(size, mass))


def rotated_tensor(principal: Vector3, turn: Quaternion) -> Inertia6:
    """The tensor (xx, yy, zz, xy, xz, yz) in body axes of principal moments about axes turned by ``turn``."""
    return frames.rotate_inertia(turn, (*principal, 0.0, 0.0, 0.0))


def combined_inertial(parts: Sequence[Part], mass: float | None = None) -> Inertial:
    """The mass properties of a body made of ``parts`` (at least one with mass): sums by the parallel-axis theorem.

    ``mass``: the total, where it is known better than as the sum of the parts' rounded masses.
    """
    # no sum(): from Python 3.12 on it compensates, and would give other last bits
    total, weighted = 0.0, (0.0, 0.0, 0.0)
    for shape_part in parts:
        x, y, z = shape_part.pose.position
        total += shape_part.mass
        weighted = frames.add(weighted, (shape_part.mass * x, shape_part.mass * y, shape_part.mass * z))
    if len(parts) == 1:
        centre = parts[0].pose.position
    else:
        centre = (weighted[0] / total, weighted[1] / total, weighted[2] / total)
    sums = [0.0] * 6
    for shape_part in parts:
        x, y, z = frames.subtract(shape_part.pose.position, centre)
        m = shape_part.mass
        steiner = (m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z)
        local = rotated_tensor(shape_part.moments, shape_part.pose.quaternion)
        sums = [total_single + a + b for total_single, a, b in zip(sums, local, steiner, strict=True)]
    inertia: Inertia6 = tuple(value + 0.0 for value in sums)  # type: ignore[assignment] # −0 becomes 0
    return Inertial(total if mass is None else mass, centre, inertia)


# Rigid groups whose inertia engines receive as one: bodies without mass and point masses that are fixed to others.
#
# Bodies joined through fixed joints move as one body, and only the sum of their inertias acts. Engines ask more of single
# bodies than mechanics does: one takes a root without mass for the ground, another refuses a moving body without moments of
# inertia. So where a body of a rigid group has no inertia of its own that is regular, and this matters to an engine, the
# group's topmost body receives the inertia of all, and the others none. The motion is the same, to round-off.

SINGULAR = 1e-12
"""Of the principal moments the smallest, relative to the largest, up to which a tensor is singular: a rod that is written in
turned axes has round-off of 1e-16 in place of zero, a wire of 1 m and 1 µm has 5e-13."""

NO_INERTIA = Inertial(0.0)


def singular(inertial: Inertial) -> bool:
    """Whether a body with this inertia alone could not be turned about every axis: no mass, a point mass, or a rod."""
    if inertial.mass <= 0.0:
        return True
    low, _, high = principal_moments(inertial.inertia)
    return low <= SINGULAR * high


def least_moment(inertial: Inertial) -> float:
    """The smallest principal moment (kg m²)."""
    xx, yy, zz, *products = inertial.inertia
    return min(xx, yy, zz) if not any(products) else principal_moments(inertial.inertia)[0]


def rigid_members(bodies: Sequence[Body]) -> dict[str, list[tuple[Body, Pose]]]:
    """The members of each rigid group with their poses in the frame of its topmost body, which stands first, by its name.
    Bodies that are fixed to the world are not among them. ``bodies``: every parent before its children."""
    members: dict[str, list[tuple[Body, Pose]]] = {}
    place: dict[str, tuple[str, Pose]] = {}
    for body in bodies:
        joint = body.joint
        if joint.kind != "fixed":
            place[body.name] = (body.name, Pose())
        elif joint.parent in place:
            top, pose = place[joint.parent]
            place[body.name] = (top, frames.compose(pose, joint.origin))
        else:
            continue
        top, pose = place[body.name]
        members.setdefault(top, []).append((body, pose))
    return members


def summed_inertial(parts: Iterable[tuple[Inertial, Pose]]) -> Inertial:
    """The inertia of bodies at poses in one frame, in that frame: sums by the parallel-axis theorem."""
    mass, weighted = 0.0, (0.0, 0.0, 0.0)
    placed: list[tuple[float, Vector3, tuple[float, ...]]] = []
    for inertial, pose in parts:
        if not inertial.mass and not any(inertial.inertia):
            continue
        centre = frames.add(pose.position, frames.rotate(pose.quaternion, inertial.centre_of_mass))
        x, y, z = centre
        m = inertial.mass
        mass += m
        weighted = frames.add(weighted, (m * x, m * y, m * z))
        placed.append((m, centre, frames.rotate_inertia(pose.quaternion, inertial.inertia)))
    if not placed:
        return NO_INERTIA
    whole = placed[0][1]
    if len(placed) > 1 and mass:
        whole = (weighted[0] / mass, weighted[1] / mass, weighted[2] / mass)
    sums = [0.0] * 6
    for m, centre, local in placed:
        x, y, z = frames.subtract(centre, whole)
        steiner = (m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z)
        sums = [total + a + b for total, a, b in zip(sums, local, steiner, strict=True)]
    xx, yy, zz, xy, xz, yz = (value + 0.0 for value in sums)  # −0 becomes 0
    return Inertial(mass, whole, (xx, yy, zz, xy, xz, yz))


@derived
def lumped(world: World) -> Mapping[str, Inertial]:
    """The inertia that engines receive for bodies whose inertia is gathered on the topmost body of their rigid group, by
    name: that body has the whole, the others nothing. Empty where no group needs it."""
    inertials: dict[str, Inertial] = {}
    for top, members in rigid_members(world.bodies).items():
        (head, _), *others = members
        heavy = [body for body, _ in others if body.inertial.mass > 0.0]
        if heavy and (singular(head.inertial) or any(singular(body.inertial) for body in heavy)):
            inertials.update((body.name, NO_INERTIA) for body, _ in others)
            inertials[top] = summed_inertial((body.inertial, pose) for body, pose in members)
    return MappingProxyType(inertials)


def lumped_gravity_scale(world: World, body: Body) -> float:
    """The ``gravity_scale`` that engines receive for a body: where inertia is gathered, that of the bodies with mass, which
    have the same (``resolve/stability.py``)."""
    if body.name not in lumped(world):
        return body.gravity_scale
    for members in rigid_members(world.bodies).values():
        if any(member.name == body.name for member, _ in members):
            return next(member.gravity_scale for member, _ in members if member.inertial.mass > 0.0)
    return body.gravity_scale


def lumped_inertial(world: World, body: Body) -> Inertial:
    """The inertia that engines receive for a body. Its centre of mass is, of a free root, the point whose position is
    integrated."""
    return lumped(world).get(body.name, body.inertial)


def gathered(world: World) -> World:
    """The world with the inertia of rigid groups gathered on their topmost bodies where engines ask for it."""
    inertials = lumped(world)
    if not inertials:
        return world
    bodies = (
        replace(body, inertial=inertials.get(body.name, body.inertial), gravity_scale=lumped_gravity_scale(world, body))
        for body in world.bodies
    )
    return replace(world, bodies=tuple(bodies))


# The boxes by which bodies feel a fluid (``world/actions.py``), from their inertia.

PRINCIPAL_MARGIN = 1e-9
"""Share of the trace of a tensor up to which its products of inertia in some axes are round-off: these are principal axes."""


def moments_along(inertia: tuple[float, ...], axes: Quaternion) -> Vector3 | None:
    """The principal moments about ``axes`` of a tensor (xx, yy, zz, xy, xz, yz) that is given in the body's axes; None where
    these are not its principal axes."""
    xx, yy, zz, *products = frames.rotate_inertia(frames.conjugate(axes), inertia)
    if max(map(abs, products)) > PRINCIPAL_MARGIN * (xx + yy + zz):
        return None
    return clip_flat((xx, yy, zz))


def box_of(inertial: Inertial, axes: Quaternion | None = None) -> InertiaBox:
    """The box of a body with mass, along ``axes`` where they are principal ones; else along those that its tensor gives."""
    moments = None if axes is None else moments_along(inertial.inertia, axes)
    if axes is None or moments is None:
        moments, axes = principal_axes(inertial.inertia)
    x, y, z = moments
    return InertiaBox(
        (_edge(inertial.mass, y + z - x), _edge(inertial.mass, x + z - y), _edge(inertial.mass, x + y - z)), axes
    )


def _edge(mass: float, moment: float) -> float:
    return math.sqrt(6.0 * max(moment, LEAST_MOMENT) / mass)


def boxed(bodies: Sequence[Body], kinematic: Container[str]) -> tuple[Body, ...]:
    """The bodies of a world with a fluid, each with the box by which it feels it: of what cannot move none, and of a rigid
    group that engines receive as a single body, at its topmost body. ``bodies``: those with mass have a box of their
    own already; ``kinematic``: the names of those whose mass is another since."""
    inertials = lumped(World("", tuple(bodies)))
    boxes: dict[str, InertiaBox] = {}
    for top, members in rigid_members(bodies).items():
        if top not in inertials:
            boxes.update(
                (body.name, body.box if body.box is not None and body.name not in kinematic else box_of(body.inertial))
                for body, _ in members
                if body.inertial.mass > 0.0
            )
            continue
        heavy = [(body, pose) for body, pose in members if body.inertial.mass > 0.0]
        axes = None
        if len(heavy) == 1 and heavy[0][0].box is not None:
            axes = frames.multiply(heavy[0][1].quaternion, heavy[0][0].box.quaternion)
        boxes[top] = box_of(inertials[top], axes)
    return tuple(
        body if body.box == boxes.get(body.name) else replace(body, box=boxes.get(body.name)) for body in bodies
    )
