"""Five worlds whose plain files are read by every program that reads the format: together they have what robots have."""

from __future__ import annotations

import functools
from pathlib import Path

from simspec.language.load import load
from simspec.world.types import World

FOLDER = Path(__file__).parent / "exported"
NAMES = ("chain", "arm", "quadruped", "scene", "claw")
LAYOUTS = (
    ("urdf", "fixed-base"),
    ("urdf", "floating"),
    ("mjcf", ""),
    ("sdf", "1.9"),
    ("sdf", "1.6"),
    ("usd", "flat"),
    ("usd", "nested"),
)
"""Formats with their profiles; "" where a format has one."""


@functools.cache
def exported_world(name: str) -> World:
    """One of the worlds, resolved."""
    return load(FOLDER / f"{name}.yaml").resolve()
