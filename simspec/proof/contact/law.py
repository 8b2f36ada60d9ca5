"""The one-step law of friction, under every cone: what probes of friction are held against.

In a step in which the normal impulse is J, the friction impulse is what opposes the tangential motion best within the
cone's section of size μ J: the projection of the momentum that the body would have without friction onto that section.
So a push F from rest meets the projection of F onto the section of size μ N, in this step and all later ones, and what
slides freely follows v' = v − proj(v), with the section of size μ g dt, and x' = x + v' dt. Under the elliptic cone a body
at speed v comes to rest after v²/2μg − v dt/2.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np


def project(vector: np.ndarray, size: float, friction_cone: str) -> np.ndarray:
    """The point nearest to ``vector`` (2,) in the section of the cone of this ``size``: a disc of that radius, the diamond
    |x| + |y| ≤ size, or the square |x|, |y| ≤ size. Raises KeyError for an unknown cone."""
    return _SECTIONS[friction_cone](np.asarray(vector, dtype=float), size)


def _disc(vector: np.ndarray, size: float) -> np.ndarray:
    length = float(np.hypot(*vector))
    return vector if length <= size else vector * (size / length)


def _square(vector: np.ndarray, size: float) -> np.ndarray:
    clipped: np.ndarray = np.clip(vector, -size, size)
    return clipped


def _diamond(vector: np.ndarray, size: float) -> np.ndarray:
    """Onto the l1 ball: take the same amount off both coordinates' magnitudes, until they sum to ``size``."""
    magnitude = np.abs(vector)
    if magnitude.sum() <= size:
        return vector
    off = (magnitude.sum() - size) / 2.0
    if off > magnitude.min():  # one coordinate is used up: the nearest point is a corner
        kept = np.where(magnitude == magnitude.max(), size, 0.0)
        corner: np.ndarray = np.sign(vector) * kept
        return corner
    nearest: np.ndarray = np.sign(vector) * (magnitude - off)
    return nearest


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
    position = np.zeros((steps + 1, 2))
    speed = np.zeros((steps + 1, 2))
    speed[0] = x, y
    for step in range(steps):
        speed[step + 1] = speed[step] - project(speed[step], size, friction_cone)
        position[step + 1] = position[step] + timestep * speed[step + 1]
    position.flags.writeable = speed.flags.writeable = False
    return position, speed
