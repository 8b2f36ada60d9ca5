"""How engines declare contact of several bodies: deviations by timestep and ratio of masses, and the ratios to be accepted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Level, Refinement, Support, approximate
from simspec.world.reach import largest_ratio
from simspec.world.types import World

FROM = 0.9
"""Share of a measured timestep from which a row counts."""
RATIOS = (0.0, 10.01, 100.1)
"""Ratios of masses from which rows count that were measured at 10, 100 and 1000: up to the measured one. Beyond 1000 the last
row counts, and level L5 decides."""


def by_timestep(probe: str, why: str, sizes: Mapping[float, float], **more: Any) -> tuple[Deviation, ...]:
    """``sizes``: by timestep (s) the largest deviation that was measured there, as :class:`Deviation` has it."""
    return tuple(Deviation(probe, size, why, timestep=FROM * timestep, **more) for timestep, size in sizes.items())


def by_ratio(
    probe: str, why: str, sizes: Mapping[float, tuple[float, float, float]], **more: Any
) -> tuple[Deviation, ...]:
    """``sizes``: by timestep (s) what was measured (m) at ratios of masses of 10, 100 and 1000; 0 where nothing is declared."""
    return tuple(
        Deviation(probe, size, why, relative=False, timestep=FROM * timestep, ratio=ratio, **more)
        for timestep, row in sizes.items()
        for ratio, size in zip(RATIOS, row, strict=True)
        if size
    )


def heavy_on_light(
    limits: Mapping[float, float], how: str, short: str, engine: str = "", setting: tuple[str, str] | None = None
) -> Support:
    """Exact below a ratio of masses, to be accepted by name from it on. ``limits``: by least timestep (s) that ratio;
    ``setting``: where the spec gives this name and value to ``engine`` alone."""

    def exact(world: World) -> Refinement | None:
        if setting is not None and dict(world.options(engine).settings).get(setting[0]) != setting[1]:
            return Refinement(Level.EXACT, "")
        here = [ratio for timestep, ratio in sorted(limits.items()) if world.physics.timestep >= FROM * timestep]
        return Refinement(Level.EXACT, "") if not here or largest_ratio(world) < here[-1] else None

    return approximate(how, exact, short)
