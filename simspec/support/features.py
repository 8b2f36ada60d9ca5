"""The closed list of things that a spec can say, with what each means."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class Feature(StrEnum):
    """One thing a spec can say."""

    JOINT_FIXED = "joint.fixed"
    JOINT_HINGE = "joint.hinge"
    JOINT_SLIDE = "joint.slide"
    JOINT_BALL = "joint.ball"
    JOINT_FREE = "joint.free"
    JOINT_SEVERAL = "joint.several"
    LIMIT_POSITION = "joint.limits.position"
    BALL_LIMIT = "joint.limits.angle"
    LIMIT_VELOCITY = "joint.limits.velocity"
    LIMIT_EFFORT = "joint.limits.effort"
    DAMPING = "joint.damping"
    BALL_DAMPING = "joint.ball.damping"
    DAMPING_IMPLICIT = "joint.damping.implicit"
    DRY_FRICTION = "joint.dry_friction"
    ARMATURE = "joint.armature"
    BALL_ARMATURE = "joint.ball.armature"
    FREE_DAMPING = "joint.free.damping"
    FREE_ARMATURE = "joint.free.armature"
    SPRING = "joint.spring"
    BALL_SPRING = "joint.ball.spring"
    INITIAL_POSITION = "joint.position"
    INITIAL_VELOCITY = "joint.velocity"
    INERTIA = "body.inertia"
    INERTIA_FULL = "body.inertia.full"
    INERTIA_SINGULAR = "body.inertia.singular"
    MASSLESS = "body.massless"
    KINEMATIC = "body.kinematic"
    GRAVITY_SCALE = "body.gravity_scale"
    TREE_SIZE = "tree.size"
    TREE_DEPTH = "tree.depth"
    SHAPE_SPHERE = "shape.sphere"
    SHAPE_BOX = "shape.box"
    SHAPE_CYLINDER = "shape.cylinder"
    SHAPE_CAPSULE = "shape.capsule"
    SHAPE_ELLIPSOID = "shape.ellipsoid"
    SHAPE_PLANE = "shape.plane"
    SHAPE_MESH = "shape.mesh"
    SHAPE_HEIGHTFIELD = "shape.heightfield"
    SHAPE_VISUAL = "shape.visual"
    SHAPE_MARGIN = "shape.margin"
    SURFACE_VELOCITY = "shape.surface_velocity"
    SHAPES_PER_BODY = "shape.several"
    MATERIALS_PER_BODY = "material.several"
    FRICTION = "material.friction"
    FRICTION_PAIRS = "material.friction.pairs"
    RESTITUTION = "material.restitution"
    RESTITUTION_PAIRS = "material.restitution.pairs"
    RESTITUTION_THRESHOLD = "material.restitution.threshold"
    TORSIONAL_FRICTION = "material.friction.torsional"
    ROLLING_FRICTION = "material.friction.rolling"
    HARDNESS_COMMON = "contact.hardness.common"
    HARDNESS_TIME_CONSTANT = "contact.hardness.time-constant"
    HARDNESS_STIFFNESS = "contact.hardness.stiffness"
    HARDNESS_NATIVE = "contact.hardness.native"
    HARDNESS_PAIRS = "contact.hardness.pairs"
    MARGIN_PAIRS = "contact.pairs.margin"
    PASSING_PAIRS = "contact.pairs.collide"
    IMPACT_FRICTION = "contact.friction.impact"
    CARRIED_FRICTION = "contact.friction.carried"
    SELF_LOCKING = "contact.friction.self-locking"
    EVEN_PRESSURE = "contact.pressure"
    MASS_RATIO = "contact.mass-ratio"
    CONE_ELLIPTIC = "contact.cone.elliptic"
    CONE_PYRAMID_INSCRIBED = "contact.cone.pyramid-inscribed"
    CONE_PYRAMID_CIRCUMSCRIBED = "contact.cone.pyramid-circumscribed"
    COLLISION_GROUPS = "contact.groups"
    EXCLUDED_PAIRS = "contact.exclude"
    TOUCHING_PAIRS = "contact.touch"
    CONSTRAINT_LOOP = "constraint.loop"
    CONSTRAINT_COUPLING = "constraint.coupling"
    SUM = "constraint.sum"
    SUM_DRY_FRICTION = "constraint.sum.dry_friction"
    SUM_LIMITS = "constraint.sum.limits"
    FRAME = "frames"
    FORCES = "forces"
    CONTROL = "control"
    CONTROL_NATIVE = "control.native"
    GRAVITY = "physics.gravity"
    TIMESTEP = "physics.timestep"
    INTEGRATOR = "physics.integrator"
    FLUID = "physics.fluid"


MEANING: Mapping[Feature, str] = {
    Feature.JOINT_FIXED: "a rigid connection of two bodies, which remain separate bodies",
    Feature.JOINT_HINGE: "rotation about one axis",
    Feature.JOINT_SLIDE: "translation along one axis",
    Feature.JOINT_BALL: "rotation about a point",
    Feature.JOINT_FREE: "free motion of a root body",
    Feature.JOINT_SEVERAL: "several joints between two bodies: universal, planar, up to six degrees of freedom",
    Feature.LIMIT_POSITION: "hard, inelastic stops at the position limits",
    Feature.BALL_LIMIT: "a hard, inelastic stop at the largest angle of a ball joint",
    Feature.LIMIT_VELOCITY: "the velocity rating: stored, not enforced",
    Feature.LIMIT_EFFORT: "the effort rating: stored, not enforced",
    Feature.DAMPING: "effort −d v, explicit in time",
    Feature.BALL_DAMPING: "torque −d ω on a ball joint",
    Feature.DAMPING_IMPLICIT: "joint damping by the velocity at the end of a step",
    Feature.DRY_FRICTION: "dry friction of at most f at a hinge or slide",
    Feature.ARMATURE: "inertia added to the joint's diagonal element of the mass matrix",
    Feature.BALL_ARMATURE: "inertia added to the diagonal elements of a ball joint, the same about every axis",
    Feature.FREE_DAMPING: "force −d v at the centre of mass of a free body, and torque −d ω on it",
    Feature.FREE_ARMATURE: "inertia added to the six diagonal elements of a free body",
    Feature.SPRING: "effort −k (q − rest) at a hinge or slide",
    Feature.BALL_SPRING: "torque −k log R at a ball joint",
    Feature.INITIAL_POSITION: "joint positions at time zero",
    Feature.INITIAL_VELOCITY: "joint velocities at time zero",
    Feature.INERTIA: "mass, centre of mass and principal moments",
    Feature.INERTIA_FULL: "an inertia tensor with products of inertia",
    Feature.INERTIA_SINGULAR: "a point mass or a rod fixed to a moving body",
    Feature.MASSLESS: "a massless body fixed to a moving body",
    Feature.KINEMATIC: "a root body with prescribed motion, independent of forces",
    Feature.GRAVITY_SCALE: "a weight other than mass × gravity, down to none",
    Feature.TREE_SIZE: "a tree of more than 127 bodies",
    Feature.TREE_DEPTH: "a chain of more than 400 bodies",
    Feature.SHAPE_SPHERE: "sphere",
    Feature.SHAPE_BOX: "box",
    Feature.SHAPE_CYLINDER: "cylinder",
    Feature.SHAPE_CAPSULE: "capsule",
    Feature.SHAPE_ELLIPSOID: "ellipsoid",
    Feature.SHAPE_PLANE: "infinite plane",
    Feature.SHAPE_MESH: "convex hull of a mesh",
    Feature.SHAPE_HEIGHTFIELD: "uneven ground: heights on a grid of points",
    Feature.SHAPE_VISUAL: "visual shapes separate from collision shapes",
    Feature.SHAPE_MARGIN: "contact that begins at a distance from the surface",
    Feature.SURFACE_VELOCITY: "a moving surface of a body at rest: a conveyor belt, a turntable",
    Feature.SHAPES_PER_BODY: "several collision shapes on one body",
    Feature.MATERIALS_PER_BODY: "shapes of different materials on one body",
    Feature.FRICTION: "sliding friction of materials",
    Feature.FRICTION_PAIRS: "friction of a pair that the engine's combination rule does not give",
    Feature.RESTITUTION: "restitution above zero",
    Feature.RESTITUTION_PAIRS: "restitution of a pair that the engine's combination rule does not give",
    Feature.RESTITUTION_THRESHOLD: "an approach speed below which bodies do not bounce",
    Feature.TORSIONAL_FRICTION: "a torque of at most c N about the normal of a contact",
    Feature.ROLLING_FRICTION: "a torque of at most c N about the tangents of a contact",
    Feature.HARDNESS_COMMON: "rigid contact with error reduction of 1 % of an overlap in each step",
    Feature.HARDNESS_TIME_CONSTANT: "compliant contact by time constant and damping ratio",
    Feature.HARDNESS_STIFFNESS: "compliant contact by stiffness and damping",
    Feature.HARDNESS_NATIVE: "the engine's default contact stiffness: a declared difference",
    Feature.HARDNESS_PAIRS: "a hardness for each pair of materials",
    Feature.MARGIN_PAIRS: "a contact margin for each pair of materials",
    Feature.PASSING_PAIRS: "pairs of materials that do not collide",
    Feature.IMPACT_FRICTION: "friction in oblique impacts, and where normal forces change within a step",
    Feature.CARRIED_FRICTION: "friction between a body and its kinematic, driven or moving support",
    Feature.SELF_LOCKING: "self-locking friction: a body that may have another between two of its shapes",
    Feature.EVEN_PRESSURE: "even pressure over the face of a body on a joint, so that friction does not turn it",
    Feature.MASS_RATIO: "a body on one of a tenth of its mass or less, or sliding with another on it",
    Feature.CONE_ELLIPTIC: "|f| ≤ μ N",
    Feature.CONE_PYRAMID_INSCRIBED: "|fx| + |fy| ≤ μ N",
    Feature.CONE_PYRAMID_CIRCUMSCRIBED: "|fx| ≤ μ N and |fy| ≤ μ N",
    Feature.COLLISION_GROUPS: "collision groups that ignore each other",
    Feature.EXCLUDED_PAIRS: "pairs of bodies that do not collide",
    Feature.TOUCHING_PAIRS: "pairs of bodies that collide although a joint or a loop joins them",
    Feature.CONSTRAINT_LOOP: "a closed loop: two bodies connected outside the tree, at a point or rigidly",
    Feature.CONSTRAINT_COUPLING: "a joint whose position is a function of another joint's",
    Feature.SUM: "springs and dampers along weighted sums of joint positions",
    Feature.SUM_DRY_FRICTION: "dry friction along weighted sums of joint positions",
    Feature.SUM_LIMITS: "hard, inelastic stops of weighted sums of joint positions",
    Feature.FRAME: "named frames on bodies",
    Feature.FORCES: "forces and torques on bodies during given times",
    Feature.CONTROL: "control laws that simspec evaluates and applies as efforts",
    Feature.CONTROL_NATIVE: "the engine's position or velocity controllers: a declared difference",
    Feature.GRAVITY: "gravity, any direction",
    Feature.TIMESTEP: "the length of one step",
    Feature.INTEGRATOR: "integration by semi-implicit Euler, v before q",
    Feature.FLUID: "drag and viscous resistance of a fluid, on the inertia box of each body",
}

# Features that are declared together.

JOINTS = (Feature.JOINT_FIXED, Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_FREE)
LIMIT_RATINGS = (Feature.LIMIT_VELOCITY, Feature.LIMIT_EFFORT)
DAMPERS_AND_SPRINGS = (Feature.DAMPING, Feature.BALL_DAMPING, Feature.SPRING, Feature.BALL_SPRING)
ARMATURES = (Feature.ARMATURE, Feature.BALL_ARMATURE, Feature.FREE_ARMATURE)
INITIAL_STATE = (Feature.INITIAL_POSITION, Feature.INITIAL_VELOCITY)
INERTIAS = (Feature.INERTIA, Feature.INERTIA_FULL, Feature.INERTIA_SINGULAR, Feature.MASSLESS)
LARGE_TREES = (Feature.TREE_SIZE, Feature.TREE_DEPTH)
SHAPES_OF_BODIES = (Feature.SHAPE_VISUAL, Feature.SHAPES_PER_BODY, Feature.MATERIALS_PER_BODY)
MARGINS = (Feature.SHAPE_MARGIN, Feature.MARGIN_PAIRS)
MOMENTS = (Feature.TORSIONAL_FRICTION, Feature.ROLLING_FRICTION)
FRICTIONS = (Feature.FRICTION, Feature.FRICTION_PAIRS, *MOMENTS)
RESTITUTIONS = (Feature.RESTITUTION, Feature.RESTITUTION_PAIRS, Feature.RESTITUTION_THRESHOLD)
COMPLIANCES = (Feature.HARDNESS_TIME_CONSTANT, Feature.HARDNESS_STIFFNESS)
HARDNESSES = (Feature.HARDNESS_COMMON, *COMPLIANCES, Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS)
PYRAMIDS = (Feature.CONE_PYRAMID_INSCRIBED, Feature.CONE_PYRAMID_CIRCUMSCRIBED)
CONES = (Feature.CONE_ELLIPTIC, *PYRAMIDS)
FILTERS = (Feature.PASSING_PAIRS, Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS, Feature.TOUCHING_PAIRS)
CONSTRAINTS = (Feature.CONSTRAINT_LOOP, Feature.CONSTRAINT_COUPLING)
SUMS = (Feature.SUM, Feature.SUM_LIMITS, Feature.SUM_DRY_FRICTION)
PASSIVE_FORCES = (Feature.GRAVITY_SCALE, Feature.FREE_DAMPING, Feature.FLUID)
CONTROLS = (Feature.CONTROL, Feature.CONTROL_NATIVE)
PHYSICS = (Feature.GRAVITY, Feature.TIMESTEP, Feature.INTEGRATOR)
COUPLED_CONTACT = (Feature.CARRIED_FRICTION, Feature.SELF_LOCKING, Feature.EVEN_PRESSURE, Feature.MASS_RATIO)
"""Further needs of contact of several bodies, compared to contact of two: coupled probes of level L5 measure them."""
CONTACT_LAWS = (*FRICTIONS, *RESTITUTIONS, Feature.IMPACT_FRICTION, *COUPLED_CONTACT, *CONES)
"""The laws of two surfaces, without their hardness."""
