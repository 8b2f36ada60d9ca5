"""Drake's inventory: whatever the engine is told besides shows, and no getter of pydrake's is left unnamed."""

from __future__ import annotations

import dataclasses
import re

import pytest

from simspec.compiler import compile_world
from simspec.engines.drake.engine import Drake
from simspec.engines.drake.getters import GETTERS
from simspec.errors import EngineError
from simspec.proof.comparator import compare, inventory_checks
from simspec.proof.selftest_worlds import WORLDS
from simspec.world import frames
from simspec.world.types import Pose
from tests import worlds

pytest.importorskip("pydrake")
from pydrake import geometry
from pydrake.multibody import plant, tree
from pydrake.systems import framework


@pytest.fixture
def load(load_files):
    """A function that compiles and loads a world."""
    return lambda world: load_files(Drake, compile_world(world, ["drake"])["drake"].files)


def failures(world, engine):
    """What differs in the inventory, or in the read-back."""
    held = engine.read_back()
    (check,) = inventory_checks(Drake.expected_inventory(world, held.neutral), held.inventory)
    checks = [check, *compare(world, dataclasses.replace(held, inventory={}, neutral={}), Drake.RULES, Drake.LAYERS)]
    return [check for check in checks if not check.passed]


def joint(sim):
    return sim.plant.GetJointByName("upper_joint")


def force(sim):
    wrench = plant.ExternallyAppliedSpatialForce()
    wrench.body_index = sim.built.bodies[-1].index()
    sim.plant.get_applied_spatial_force_input_port().FixValue(sim.context, [wrench])


def material(name, value):
    """Another number of a geometry, in this context alone."""

    def change(sim):
        context = sim.built.scene.GetMyMutableContextFromRoot(sim.root)
        held = sim.built.geometries[0].id
        properties = geometry.ProximityProperties(sim.query().inspector().GetProximityProperties(held))
        properties.UpdateProperty(*name.split("."), value)
        sim.built.scene.AssignRole(context, sim.plant.get_source_id(), held, properties, geometry.RoleAssign.kReplace)

    return change


def unfiltered(sim):
    context = sim.built.scene.GetMyMutableContextFromRoot(sim.root)
    every = geometry.GeometrySet([one.id for one in sim.built.geometries])
    declared = geometry.CollisionFilterDeclaration().ExcludeWithin(every)
    sim.built.scene.collision_filter_manager(context).Apply(declared)


BESIDES = {
    "damping": lambda sim: joint(sim).SetDamping(sim.context, 0.1),
    "locked": lambda sim: joint(sim).Lock(sim.context),
    "position limits": lambda sim: joint(sim).set_position_limits([-0.1], [0.1]),
    "velocity limits": lambda sim: joint(sim).set_velocity_limits([-0.1], [0.1]),
    "acceleration limits": lambda sim: joint(sim).set_acceleration_limits([-0.1], [0.1]),
    "gear": lambda sim: sim.plant.get_joint_actuator(tree.JointActuatorIndex(0)).SetGearRatio(sim.context, 2.0),
    "rotor": lambda sim: sim.plant.get_joint_actuator(tree.JointActuatorIndex(0)).SetRotorInertia(sim.context, 2.0),
    "mass": lambda sim: sim.built.bodies[-1].SetMass(sim.context, 77.0),
    "centre of mass": lambda sim: sim.built.bodies[-1].SetCenterOfMassInBodyFrame(sim.context, [0.1, 0.0, 0.0]),
    "stiction": lambda sim: sim.settings.update(stiction_tolerance=1e-3),
    "wrench": force,
    "actuation": lambda sim: sim.plant.get_actuation_input_port().FixValue(
        sim.context, [1.0] * sim.plant.num_actuated_dofs()
    ),
    "friction": material("material.coulomb_friction", plant.CoulombFriction(0.9, 0.9)),
    "relaxation": material("material.relaxation_time", 0.3),
    "stiffness": material("material.point_contact_stiffness", 1.0),
    "margin": material("hydroelastic.margin", 0.01),
    "kept apart": unfiltered,
}


@pytest.mark.parametrize("name", BESIDES)
def test_whatever_the_engine_is_told_besides_shows(name, load):
    world = WORLDS["model"]("drake")
    engine = load(world)
    assert failures(world, engine) == []
    BESIDES[name](engine._simulation)
    assert failures(world, engine) != []


def test_two_frictions_of_a_geometry_are_the_engines_failure(load):
    engine = load(WORLDS["model"]("drake"))
    material("material.coulomb_friction", plant.CoulombFriction(0.9, 0.1))(engine._simulation)
    with pytest.raises(EngineError, match="two frictions"):
        engine.read_back()


CLASSES = {
    "MultibodyPlant": [plant.MultibodyPlant],
    "Joint": [
        getattr(tree, f"{name}Joint") for name in ("Weld", "Revolute", "Prismatic", "BallRpy", "QuaternionFloating")
    ],
    "JointActuator": [tree.JointActuator],
    "RigidBody": [tree.RigidBody],
    "UniformGravityFieldElement": [tree.UniformGravityFieldElement],
    "CoulombFriction": [plant.CoulombFriction],
    "SceneGraphInspector": [geometry.SceneGraphInspector],
    "SceneGraph": [geometry.SceneGraph],
    "ProximityConfig": [geometry.DefaultProximityProperties],
}
CHANGES = re.compile(
    "Add|Assign|Change|Declare|Finalize|Lock|Map|Register|Remove|Rename|Set|Unlock|Weld|set_|get_mutable|mutable_|"
    "GetMutable|GetParentPlant|Calc|Eval|Is.*EqualTo|Make|_"
)
"""Methods that change something, lead to what can be changed, or compute from a state."""
OUTPUT = re.compile("get_.*_output_port$")
FRAMEWORK = {*dir(framework.LeafSystem), "ToScalarType"}
OF_EVERY_SYSTEM = {
    "GetUniquePeriodicDiscreteUpdateAttribute",
    "num_abstract_states",
    "num_constraints",
    "num_continuous_states",
}
"""Of the framework's getters those that tell something of the model."""


@pytest.mark.parametrize("name", CLASSES)
def test_no_getter_is_left_unnamed(name):
    installed = {
        method for one in CLASSES[name] for method in dir(one) if not (CHANGES.match(method) or OUTPUT.match(method))
    }
    if name in ("MultibodyPlant", "SceneGraph"):
        installed = {
            method
            for method in installed
            if (method not in FRAMEWORK or method in OF_EVERY_SYSTEM) and not method.startswith("ToScalarType")
        }
        if name == "SceneGraph":
            installed -= OF_EVERY_SYSTEM
    named = [method for methods in GETTERS[name].values() for method in methods.split()]
    assert sorted(named) == sorted(set(named)), "each once"
    assert set(named) - installed == set(), "there is none of that name"
    assert installed - set(named) == set(), "what becomes of it?"


def test_every_class_is_asked():
    assert set(CLASSES) == set(GETTERS)


@pytest.mark.parametrize("end", [(0.002, 0.0, 0.0), (4e-4, 4.9e-10, -3e-9), (0.0, 0.0, 2e-12)])
def test_what_a_rotation_leaves_of_nothing_is_nothing(end, load):
    """Ends of capsules beside the origin, whose y and z are 0, or next to it, but for the round-off of a sum."""
    base = worlds.shapes_world(("capsule",))
    turns = [frames.from_rpy(0.3 * index, 0.2 + index, 0.7 * index) for index in range(6)]
    solid = next(shape for body in base.bodies for shape in body.shapes if shape.collision)
    ends = tuple(
        dataclasses.replace(
            solid,
            name=f"end{index}",
            kind="capsule",
            size=(0.002, 0.1),
            pose=Pose(frames.subtract(end, frames.rotate(turn, (0.0, 0.0, 0.05))), turn),
        )
        for index, turn in enumerate(turns)
    )
    owner = next(body for body in base.bodies if solid in body.shapes)
    bodies = tuple(dataclasses.replace(body, shapes=ends) if body is owner else body for body in base.bodies)
    world = dataclasses.replace(base, bodies=bodies)
    assert failures(world, load(world)) == []
