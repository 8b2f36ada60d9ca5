"""Sleeping with the engine in this process (the rest is the shipped suite's): queries are independent of it, and a new state
ends it."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.engines.kit.contract import Engine
from simspec.testing import worlds
from simspec.testing.suite import LENGTH, MASS, ON, SETTING, SETTLED, cylinder, scene
from simspec.world.kinematics import free_rigid
from simspec.world.types import World
from tests.installed import having

HAVING = having(lambda engine: SETTING in engine.SETTINGS)


@pytest.fixture(params=HAVING)
def name(request) -> str:
    return request.param


@pytest.fixture
def asleep(name, loaded):
    """Load a world with sleeping on."""

    def load(world: World) -> Engine:
        return loaded(worlds.with_options(world, name, settings=ON))

    return load


def places(engine: Engine) -> np.ndarray:
    return engine.body_states()[0][1:, :3]


def test_questions_do_not_see_sleep(asleep):
    """Poses, dynamics, energy and overlaps are those of the state, whoever sleeps."""
    engine = asleep(scene(cylinder("one", 0.0)))
    engine.step(SETTLED)
    q, _ = engine.get_state()
    np.testing.assert_allclose(places(engine)[0], q[:3], atol=1e-12)
    np.testing.assert_allclose(np.diag(engine.mass_matrix())[:3], MASS, rtol=1e-12)
    np.testing.assert_allclose(engine.bias_force()[2], MASS * 9.81, rtol=1e-12)
    assert engine.energy()[1] == pytest.approx(MASS * 9.81 * q[2], rel=1e-9)
    assert engine.detect_contacts().tolist() == [[0, 1]]


def test_a_new_state_wakes(asleep):
    """Setting a state leaves no memory of sleep: neither of a place in the air nor of a speed."""
    world = scene(cylinder("one", 0.0))
    ends = []
    for sleep_first in (True, False):
        engine = asleep(world)
        q, v = engine.get_state()
        if sleep_first:
            engine.step(SETTLED)
        q[2] += 1.0
        engine.set_state(q, v)
        engine.step(100)
        ends.append(engine.get_state())
    assert ends[1][0][2] == pytest.approx(1.0 + LENGTH / 2 - 9.81 * 1e-6 * 100 * 101 / 2, rel=1e-9)
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-12)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-12)


def test_free_rigid_bodies_are_distinguished_from_others():
    world = worlds.world(
        worlds.tree(["free", "fixed"], 1, prefix="rigid-")
        + worlds.tree(["free", "hinge"], 2, prefix="jointed-")
        + worlds.tree(["hinge"], 3, prefix="held-")
        + worlds.tree(["fixed"], 4, prefix="base-")
    )
    assert free_rigid(world) == {"rigid-link0"}
