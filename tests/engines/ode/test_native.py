"""ODE's native motion, which a spec requests by a setting and accepts by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.ode.engine import Ode
from simspec.errors import UnsupportedError
from simspec.proof.checks import inventory_checks
from simspec.proof.verify import verify
from tests import worlds
from tests.engines.drake.scenes import boxes

pytestmark = [
    pytest.mark.skipif(Ode.version() is None, reason="ODE or a C compiler is not installed"),
    pytest.mark.usefixtures("warm_engines"),
]
JOINTS = ("joint.hinge", "joint.slide", "joint.ball", "joint.free")


def natively(world, accept=JOINTS):
    return worlds.with_options(world, "ode", settings=(("native_motion", True),), accept=accept)


def loaded(world, load_files):
    return load_files(Ode, compile_world(world, ["ode"])["ode"].files)


def tree(dt, *kinds):
    physics = dataclasses.replace(worlds.every_joint().physics, timestep=dt)
    return worlds.world(worlds.tree(["fixed", *kinds], 3), physics=physics)


def test_it_is_accepted_by_name():
    world = tree(1e-3, "hinge")
    with pytest.raises(UnsupportedError, match=r"joint\.hinge only approximately: .*to first order"):
        compile_world(natively(world, ()), ["ode"])
    plain = compile_world(world, ["ode"])["ode"].files
    assert not any("native_motion" in text for text in plain.values())  # files that do not ask for it say nothing


def test_the_certificate_is_not_valid_and_says_by_how_much():
    found = verify(natively(tree(1e-3, "hinge", "hinge")), ["ode"])
    assert [(check.level, check.name) for _, check in found.failures()] == [("L6", "motion")]
    ((_, check),) = found.failures()
    assert check.worst is not None
    assert 1e-4 < check.worst < 0.1
    assert set(found.engines["ode"].approximations) == {"joint.hinge"}


def test_all_other_values_are_stored_as_the_world_requires(load_files):
    world = natively(tree(1e-3, "hinge", "slide", "fixed", "ball"))
    back = loaded(world, load_files).read_back()
    (check,) = inventory_checks(Ode.expected_inventory(world, back.neutral), back.inventory)
    assert check.passed, check.detail
    assert back.inventory["body.link1.GyroscopicMode"] == 1.0


def test_it_is_of_first_order_and_a_question_changes_nothing(load_files):
    """Half the step is half the error."""
    ends = {}
    for native, dt in ((False, 1e-4), (True, 2e-3), (True, 1e-3)):
        world = tree(dt, "hinge", "ball", "slide")
        engine = loaded(natively(world) if native else world, load_files)
        for _ in range(4):
            engine.step(round(0.05 / dt))
            engine.mass_matrix()
            engine.bias_force()
        ends[native, dt] = engine.body_states()[0][:, :3]
    engine = loaded(natively(tree(1e-3, "hinge", "ball", "slide")), load_files)
    engine.step(200)
    assert engine.body_states()[0][:, :3] == pytest.approx(ends[True, 1e-3], abs=1e-12)
    coarse, fine = (np.abs(ends[True, dt] - ends[False, 1e-4]).max() for dt in (2e-3, 1e-3))
    assert 1.7 < coarse / fine < 2.4


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
