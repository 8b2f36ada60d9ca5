"""Kinematic bodies with joints with dry friction: the tolerance of the solver suffices for the lighter bodies, too."""

from __future__ import annotations

import pytest

import simspec
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import resolve_settings
from simspec.proof.verify import verify
from simspec.testing.worlds import with_options
from tests import constrained

pytestmark = pytest.mark.usefixtures("warm_engines")

DATA = {
    "name": "beside",
    "engines": {"mujoco": {"accept": ["joint.dry_friction"]}},
    "physics": {"timestep": "2 ms", "duration": "0.1 s"},
    "bodies": {
        "lift": {"kinematic": True, "shapes": [{"box": {"size": [1, 1, 1]}, "collision": False}]},
        "arm": {
            "mass": 2,
            "centre_of_mass": [0.1, 0, 0],
            "inertia": {"principal": [0.02, 0.03, 0.04]},
            "joint": {"type": "hinge", "axis": [0, 0, 1], "dry_friction": 0.2},
        },
    },
    "motion": {"lift": {"points": [{"at": 0}, {"at": 0.1, "xyz": [0.1, 0, 0]}]}},
}


def test_dry_friction_is_exact_next_to_a_kinematic_body():
    world = simspec.Spec.from_data(DATA).resolve()
    assert resolve_settings(find_engine("mujoco"), world)["tolerance"] == 1e-14
    stated = with_options(world, "mujoco", settings=(("tolerance", 1e-8),))
    assert resolve_settings(find_engine("mujoco"), stated)["tolerance"] == 1e-8
    assert verify(world, ["mujoco"], levels={"L6"}).failures() == []


def test_a_light_joint_with_dry_friction_is_exact_next_to_a_heavy_joint():
    """A latch of 0.04 kg m² in a gate of 4e7: with MuJoCo's own tolerance its speed is off."""
    door = {
        "mass": 4e7,
        "inertia": {"principal": [4e7, 4e7, 4e7]},
        "joint": {"type": "hinge", "axis": [0, 0, 1], "damping": 1, "dry_friction": 1},
    }
    latch = {
        "parent": "door",
        "mass": 0.1,
        "inertia": {"principal": [0.04, 0.04, 0.04]},
        "joint": {"type": "hinge", "axis": [0, 1, 0], "dry_friction": 0.1, "spring": {"stiffness": 1}},
    }
    data = {**DATA, "bodies": {"door": door, "latch": latch}}
    del data["motion"]
    world = simspec.Spec.from_data(data).resolve()
    assert resolve_settings(find_engine("mujoco"), world)["tolerance"] == 1e-14
    assert verify(world, ["mujoco"], levels={"L6"}).failures() == []
    stated = with_options(world, "mujoco", settings=(("tolerance", 1e-8),))
    assert verify(stated, ["mujoco"], levels={"L6"}).failures()


def test_a_world_with_constraints_is_solved_for_its_light_bodies_too():
    assert resolve_settings(find_engine("mujoco"), constrained.follower())["tolerance"] == 1e-14
    assert resolve_settings(find_engine("mujoco"), constrained.hinges())["tolerance"] == 1e-8
