"""Fixtures that several test modules of this folder share."""

from __future__ import annotations

import pytest

from simspec.engines.dart import Dart
from simspec.formats.base import read_sidecar
from tests.formats.test_skel import emit, write


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
