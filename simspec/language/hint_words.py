"""Words of other languages of models and of plain speech, and what the language says instead.

How they are looked up stands in :mod:`simspec.language.hints`; a test holds every target against the language's schema.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Hint:
    """What to write instead of a word.

    text     the hint itself
    targets  what it names, as MODEL.FIELD or MODEL.FIELD=WORD of the language; none: the language has nothing like it yet
    at       the models in which the word means this; none: anywhere
    """

    text: str
    targets: tuple[str, ...] = ()
    at: tuple[str, ...] = ()


def _all(words: str, text: str, *targets: str, at: str = "") -> list[tuple[str, Hint]]:
    """One hint for several words."""
    return [(word, Hint(text, targets, tuple(at.split()))) for word in words.split()]


_NOT_YET = "not supported yet"

ENTRIES: tuple[tuple[str, Hint], ...] = (
    # --- kinds of joints (values of joint.type; also written as keys) ---------------------------------------------------
    *_all("revolute rotary rotational revolute_joint hinge_joint", "type: hinge", "Joint.type=hinge"),
    *_all("continuous", "type: hinge, without limits", "Joint.type=hinge", "Joint.limits"),
    *_all("prismatic linear sliding slider translational prismatic_joint", "type: slide", "Joint.type=slide"),
    *_all(
        "floating freejoint free_joint six_dof 6dof",
        "type: free; a root without joint is free as it is",
        "Joint.type=free",
    ),
    *_all("spherical ball_joint ball_and_socket socket", "type: ball", "Joint.type=ball"),
    *_all("weld welded rigid fixed_joint", "type: fixed", "Joint.type=fixed"),
    *_all(
        "universal planar screw helical revolute2 gearbox cylindrical cardan",
        f"this kind of joint is {_NOT_YET}; use a chain of hinges and slides with small bodies between them",
        "Joint.type=hinge",
        "Joint.type=slide",
    ),
    # --- shapes -------------------------------------------------------------------------------------------------------
    *_all(
        "mesh meshes trimesh stl obj dae glb convex_hull hull convex sdf_shape",
        f"meshes are {_NOT_YET}; shapes are sphere, box, cylinder, capsule, ellipsoid and plane",
        "Shape.sphere",
        "Shape.box",
        "Shape.cylinder",
        "Shape.capsule",
        "Shape.ellipsoid",
        "Shape.plane",
    ),
    *_all(
        "hfield heightfield heightmap terrain",
        f"height fields are {_NOT_YET}; a plane, or boxes",
        "Shape.plane",
    ),
    *_all(
        "half_size half_sizes half_extents half_extent half_lengths",
        "size, twice as much: the full edge lengths",
        "Box.size",
    ),
    *_all("extents dimensions dims edges lengths", "size: the full edge lengths along x, y, z", "Box.size", at="Box"),
    *_all("half_length half_height", "length, twice as much", "Cylinder.length", "Capsule.length"),
    *_all("height", "length", "Cylinder.length", "Capsule.length", at="Cylinder Capsule"),
    *_all("diameter", "radius, half as much", "Sphere.radius", "Cylinder.radius", "Capsule.radius"),
    *_all("semi_axes axes", "radii", "Ellipsoid.radii", at="Ellipsoid"),
    *_all("size radius", "radii: the semi-axes along x, y, z", "Ellipsoid.radii", at="Ellipsoid"),
    *_all("fromto", "length, with the shape's pose at the middle", "Capsule.length", "Shape.pose"),
    *_all("cube cuboid rectangle brick", "box: {size: [x, y, z]}, full edge lengths", "Shape.box", "Box.size"),
    *_all("ball", "sphere: {radius: ...}", "Shape.sphere", "Sphere.radius", at="Shape"),
    *_all(
        "tube pipe rod",
        "cylinder: {radius: ..., length: ...}, or capsule",
        "Shape.cylinder",
        "Shape.capsule",
        at="Shape",
    ),
    *_all(
        "ground floor ground_plane halfspace",
        "plane: {}, of a body that is fixed",
        "Shape.plane",
        "Body.fixed",
        at="Shape",
    ),
    *_all(
        "geom geoms geometry geometries collider colliders collision collisions visual visuals shape",
        "shapes: [{box: {size: [x, y, z]}}, ...]",
        "Body.shapes",
        at="Body File",
    ),
    *_all(
        "geom geometry type",
        "the shape's own word: sphere, box, ..., as {box: {size: [x, y, z]}}",
        "Shape.box",
        at="Shape",
    ),
    *_all("rgba color rgb diffuse", "colour: [r, g, b]", "Shape.colour"),
    *_all("visual_only no_collision", "collision: false", "Shape.collision"),
    # --- mass ---------------------------------------------------------------------------------------------------------
    *_all("weight", "mass, in kg", "Body.mass"),
    *_all("mass", "density here, or the mass of the body", "Shape.density", "Body.mass", at="Shape"),
    *_all(
        "com cog centre_of_gravity center_of_gravity center_of_mass centroid ipos",
        "centre_of_mass: [x, y, z]",
        "Body.centre_of_mass",
    ),
    *_all(
        "ixx iyy izz ixy ixz iyz",
        "inertia: {tensor: {xx: ..., yy: ..., zz: ..., xy: ..., xz: ..., yz: ...}}",
        "Inertia.tensor",
    ),
    *_all("diaginertia diagonal_inertia diagonal moments", "inertia: {principal: [...]}", "Inertia.principal"),
    *_all(
        "fullinertia inertia_tensor inertia_matrix moment_of_inertia",
        "inertia: {tensor: {xx: ...}}",
        "Inertia.tensor",
    ),
    *_all(
        "inertial",
        "write mass, centre_of_mass and inertia in the body itself",
        "Body.mass",
        "Body.centre_of_mass",
        "Body.inertia",
    ),
    # --- places -------------------------------------------------------------------------------------------------------
    *_all(
        "pos position location translation xyz place",
        "pose: {xyz: [x, y, z]}",
        "Pose.xyz",
        at="Body Use Shape ToolFrame",
    ),
    *_all(
        "rpy euler rotation orientation angles",
        "pose: {rpy: [roll, pitch, yaw]}",
        "Pose.rpy",
        at="Body Use Shape ToolFrame",
    ),
    *_all("quat quaternion", "pose: {quat: [w, x, y, z]}", "Pose.quat", at="Body Use Shape ToolFrame"),
    *_all("pos position location translation", "xyz: [x, y, z]", "Pose.xyz", at="Pose"),
    *_all("pos xyz translation", "origin: {xyz: [x, y, z]}", "Joint.origin", "Pose.xyz", at="Joint"),
    *_all(
        "rpy rotation orientation euler", "origin: {rpy: [roll, pitch, yaw]}", "Joint.origin", "Pose.rpy", at="Joint"
    ),
    *_all("euler rotation orientation angles", "rpy: [roll, pitch, yaw]", "Pose.rpy", at="Pose Orientation Inertia"),
    *_all("quaternion wxyz xyzw rotation_quat", "quat: [w, x, y, z]", "Pose.quat"),
    *_all(
        "axis_angle rotation_vector rotation_matrix",
        f"this form is {_NOT_YET}; rpy or quat",
        "Pose.rpy",
        "Pose.quat",
    ),
    *_all("pose", "origin: {xyz: ..., rpy: ...}: the joint's frame in the parent's", "Joint.origin", at="Joint"),
    *_all(
        "origin transform frame tf",
        "pose: {xyz: ..., rpy: ...} of a root; joint: {origin: ...} of a body with a parent",
        "Body.pose",
        "Joint.origin",
        at="Body Use",
    ),
    *_all("origin transform", "pose: {xyz: ..., rpy: ...}", "Shape.pose", at="Shape"),
    # --- joints -------------------------------------------------------------------------------------------------------
    *_all(
        "stiffness spring_stiffness springdamper",
        "spring: {stiffness: ...} of the joint",
        "Joint.spring",
        "Spring.stiffness",
        at="Joint Body",
    ),
    *_all(
        "springref spring_reference spring_rest equilibrium",
        "spring: {rest: ...}",
        "Spring.rest",
        at="Joint Spring",
    ),
    *_all("damping", "joint: {damping: ...}", "Joint.damping", at="Body"),
    *_all("damper viscous_friction viscous_damping friction_viscous", "damping", "Joint.damping", at="Joint"),
    *_all(
        "friction frictionloss coulomb_friction static_friction joint_friction friction_coulomb",
        "dry_friction: the largest effort against motion",
        "Joint.dry_friction",
        at="Joint",
    ),
    *_all("rotor_inertia reflected_inertia", "armature", "Joint.armature", at="Joint"),
    *_all(
        "lower upper range limit lower_limit upper_limit position_limits joint_limits min max",
        "limits: {position: [lower, upper]}",
        "Joint.limits",
        "Limits.position",
        at="Joint",
    ),
    *_all("lower upper range min max", "position: [lower, upper]", "Limits.position", at="Limits"),
    *_all(
        "effort effort_limit max_effort max_force max_torque torque_limit force_limit forcerange",
        "limits: {effort: ...}",
        "Joint.limits",
        "Limits.effort",
        at="Joint",
    ),
    *_all("force torque max_force max_torque max_effort", "effort", "Limits.effort", at="Limits"),
    *_all(
        "velocity_limit max_velocity vmax speed_limit",
        "limits: {velocity: ...}",
        "Joint.limits",
        "Limits.velocity",
        at="Joint",
    ),
    *_all("max_velocity speed vmax", "velocity", "Limits.velocity", at="Limits"),
    *_all(
        "qpos qpos0 q0 initial_position start", "position: initial position of the joint", "Joint.position", at="Joint"
    ),
    *_all("qvel qvel0 v0 initial_velocity", "velocity: initial velocity of the joint", "Joint.velocity", at="Joint"),
    *_all("child", "write the joint in its child body, next to `parent`", "Body.parent", "Body.joint"),
    *_all("parent parent_link", "write parent in the body, next to `joint`", "Body.parent", at="Joint"),
    *_all("parent_link parent_body", "parent", "Body.parent", at="Body"),
    *_all(
        "mimic equality equalities tendon tendons loop loop_closure constraint constraints gear_constraint",
        f"constraints between joints and bodies are {_NOT_YET}",
    ),
    *_all("joints", "write joint: {...} in each body that has a parent", "Body.joint"),
    # --- contact ------------------------------------------------------------------------------------------------------
    *_all(
        "mu mu1 mu_s mu_d friction_coefficient sliding_friction lateral_friction static_friction dynamic_friction",
        "friction, of a material or of a pair of them",
        "Material.friction",
        "Pair.friction",
    ),
    *_all(
        "friction restitution",
        "of a material: contact: {materials: {NAME: {friction: ..., restitution: ...}}}, and the shape's material: NAME",
        "Contact.materials",
        "Material.friction",
        "Material.restitution",
        "Shape.material",
        at="Shape Body Contact",
    ),
    *_all("mu2 fdir1 anisotropic_friction", f"friction that differs by direction is {_NOT_YET}"),
    *_all("spinning_friction spin_friction", "torsional_friction", "Material.torsional_friction"),
    *_all(
        "bounce bounciness elasticity cor coefficient_of_restitution restitution_coefficient",
        "restitution",
        "Material.restitution",
        "Pair.restitution",
    ),
    *_all(
        "surface physical_material",
        "material: a name of contact.materials",
        "Shape.material",
        "Contact.materials",
        at="Shape Body",
    ),
    *_all("material", "write material in each shape", "Shape.material", at="Body"),
    *_all(
        "stiffness damping kp kd solref solimp compliance softness time_constant contact_stiffness",
        "hardness, of the contact or of a pair",
        "Contact.hardness",
        "Pair.hardness",
        at="Contact Material Pair",
    ),
    *_all("cone friction_model", "friction_cone", "Contact.friction_cone", at="Contact"),
    *_all(
        "condim",
        "torsional_friction and rolling_friction of the material",
        "Material.torsional_friction",
        "Material.rolling_friction",
    ),
    *_all(
        "contype conaffinity collision_filter collision_mask collide_bitmask category_bitmask bitmask layer collision_layer",
        "collision_group of the body, with contact: {groups: ...}",
        "Body.collision_group",
        "Contact.groups",
    ),
    *_all(
        "excludes exclude_pairs excluded disable_collisions ignore_collisions no_collide self_collide self_collision",
        "contact: {exclude: [[BODY, BODY], ...]}, or groups",
        "Contact.exclude",
        "Contact.groups",
    ),
    *_all("bodies_between materials pair", "between: [MATERIAL, MATERIAL]", "Pair.between", at="Pair"),
    # --- bodies, models, files ----------------------------------------------------------------------------------------
    *_all("link links body worldbody objects object entities", "bodies: {NAME: ...}", "File.bodies"),
    *_all(
        "robot robots include includes",
        "models: {NAME: {use: FILE}}; in a file of its own, model: {bodies: ...}",
        "File.models",
        "Use.use",
    ),
    *_all("file path filename src uri url import model_file", "use: FILE", "Use.use", at="Use Model"),
    *_all("static is_static immovable anchored kinematic_fixed world_fixed", "fixed: true", "Body.fixed", "Use.fixed"),
    *_all("fixed_base use_fixed_base fix_base", "fixed: true", "Use.fixed", "Body.fixed"),
    *_all("kinematic", f"kinematic bodies on a given path are {_NOT_YET}"),
    *_all(
        "gravcomp gravity_compensation use_gravity",
        "use gravity_compensation of a controller; gravity is the same for all bodies",
        "Controller.gravity_compensation",
        at="Body Shape Joint",
    ),
    *_all(
        "initial_velocity twist",
        "velocity: {linear: [...], angular: [...]}",
        "Body.velocity",
        "Use.velocity",
        at="Body Use",
    ),
    *_all("linear_velocity", "velocity: {linear: [x, y, z]}", "Body.velocity", "Velocity.linear"),
    *_all("angular_velocity omega", "velocity: {angular: [x, y, z]}", "Body.velocity", "Velocity.angular"),
    *_all(
        "initial_positions joint_positions qpos keyframe configuration",
        "positions: {JOINT: ...}",
        "Use.positions",
        at="Use",
    ),
    *_all("joint_velocities initial_velocities qvel", "velocities: {JOINT: ...}", "Use.velocities", at="Use"),
    *_all("count repeat copies instances replicate", "array: {...}", "Body.array", "Use.array", at="Body Use"),
    *_all(
        "site sites frames", f"named frames are {_NOT_YET}; write a tool's frame in the trajectory", "Trajectory.tool"
    ),
    *_all(
        "sensor sensors camera cameras imu", f"sensors are {_NOT_YET}; write recorded channels in record", "File.record"
    ),
    *_all(
        "default defaults class compiler asset assets",
        "classes and defaults are not supported; use use: and array: for repeated elements",
        "Use.use",
        "Body.array",
    ),
    *_all(
        "light lights skybox texture textures plugin plugins statistic",
        "rendering and plugins are not part of a spec: remove it",
    ),
    # --- time, running ------------------------------------------------------------------------------------------------
    *_all(
        "option options simulation world",
        "physics: {gravity: ..., timestep: ..., duration: ...}",
        "File.physics",
        at="File",
    ),
    *_all("dt time_step step step_size max_step_size delta_t h", "timestep", "Physics.timestep"),
    *_all(
        "end_time simulation_time sim_time t_end total_time length time", "duration", "Physics.duration", at="Physics"
    ),
    *_all(
        "timestep duration gravity",
        "physics: {timestep: ..., duration: ..., gravity: ...}",
        "Physics.timestep",
        "Physics.duration",
        "Physics.gravity",
        at="File",
    ),
    *_all("g", "gravity: [0, 0, -9.81]", "Physics.gravity", at="Physics File"),
    *_all("steps num_steps iterations", "duration: the steps times the timestep", "Physics.duration", at="Physics"),
    *_all(
        "integrator solver",
        "every engine's integrator is semi-implicit Euler; write solver settings in engines: {NAME: {settings: ...}}",
        "File.engines",
        "EngineOptions.settings",
        at="Physics File",
    ),
    *_all(
        "output outputs log logging recording",
        "record: {every: ..., channels: [...]}",
        "File.record",
        "Record.channels",
        at="File",
    ),
    *_all(
        "fps rate interval frequency period sampling",
        "every: the time between two records",
        "Record.every",
        at="Record",
    ),
    *_all(
        "expectations expected assert asserts assertions test tests check checks",
        "expect: [...]",
        "File.expect",
        at="File",
    ),
    *_all("engine simulator simulators backend backends", "engines: {NAME: ...}", "File.engines", at="File"),
    *_all(
        "actuator actuators motor motors transmission transmissions controllers controller",
        "control: {NAME: {joints: [...]}}",
        "File.control",
        "Controller.joints",
    ),
    *_all(
        "trajectories motion path waypoints",
        "trajectory: {points: [...]}, or a program",
        "File.trajectory",
        "Trajectory.points",
        "Trajectory.program",
        at="File",
    ),
    *_all(
        "waypoints keyframes knots", "points: [{at: ..., positions: {...}}, ...]", "Trajectory.points", at="Trajectory"
    ),
    *_all("p kp_gain stiffness gain p_gain", "kp", "Controller.kp", at="Controller"),
    *_all("d kv damping d_gain derivative", "kd", "Controller.kd", at="Controller"),
    *_all(
        "i ki integral",
        "there is no integral term; gravity_compensation: true compensates gravity",
        "Controller.gravity_compensation",
        at="Controller",
    ),
    *_all(
        "type mode control_mode",
        "law, and the kind of actuator",
        "Controller.law",
        "Controller.actuator",
        at="Controller",
    ),
    *_all(
        "force_limit torque_limit max_effort max_force max_torque forcerange",
        "effort_limit",
        "Controller.effort_limit",
        at="Controller",
    ),
    *_all("t time when", "at", "TrajectoryPoint.at", at="TrajectoryPoint"),
    *_all(
        "q joints angles position values", "positions: {JOINT: ...}", "TrajectoryPoint.positions", at="TrajectoryPoint"
    ),
    *_all("accepts approximate allow", "accept: [FEATURE, ...]", "EngineOptions.accept", at="EngineOptions"),
    # --- words that are values ----------------------------------------------------------------------------------------
    *_all("cubic_spline spline hermite", "cubic", "Trajectory.interpolation=cubic"),
    *_all("zero_order constant step_hold none", "hold", "Trajectory.interpolation=hold"),
    *_all("torque force motor direct", "effort", "Controller.actuator=effort"),
    *_all("servo pid p_d", "pd", "Controller.law=pd"),
    *_all(
        "inverse_dynamics computed_torque_control feedback_linearization",
        "computed-torque",
        "Controller.law=computed-torque",
    ),
    *_all("semi_implicit backward", "implicit", "Controller.discretisation=implicit"),
    *_all("cone circular coulomb", "elliptic", "Contact.friction_cone=elliptic"),
    *_all(
        "pyramid pyramidal box",
        "pyramid-inscribed or pyramid-circumscribed: two laws, a factor of two apart at 45°",
        "Contact.friction_cone=pyramid-inscribed",
        "Contact.friction_cone=pyramid-circumscribed",
    ),
    *_all("position positions poses", "pose", "Record.channels=pose"),
    *_all("velocities speed twist", "velocity", "Record.channels=velocity"),
    *_all("contact forces collisions", "contacts", "Record.channels=contacts"),
)
