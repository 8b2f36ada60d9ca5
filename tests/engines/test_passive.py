"""Weights of single bodies, and damping and armature of free ones: read, refused where they mean nothing, felt in contact."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.dynamics.oracle import Oracle
from simspec.errors import SpecError, UnsupportedError
from simspec.testing import worlds
from simspec.world.canonical import canonical_json
from simspec.world.kinematics import initial_state

pytestmark = pytest.mark.usefixtures("warm_engines")

FLOOR = {"fixed": True, "shapes": [{"plane": {}}]}
BALL = {
    "pose": {"xyz": [0, 0, 0.1]},
    "mass": 2,
    "inertia": {"principal": [0.01, 0.01, 0.01]},
    "shapes": [{"sphere": {"radius": 0.1}}],
}
FREE = {"mass": 2, "inertia": {"principal": [0.01, 0.02, 0.025]}}


def world_of(bodies, **more):
    data = {
        "simspec": 1,
        "name": "passive",
        "physics": {"timestep": 0.001, "duration": 0.1},
        "contact": {"materials": {"ice": {"friction": 0}}},
        "bodies": bodies,
    }
    return simspec.Spec.from_data({**data, **more}).resolve()


@pytest.mark.parametrize("engine", ["mujoco", "pybullet", "dart", "drake"])
def test_contact_carries_the_weight_that_is_left(engine):
    """A body with a quarter of its weight rests, and presses on the floor with that."""
    world = world_of({"floor": FLOOR, "ball": {**BALL, "gravity_scale": 0.25}}, record={"every": "50 ms"})
    run = simspec.run(worlds.accepting(world, engine), engine)
    last = run.arrays["contact.row"] == len(run.time) - 1
    assert run.arrays["contact.normal_force"][last].sum() == pytest.approx(0.25 * 2 * 9.81, rel=0.02)
    energy = run.arrays["energy"][:, 1] - 0.25 * 2 * 9.81 * run.arrays["pose"][:, 1, 2]
    np.testing.assert_allclose(energy - energy[0], 0.0, atol=1e-9)


def test_damping_acts_at_the_centre_of_mass():
    """v⁺ = v (1 − dt c / m), whatever the body turns: its frame's origin may be elsewhere."""
    damped = {"type": "free", "damping": {"linear": 0.6, "angular": 0.006}}
    body = {**FREE, "centre_of_mass": [0.3, 0, 0], "joint": damped, "gravity_scale": 0}
    world = world_of({"a": {**body, "velocity": {"linear": [1, 0, 0], "angular": [0, 0, 2]}}})
    q, v = initial_state(world)
    _, after = Oracle(world).step(q, v, np.zeros(6))
    np.testing.assert_allclose(after[:3], v[:3] * (1 - 0.001 * 0.6 / 2), atol=1e-15)
    np.testing.assert_allclose(after[5], 2 * (1 - 0.001 * 0.006 / 0.025), atol=1e-15)


def test_armature_is_in_the_mass_matrix_and_the_acceleration():
    armed = world_of({"a": {**FREE, "joint": {"type": "free", "armature": {"linear": 3, "angular": 0.5}}}})
    bare = world_of({"a": FREE})
    q, v = initial_state(bare)
    v = v + np.linspace(0.5, -0.7, 6)
    added = Oracle(armed).mass_matrix(q) - Oracle(bare).mass_matrix(q)
    np.testing.assert_allclose(added, np.diag([3, 3, 3, 0.5, 0.5, 0.5]), atol=1e-14)
    expected = np.linalg.solve(Oracle(armed).mass_matrix(q), -Oracle(bare).bias_force(q, v))
    np.testing.assert_allclose(Oracle(armed).acceleration(q, v, np.zeros(6)), expected, rtol=1e-10, atol=1e-12)


def test_omitted_fields_leave_the_text_unchanged():
    text = canonical_json(world_of({"a": FREE}))
    assert not [word for word in ("gravity_scale", "angular_damping", "angular_armature") if word in text]


def free(**joint):
    return {"a": {**FREE, "joint": {"type": "free", **joint}}}


POINT = {"mass": 1, "inertia": {"principal": [0, 0, 0]}, "parent": "a", "joint": {"type": "fixed"}}
WRONG = {
    "one number": (free(damping=0.1), "two parts"),
    "an unknown part": (free(damping={"lateral": 1}), "has no lateral"),
    "below zero": (free(armature={"linear": -1}), "at least 0"),
    "of another unit": (free(armature={"angular": "1 kg"}), "moment of inertia|kg m²"),
    "not a number": ({"a": {**FREE, "gravity_scale": "much"}}, "gravity_scale"),
    "of a kinematic body": ({"a": {**FREE, "kinematic": True, "gravity_scale": 0}}, "kinematic"),
    "unlike": ({"a": {**FREE, "gravity_scale": 0}, "b": POINT}, "one gravity_scale"),
    "unstable": (free(damping={"angular": 100}), "unstable at this timestep"),
}


@pytest.mark.parametrize("name", WRONG)
def test_meaningless_values_are_rejected(name):
    bodies, message = WRONG[name]
    with pytest.raises(SpecError, match=message):
        world_of(bodies)


@pytest.mark.parametrize("engine", ["gzsim", "webots"])
def test_engines_without_armature_of_free_bodies_refuse_it(engine):
    world = world_of(free(armature={"linear": 0.1, "angular": 0.1}))
    with pytest.raises(UnsupportedError, match=r"does not support joint\.free\.armature"):
        compile_world(world, [engine])


def test_servos_of_dart_would_ignore_a_weight():
    arm = {"base": {"fixed": True}, "arm": {**FREE, "parent": "base", "gravity_scale": 0.5}}
    arm["arm"]["joint"] = {"name": "elbow", "type": "hinge", "axis": [0, 1, 0]}
    served = {"servo": {"law": "native", "joints": ["elbow"], "kp": 5, "kd": 1}}
    with pytest.raises(UnsupportedError, match=r"does not support body\.gravity_scale"):
        compile_world(worlds.accepting(world_of(arm, control=served), "dart"), ["dart"])


def test_mujoco_has_no_more_than_the_weight():
    world = world_of({"a": {**FREE, "gravity_scale": 1.5}})
    with pytest.raises(UnsupportedError, match="below 0"):
        compile_world(world, ["mujoco"])
    assert compile_world(world, ["dart"])


def test_mujoco_has_a_common_damping_for_translation_and_rotation():
    (body,) = world_of(free()).bodies
    joint = dataclasses.replace(body.joint, damping=0.1, angular_damping=0.2)
    world = dataclasses.replace(world_of(free()), bodies=(dataclasses.replace(body, joint=joint),))
    with pytest.raises(UnsupportedError, match="one number"):
        compile_world(world, ["mujoco"])
