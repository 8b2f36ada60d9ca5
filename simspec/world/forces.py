"""Forces and torques that act on bodies during given times. Frozen, SI units, all resolved.

In every step a force is its mean over the step: what begins or ends between two steps counts by its share of the step, so that
its impulse is exact at every timestep. It is taken at the state before the step, as all efforts are.
"""

from __future__ import annotations

from dataclasses import dataclass

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Force:
    """A force and a torque on a body, constant in the world's axes.

    body     its full name
    force    N, world axes, at ``at``
    torque   N m, world axes; a couple, beside that of the force
    at       the point, in the body's frame (m); it moves with the body
    start    s, from which on it acts
    until    s, up to which it acts; None: to the end of the run
    """

    body: str
    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)
    at: Vector3 = (0.0, 0.0, 0.0)
    start: float = 0.0
    until: float | None = None

    def __repr__(self) -> str:
        return f"<Force on {self.body!r}, {self.start:g} to {'the end' if self.until is None else f'{self.until:g}'} s>"
