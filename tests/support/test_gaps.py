"""Features that only a single engine supports are rejected by the others, by name."""

from __future__ import annotations

import pytest

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from tests.planted import MUJOCO_ALONE, WORLDS


@pytest.mark.parametrize("name", MUJOCO_ALONE)
def test_it_is_refused_by_name(name):
    assert compile_world(WORLDS[name]("mujoco"), ["mujoco"])
    for engine in ("pybullet", "dart", "drake"):
        with pytest.raises(UnsupportedError, match=f"does not support {MUJOCO_ALONE[name]}"):
            compile_world(WORLDS[name](engine), [engine])
