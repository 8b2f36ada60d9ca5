"""Words of other languages for joints, shapes, masses and places."""

from __future__ import annotations

from simspec.language.hint import NOT_YET, Hint, same_hint

BODY_WORDS: tuple[tuple[str, Hint], ...] = (
    # --- kinds of joints (values of joint.type; also written as keys) ---------------------------------------------------
    *same_hint("revolute rotary rotational revolute_joint hinge_joint", "type: hinge", "Joint.type=hinge"),
    *same_hint("continuous", "type: hinge, without limits", "Joint.type=hinge", "Joint.limits"),
    *same_hint("prismatic linear sliding slider translational prismatic_joint", "type: slide", "Joint.type=slide"),
    *same_hint(
        "floating freejoint free_joint six_dof 6dof",
        "type: free; a root without joint is free as it is",
        "Joint.type=free",
    ),
    *same_hint("spherical ball_joint ball_and_socket socket", "type: ball", "Joint.type=ball"),
    *same_hint("weld welded rigid fixed_joint", "type: fixed", "Joint.type=fixed"),
    *same_hint(
        "universal planar revolute2 cylindrical cardan d6",
        "joints: [...], several hinges and slides in a row (a universal joint is two hinges)",
        "Body.joints",
        "Joint.type=hinge",
        "Joint.type=slide",
    ),
    *same_hint(
        "screw helical gearbox",
        f"this kind of joint is {NOT_YET}; a slide can follow a hinge (constraints)",
        "Joint.type=hinge",
        "Joint.type=slide",
    ),
    # --- shapes -------------------------------------------------------------------------------------------------------
    *same_hint(
        "meshes trimesh stl obj dae glb gltf ply convex_hull hull convex collada",
        "mesh: {file: ...}: the convex hull of a file of triangles",
        "Shape.mesh",
        "Mesh.file",
        at="Shape",
    ),
    *same_hint(
        "filename uri path url", "file: path of the file", "Mesh.file", "Heightfield.file", at="Mesh Heightfield"
    ),
    *same_hint("units length_unit", "unit", "Mesh.unit", at="Mesh"),
    *same_hint("up_axis", "up", "Mesh.up", at="Mesh"),
    *same_hint("maxhullvert max_verts vertices", "max_vertices", "Mesh.max_vertices", at="Mesh"),
    *same_hint("coacd vhacd decomposition decompose", "as: pieces", "Mesh.as", at="Mesh"),
    *same_hint("sdf_shape", f"signed distance fields are {NOT_YET}; mesh: {{file: ..., as: pieces}}", "Shape.mesh"),
    *same_hint(
        "hfield heightmap terrain height_field elevation_map",
        "heightfield: {rows: [[...], ...], size: [x, y]}, or with file: of a body that is fixed",
        "Shape.heightfield",
        "Heightfield.rows",
        "Heightfield.file",
        at="Shape",
    ),
    *same_hint("elevation data values grid", "rows: [[...], ...]", "Heightfield.rows", at="Heightfield"),
    *same_hint("nrow ncol", "none: rows has as many as are written", "Heightfield.rows", at="Heightfield"),
    *same_hint("z_range height_range range", "heights: [lowest, highest]", "Heightfield.heights", at="Heightfield"),
    *same_hint("thickness depth", "base", "Heightfield.base", at="Heightfield"),
    *same_hint(
        "half_size half_sizes half_extents half_extent half_lengths",
        "size, twice as much: the full edge lengths",
        "Box.size",
    ),
    *same_hint(
        "extents dimensions dims edges lengths", "size: the full edge lengths along x, y, z", "Box.size", at="Box"
    ),
    *same_hint("half_length half_height", "length, twice as much", "Cylinder.length", "Capsule.length"),
    *same_hint("height", "length", "Cylinder.length", "Capsule.length", at="Cylinder Capsule"),
    *same_hint("diameter", "radius, half as much", "Sphere.radius", "Cylinder.radius", "Capsule.radius"),
    *same_hint("semi_axes axes", "radii", "Ellipsoid.radii", at="Ellipsoid"),
    *same_hint("size radius", "radii: the semi-axes along x, y, z", "Ellipsoid.radii", at="Ellipsoid"),
    *same_hint("fromto", "length, with the shape's pose at the middle", "Capsule.length", "Shape.pose"),
    *same_hint("cube cuboid rectangle brick", "box: {size: [x, y, z]}, full edge lengths", "Shape.box", "Box.size"),
    *same_hint("ball", "sphere: {radius: ...}", "Shape.sphere", "Sphere.radius", at="Shape"),
    *same_hint(
        "tube pipe rod",
        "cylinder: {radius: ..., length: ...}, or capsule",
        "Shape.cylinder",
        "Shape.capsule",
        at="Shape",
    ),
    *same_hint(
        "ground floor ground_plane halfspace",
        "plane: {}, of a body that is fixed",
        "Shape.plane",
        "Body.fixed",
        at="Shape",
    ),
    *same_hint(
        "geom geoms geometry geometries collider colliders collision collisions visual visuals shape",
        "shapes: [{box: {size: [x, y, z]}}, ...]",
        "Body.shapes",
        at="Body File",
    ),
    *same_hint(
        "geom geometry type",
        "the shape's own word: sphere, box, ..., as {box: {size: [x, y, z]}}",
        "Shape.box",
        at="Shape",
    ),
    *same_hint("rgba color rgb diffuse", "colour: [r, g, b]", "Shape.colour"),
    *same_hint(
        "contact_margin collision_margin contact_offset rest_offset",
        "margin, in m",
        "Shape.margin",
        "Pair.margin",
        at="Shape Pair",
    ),
    *same_hint("visual_only no_collision", "collision: false", "Shape.collision"),
    # --- mass ---------------------------------------------------------------------------------------------------------
    *same_hint("weight", "mass, in kg", "Body.mass"),
    *same_hint("mass", "density here, or the mass of the body", "Shape.density", "Body.mass", at="Shape"),
    *same_hint(
        "com cog centre_of_gravity center_of_gravity center_of_mass centroid ipos",
        "centre_of_mass: [x, y, z]",
        "Body.centre_of_mass",
    ),
    *same_hint(
        "ixx iyy izz ixy ixz iyz",
        "inertia: {tensor: {xx: ..., yy: ..., zz: ..., xy: ..., xz: ..., yz: ...}}",
        "Inertia.tensor",
    ),
    *same_hint("diaginertia diagonal_inertia diagonal moments", "inertia: {principal: [...]}", "Inertia.principal"),
    *same_hint(
        "fullinertia inertia_tensor inertia_matrix moment_of_inertia",
        "inertia: {tensor: {xx: ...}}",
        "Inertia.tensor",
    ),
    *same_hint(
        "inertial",
        "write mass, centre_of_mass and inertia in the body itself",
        "Body.mass",
        "Body.centre_of_mass",
        "Body.inertia",
    ),
    # --- places -------------------------------------------------------------------------------------------------------
    *same_hint(
        "pos position location translation xyz place",
        "pose: {xyz: [x, y, z]}",
        "Pose.xyz",
        at="Body Use Shape ToolFrame",
    ),
    *same_hint(
        "rpy euler rotation orientation angles",
        "pose: {rpy: [roll, pitch, yaw]}",
        "Pose.rpy",
        at="Body Use Shape ToolFrame",
    ),
    *same_hint("quat quaternion", "pose: {quat: [w, x, y, z]}", "Pose.quat", at="Body Use Shape ToolFrame"),
    *same_hint("pos position location translation", "xyz: [x, y, z]", "Pose.xyz", at="Pose"),
    *same_hint("pos xyz translation", "origin: {xyz: [x, y, z]}", "Joint.origin", "Pose.xyz", at="Joint"),
    *same_hint(
        "rpy rotation orientation euler", "origin: {rpy: [roll, pitch, yaw]}", "Joint.origin", "Pose.rpy", at="Joint"
    ),
    *same_hint(
        "euler rotation orientation angles", "rpy: [roll, pitch, yaw]", "Pose.rpy", at="Pose Orientation Inertia"
    ),
    *same_hint("quaternion wxyz xyzw rotation_quat", "quat: [w, x, y, z]", "Pose.quat"),
    *same_hint(
        "axis_angle rotation_vector rotation_matrix",
        f"this form is {NOT_YET}; rpy or quat",
        "Pose.rpy",
        "Pose.quat",
    ),
    *same_hint("pose", "origin: {xyz: ..., rpy: ...}: the joint's frame in the parent's", "Joint.origin", at="Joint"),
    *same_hint(
        "origin transform frame tf",
        "pose: {xyz: ..., rpy: ...} of a root; joint: {origin: ...} of a body with a parent",
        "Body.pose",
        "Joint.origin",
        at="Body Use",
    ),
    *same_hint("origin transform", "pose: {xyz: ..., rpy: ...}", "Shape.pose", at="Shape"),
    # --- joints -------------------------------------------------------------------------------------------------------
    *same_hint(
        "stiffness spring_stiffness springdamper",
        "spring: {stiffness: ...} of the joint",
        "Joint.spring",
        "Spring.stiffness",
        at="Joint Body",
    ),
    *same_hint(
        "springref spring_reference spring_rest equilibrium",
        "spring: {rest: ...}",
        "Spring.rest",
        at="Joint Spring",
    ),
    *same_hint("damping", "joint: {damping: ...}", "Joint.damping", at="Body"),
    *same_hint("damper viscous_friction viscous_damping friction_viscous", "damping", "Joint.damping", at="Joint"),
    *same_hint(
        "friction frictionloss coulomb_friction static_friction joint_friction friction_coulomb",
        "dry_friction: the largest effort against motion",
        "Joint.dry_friction",
        at="Joint",
    ),
    *same_hint("rotor_inertia reflected_inertia", "armature", "Joint.armature", at="Joint"),
    *same_hint(
        "lower upper range limit lower_limit upper_limit position_limits joint_limits min max",
        "limits: {position: [lower, upper]}",
        "Joint.limits",
        "Limits.position",
        at="Joint",
    ),
    *same_hint("lower upper range min max", "position: [lower, upper]", "Limits.position", at="Limits"),
    *same_hint(
        "effort effort_limit max_effort max_force max_torque torque_limit force_limit forcerange",
        "limits: {effort: ...}",
        "Joint.limits",
        "Limits.effort",
        at="Joint",
    ),
    *same_hint("force torque max_force max_torque max_effort", "effort", "Limits.effort", at="Limits"),
    *same_hint(
        "velocity_limit max_velocity vmax speed_limit",
        "limits: {velocity: ...}",
        "Joint.limits",
        "Limits.velocity",
        at="Joint",
    ),
    *same_hint("max_velocity speed vmax", "velocity", "Limits.velocity", at="Limits"),
    *same_hint(
        "qpos qpos0 q0 initial_position start", "position: initial position of the joint", "Joint.position", at="Joint"
    ),
    *same_hint(
        "qvel qvel0 v0 initial_velocity", "velocity: initial velocity of the joint", "Joint.velocity", at="Joint"
    ),
    *same_hint("child", "write the joint in its child body, next to `parent`", "Body.parent", "Body.joint"),
    *same_hint("parent parent_link", "write parent in the body, next to `joint`", "Body.parent", at="Joint"),
    *same_hint("parent_link parent_body", "parent", "Body.parent", at="Body"),
    *same_hint(
        "mimic gear_constraint gear_ratio coupler polycoef",
        "constraints: {NAME: {follow: {joint: ..., leader: ..., ratio: ..., offset: ...}}}",
        "File.constraints",
        "Follow.ratio",
    ),
    *same_hint(
        "equality equalities constraint loop loops loop_closure closure",
        "constraints: {NAME: {follow: ...}}, connect or weld",
        "File.constraints",
        "Constraint.follow",
        "Constraint.connect",
        "Constraint.weld",
    ),
    *same_hint("multiplier gearing", "ratio", "Follow.ratio", at="Follow"),
    *same_hint("constant", "offset", "Follow.offset", at="Follow"),
    *same_hint("joint1 follower slave", "joint: the one that follows", "Follow.joint", at="Follow"),
    *same_hint("joint2 master lead", "leader", "Follow.leader", at="Follow"),
    *same_hint("joint", "follow: {joint: ..., leader: ...}", "Constraint.follow", at="Constraint"),
    *same_hint(
        "body1 body2 first second", "bodies: [FIRST, SECOND]", "Connect.bodies", "Weld.bodies", at="Connect Weld"
    ),
    *same_hint("anchor point", "at: the point in the first body's frame", "Connect.at", at="Connect"),
    *same_hint("relpose", "pose", "Weld.pose", at="Weld"),
    *same_hint("point2point p2p ball_constraint", "connect", "Constraint.connect", at="Constraint"),
    *same_hint(
        "tendon tendons fixed_tendon gearbox differential",
        "constraints: {NAME: {sum: {joints: {JOINT: coefficient}, stiffness: ...}}}",
        "File.constraints",
        "Constraint.sum",
    ),
    *same_hint("fixed", "sum: a weighted sum of joint positions", "Constraint.sum", at="Constraint"),
    *same_hint("coef coefs coefficients weights terms", "joints: {JOINT: coefficient}", "Sum.joints", at="Sum"),
    *same_hint("spring k", "stiffness", "Sum.stiffness", at="Sum"),
    *same_hint("springlength springref rest_length", "rest", "Sum.rest", at="Sum"),
    *same_hint("range lower upper position", "limits: {position: [lower, upper]}", "Sum.limits", at="Sum"),
    *same_hint("lower upper range min max", "position: [lower, upper]", "SumLimits.position", at="SumLimits"),
    *same_hint(
        "joints", "write joint: {...} in each body that has a parent, or joints: [...]", "Body.joint", "Body.joints"
    ),
    *same_hint(
        "joint_list joint_chain chain dofs axes", "joints: [...], the parent's side first", "Body.joints", at="Body"
    ),
)
