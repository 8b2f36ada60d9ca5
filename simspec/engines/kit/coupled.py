"""Support for contact of several bodies: exact where no declared deviation of its probes counts, else accepted by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from simspec.contact.plan import HEAVY_ON_LIGHT
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import written_settings
from simspec.support.declarations import Level, Refinement, Support, approximate
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws
from simspec.world.reach import Reach, largest_ratio, reach
from simspec.world.types import PairContact, World

SLIDING = ("stack-slides", "stack-stays", "stack-slides-plane", "stack-stays-plane")
"""Probes of stacks that slide: their rows say nothing of worlds in which no body that moves has faces, or of those without a
plane."""


Settings = Callable[[World], Mapping[str, Any]]


def in_force(engine: str) -> Settings:
    """The settings that are in force in a world: those that its spec gives the engine, and the engine's own."""
    return lambda world: written_settings(find_engine(engine), world)


def _happens(row: Deviation, law: PairContact, there: Reach) -> bool:
    """Whether two materials can do what a row is of; stacks at rest below ``HEAVY_ON_LIGHT`` are near enough to the law."""
    if row.probe not in SLIDING:
        return not row.probe.startswith("stack") or there.ratio >= HEAVY_ON_LIGHT
    return (
        law.friction > 0.0 and there.ratio > 0.0 and there.corners and (there.plane or not row.probe.endswith("-plane"))
    )


def leans(world: World) -> bool:
    """Whether friction can change a normal force in ``world``: a body with friction may lean, clamp or be piled."""
    return any(law.friction and reach(world, *pair).leans for pair, law in meeting_laws(world).items())


PROBES: Mapping[Feature, str] = {
    Feature.MASS_RATIO: "stack",
    Feature.EVEN_PRESSURE: "squeeze",
    Feature.SELF_LOCKING: "jam",
}
"""Beginnings of the names of the probes that measure features of contact of several bodies."""


def coupled(
    settings: str | Settings,
    rows: Sequence[Deviation],
    texts: Mapping[Feature, tuple[str, str]],
    stacks: Callable[[Deviation], bool] = lambda row: True,
) -> dict[Feature, Support]:
    """For each feature of ``texts`` (how, short): exact where no deviation of its probes counts, else accepted by name.
    ``settings``: an engine's name, or its settings in a world; ``stacks``: the rows of stacks that count here."""
    chosen = in_force(settings) if isinstance(settings, str) else settings
    return {
        feature: _exact_without(
            [
                row
                for row in rows
                if row.probe.startswith(PROBES[feature]) and (feature is not Feature.MASS_RATIO or stacks(row))
            ],
            chosen,
            *text,
        )
        for feature, text in texts.items()
    }


def _exact_without(rows: Sequence[Deviation], settings: Settings, how: str, short: str) -> Support:
    def exact(world: World) -> Refinement | None:
        ratio, timestep, cone = largest_ratio(world), world.physics.timestep, world.contact.friction_cone
        counting = any(
            row.counts_for(law, cone, timestep, settings(world), ratio) and _happens(row, law, reach(world, *pair))
            for pair, law in meeting_laws(world).items()
            for row in rows
        )
        return None if counting else Refinement(Level.EXACT, "")

    return approximate(how, exact, short)
