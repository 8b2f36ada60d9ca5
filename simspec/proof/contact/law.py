"""The one-step law of friction, under every cone: what probes of friction are held against.

In a step in which the normal impulse is J, the friction impulse is what opposes the tangential motion best within the
cone's section of size μ J: the projection of the momentum that the body would have without friction onto that section.
So a push F from rest meets the projection of F onto the section of size μ N, in this step and all later ones, and what
slides freely follows v' = v − proj(v), with the section of size μ g dt, and x' = x + v' dt. Under the elliptic cone a body
at speed v comes to rest after v²/2μg − v dt/2.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np


def project(vector: np.ndarray, size: float, friction_cone: str) -> np.ndarray:
    """The point nearest to ``vector`` (2,) in the section of the cone of this ``size``: a disc of that radius, the diamond
    |x| + |y| ≤ size, or the square |x|, |y| ≤ size. Raises KeyError for an unknown cone."""
    x, y = vector
    return np.array(nearest(float(x), float(y), size, friction_cone))


def nearest(x: float, y: float, size: float, friction_cone: str) -> tuple[float, float]:
    """As :func:`project`, of two numbers, which is ten times as quick."""
    return _SECTIONS[friction_cone](x, y, size)


def _disc(x: float, y: float, size: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    return (x, y) if length <= size else (x * (size / length), y * (size / length))


def _square(x: float, y: float, size: float) -> tuple[float, float]:
    return min(max(x, -size), size), min(max(y, -size), size)


def _diamond(x: float, y: float, size: float) -> tuple[float, float]:
    """Onto the l1 ball: take the same amount off both coordinates' magnitudes, until they sum to ``size``."""
    off = (abs(x) + abs(y) - size) / 2.0
    if off <= 0.0:
        return x, y
    if off > min(abs(x), abs(y)):  # one coordinate is used up: the nearest point is a corner
        return (math.copysign(size, x), 0.0) if abs(x) > abs(y) else (0.0, math.copysign(size, y))
    return math.copysign(abs(x) - off, x), math.copysign(abs(y) - off, y)


_SECTIONS = {"elliptic": _disc, "pyramid-inscribed": _diamond, "pyramid-circumscribed": _square}


def outline(size: float, friction_cone: str, points: int = 181) -> np.ndarray:
    """The boundary of the section, for plots: (points, 2)."""
    angles = np.linspace(0.0, 2.0 * np.pi, points)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    if friction_cone == "elliptic":
        return size * directions
    norm = np.abs(directions).sum(axis=1) if friction_cone == "pyramid-inscribed" else np.abs(directions).max(axis=1)
    boundary: np.ndarray = size * directions / norm[:, None]
    return boundary


def slide(
    velocity: np.ndarray, friction: float, gravity: float, timestep: float, friction_cone: str, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (steps + 1, 2) of a body that slides freely from the origin; both are read-only."""
    x, y = (float(part) for part in velocity)
    return _slid(x, y, friction * gravity * timestep, timestep, friction_cone, steps)


@lru_cache(maxsize=2048)
def _slid(
    x: float, y: float, size: float, timestep: float, friction_cone: str, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Kept, since the figures of a certificate ask for thousands of slides, most of them the same."""
    places, speeds = [(0.0, 0.0)], [(x, y)]
    along = across = 0.0
    for _ in range(steps):
        less, sideways = nearest(x, y, size, friction_cone)
        x, y = x - less, y - sideways
        along, across = along + timestep * x, across + timestep * y
        speeds.append((x, y))
        places.append((along, across))
    position, speed = np.array(places), np.array(speeds)
    position.flags.writeable = speed.flags.writeable = False
    return position, speed
