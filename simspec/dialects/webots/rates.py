"""The rates of joints from the velocities of bodies, as a .wbt has them: of the centre of mass of each rigid group."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

from simspec.dialects.webots.raised_places import Found, vector
from simspec.world import frames
from simspec.world.types import Quaternion, Vector3

TOGETHER: Final = 1e-9
"""Of the speeds around it: how fast a joint's ends may part, by the round-off of a chain."""
ZERO: Final[Vector3] = (0.0, 0.0, 0.0)


def rates(found: Mapping[str, Found], turned: Quaternion) -> dict[str, tuple[float, ...]]:
    """The velocity of every body's joint, in the world's coordinates of it; ``turned``: the world in the file. Raises
    ValueError where velocities pull a joint apart, or are of what has none."""
    centres = _centres(found)
    back = frames.conjugate(turned)
    of_group: dict[str, tuple[Vector3, Vector3]] = {}
    for name, one in found.items():
        linear, angular = (vector(one.node, field) for field in ("linearVelocity", "angularVelocity"))
        if one.top == name and one.moves:
            of_group[name] = (frames.rotate(back, linear), frames.rotate(back, angular))
        elif any((*linear, *angular)):
            raise one.node.refused("has a velocity, which is of the topmost Solid of what moves as one")

    def at(name: str | None, point: Vector3) -> tuple[Vector3, Vector3]:
        """Of a body, or the world, at a point of the world."""
        if name is None or not found[name].moves:
            return ZERO, ZERO
        one = found[name]
        linear, angular = of_group[one.top]
        return frames.add(linear, frames.cross(angular, frames.subtract(point, centres[one.top]))), angular

    return {name: _rate(one, at) for name, one in found.items()}


def _rate(one: Found, at: Callable[[str | None, Vector3], tuple[Vector3, Vector3]]) -> tuple[float, ...]:
    joint, point = one.joint, one.pose.position
    if joint.kind == "fixed":
        return ()
    linear, angular = at(one.name, point)
    if joint.kind == "free":
        return (*linear, *angular)
    above_linear, above_angular = at(joint.parent, point)
    slip, turn = frames.subtract(linear, above_linear), frames.subtract(angular, above_angular)
    speed = 1.0 + max(math.hypot(*part) for part in (linear, angular, above_linear, above_angular))
    if joint.kind == "ball":
        _check(one, (slip,), speed)
        return frames.rotate(frames.conjugate(one.pose.quaternion), turn)
    x, y, z = frames.rotate(one.pose.quaternion, joint.axis)
    along, other = (turn, slip) if joint.kind == "hinge" else (slip, turn)
    rate = frames.dot((x, y, z), along)
    _check(one, (frames.subtract(along, (x * rate, y * rate, z * rate)), other), speed)
    return (rate,)


def _check(one: Found, parts: tuple[Vector3, ...], speed: float) -> None:
    if any(math.hypot(*part) > TOGETHER * speed for part in parts):
        raise one.node.refused("moves otherwise than its joint lets it")


def _centres(found: Mapping[str, Found]) -> dict[str, Vector3]:
    """The centre of mass of every rigid group that moves, in the world (m)."""
    masses: dict[str, float] = {}
    sums: dict[str, Vector3] = {}
    for one in found.values():
        mass = one.inertial.mass
        if one.moves and mass:
            x, y, z = frames.add(one.pose.position, frames.rotate(one.pose.quaternion, one.inertial.centre_of_mass))
            masses[one.top] = masses.get(one.top, 0.0) + mass
            sums[one.top] = frames.add(sums.get(one.top, ZERO), (mass * x, mass * y, mass * z))
    return {top: (x / masses[top], y / masses[top], z / masses[top]) for top, (x, y, z) in sums.items()}
