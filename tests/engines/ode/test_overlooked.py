"""Overlaps that ODE's native code overlooks: some of a box and a cylinder."""

from __future__ import annotations

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.engines.kit.session import Session
from simspec.engines.ode.engine import Ode
from simspec.proof.touch.geometry import gap, solids, transform
from simspec.world import frames
from simspec.world.types import Pose
from tests.installed import each

SIZES = {"box": {"box": {"size": [0.11, 0.16, 0.04]}}, "drum": {"cylinder": {"radius": 0.16, "length": 0.13}}}
TURNS = ((0.35, -0.78, 0.09, -0.51), (0.76, 0.09, 0.62, -0.19))
AWAY = (0.144, 0.053, -0.13)
"""An edge of the box is 10 mm in the rim of the drum."""


def edge_in_rim():
    bodies = {
        name: {"mass": 1, "shapes": [shape], "pose": {"xyz": place, "quat": frames.normalise(turn)}}
        for (name, shape), place, turn in zip(SIZES.items(), ((0, 0, 0), AWAY), TURNS, strict=True)
    }
    data = {"simspec": 1, "name": "edge", "contact": {"materials": {"m": {"friction": 0}}}, "bodies": bodies}
    return simspec.Spec.from_data(data).resolve()


@pytest.mark.parametrize("engine", each(["ode"]))
def test_an_edge_in_a_rim_is_overlooked_and_declared(engine, tmp_path):
    world = edge_in_rim()
    solid, other = solids(world)
    places = [Pose(place, frames.normalise(turn)) for place, turn in zip(((0.0, 0.0, 0.0), AWAY), TURNS, strict=True)]
    assert gap(solid, transform(places[0]), other, transform(places[1])).distance < -0.01
    write_folder(compile_world(world, [engine])[engine].files, tmp_path / engine)
    with Session(engine, tmp_path / engine) as session:
        assert len(session.detect_units()) == 0, "if this fails, ODE has learned it: declare less"
        q, v = session.get_state()
        found = []
        for share in (0.1, 0.3, 0.5, 0.7, 0.9):
            session.set_state(np.array([*q[:7], *(share * x for x in AWAY), *places[1].quaternion]), v)
            found.append(len(session.detect_units()))
        assert found[:2] == [1, 1], "others are found"
    assert ("box", "cylinder") in Ode.overlooks(world)
