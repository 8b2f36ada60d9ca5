"""How fast an engine takes an overlap of two bodies back, as it declares it."""

from __future__ import annotations

import math
from dataclasses import dataclass

COMMON_SHARE = 0.01
"""Of an overlap, taken back in each step: the common law of contact (docs/records/contact.md)."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """In a step of dt an overlap r decreases by min(share · r, speed · dt).

    share   of the overlap (β)
    speed   m/s, the most with which it is taken back
    why     what the largest speed comes from; empty where there is none
    """

    share: float = COMMON_SHARE
    speed: float = math.inf
    why: str = ""

    def taken_back(self, overlap: float, steps: int, timestep: float) -> float:
        """The part of an overlap (m) that is taken back in so many steps of ``timestep`` (s)."""
        left = max(0.0, overlap)
        begun = left
        for _ in range(steps):
            left -= min(self.share * left, self.speed * timestep)
        return begun - left


COMMON = Recovery()
