"""Drake's own methods of integration: the setting in files and in the loaded plant, their orders, and what they refuse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dynamics.oracle import Oracle
from simspec.engines.drake.engine import Drake
from simspec.engines.drake.integrators import ORDERS
from simspec.engines.kit.operations import OPERATIONS
from simspec.engines.kit.session import Session
from simspec.errors import UnsupportedError
from simspec.proof import convergence
from simspec.proof.building import with_joint
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.proof.convergence import ORDER
from simspec.proof.motion import MOTION
from simspec.testing import worlds
from tests.constrained import follower
from tests.engines.drake.scenes import boxes

DAMPED = worlds.damped_springs()
SMALL = worlds.world(worlds.tree(["fixed", "hinge", "hinge"], 3, damping=0.1, spring_stiffness=2.0), "small")


def by(world, name):
    return worlds.with_options(world, "drake", settings=(("integrator", name),))


def usual(world):
    return dataclasses.replace(world, physics=dataclasses.replace(world.physics, integrator="engine"))


def coarse(world, timestep):
    return dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=timestep))


def sidecar(world):
    return compile_world(world, ["drake"])["drake"].files["sidecar.json"]


def outcome(world, motion, model, folder):
    """The checks of a motion of ``world`` by an engine that has the files of ``model``."""
    write_folder(compile_world(model, ["drake"])["drake"].files, folder)
    operation = motion.operation(world)
    with Session("drake", folder) as session:
        _, answer = OPERATIONS["limit"].do(session, operation.arrays, operation.parameters)
    return {(check.level, check.name): check for check in motion.checks(world, answer)}


def test_only_other_methods_are_written():
    assert not any("integrator" in sidecar(world) for world in (DAMPED, by(DAMPED, "common")))
    assert '"integrator": "discrete"' in sidecar(usual(DAMPED))
    assert Drake.method(usual(DAMPED)) == Drake.method(by(DAMPED, "discrete"))
    assert Drake.method(DAMPED) is None


def test_the_order_follows_from_the_world():
    assert {name: Drake.method(by(DAMPED, name)).order for name in ORDERS} == ORDERS
    assert Drake.method(by(worlds.lifted(), "runge_kutta3")).order == 1
    undamped = worlds.world(worlds.tree(["hinge", "slide"], 3))
    assert Drake.method(by(undamped, "discrete")) is None


@pytest.mark.parametrize("name", ["discrete", *ORDERS])
def test_the_integrator_is_read_back(name, load_files):
    world = by(SMALL, name)
    engine = load_files(Drake, compile_world(world, ["drake"])["drake"].files)
    back = engine.read_back()
    (check,) = inventory_checks(Drake.expected_inventory(world, back.neutral), back.inventory)
    assert check.passed, check.detail
    assert back.timestep == 0.001
    assert [body.joint.damping for body in back.bodies] == [0.0, 0.1, 0.1]
    assert back.inventory["body.link1.joint.damping"] == (0.1,)
    engine.set_timestep(0.0005)
    assert engine.read_back().timestep == 0.0005
    assert engine.read_back().inventory["integrator"] == ("discrete" if name == "discrete" else (name, True, 0.0005))


@pytest.fixture(scope="module")
def third():
    """A short motion of the small world for a method of third order."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(convergence, "STEPS", 120)
        found = convergence.plan(SMALL, Oracle(SMALL), PRECISIONS["double"].of_order(3))
    assert isinstance(found, convergence.LimitMotion)
    return found


def test_it_is_valid_in_the_limit_and_a_defect_is_not(third, tmp_path):
    """A damping of 1e-4 N m s/rad more, and a method of another order than declared."""
    more = with_joint(SMALL.bodies[2], damping=0.1001)
    defect = dataclasses.replace(SMALL, bodies=(*SMALL.bodies[:2], more))
    right = outcome(SMALL, third, by(SMALL, "runge_kutta3"), tmp_path / "right")
    assert right[ORDER].passed, right[ORDER].detail
    assert right[MOTION].passed, right[MOTION].detail
    assert "decrease" in right[ORDER].detail
    assert not outcome(SMALL, third, by(defect, "runge_kutta3"), tmp_path / "defect")[MOTION].passed
    assert not outcome(SMALL, third, by(SMALL, "runge_kutta2"), tmp_path / "other")[ORDER].passed


@pytest.mark.parametrize(
    ("name", "order"), [("semi_explicit_euler", 1), ("implicit_euler", 1), ("runge_kutta2", 2), ("radau3", 3)]
)
def test_orders_of_free_bodies_and_balls(name, order, load_files):
    """From one state under a constant effort in the axes of the bodies, within 32 ms, against steps of fifth order."""
    world = worlds.every_joint(damping=0.1, spring_stiffness=2.0)
    effort = np.linspace(-1.0, 1.0, Oracle(world).nv)
    ends = {}
    for method, timestep in (("runge_kutta5", 0.001), (name, 0.008), (name, 0.004)):
        engine = load_files(Drake, compile_world(by(coarse(world, timestep), method), ["drake"])["drake"].files)
        engine.step(round(0.032 / timestep), effort)
        ends[method, timestep] = np.concatenate(engine.get_state())
    errors = [np.abs(ends[name, step] - ends["runge_kutta5", 0.001]).max() for step in (0.008, 0.004)]
    assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.15)


def test_contact_by_discrete_steps_is_that_of_the_common_method(load_files):
    """Bodies that slide without turning."""
    ends = []
    for world in (boxes(1, friction=0.5), by(boxes(1, friction=0.5), "discrete")):
        engine = load_files(Drake, compile_world(world, ["drake"])["drake"].files)
        q, v = engine.get_state()
        v[0] = 0.5
        engine.set_state(q, v)
        engine.step(50)
        ends.append(engine.get_state()[0])
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


@pytest.mark.parametrize(
    ("world", "reason"),
    [
        (boxes(1), "contact is a spring"),
        (worlds.limits_and_armature(), "ignores the limits of joints"),
        (follower(), "forces for constraints"),
    ],
)
def test_worlds_beyond_continuous_plants_are_refused_with_the_way_out(world, reason):
    world = by(worlds.accepting(world, "drake"), "runge_kutta3")
    with pytest.raises(UnsupportedError, match=reason) as caught:
        compile_world(world, ["drake"])
    assert "Set integrator:" in str(caught.value)
