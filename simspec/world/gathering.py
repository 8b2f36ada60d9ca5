"""Rigid groups whose inertia engines are told as one: bodies without mass and point masses that are fixed to others.

Bodies joined through fixed joints move as one body, and only the sum of their inertias acts. Engines ask more of single bodies
than mechanics does: one takes a root without mass for the ground, another refuses a moving body without moments of inertia.
So where a body of a rigid group has no inertia of its own that is regular, and this matters to an engine, the group's topmost
body is told the inertia of all, and the others none. The motion is the same, to round-off.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from simspec.language.moments import principal_moments
from simspec.world import frames
from simspec.world.derived import derived
from simspec.world.types import Body, Inertial, Pose, Vector3, World

SINGULAR = 1e-12
"""Of the principal moments the smallest, relative to the largest, up to which a tensor is singular: a rod that is written in
turned axes has round-off of 1e-16 in place of zero, a wire of 1 m and 1 µm has 5e-13."""

NOTHING = Inertial(0.0)


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


def summed(parts: Iterable[tuple[Inertial, Pose]]) -> Inertial:
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
        return NOTHING
    whole = placed[0][1]
    if len(placed) > 1 and mass:
        whole = (weighted[0] / mass, weighted[1] / mass, weighted[2] / mass)
    sums = [0.0] * 6
    for m, centre, own in placed:
        x, y, z = frames.subtract(centre, whole)
        steiner = (m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z)
        sums = [total + a + b for total, a, b in zip(sums, own, steiner, strict=True)]
    xx, yy, zz, xy, xz, yz = (value + 0.0 for value in sums)  # −0 becomes 0
    return Inertial(mass, whole, (xx, yy, zz, xy, xz, yz))


@derived
def lumped(world: World) -> Mapping[str, Inertial]:
    """What engines are told of the bodies whose inertia is gathered on the topmost body of their rigid group, by name: that
    body has the whole, the others nothing. Empty where no group needs it."""
    told: dict[str, Inertial] = {}
    for top, members in rigid_members(world.bodies).items():
        (head, _), *others = members
        heavy = [body for body, _ in others if body.inertial.mass > 0.0]
        if heavy and (singular(head.inertial) or any(singular(body.inertial) for body in heavy)):
            told.update((body.name, NOTHING) for body, _ in others)
            told[top] = summed((body.inertial, pose) for body, pose in members)
    return MappingProxyType(told)


def lumped_gravity_scale(world: World, body: Body) -> float:
    """The ``gravity_scale`` that engines are told of a body: where inertia is gathered, that of the bodies with mass, which
    have the same (``resolve/masses.py``)."""
    if body.name not in lumped(world):
        return body.gravity_scale
    for members in rigid_members(world.bodies).values():
        if any(member.name == body.name for member, _ in members):
            return next(member.gravity_scale for member, _ in members if member.inertial.mass > 0.0)
    return body.gravity_scale


def lumped_inertial(world: World, body: Body) -> Inertial:
    """The inertia that engines are told of a body. Its centre of mass is, of a free root, the point whose position is
    integrated."""
    return lumped(world).get(body.name, body.inertial)
