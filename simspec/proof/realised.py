"""How an engine's files realise a world: the decisions on its features and the settings in force, from which follow the
accepted approximations of a certificate and the declared deviations that may count in it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.support.declarations import Level
from simspec.support.negotiation import Decision
from simspec.world.canonical import derived
from simspec.world.contact_pairs import Pair
from simspec.world.types import World


@dataclass(frozen=True)
class Realised:
    """``approximations``: as a certificate has them; ``settings``: of the whole world, and ``pairs``, those of pairs of
    materials, which replace them there; ``refused``: why the world cannot be compiled for the engine, "" where it can."""

    approximations: Mapping[str, str]
    settings: Mapping[str, Any]
    pairs: Mapping[Pair, Mapping[str, Any]]
    refused: str = ""

    def between(self, pair: Pair) -> Mapping[str, Any]:
        """The settings that are in force between two materials (sorted names)."""
        return {**self.settings, **self.pairs.get(pair, {})}


def approximations(decisions: Iterable[Decision]) -> dict[str, str]:
    """The features that are approximate, or computed outside the engine, with how: those that a spec accepts by name."""
    return {
        decision.feature.value: f"{decision.level.value}: {decision.how}"
        for decision in decisions
        if decision.level in (Level.APPROXIMATE, Level.OUTSIDE)
    }


@derived
def realised(world: World, engine: str, version: str) -> Realised:
    """What compiling ``world`` for an engine (a name or label) of a version gives."""
    label = f"{engine_name(engine)}@{version}" if find_engine(engine).version() is not None else engine
    try:
        compiled = compile_world(world, [label])[label]
    except UnsupportedError as error:
        return Realised({}, {}, {}, error.problems[0].message)
    sidecar = json.loads(compiled.files[SIDECAR])
    pairs = {
        (entry["between"][0], entry["between"][1]): entry["settings"] for entry in sidecar.get("pair_settings", ())
    }
    return Realised(approximations(compiled.decisions), sidecar["settings"], pairs)
