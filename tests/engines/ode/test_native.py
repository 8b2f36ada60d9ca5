"""ODE's native motion, which a spec selects by a setting, in contact."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.ode.engine import Ode
from simspec.testing import worlds
from tests.engines.drake.scenes import boxes

pytestmark = [
    pytest.mark.skipif(Ode.version() is None, reason="ODE or a C compiler is not installed"),
    pytest.mark.usefixtures("warm_engines"),
]


def natively(world, native=True):
    return worlds.with_options(world, "ode", settings=(("native_motion", native),))


def loaded(world, load_files):
    return load_files(Ode, compile_world(world, ["ode"])["ode"].files)


def test_the_gyroscopic_torque_is_that_of_ode(load_files):
    world = natively(worlds.world(worlds.tree(["fixed", "hinge"], 3)))
    assert loaded(world, load_files).read_back().inventory["body.link1.GyroscopicMode"] == 1.0


def test_bodies_rest_and_slide_as_the_law_has_it(load_files):
    engine = loaded(natively(boxes(2, tower=False, friction=0.5)), load_files)
    q, v = engine.get_state()
    v[[0, 1]] = 0.6, 0.8
    engine.set_state(q, v)
    engine.step(100)
    q, v = engine.get_state()
    assert v[:2] == pytest.approx(np.array([0.6, 0.8]) * (1.0 - 0.5 * 9.81 * 0.1), rel=0.02)
    assert q[[2, 9]] == pytest.approx([0.05, 0.05], abs=1e-4)
    assert v[6:] == pytest.approx(0.0, abs=1e-4)  # the remaining overlap is corrected
