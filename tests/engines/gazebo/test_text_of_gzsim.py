"""The SDF that gz sim is given, read by the libraries behind it: libsdformat and gz-physics. That is not gz sim itself."""

from __future__ import annotations

import json

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.engines.gazebo.building import SdfPlan
from simspec.engines.gazebo.engine import Gazebo
from simspec.engines.gzsim.simulation import stepped_world
from simspec.testing.worlds import accepting
from tests.engines.gzsim.worlds import ARMS, world_of


class OfGzSim(SdfPlan):
    def __init__(self, walk):
        super().__init__(walk)
        self.text = stepped_world(walk)


@pytest.mark.skipif(Gazebo.version() is None, reason="gz-physics is not installed")
def test_the_text_of_gzsim_makes_the_same_bodies_in_gazebo(tmp_path, monkeypatch):
    world = accepting(world_of(ARMS), "gazebo")
    compiled = compile_world(world, ["gazebo"])["gazebo"]
    write_folder(compiled.files, tmp_path)
    values = []
    for plan in (SdfPlan, OfGzSim):
        monkeypatch.setattr("simspec.engines.gazebo.simulation.SdfPlan", plan)
        engine = Gazebo()
        engine.load(tmp_path, json.loads(compiled.files["sidecar.json"]))
        engine.step(3)
        state = np.concatenate(engine.get_state())
        values.append(np.concatenate([engine.mass_matrix().ravel(), engine.bias_force(), state]))
        engine.close()
    assert values[1] == pytest.approx(values[0], rel=1e-12, abs=1e-12)
