"""Fixtures that several test modules of this folder share."""

from __future__ import annotations

import pytest

from simspec.engines.dart.engine import Dart
from tests.dialects.dart.saying import emit


@pytest.fixture
def load_dart(load_files):
    """A function that emits a world, changes its files, and loads them."""

    def load(world, change=lambda files: files, folder="artifacts"):
        return load_files(Dart, change(emit(world)), folder)

    return load
