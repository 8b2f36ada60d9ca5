"""Differences of worlds: every value has a group, taking all of them gives the other world, other scenes are refused."""

from __future__ import annotations

import dataclasses

import pytest

import simspec
from simspec.attribution.candidates import causes
from simspec.attribution.configuration import Configuration
from simspec.attribution.differences import OTHER, differences, named_tree, taking, world_of
from simspec.errors import SpecError
from tests import worlds
from tests.attribution.planted import SCENE, world

SPECS = ("box-on-ramp", "gripper-lift", "double-pendulum", "spring-damper")
CHANGES = {
    "physics.gravity=[0,0,-3]": "gravity",
    "physics.timestep=2 ms": "timestep",
    "contact.friction_cone=pyramid-inscribed": "friction cone",
    "contact.pairs.0.friction=0.5": "friction of ground and wood",
    "contact.pairs.1.restitution=0.9": "restitution of ground and rubber",
    "contact.pairs.0.rolling_friction=1 mm": "rolling friction of ground and wood",
    "contact.pairs.0.torsional_friction=1 mm": "torsional friction of ground and wood",
    "contact.pairs.0.hardness={stiffness: 1e5, damping: 50}": "hardness of ground and wood",
    "contact.exclude=[[ball, floor]]": "collision filter",
    "bodies.ball.mass=2 kg": "mass and inertia of ball",
    "bodies.arm.joint.damping=1": "joint damping of arm",
    "bodies.arm.joint.armature=1": "armature of arm",
    "bodies.arm.joint.dry_friction=1": "dry friction of a joint of arm",
    "bodies.arm.joint.limits={position: [-1, 1]}": "joint limits of arm",
    "bodies.arm.joint.spring={stiffness: 5, rest: 0.1}": "joint spring of arm",
    "bodies.arm.joint.position=0.4": "initial state of arm",
    "control.drive.kp=30": "controller of drive",
    "bodies.slider.velocity.linear=[1,0,0]": "initial state of slider",
    "bodies.slider.shapes.0.material=rubber": "materials",
}


@pytest.mark.parametrize("name", SPECS)
def test_a_tree_gives_its_world_back(name):
    there = simspec.load(simspec.find_spec(name)).resolve()
    assert world_of(named_tree(there)) == dataclasses.replace(there, expectations=())
    assert not differences(there, there)


@pytest.mark.parametrize(("change", "name"), CHANGES.items())
def test_each_value_has_its_name_and_taking_it_back_leaves_nothing(change, name):
    a, b = world(), world(SCENE, change)
    found = differences(a, b)
    assert [difference.name for difference in found] == [name]
    assert not differences(a, taking(b, a, found))


def test_all_differences_are_distinguished_and_applied_singly():
    changes = [change for change in CHANGES if "hardness" not in change]
    a, b = world(), world(SCENE, *changes)
    found = differences(a, b)
    assert len({difference.name for difference in found}) == len(found) >= len(changes) - 2
    assert OTHER not in {difference.group for difference in found}
    left = b
    for number, difference in enumerate(found, 1):
        left = taking(left, a, [difference])
        assert len(differences(a, left)) == len(found) - number


def test_many_differences_of_a_kind_are_merged():
    a = simspec.load(simspec.find_spec("spheres-216")).resolve()
    b = simspec.load(simspec.find_spec("spheres-216"), sets=("bodies.ball.mass=11 kg",)).resolve()
    (difference,) = differences(a, b)
    assert difference.name == "mass and inertia of 216 things"


def test_values_without_effect_on_motion_are_no_difference():
    assert not differences(
        world(), world(SCENE, "name=other", "record.every=2 ms", "bodies.ball.shapes.0.colour=[1,0,0]")
    )


def test_other_scenes_are_refused_where_they_differ():
    other = dataclasses.replace(world(), bodies=world().bodies[:-1])
    with pytest.raises(SpecError, match=r"bodies\.arm: the two are of different scenes"):
        differences(world(), other)
    fixed = dataclasses.replace(world().bodies[-1].joint, kind="slide")
    slid = dataclasses.replace(
        world(), bodies=(*world().bodies[:-1], dataclasses.replace(world().bodies[-1], joint=fixed))
    )
    with pytest.raises(SpecError, match=r"bodies\.arm\.joint\.kind"):
        differences(world(), slid)


def test_features_computed_outside_the_engine_are_a_difference():
    options = ((), ("joint.dry_friction", "joint.armature"))
    sides = [Configuration(worlds.with_options(world(), "mujoco", outside=outside), "mujoco") for outside in options]
    (found,) = [candidate for candidate in causes(*sides) if candidate.name == "features computed outside MuJoCo"]
    assert found.values == ("nothing", ", ".join(sides[1].world.options("mujoco").outside))
    assert found.apply(tuple(sides))[1].world.options("mujoco").outside == ()
