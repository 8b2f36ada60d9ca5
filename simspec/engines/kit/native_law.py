"""The law that an engine's own controllers follow, as a declaration that tests compare with its closed form."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class ServoLaw(StrEnum):
    """How an engine's own controller of one joint acts, with gains kp and kd, targets q* and v*, and an effort limit."""

    EXPLICIT_SPRING = "explicit_spring"
    """clip(kp (q* − q) + kd (v* − v)), by the state before the step."""
    IMPLICIT_SPRING = "implicit_spring"
    """clip(kp (q* − q − dt v') + kd (v* − v')), by the velocity v' after the step."""
    MOTOR = "motor"
    """Whatever effort within the limit makes v' = v* + kp/(kd + dt kp) (q* − q), or comes nearest."""


@dataclass(frozen=True)
class NativeLaw:
    """What an engine's own controllers do."""

    law: ServoLaw
    accuracy: float
    """rad from the closed form within a second, for a wheel of 0.02 kg m²: measured, rounded up."""
    implicit_damping: bool = False
    """Whether the joint's own damping d acts by the velocity after the step where a controller is at its limit, which makes it
    weaker by 1 + dt d / I."""

    residual: float = 0.0
    """Share of a joint's momentum that the engine's solver may leave out in each step, its relative tolerance: at speed v as if
    by a damping of ``residual`` I / dt."""

    @property
    def sags(self) -> bool:
        """Whether a constant load moves the joint away from its target, as it does with a spring."""
        return self.law is not ServoLaw.MOTOR
