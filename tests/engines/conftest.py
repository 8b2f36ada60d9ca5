"""Fixtures that several test modules of this folder share."""

from __future__ import annotations

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.dart.engine import Dart
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import find_engine
from simspec.world.types import World
from tests import worlds
from tests.dialects.dart.test_dialect import emit, write

ENGINES = [
    "mujoco",
    "pybullet",
    "dart",
]
"""Every engine that must pass all suites of this folder."""

EVERY = [*ENGINES, "drake"]
"""Every engine that must pass the shared suite. Of Drake's contact the deviations are measured, and its gaps
asserted, in test_drake.py."""

ACCEPTED = (
    "contact.friction.impact",
    "contact.cone.elliptic",
    "joint.limits.position",
    "joint.dry_friction",
    "material.restitution",
    "shape.capsule",
)


@pytest.fixture(params=ENGINES)
def name(request) -> str:
    return request.param


@pytest.fixture
def loaded(name, tmp_path):
    """Compile a world for the engine and load it; several may be loaded one after the other."""
    alive: list[Engine] = []

    def load(world: World, outside: tuple[str, ...] = (), accept: tuple[str, ...] = ACCEPTED) -> Engine:
        for engine in alive:
            engine.close()
        alive.clear()
        world = worlds.with_options(world, name, accept=(*accept, "contact.friction.impact"), outside=outside)
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        write_folder(compile_world(world, [name])[name].files, folder)
        engine = find_engine(name)()
        engine.load(folder, read_sidecar(folder))
        alive.append(engine)
        return engine

    yield load
    for engine in alive:
        engine.close()


@pytest.fixture
def load_dart(tmp_path):
    """A function that emits a world and loads it; everything is closed at the end."""
    opened = []

    def of(world, change=lambda files: files, folder="artifacts"):
        place = tmp_path / str(len(opened)) / folder
        place.mkdir(parents=True)
        write(change(emit(world)), place)
        engine = Dart()
        opened.append(engine)
        engine.load(place, read_sidecar(place))
        return engine

    yield of
    for engine in opened:
        engine.close()
