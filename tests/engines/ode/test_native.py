"""ODE's native motion, which a spec selects by a setting: its proof in the limit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.ode.engine import Ode
from simspec.proof.checks import inventory_checks
from simspec.proof.judge import judge_proof
from simspec.proof.verify import verify
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


def tree(dt, *kinds):
    physics = dataclasses.replace(worlds.every_joint().physics, timestep=dt)
    return worlds.world(worlds.tree(["fixed", *kinds], 3), physics=physics)


def test_files_that_do_not_ask_for_it_say_nothing():
    plain = compile_world(tree(1e-3, "hinge"), ["ode"])["ode"].files
    assert not any("native_motion" in text for text in plain.values())


@pytest.mark.parametrize("kinds", [("hinge", "hinge"), ("slide", "hinge", "ball")])
def test_it_is_valid_in_the_limit_and_says_by_how_much_it_deviates(kinds):
    world = natively(tree(1e-3, *kinds))
    proof = verify(world, ["ode"]).engines["ode"]
    assert proof.valid, [check for check in proof.checks if not check.passed]
    assert proof.convergence is not None
    assert proof.convergence.ratios[-1] == pytest.approx(2.0, rel=0.1)
    assert max(proof.convergence.away) > 1e-6
    assert set(proof.approximations) == {"physics.integrator"}
    assert judge_proof("ode", proof, world, thorough=True) == []


def test_it_is_the_usual_method_of_ode():
    world = tree(1e-3, "hinge")
    usual = dataclasses.replace(world, physics=dataclasses.replace(world.physics, integrator="engine"))
    assert Ode.method(usual) is not None
    assert Ode.method(natively(usual, False)) is None
    assert Ode.method(world) is None


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
