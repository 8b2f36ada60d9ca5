"""What pydrake can be asked of each of Drake's classes, and what becomes of the answer: data, for people and for a test.

Every method of the installed version that asks something is here, under its class (one name stands for several classes of a
kind) and what becomes of it. So a new version that can tell more fails the test until that is decided. Left out by their names
are methods that change something, that belong to every system of Drake's framework, or that compute from a state.
"""

from __future__ import annotations

from collections.abc import Mapping

INVENTORY = "in the inventory"
READ_BACK = "a field of the read-back"
STATE = "state or what was computed from it, compared by levels L2, L3 and L6"
DEFAULT = "of contexts that are made later: this one's own value is asked for"
DERIVED = "follows from what is in the inventory or the read-back"
WAY = "leads to other objects, which are asked themselves"
LABEL = "a name or a number of order; names of bodies are those of the read-back"
UNUSED = "of what simspec has none of: counted, or a part of what is"

GETTERS: Mapping[str, Mapping[str, str]] = {
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
