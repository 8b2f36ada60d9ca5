"""Drake's inventory: additional calls are found, and every getter of pydrake is named."""

from __future__ import annotations

import dataclasses
import re

import pytest

from simspec.compiler import compile_world
from simspec.engines.drake.engine import Drake
from simspec.errors import EngineError
from simspec.proof.checks import inventory_checks
from simspec.proof.comparator import compare
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
    """Differences of the inventory or of the read-back."""
    back = engine.read_back()
    (check,) = inventory_checks(Drake.expected_inventory(world, back.neutral), back.inventory)
    checks = [check, *compare(world, dataclasses.replace(back, inventory={}, neutral={}), Drake.RULES, Drake.LAYERS)]
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
        id_ = sim.built.geometries[0].id
        properties = geometry.ProximityProperties(sim.query().inspector().GetProximityProperties(id_))
        properties.UpdateProperty(*name.split("."), value)
        sim.built.scene.AssignRole(context, sim.plant.get_source_id(), id_, properties, geometry.RoleAssign.kReplace)

    return change


def unfiltered(sim):
    context = sim.built.scene.GetMyMutableContextFromRoot(sim.root)
    every = geometry.GeometrySet([entry.id for entry in sim.built.geometries])
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
    "not filtered": unfiltered,
}


@pytest.mark.parametrize("name", BESIDES)
def test_additional_calls_to_the_engine_are_found(name, load):
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


# Every getter of the installed version, by class (a name stands for several classes of a kind), and its use.

INVENTORY = "in the inventory"
READ_BACK = "a field of the read-back"
STATE = "state or what was computed from it, compared by levels L2, L3 and L6"
DEFAULT = "the default of later contexts: the value of this context is queried"
DERIVED = "follows from what is in the inventory or the read-back"
WAY = "leads to other objects, which are queried themselves"
LABEL = "a name or a number of order; names of bodies are those of the read-back"
UNUSED = "of what simspec has none of: counted, or a part of what is"

GETTERS = {
    "MultibodyPlant": {
        INVENTORY: "get_contact_model get_discrete_contact_approximation get_discrete_contact_solver "
        "get_sap_near_rigid_threshold get_contact_surface_representation get_adjacent_bodies_collision_filters "
        "has_sampled_output_ports is_gravity_enabled num_bodies num_joints num_actuators num_force_elements num_constraints "
        "num_frames num_collision_geometries num_model_instances num_continuous_states num_abstract_states "
        "GetUniquePeriodicDiscreteUpdateAttribute GetModelInstanceName IsAnchored",
        READ_BACK: "time_step gravity_field",
        STATE: "GetFreeBodyPose GetPositions GetPositionsAndVelocities GetVelocities",
        DEFAULT: "GetDefaultContactSurfaceRepresentation GetDefaultFloatingBaseBodyPose GetDefaultFreeBodyPose "
        "GetDefaultPositions",
        DERIVED: "GetAccelerationLowerLimits GetAccelerationUpperLimits GetEffortLowerLimits GetEffortUpperLimits "
        "GetPositionLowerLimits GetPositionUpperLimits GetVelocityLowerLimits GetVelocityUpperLimits "
        "GetBodiesKinematicallyAffectedBy GetBodiesWeldedTo GetFloatingBaseBodies GetUniqueFloatingBaseBodyOrThrow "
        "GetUniqueFreeBaseBodyOrThrow HasUniqueFloatingBaseBody HasUniqueFreeBaseBody num_actuated_dofs "
        "num_multibody_states num_positions num_velocities is_finalized "
        "get_contact_penalty_method_time_scale",
        WAY: "CollectRegisteredGeometries "
        "GetActuatedJointIndices GetBodyByName GetBodyFromFrameId GetBodyIndices GetCollisionGeometriesForBody "
        "GetVisualGeometriesForBody GetFrameByName GetFrameIndices GetJointActuatorByName GetJointActuatorIndices "
        "GetJointByName GetJointIndices GetRigidBodyByName deformable_model get_body get_force_element get_frame get_joint "
        "get_joint_actuator world_body world_frame get_actuation_input_port get_applied_generalized_force_input_port "
        "get_applied_spatial_force_input_port get_geometry_query_input_port get_desired_state_input_port",
        LABEL: "GetActuationFromArray GetActuatorNames GetBodyFrameIdIfExists GetBodyFrameIdOrThrow GetModelInstanceByName "
        "GetPositionNames GetPositionsFromArray GetStateNames GetTopologyGraphvizString GetVelocitiesFromArray "
        "GetVelocityNames HasBodyNamed HasFrameNamed HasJointActuatorNamed HasJointNamed HasModelInstanceNamed "
        "NumBodiesWithName geometry_source_is_registered get_source_id has_joint has_joint_actuator",
        UNUSED: "GetConstraintActiveStatus GetConstraintIds GetDefaultDistanceConstraintParams GetDistanceConstraintParams",
    },
    "Joint": {
        INVENTORY: "GetDampingVector acceleration_lower_limits acceleration_upper_limits is_locked position_lower_limits "
        "position_upper_limits velocity_lower_limits velocity_upper_limits num_positions num_velocities",
        READ_BACK: "frame_on_child frame_on_parent parent_body child_body type_name revolute_axis translation_axis X_FM",
        STATE: "GetOnePosition GetOneVelocity GetPose get_angle get_angles get_angular_rate get_angular_velocity "
        "get_quaternion get_translation get_translational_velocity get_translation_rate",
        DEFAULT: "GetDefaultPose GetDefaultPosePair default_angular_damping default_damping default_damping_vector "
        "default_positions default_translational_damping get_default_angle get_default_angles get_default_quaternion "
        "get_default_translation",
        DERIVED: "GetDamping acceleration_lower_limit acceleration_upper_limit can_rotate can_translate "
        "position_lower_limit position_upper_limit velocity_lower_limit velocity_upper_limit",
        LABEL: "index is_ephemeral kTypeName model_instance name position_start position_suffix velocity_start "
        "velocity_suffix",
    },
    "JointActuator": {
        INVENTORY: "effort_limit gear_ratio rotor_inertia has_controller",
        READ_BACK: "calc_reflected_inertia get_controller_gains",
        DEFAULT: "default_gear_ratio default_reflected_inertia default_rotor_inertia",
        STATE: "get_actuation_vector",
        WAY: "joint",
        LABEL: "index input_start is_ephemeral model_instance name num_inputs",
    },
    "RigidBody": {
        READ_BACK: "get_mass",
        STATE: "GetForceInWorld",
        DEFAULT: "default_com default_mass default_rotational_inertia default_spatial_inertia default_unit_inertia",
        DERIVED: "is_locked is_floating is_floating_base_body has_quaternion_dofs",
        WAY: "body_frame",
        LABEL: "floating_position_suffix floating_positions_start floating_velocities_start_in_v floating_velocity_suffix "
        "index is_ephemeral model_instance name scoped_name",
    },
    "UniformGravityFieldElement": {
        READ_BACK: "gravity_vector",
        INVENTORY: "is_enabled",
        LABEL: "index is_ephemeral kDefaultStrength model_instance",
    },
    "CoulombFriction": {INVENTORY: "dynamic_friction static_friction"},
    "SceneGraphInspector": {
        INVENTORY: "CollisionFiltered GetProximityProperties GetPoseInFrame GetShape num_sources maybe_get_hydroelastic_mesh "
        "GetAllDeformableGeometryIds",
        READ_BACK: "GetConvexHull GetIllustrationProperties GetName",
        DERIVED: "GetCollisionCandidates GetFrameGroup GetObbInGeometryFrame GetProperties "
        "IsDeformableGeometry NumAnchoredGeometries NumDeformableGeometriesWithRole NumDynamicGeometries "
        "NumFramesForSource NumGeometriesForFrame NumGeometriesForFrameWithRole NumGeometriesWithRole num_frames "
        "num_geometries geometry_version",
        WAY: "FramesForSource GetAllFrameIds GetAllGeometryIds GetAllSourceIds GetFrameId GetGeometries "
        "GetGeometryIdByName GetGeometryIds world_frame_id CloneGeometryInstance",
        LABEL: "BelongsToSource GetOwningSourceName SourceIsRegistered",
        UNUSED: "GetPerceptionProperties GetReferenceMesh",
    },
    "SceneGraph": {
        INVENTORY: "get_config RendererCount",
        WAY: "collision_filter_manager model_inspector get_source_configuration_port get_source_pose_port",
        LABEL: "world_frame_id",
        UNUSED: "GetRendererParameterYaml GetRendererTypeName HasRenderer",
    },
    "ProximityConfig": {
        INVENTORY: "compliance_type dynamic_friction hunt_crossley_dissipation hydroelastic_modulus margin point_stiffness "
        "relaxation_time resolution_hint slab_thickness static_friction",
    },
}

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
        method
        for entry in CLASSES[name]
        for method in dir(entry)
        if not (CHANGES.match(method) or OUTPUT.match(method))
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


def test_every_class_is_queried():
    assert set(CLASSES) == set(GETTERS)


@pytest.mark.parametrize("end", [(0.002, 0.0, 0.0), (4e-4, 4.9e-10, -3e-9), (0.0, 0.0, 2e-12)])
def test_zeros_remain_zero_after_a_rotation(end, load):
    """Ends of capsules at y = z = 0, or near it, except for the round-off of a sum."""
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
