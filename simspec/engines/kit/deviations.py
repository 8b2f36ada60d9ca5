"""Known deviations of an engine from the contact law, each measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import Any

from simspec.support.versions import is_before
from simspec.world.types import PairContact


@dataclass(frozen=True, slots=True)
class Deviation:
    """A known deviation of an engine from the contact law, in one contact probe (see ``proof/contact/``).

    ``size`` is the largest measured one, ``why`` what it comes from. ``relative``: size is a share of the expected value,
    else it is in the figure's unit. It counts for pairs with at least this ``friction`` and ``restitution``, from this
    ``timestep`` (s) on, and under this ``friction_cone``, kind of ``hardness`` and ``setting`` (name, value) of the engine
    alone, where these are given, in worlds where bodies of at least this ``ratio`` of masses may touch, and in releases before
    ``until`` ("": in all), where the release is known; and below the values of ``below``: friction, restitution, timestep,
    ratio.
    """

    probe: str
    size: float
    why: str
    relative: bool = True
    friction: float = 0.0
    timestep: float = 0.0
    restitution: float = 0.0
    friction_cone: str = ""
    hardness: str = ""
    setting: tuple[str, Any] | None = None
    ratio: float = 0.0
    until: str = ""
    below: tuple[float, float, float, float] = (inf, inf, inf, inf)

    @property
    def is_local(self) -> bool:
        """Whether it counts around single values alone."""
        return min(self.below) < inf

    def counts_for(
        self,
        pair: PairContact,
        friction_cone: str,
        timestep: float,
        settings: Mapping[str, Any] = MappingProxyType({}),
        ratio: float = 0.0,
        version: str | None = None,
    ) -> bool:
        """Whether it is one of this pair's, under this cone, timestep, and these settings of the engine, in this release of
        it (None: not known)."""
        return (
            (not self.until or (version is not None and is_before(version, self.until)))
            and (self.setting is None or settings.get(self.setting[0]) == self.setting[1])
            and pair.friction >= self.friction
            and pair.restitution >= self.restitution
            and timestep >= self.timestep
            and ratio >= self.ratio
            and self.friction_cone in ("", friction_cone)
            and self.hardness in ("", pair.hardness.kind)
            and pair.friction < self.below[0]
            and pair.restitution < self.below[1]
            and timestep < self.below[2]
            and ratio < self.below[3]
        )
