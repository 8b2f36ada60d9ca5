"""How far MuJoCo's own friction is off where pairs bounce well: pushes and slides of pairs with e from 0.35 on.

Measured with MuJoCo 4.0.1 at e = 0.8, 0.5, 1, 2, 4 and 8 ms and frictions of 0.05 to 1.45 in steps of 0.05, with a margin of 5
to 15 %. A pair that bounces has no cushion, so that what slides leaves its floor, and the further the livelier it is.
"""

from __future__ import annotations

from collections.abc import Mapping

LEAST = 0.35
"""Least restitution of these; below it the rows of e = 0.3 hold."""
Sizes = Mapping[float, Mapping[float, float]]
"""By timestep (s), by least friction, the largest share of the expected value."""
_PUSHED: Sizes = {
    0.0005: {0.04: 0.065, 0.17: 0.11, 0.57: 0.18, 0.77: 0.26, 1.17: 0.32},
    0.004: {0.37: 0.19, 0.57: 0.28, 0.97: 0.37, 1.37: 0.43},
}
_SLID: Sizes = {
    0.0005: {0.04: 0.026, 0.17: 0.045, 0.57: 0.056, 0.77: 0.11, 0.97: 0.23, 1.17: 0.49, 1.37: 0.62},
    0.004: {0.37: 0.096, 0.57: 0.22, 0.77: 0.33, 0.97: 0.37, 1.17: 0.61},
}
_PUSHED_UNDER_PYRAMID: Sizes = {
    0.0005: {0.04: 0.12, 0.17: 0.53, 0.37: 1.3, 0.77: 1.6, 0.97: 2.3, 1.37: 2.8},
}
_SLID_UNDER_PYRAMID: Sizes = {
    0.0005: {0.17: 0.17, 0.37: 0.34, 0.57: 0.71, 0.97: 1.4, 1.17: 2.1, 1.37: 2.5},
    0.004: {0.77: 0.89},
}
ELLIPTIC: Mapping[str, Sizes] = {"push": _PUSHED, "push-oblong": _PUSHED, "stop": _SLID, "stop-oblong": _SLID}
"""By probe."""
PYRAMID: Mapping[str, Sizes] = {
    "push": _PUSHED_UNDER_PYRAMID,
    "push-oblong": _PUSHED_UNDER_PYRAMID,
    "stop": _SLID_UNDER_PYRAMID,
    "stop-oblong": _SLID_UNDER_PYRAMID,
}
"""The same under the inscribed pyramid."""
