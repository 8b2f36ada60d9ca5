"""Fixtures that several test modules of this folder share."""

from __future__ import annotations

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.dart.engine import Dart
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import find_engine
from simspec.testing import worlds
from simspec.world.types import World
from tests.dialects.dart.test_dialect import emit, write


@pytest.fixture
def loaded(name, tmp_path):
    """Compile a world for the engine and load it in this process; several may be loaded one after the other."""
    alive: list[Engine] = []

    def load(world: World) -> Engine:
        for engine in alive:
            engine.close()
        alive.clear()
        world = worlds.accepting(world, name)
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
