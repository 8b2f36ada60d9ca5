"""Words of other languages for contact, files, time, control and values."""

from __future__ import annotations

from simspec.language.hint import NOT_YET, Hint, same_hint

SCENARIO_WORDS: tuple[tuple[str, Hint], ...] = (
    # --- contact ------------------------------------------------------------------------------------------------------
    *same_hint(
        "mu mu1 mu_s mu_d friction_coefficient sliding_friction lateral_friction static_friction dynamic_friction",
        "friction, of a material or of a pair of them",
        "Material.friction",
        "Pair.friction",
    ),
    *same_hint(
        "friction restitution",
        "of a material: contact: {materials: {NAME: {friction: ..., restitution: ...}}}, and the shape's material: NAME",
        "Contact.materials",
        "Material.friction",
        "Material.restitution",
        "Shape.material",
        at="Shape Body Contact",
    ),
    *same_hint("mu2 fdir1 anisotropic_friction", f"friction that differs by direction is {NOT_YET}"),
    *same_hint("spinning_friction spin_friction", "torsional_friction", "Material.torsional_friction"),
    *same_hint(
        "bounce bounciness elasticity cor coefficient_of_restitution restitution_coefficient",
        "restitution",
        "Material.restitution",
        "Pair.restitution",
    ),
    *same_hint(
        "surface physical_material",
        "material: a name of contact.materials",
        "Shape.material",
        "Contact.materials",
        at="Shape Body",
    ),
    *same_hint("material", "write material in each shape", "Shape.material", at="Body"),
    *same_hint(
        "stiffness damping kp kd solref solimp compliance softness time_constant contact_stiffness",
        "hardness, of the contact or of a pair",
        "Contact.hardness",
        "Pair.hardness",
        at="Contact Material Pair",
    ),
    *same_hint("cone friction_model", "friction_cone", "Contact.friction_cone", at="Contact"),
    *same_hint(
        "condim",
        "torsional_friction and rolling_friction of the material",
        "Material.torsional_friction",
        "Material.rolling_friction",
    ),
    *same_hint(
        "contype conaffinity collision_filter collision_mask collide_bitmask category_bitmask bitmask layer collision_layer",
        "collision_group of the body, with contact: {groups: ...}",
        "Body.collision_group",
        "Contact.groups",
    ),
    *same_hint(
        "excludes exclude_pairs excluded disable_collisions ignore_collisions no_collide self_collide self_collision",
        "contact: {exclude: [[BODY, BODY], ...]}, or groups",
        "Contact.exclude",
        "Contact.groups",
    ),
    *same_hint(
        "allow touching collide_connected filterparent parent_collision",
        "contact: {touch: [[BODY, BODY], ...]}",
        "Contact.touch",
    ),
    *same_hint("include includes", "touch: [[BODY, BODY], ...]", "Contact.touch", at="Contact"),
    *same_hint("bodies_between materials pair", "between: [MATERIAL, MATERIAL]", "Pair.between", at="Pair"),
    *same_hint(
        "bodies_between materials pair", "between: [MATERIAL, MATERIAL]", "PairSettings.between", at="PairSettings"
    ),
    *same_hint(
        "by_pair pair_settings material_pairs",
        "pairs: [{between: [MATERIAL, MATERIAL], settings: {...}}]",
        "EngineOptions.pairs",
        at="EngineOptions SettingsAtTimestep",
    ),
    # --- bodies, models, files ----------------------------------------------------------------------------------------
    *same_hint("link links body worldbody objects object entities", "bodies: {NAME: ...}", "File.bodies"),
    *same_hint(
        "robot robots include includes",
        "models: {NAME: {use: FILE}}; in a file of its own, model: {bodies: ...}",
        "File.models",
        "Use.use",
    ),
    *same_hint("file path filename src uri url model_file", "use: FILE", "Use.use", at="Use Model"),
    *same_hint(
        "static is_static immovable anchored kinematic_fixed world_fixed", "fixed: true", "Body.fixed", "Use.fixed"
    ),
    *same_hint("fixed_base use_fixed_base fix_base", "fixed: true", "Use.fixed", "Body.fixed"),
    *same_hint(
        "mocap prescribed driven_body moving_base",
        "kinematic: true, and motion: {BODY: {points: [...]}} of the scenario",
        "Body.kinematic",
        "Use.kinematic",
        "File.motion",
        at="Body Use",
    ),
    *same_hint(
        "motions kinematic mocap", "motion: {BODY: {points: [...]}} of kinematic bodies", "File.motion", at="File"
    ),
    *same_hint("t time when", "at", "MotionPoint.at", at="MotionPoint"),
    *same_hint("position pos pose", "xyz, and rpy or quat", "MotionPoint.xyz", "MotionPoint.rpy", at="MotionPoint"),
    *same_hint(
        "gravcomp gravity_compensation use_gravity gravity disable_gravity weightless gravity_mode",
        "gravity_scale: 0 of a weightless body (1 − gravcomp), or gravity_compensation of a controller",
        "Body.gravity_scale",
        "Controller.gravity_compensation",
        at="Body",
    ),
    *same_hint(
        "gravcomp gravity_compensation use_gravity",
        "gravity_scale of the body, or gravity_compensation of a controller",
        "Body.gravity_scale",
        "Controller.gravity_compensation",
        at="Shape Joint",
    ),
    *same_hint(
        "initial_velocity twist",
        "velocity: {linear: [...], angular: [...]}",
        "Body.velocity",
        "Use.velocity",
        at="Body Use",
    ),
    *same_hint("linear_velocity", "velocity: {linear: [x, y, z]}", "Body.velocity", "Velocity.linear"),
    *same_hint("angular_velocity omega", "velocity: {angular: [x, y, z]}", "Body.velocity", "Velocity.angular"),
    *same_hint(
        "keyframe keyframes key initial_state initial_states named_states postures home",
        "states: {NAME: {positions: {JOINT: ...}}}, and state: NAME where the model is placed",
        "Model.states",
        "Use.states",
        "Use.state",
        at="Use Model File",
    ),
    *same_hint(
        "initial_positions joint_positions qpos configuration",
        "positions: {JOINT: ...}",
        "Use.positions",
        at="Use",
    ),
    *same_hint("joint_velocities initial_velocities qvel", "velocities: {JOINT: ...}", "Use.velocities", at="Use"),
    *same_hint("count repeat copies instances replicate", "array: {...}", "Body.array", "Use.array", at="Body Use"),
    *same_hint(
        "site sites named_frames tcp tool_frames markers reference_frames",
        "frames: {NAME: {body: BODY, pose: {...}}}",
        "File.frames",
        "Model.frames",
        "Use.frames",
        at="File Model Use",
    ),
    *same_hint("link parent attached_to on", "body: the body that it is fixed to", "Frame.body", at="Frame"),
    *same_hint("position pos xyz rpy quat rotation", "pose: {xyz: ..., rpy: ...}", "Frame.pose", at="Frame"),
    *same_hint(
        "sensor sensors camera cameras imu", f"sensors are {NOT_YET}; write recorded channels in record", "File.record"
    ),
    *same_hint(
        "default defaults class compiler asset assets",
        "classes and defaults are not supported; use use: and array: for repeated elements",
        "Use.use",
        "Body.array",
    ),
    *same_hint(
        "light lights skybox texture textures plugin plugins statistic",
        "rendering and plugins are not part of a spec: remove it",
    ),
    # --- time, running ------------------------------------------------------------------------------------------------
    *same_hint(
        "option options simulation world",
        "physics: {gravity: ..., timestep: ..., duration: ...}",
        "File.physics",
        at="File",
    ),
    *same_hint("dt time_step step step_size max_step_size delta_t h", "timestep", "Physics.timestep"),
    *same_hint(
        "end_time simulation_time sim_time t_end total_time length time", "duration", "Physics.duration", at="Physics"
    ),
    *same_hint(
        "timestep duration gravity",
        "physics: {timestep: ..., duration: ..., gravity: ...}",
        "Physics.timestep",
        "Physics.duration",
        "Physics.gravity",
        at="File",
    ),
    *same_hint("g", "gravity: [0, 0, -9.81]", "Physics.gravity", at="Physics File"),
    *same_hint(
        "steps num_steps iterations", "duration: the steps times the timestep", "Physics.duration", at="Physics"
    ),
    *same_hint(
        "integrator solver",
        "every engine's integrator is semi-implicit Euler; write solver settings in engines: {NAME: {settings: ...}}",
        "File.engines",
        "EngineOptions.settings",
        at="Physics File",
    ),
    *same_hint(
        "output outputs log logging recording",
        "record: {every: ..., channels: [...]}",
        "File.record",
        "Record.channels",
        at="File",
    ),
    *same_hint(
        "fps rate interval frequency period sampling",
        "every: the time between two records",
        "Record.every",
        at="Record",
    ),
    *same_hint(
        "expectations expected assert asserts assertions test tests check checks",
        "expect: [...]",
        "File.expect",
        at="File",
    ),
    *same_hint(
        "sweeps grid parameters variations experiments randomise randomize domain_randomization",
        "sweep: {over: {PATH: [...]}, samples: {...}}",
        "File.sweep",
        "Sweep.over",
        "Sweep.samples",
        at="File",
    ),
    *same_hint("grid parameters axes product", "over: {PATH: [...]}", "Sweep.over", at="Sweep"),
    *same_hint("zip rows linked", "together: [{PATH: [...], PATH: [...]}]", "Sweep.together", at="Sweep"),
    *same_hint(
        "random randomise randomize distributions draws",
        "samples: {count: ..., seed: ..., values: {...}}",
        "Sweep.samples",
        at="Sweep",
    ),
    *same_hint("repeats repetitions trials runs", "repeat", "Sweep.repeat", at="Sweep"),
    *same_hint("ensemble noise perturbation seeds", "perturb: {amount: ..., seeds: ...}", "Sweep.perturb", at="Sweep"),
    *same_hint("n num number samples steps", "count", "Samples.count", at="Samples"),
    *same_hint("gaussian gauss", "normal: [mean, standard deviation]", "Distribution.normal", at="Distribution"),
    *same_hint("loguniform reciprocal", "log_uniform: [lower, upper]", "Distribution.log_uniform", at="Distribution"),
    *same_hint("values discrete categorical one_of options", "choice: [...]", "Distribution.choice", at="Distribution"),
    *same_hint(
        "by_timestep timestep_settings",
        "at_timestep: [{above: TIME, settings: {...}}]",
        "EngineOptions.at_timestep",
        at="EngineOptions",
    ),
    *same_hint("engine simulator simulators backend backends", "engines: {NAME: ...}", "File.engines", at="File"),
    *same_hint(
        "actuator actuators motor motors transmission transmissions controllers controller",
        "control: {NAME: {joints: [...]}}; of a model: actuators: {NAME: {joint: ...}}, control: {NAME: {actuators: [...]}}",
        "File.control",
        "Controller.joints",
        "Controller.actuators",
        "Model.actuators",
        "Use.actuators",
        "File.actuators",
    ),
    *same_hint(
        "trajectories path waypoints",
        "trajectory: {points: [...]}, or a program",
        "File.trajectory",
        "Trajectory.points",
        "Trajectory.program",
        at="File",
    ),
    *same_hint(
        "push pushes perturbation perturbations disturbance disturbances wrench wrenches external_force external_forces "
        "applied_forces loads xfrc_applied",
        "forces: [{body: ..., force: [80, 0, 0], from: 1 s, until: 1.1 s}]",
        "File.forces",
        "Force.force",
        at="File Body Use",
    ),
    *same_hint("start begin t0 after", "from", "Force.from", at="Force"),
    *same_hint("to end stop t1 duration", "until: the time up to which it acts", "Force.until", at="Force"),
    *same_hint("point position pos xyz", "at, in the body's frame", "Force.at", at="Force"),
    *same_hint("moment couple", "torque", "Force.torque", at="Force"),
    *same_hint("link target", "body", "Force.body", at="Force"),
    *same_hint(
        "belt conveyor belt_velocity surfacevel surface_motion",
        "surface_velocity: {linear: [VX, VY, VZ]} of the shape",
        "Shape.surface_velocity",
        at="Shape Body Material",
    ),
    *same_hint(
        "waypoints keyframes knots", "points: [{at: ..., positions: {...}}, ...]", "Trajectory.points", at="Trajectory"
    ),
    *same_hint("p kp_gain stiffness gain p_gain", "kp", "Controller.kp", at="Controller"),
    *same_hint(
        "rate frequency period decimation control_rate control_frequency update_rate frame_skip sample_time interval",
        "every: the time between two looks of the controller at the state",
        "Controller.every",
        at="Controller",
    ),
    *same_hint("d kv damping d_gain derivative", "kd", "Controller.kd", at="Controller"),
    *same_hint(
        "i ki integral",
        "there is no integral term; gravity_compensation: true compensates gravity",
        "Controller.gravity_compensation",
        at="Controller",
    ),
    *same_hint(
        "type mode control_mode",
        "law, and the kind of actuator",
        "Controller.law",
        "Controller.actuator",
        at="Controller",
    ),
    *same_hint(
        "force_limit torque_limit max_effort max_force max_torque forcerange",
        "effort_limit",
        "Controller.effort_limit",
        at="Controller",
    ),
    *same_hint("t time when", "at", "TrajectoryPoint.at", at="TrajectoryPoint"),
    *same_hint(
        "q joints angles position values", "positions: {JOINT: ...}", "TrajectoryPoint.positions", at="TrajectoryPoint"
    ),
    *same_hint("accepts approximate allow", "accept: [FEATURE, ...]", "EngineOptions.accept", at="EngineOptions"),
    # --- words that are values ----------------------------------------------------------------------------------------
    *same_hint("cubic_spline spline hermite", "cubic", "Trajectory.interpolation=cubic"),
    *same_hint("zero_order constant step_hold none", "hold", "Trajectory.interpolation=hold"),
    *same_hint("torque force motor direct", "effort", "Controller.actuator=effort"),
    *same_hint("servo pid p_d", "pd", "Controller.law=pd"),
    *same_hint(
        "inverse_dynamics computed_torque_control feedback_linearization",
        "computed-torque",
        "Controller.law=computed-torque",
    ),
    *same_hint("semi_implicit backward", "implicit", "Controller.discretisation=implicit"),
    *same_hint("cone circular coulomb", "elliptic", "Contact.friction_cone=elliptic"),
    *same_hint(
        "pyramid pyramidal box",
        "pyramid-inscribed or pyramid-circumscribed: two laws, a factor of two apart at 45°",
        "Contact.friction_cone=pyramid-inscribed",
        "Contact.friction_cone=pyramid-circumscribed",
    ),
    *same_hint("position positions poses", "pose", "Record.channels=pose"),
    *same_hint("velocities speed twist", "velocity", "Record.channels=velocity"),
    *same_hint("contact forces collisions", "contacts", "Record.channels=contacts"),
)
