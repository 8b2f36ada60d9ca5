"""Fixtures that several test modules of this folder share."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import find_engine
from simspec.testing import worlds
from simspec.world.types import World
from tests.files import write


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
def load_files(tmp_path):
    """A function that writes files into a folder of their own and loads them into a new engine; all are closed at the end."""
    opened: list[Engine] = []

    def load(engine_class: type[Engine], files: Mapping[str, str], folder: str = "artifacts") -> Engine:
        place = tmp_path / str(len(opened)) / folder
        place.mkdir(parents=True)
        engine = engine_class()
        opened.append(engine)
        engine.load(write(files, place), read_sidecar(place))
        return engine

    yield load
    for engine in opened:
        engine.close()
