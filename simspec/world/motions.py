"""Motions of kinematic bodies: where they are at every time, whatever pushes them. Frozen, SI units, all resolved.

A kinematic body is a free root of a mass that is ``HEAVIER`` times that of all else that moves. Before every step an effort
gives it the velocity that brings it to where its motion has it at the end of the step: contact and joints see a body of that
velocity, and move it by 1/HEAVIER of what they would move a body of their own mass, which the next step takes back.
"""

from __future__ import annotations

from dataclasses import dataclass

HEAVIER = 1e5
"""Of a kinematic body beside all that moves in its world. At 1e4 a box that slides on one shifts it by 2e-9 m in a step of
1 ms, at 1e5 by 2e-10 m; at 1e8 one engine lifts the box at 2.5 mm/s (measured)."""

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Motion:
    """The motion of a kinematic body, by points in time.

    body            its full name
    times           strictly increasing (s), the first ≥ 0; before the first and after the last point it stands still there
    positions       of its frame's origin in the world (m), one for each time
    quaternions     w x y z of its frame in the world, one for each time
    interpolation   of positions as in :class:`simspec.world.control.Trajectory`: linear, cubic (C²) or quintic (C⁴), at rest
                    at both ends. Between two points it turns about one axis, the shorter way, by a share of the angle: u,
                    u² (3 − 2 u) and u³ (10 − 15 u + 6 u²) at the share u of the time
    """

    body: str
    times: tuple[float, ...] = (0.0,)
    positions: tuple[Vector3, ...] = ((0.0, 0.0, 0.0),)
    quaternions: tuple[Quaternion, ...] = ((1.0, 0.0, 0.0, 0.0),)
    interpolation: str = "cubic"

    def __repr__(self) -> str:
        return f"<Motion of {self.body!r}: {len(self.times)} points, {self.interpolation}>"
