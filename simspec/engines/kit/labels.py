"""What a sidecar says it is for, and its settings: as an engine's process was given them, and as the world asks for them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simspec.dialects.kit.sidecar import SIDECAR_SCHEMA
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import format_of
from simspec.engines.kit.settings import pair_settings, written_settings
from simspec.world.canonical import sha256
from simspec.world.types import EngineValue, World

LABELS = ("schema", "dialect", "format", "engine", "world", "friction_cone")


def sidecar_labels(sidecar: Mapping[str, Any]) -> dict[str, EngineValue]:
    """The labels and settings of a sidecar, by the names that inventories give them."""
    labels: dict[str, EngineValue] = {f"sidecar.{name}": sidecar[name] for name in LABELS}
    for pair in sidecar.get("pair_settings", ()):
        first, second = pair["between"]
        labels |= _of_pair((first, second), pair["settings"])
    return labels | {f"settings.{name}": value for name, value in sidecar["settings"].items()}


def expected_labels(engine: type[Engine], world: World) -> dict[str, EngineValue]:
    """What :func:`sidecar_labels` must be for ``world``."""
    values: tuple[str | int, ...] = (
        SIDECAR_SCHEMA,
        engine.DIALECT,
        format_of(engine),
        engine.NAME,
        sha256(world),
        world.contact.friction_cone,
    )
    labels: dict[str, EngineValue] = {}
    for name, value in zip(LABELS, values, strict=True):
        labels[f"sidecar.{name}"] = value
    for pair, settings in pair_settings(engine, world).items():
        labels |= _of_pair(pair, settings)
    return labels | {f"settings.{name}": value for name, value in written_settings(engine, world).items()}


def _of_pair(pair: tuple[str, str], settings: Mapping[str, Any]) -> dict[str, EngineValue]:
    return {f"pair_settings.{pair[0]}.{pair[1]}.{name}": value for name, value in settings.items()}
