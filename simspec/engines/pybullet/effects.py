"""What PyBullet's loaders do to plain files (pybullet 3.2.7), measured by tests/formats/test_readers.py."""

from __future__ import annotations

from typing import Final

from simspec.engines.kit.effects import REFUSED, Effect

MEASURED: Final = "3.2.7"
ALWAYS: Final = (
    Effect(
        "joints_held_by_motors", "a hinge or a slide", "holds hinges and slides by motors until they are given none"
    ),
    Effect("velocity_clamp", "a hinge or a slide", "lets no joint move faster than 100 rad/s or m/s", seen="elsewhere"),
)
DAMPING: Final = "damps what moves freely by 4 % of its speed a second"
SELF: Final = "lets no links of one tree touch each other"
MARGIN: Final = Effect(
    "collision_margin", "a shape that is no sphere", "adds up to 1 mm of collision margin around shapes"
)
HULLS: Final = Effect("shapes", "cylinder", "replaces cylinders by hulls of points")
TENSORS: Final = "computes inertia tensors from the shapes' boxes"
SHAPES: Final = (
    Effect("inertia", "mass that moves, other than a uniform sphere or box", TENSORS, seen="may"),
    HULLS,
    MARGIN,
)
URDF: Final = (
    *ALWAYS,
    Effect("linear_damping", "a free body", DAMPING, profiles=("fixed-base",)),
    *SHAPES,
    Effect("self_collision", "several links", SELF, profiles=("fixed-base",)),
    Effect("self_collision", "every file", SELF, profiles=("floating",)),
    Effect(
        "joint.type",
        "free root",
        "reads no floating joint: the root is fixed to the world; the profile fixed-base keeps it free",
        profiles=("floating",),
    ),
)
SCENE: Final = (
    Effect("gravity", "gravity", "reads no gravity"),
    Effect("timestep", "every file", "reads no timestep: 1/240 s"),
)
MJCF: Final = (
    *ALWAYS,
    *SCENE,
    Effect("linear_damping", "free root or fixed root with mass or volume", DAMPING),
    Effect("self_collision", "several bodies in a tree, or a hinge or a slide", SELF),
    *(
        Effect(quantity, "root on a ball joint", "lets a root on a ball joint move freely", seen="may")
        for quantity in ("joint.type", "joint.origin.xyz", "mass")
    ),
    Effect("joint.type", "hinge or slide", "puts each joint on a further link, to which the body is fixed"),
    Effect("joint.type", "fixed root with mass or volume", "lets a body that is fixed to the world move freely"),
    Effect("mass", "fixed root with volume, without mass", "gives a body without mass that of its shapes as water"),
    Effect("inertia", "mass, other than a uniform sphere, box or cylinder", TENSORS, seen="may"),
    Effect("body", "body on a ball joint, or on such a body", "drops bodies on ball joints, and all that they carry"),
)
NEW: Final = ("1.9",)
ELSEWHERE: Final = "reads no quaternions and no relative places: links and shapes stand elsewhere; use --profile 1.6"
SDF: Final = (
    Effect(REFUSED, "something joined to the world", "refuses files in which a joint joins something to the world"),
    Effect(REFUSED, "a ball joint", "refuses files with ball joints"),
    Effect(REFUSED, "an ellipsoid", "refuses files with ellipsoids", profiles=NEW),
    *ALWAYS,
    *SCENE,
    Effect("linear_damping", "a free body", DAMPING),
    *SHAPES,
    Effect("self_collision", "several bodies in a tree", SELF),
    *(
        Effect(quantity, "every file", ELSEWHERE, profiles=NEW, seen="may")
        for quantity in ("joint.origin.xyz", "joint.type", "shapes", "pose", "inertia", "mass", "centre_of_mass")
    ),
)
