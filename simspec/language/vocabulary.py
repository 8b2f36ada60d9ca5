"""Every closed list of words of the language, once: language, world, formats and engines take them from here.

It imports nothing, so that an engine's process can have it too.
"""

from __future__ import annotations

JOINT_KINDS = ("fixed", "hinge", "slide", "ball", "free")
SCALAR_JOINTS = ("hinge", "slide")
"""Kinds of joints with an axis and one coordinate: a controller drives them, and a trajectory moves them."""
TREE_JOINTS = (*SCALAR_JOINTS, "ball")
"""Kinds of joints that move a body against its parent."""
QUATERNION_JOINTS = ("ball", "free")
"""Kinds of joints whose position ends with a quaternion w x y z."""
PRIMITIVE_SHAPES = ("sphere", "box", "cylinder", "capsule", "ellipsoid", "plane")
"""Kinds of shapes that a few lengths define."""
SHAPE_KINDS = (*PRIMITIVE_SHAPES, "mesh", "heightfield")
"""Each has a row in ``world/shapes.py``."""
STATIC_SHAPES = ("plane", "heightfield")
"""Kinds that only bodies which cannot move have; they have no mass."""

FRICTION_CONES = ("elliptic", "pyramid-inscribed", "pyramid-circumscribed")
HARDNESS_WORDS = ("common", "native")
"""Kinds of hardness without numbers."""
HARDNESS_KINDS = ("common", "time-constant", "stiffness", "native")
LAW_QUANTITIES = ("friction", "restitution", "torsional_friction", "rolling_friction", "restitution_threshold")
"""The numbers of the law of two materials."""
COMBINED_QUANTITIES = ("friction", "torsional_friction", "rolling_friction", "restitution")
"""Those that engines combine from two shapes, in the order in which they depend on each other; a single word for `combine`
stands for all of them."""
COMBINATIONS = ("min", "max", "product", "mean", "geometric-mean")
"""How the language makes the law of a pair from two materials."""
ENGINE_RULES = ("max", "min", "product", "mean", "harmonic", "cross", "table", "none")
"""How an engine makes one number from two shapes'. harmonic: 2 μ₁ μ₂ / (μ₁ + μ₂); cross: s₁ μ₂ + s₂ μ₁ with the sliding
friction μ; table: the engine combines nothing and holds the law of every two materials; none: the engine lacks it."""

INTEGRATORS = ("common", "engine")
"""Semi-implicit Euler in all engines, or the usual method of each engine."""

DAMPINGS = ("explicit", "implicit")
"""Damping of joints by the velocity at the beginning of a step, or by that at its end."""

CONTROL_LAWS = ("pd", "computed-torque", "native")
DISCRETISATIONS = ("explicit", "implicit")
ACTUATORS = ("position", "velocity", "effort")
INTERPOLATIONS = ("hold", "linear", "cubic", "quintic")
MOTION_INTERPOLATIONS = ("linear", "cubic", "quintic")
"""Those that a body in contact can follow: one that jumps has no velocity."""

CHANNELS = ("pose", "velocity", "contacts", "energy")
"""The channels that a run can record."""
