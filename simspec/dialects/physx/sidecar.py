"""The sidecar of a ``world.json`` for PhysX: beside what every such sidecar has, the one threshold of restitution."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simspec.dialects.kit.world_sidecar import WorldSidecar


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysxSidecar(WorldSidecar):
    """Settings, where the frames of free roots are, and what is one for all contacts."""

    restitution_threshold: float
    """m/s: what approaches slower does not bounce; 0: nothing has to."""

    def check(self) -> None:
        WorldSidecar.check(self)
        if not (math.isfinite(self.restitution_threshold) and self.restitution_threshold >= 0.0):
            raise ValueError("sidecar.restitution_threshold is no speed")
