"""A fluid around the bodies: its law by closed forms and against MuJoCo, the boxes that feel it, what is refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.dynamics.oracle import Oracle
from simspec.errors import SpecError, UnsupportedError
from simspec.proof.selftest_worlds import immersed
from simspec.proof.verify import verify
from simspec.testing import worlds
from simspec.world import frames
from simspec.world.actions import Fluid
from simspec.world.canonical import canonical_json
from simspec.world.inertia import box_of, boxed
from simspec.world.kinematics import initial_state
from simspec.world.types import Inertial
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

SLAB = {"mass": 2, "shapes": [{"box": {"size": [0.3, 0.2, 0.1]}}]}
VELOCITY = {"linear": [1, -2, 0.5], "angular": [3, 1, -2]}
POINT = {"mass": 1, "inertia": {"principal": [0, 0, 0]}, "parent": "a", "joint": {"type": "fixed"}}


def world_of(bodies, fluid, **more):
    data = {
        "simspec": 1,
        "name": "fluid",
        "physics": {"timestep": 0.001, "duration": 0.1, "gravity": [0, 0, 0], "fluid": fluid},
        "contact": {"materials": {"ice": {"friction": 0}}},
        "bodies": bodies,
    }
    return simspec.Spec.from_data({**data, **more}).resolve()


def acceleration(world):
    """(linear, angular in the body's axes) of the one free body at the start."""
    q, v = initial_state(world)
    a = Oracle(world).acceleration(q, v, np.zeros(6))
    return a[:3], a[3:]


def test_a_ball_that_does_not_turn_obeys_stokes():
    """The box of a ball of radius r is a cube, whose edge is the diameter of the law."""
    moment = 0.4 * 2 * 0.1**2
    ball = {"mass": 2, "inertia": {"principal": [moment] * 3}, "velocity": {"linear": [1, -2, 0.5]}}
    world = world_of({"a": ball}, {"viscosity": 0.3})
    edge = math.sqrt(6 * moment / 2)
    linear, angular = acceleration(world)
    np.testing.assert_allclose(linear, -3 * math.pi * 0.3 * edge * np.array([1, -2, 0.5]) / 2, rtol=1e-13)
    np.testing.assert_allclose(angular, 0.0, atol=1e-15)


def test_the_fluid_box_of_a_slab_is_the_slab():
    """Each face has its drag and each axis its own torque, in a current, along the slab's own axes."""
    world = world_of(
        {"a": {**SLAB, "velocity": VELOCITY, "pose": {"rpy": [0.4, 0.3, -0.5]}}},
        {"density": 800, "velocity": [0.2, 0.1, 0]},
    )
    (body,) = world.bodies
    a, b, c = body.box.edges
    np.testing.assert_allclose(body.box.edges, [0.3, 0.2, 0.1], rtol=1e-12)
    turn = np.array(frames.matrix(body.joint.position[3:7]))
    v, w = turn.T @ (np.array([1, -2, 0.5]) - [0.2, 0.1, 0]), turn.T @ np.array([3, 1, -2])
    force = -0.5 * 800 * np.array([b * c, a * c, a * b]) * np.abs(v) * v
    stirred = np.array([a * (b**4 + c**4), b * (a**4 + c**4), c * (a**4 + b**4)])
    torque = -800 / 64 * stirred * np.abs(w) * w
    inertia = 2 / 12 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    linear, angular = acceleration(world)
    np.testing.assert_allclose(linear, turn @ force / 2, rtol=1e-10)
    np.testing.assert_allclose(angular, (torque - np.cross(w, inertia * w)) / inertia, rtol=1e-10)


def test_the_law_is_mujocos():
    """Against ``mj_passive``, on a model that MuJoCo compiled from a file of its own."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option density="700" viscosity="0.4" wind="0.3 -0.2 0.5"/><worldbody><body><freejoint/>
        <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.08 0.05" quat="0.5 0.1 0.7 0.2"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[3:] = frames.normalise((0.3, -0.4, 0.5, 0.7))
    data.qvel[:] = np.linspace(-2, 3, 6)
    mujoco.mj_forward(model, data)
    inertia = {"principal": [0.1, 0.08, 0.05], "quat": model.body_iquat[1].tolist()}
    fluid = {"density": 700, "viscosity": 0.4, "velocity": [0.3, -0.2, 0.5]}
    world = world_of({"a": {"mass": 2, "inertia": inertia}}, fluid)
    found = Oracle(world).joint_effort(data.qpos.copy(), data.qvel.copy())
    np.testing.assert_allclose(found, data.qfrc_passive, rtol=1e-12)


def test_a_body_reaches_its_terminal_velocity():
    """m g = 3 π d μ v + ½ ρ A v²."""
    world = world_of({"a": SLAB}, {"density": 1000, "viscosity": 5}, physics={})
    physics = dataclasses.replace(world.physics, gravity=(0.0, 0.0, -9.81), fluid=Fluid(1000.0, 5.0))
    world = dataclasses.replace(world, bodies=boxed(world.bodies, ()), physics=physics)
    q, v = initial_state(world)
    _, speeds = Oracle(world).motion(q, v, None, 3000, 3000)
    drag, resistance = 0.5 * 1000 * 0.3 * 0.2, 3 * math.pi * 0.2 * 5
    terminal = (-resistance + math.sqrt(resistance**2 + 4 * drag * 2 * 9.81)) / (2 * drag)
    assert speeds[-1, 2] == pytest.approx(-terminal, rel=1e-12)


def test_axes_are_those_that_are_written():
    """Of equal moments no axes follow: a cube that is written turned feels the current turned."""
    cube = {"mass": 1, "inertia": {"principal": [0.01] * 3}}
    turned = {"mass": 1, "inertia": {"principal": [0.01] * 3, "rpy": [0, 0, math.pi / 4]}}
    solid = {"mass": 1, "shapes": [{"box": {"size": [0.2] * 3}, "pose": {"rpy": [0, 0, math.pi / 4]}}]}
    axes = [world_of({"a": body}, {"density": 1}).bodies[0].box.quaternion for body in (cube, turned, solid)]
    assert axes[0] == frames.IDENTITY
    np.testing.assert_allclose(axes[1], frames.from_rpy(0, 0, math.pi / 4))
    assert axes[1] == axes[2]


def test_merged_bodies_have_a_single_box():
    fixed_slab = {**SLAB, "parent": "a", "joint": {"type": "fixed", "origin": {"rpy": [0.1, 0.2, 0.3]}}}
    root = {"pose": {"xyz": [0, 0, 1]}}
    alone = world_of({"a": root, "b": fixed_slab}, {"density": 1})
    first, second = alone.bodies
    assert second.box is None  # the massless root gets the slab's inertia, and is its box
    np.testing.assert_allclose(first.box.edges, [0.3, 0.2, 0.1], rtol=1e-12)
    np.testing.assert_allclose(first.box.quaternion, frames.from_rpy(0.1, 0.2, 0.3), atol=1e-15)
    both = world_of({"a": SLAB, "b": POINT}, {"density": 1})
    assert both.bodies[1].box is None
    assert both.bodies[0].box.edges != box_of(both.bodies[0].inertial).edges


def test_fixed_bodies_have_no_fluid_force_and_no_fields():
    world = world_of({"a": {**SLAB, "fixed": True}}, {"density": 1})
    assert world.bodies[0].box is None
    assert "physics.fluid" not in [need.feature.value for need in simspec.support.negotiation.needs(world)]
    vacuum = world_of({"a": SLAB}, {"density": 0, "velocity": [1, 0, 0]})
    assert vacuum.physics.fluid is None
    assert not [word for word in ("fluid", "box") if f'"{word}":' in canonical_json(vacuum)]


def test_an_edge_that_round_off_makes_imaginary_is_that_of_the_least_moment():
    flat = box_of(Inertial(1.0, inertia=(1.0, 1.0, 2.0 + 1e-12, 0.0, 0.0, 0.0)))
    assert flat.edges[2] == pytest.approx(math.sqrt(6 * 2 * 2.0**-40), rel=1e-3)
    tiny = box_of(Inertial(1.0, inertia=(1e-16, 1e-16, 1e-16, 0.0, 0.0, 0.0)))
    assert tiny.edges == (math.sqrt(6e-15),) * 3


WRONG = {
    "nothing of it": ({}, "density or a viscosity"),
    "below zero": ({"density": -1}, "at least 0"),
    "of another unit": ({"viscosity": "1 N"}, "Pa s"),
    "another word": ({"density": 1, "wind": [1, 0, 0]}, "velocity"),
    "unstable": ({"viscosity": 1e4}, "viscosity at 'a' in the fluid is unstable at this timestep"),
}


@pytest.mark.parametrize("name", WRONG)
def test_meaningless_values_are_rejected(name):
    fluid, message = WRONG[name]
    with pytest.raises(SpecError, match=message):
        world_of({"a": SLAB}, fluid)


def test_the_largest_stable_step_of_a_viscous_fluid_is_that_of_a_body_alone():
    """dt 3 π d μ = 2 m, or dt π d³ μ = 2 I where that is less; here it is."""
    limit = 2 * (2 / 12 * (0.2**2 + 0.1**2)) / (math.pi * 0.2**3 * 0.001)
    assert world_of({"a": SLAB}, {"viscosity": 0.999 * limit})
    with pytest.raises(SpecError, match=r"unstable at this timestep"):
        world_of({"a": SLAB}, {"viscosity": 1.001 * limit})


def test_servos_of_dart_would_ignore_a_fluid():
    arm = {"base": {"fixed": True}, "arm": {**SLAB, "parent": "base"}}
    arm["arm"]["joint"] = {"name": "elbow", "type": "hinge", "axis": [0, 1, 0]}
    served = {"servo": {"law": "native", "joints": ["elbow"], "kp": 5, "kd": 1}}
    world = world_of(arm, {"density": 1}, control=served)
    with pytest.raises(UnsupportedError, match=r"does not support physics\.fluid"):
        compile_world(worlds.accepting(world, "dart"), ["dart"])


@pytest.mark.parametrize("engine", ["mujoco", "pybullet", "dart", "drake"])
def test_engines_and_oracle_agree_with_a_step_that_is_small(engine):
    """In all engines the forces are those of the state before the step: not one is implicit."""
    world = immersed(engine)
    physics = dataclasses.replace(world.physics, steps=100)
    world = worlds.accepting(dataclasses.replace(world, physics=physics), engine)
    run = simspec.run(world, engine)
    _, v = Oracle(world).motion(*initial_state(world), None, 100, 1)
    np.testing.assert_allclose(run.arrays["v"][-1], v[-1], atol=1e-10)
    oracle = Oracle(dataclasses.replace(world, physics=dataclasses.replace(physics, fluid=None)))
    _, without = oracle.motion(*initial_state(world), None, 100, 100)
    assert np.abs(without[-1] - v[-1]).max() > 0.1


def has(engine, world):
    """Whether an engine has all of a world."""
    try:
        compile_world(world, [engine])
    except UnsupportedError:
        return False
    return True


def test_a_kinematic_body_in_a_fluid_follows_its_motion():
    """The fluid's force of some 1e3 N on a box of 2.4 m moved it by 5e-5 m in nine steps, in every engine."""
    drum = {
        "mass": 1,
        "inertia": {"principal": [0.02, 0.03, 0.04]},
        "kinematic": True,
        "pose": {"rpy": [0.4, -1.1, 0.3]},
    }
    points = [{"at": 0}, {"at": 0.05, "xyz": [0.1, -0.05, 0.02], "rpy": [0.3, 0.2, -0.4]}]
    fluid = {"density": 700, "viscosity": 0.4, "velocity": [0.3, -0.2, 0.5]}
    world = world_of({"drum": drum}, fluid, motion={"drum": {"points": points, "interpolation": "quintic"}})
    able = [engine for engine in INSTALLED if has(engine, world)]
    assert {"mujoco", "pybullet", "dart", "drake"} & set(INSTALLED) <= set(able)
    found = verify(world, able, levels={"L7"})
    assert [f"{engine} {check}" for engine, check in found.failures()] == []
    assert all(
        any(check.name == "prescribed motion" and check.count for check in proof.checks)
        for proof in found.engines.values()
    )
