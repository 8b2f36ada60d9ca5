"""Engines whose own method of integration the setting ``native_motion`` selects: its proof in the limit, and what it stores."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.capabilities import SINGLE
from simspec.engines.kit.registry import engines, find_engine
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.proof.judge import judge_proof
from simspec.proof.verify import verify
from simspec.testing import worlds

NAMES = [name for name, kind in engines().items() if "native_motion" in kind.SETTINGS]
pytestmark = pytest.mark.usefixtures("warm_engines")
KINDS = [("hinge", "hinge"), ("slide", "hinge", "ball"), ("free", "hinge")]


@pytest.fixture(params=NAMES)
def name(request):
    if find_engine(request.param).version() is None:
        pytest.skip(f"{request.param} is not installed")
    return request.param


def natively(world, name, native=True):
    return worlds.with_options(world, name, settings=(("native_motion", native),))


def loaded(name, world, load_files):
    return load_files(find_engine(name), compile_world(world, [name])[name].files)


def tree(dt, *kinds, damping=0.1):
    """Bodies with these joints, one on the other, those about an axis damped."""
    physics = dataclasses.replace(worlds.every_joint().physics, timestep=dt)
    root = () if kinds[0] == "free" else ("fixed",)
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, damping=damping))
        if body.joint.kind in ("hinge", "slide")
        else body
        for body in worlds.tree([*root, *kinds], 3)
    )
    return worlds.world(bodies, physics=physics)


def test_some_engines_have_it():
    assert {"ode", "rapier"} <= set(NAMES)


def test_files_that_do_not_ask_for_it_say_nothing(name):
    plain = compile_world(tree(1e-3, "hinge"), [name])[name].files
    assert not any("native_motion" in text for text in plain.values())


@pytest.mark.parametrize("kinds", KINDS)
def test_it_is_valid_in_the_limit_and_says_by_how_much_it_deviates(name, kinds):
    world = natively(tree(1e-3, *kinds), name)
    proof = verify(world, [name]).engines[name]
    assert proof.valid, [check for check in proof.checks if not check.passed]
    assert proof.convergence is not None
    assert max(proof.convergence.away) > 1e-6
    assert set(proof.approximations) == {"physics.integrator"}
    assert judge_proof(name, proof, world, thorough=True) == []


def test_it_is_the_usual_method(name):
    kind, world = find_engine(name), tree(1e-3, "hinge")
    usual = dataclasses.replace(world, physics=dataclasses.replace(world.physics, integrator="engine"))
    assert kind.method(usual) is not None
    assert kind.method(natively(usual, name, False)) is None
    assert kind.method(world) is None


def test_all_other_values_are_stored_as_the_world_requires(name, load_files):
    world = natively(tree(1e-3, "hinge", "slide", "fixed", "ball"), name)
    kind, back = find_engine(name), loaded(name, world, load_files).read_back()
    (check,) = inventory_checks(
        kind.expected_inventory(world, back.neutral), back.inventory, PRECISIONS[kind.PRECISION]
    )
    assert check.passed, check.detail
    dampings = {body.name: body.joint.damping for body in back.bodies}
    assert dampings == pytest.approx({body.name: body.joint.damping for body in world.bodies}, rel=1e-6)


def test_it_is_of_first_order_and_a_question_changes_nothing(name, load_files):
    """Half the step is half the error."""
    ends = {}
    for native, dt in ((False, 1e-4), (True, 2e-3), (True, 1e-3)):
        world = tree(dt, "hinge", "ball", "slide")
        engine = loaded(name, natively(world, name) if native else world, load_files)
        for _ in range(4):
            engine.step(round(0.05 / dt))
            engine.mass_matrix()
            engine.bias_force()
        ends[native, dt] = engine.body_states()[0][:, :3]
    engine = loaded(name, natively(tree(1e-3, "hinge", "ball", "slide"), name), load_files)
    engine.step(200)
    tolerance = 1e-5 if find_engine(name).PRECISION == SINGLE else 1e-12
    assert engine.body_states()[0][:, :3] == pytest.approx(ends[True, 1e-3], abs=tolerance)
    coarse, fine = (np.abs(ends[True, dt] - ends[False, 1e-4]).max() for dt in (2e-3, 1e-3))
    assert 1.7 < coarse / fine < 2.4
