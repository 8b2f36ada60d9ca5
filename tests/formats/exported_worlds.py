"""Five worlds whose plain files are read by every program that reads the format: together they have what robots have."""

from __future__ import annotations

import functools
from pathlib import Path

from simspec.language.load import load
from simspec.world.types import World

FOLDER = Path(__file__).parent / "exported"
NAMES = ("chain", "arm", "quadruped", "scene", "claw")


@functools.cache
def exported_world(name: str) -> World:
    """One of the worlds, resolved."""
    return load(FOLDER / f"{name}.yaml").resolve()
