"""The worlds whose files the complete self-test changes: compact ones that use every feature between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simspec.proof import selftest_worlds
from simspec.world.types import World

WORLDS: Mapping[str, Callable[[str], World]] = {**selftest_worlds.WORLDS}
"""By name, each for one engine."""
