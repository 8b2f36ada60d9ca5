"""Controllers of engines that set velocities: what gains are to them."""

from __future__ import annotations

import numpy as np


def motor_rate(stiffness: np.ndarray, damping: np.ndarray, timestep: float) -> np.ndarray:
    """How fast (1/s) a motor that sets velocities takes back an error: kp / (kd + dt kp); 0 without kp.

    Such a motor makes v' = v* + rate (q* − q). That is the law kp (q* − q) + kd (v* − v) at the end of the step, of a joint
    whose inertia is nothing beside kd dt + kp dt²: kp (q* + dt v* − q − dt v') + kd (v* − v') = 0.
    """
    divisor = damping + timestep * stiffness
    rate: np.ndarray = np.divide(stiffness, divisor, out=np.zeros_like(divisor), where=divisor > 0.0)
    return rate


def motor_limit(stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The largest effort of such motors: none where a joint has neither kp nor kd."""
    return np.where((stiffness > 0.0) | (damping > 0.0), limit, 0.0)
