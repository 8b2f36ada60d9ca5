"""What DART's parsers do to plain files (dartpy 6.20.0), measured by tests/formats/test_readers.py."""

from __future__ import annotations

from typing import Final

from simspec.engines.kit.effects import REFUSED, Effect

MEASURED: Final = "6.20.0"
LIMITS: Final = Effect(
    "limits_enforced", "a position limit", "does not enforce position limits unless they are enabled"
)
SELF: Final = Effect("self_collision", "several bodies in a tree", "lets no links of one tree touch each other")
EARTH: Final = Effect("gravity", "gravity other than 9.81 m/s² down", "reads no gravity: 9.81 m/s² along -z")
RATINGS: Final = (
    Effect("joint.velocity_limit", "velocity limit", "drops the velocity limits of joints"),
    Effect("joint.effort_limit", "effort limit", "drops the effort limits of joints"),
)
URDF: Final = (LIMITS, SELF)
MJCF: Final = (
    LIMITS,
    SELF,
    EARTH,
    RATINGS[1],
    Effect("timestep", "timestep other than 1 ms", "reads no timestep: 1 ms"),
    Effect("inertia", "mass that moves", "replaces every inertia tensor by the unit tensor"),
    Effect("mass", "no shape", "gives a body without shapes 1 kg"),
    Effect(
        "centre_of_mass", "no shape, centre elsewhere", "puts the centre of mass of a body without shapes at its origin"
    ),
    Effect("joint.dry_friction", "dry friction", "drops the dry friction of joints"),
    Effect("joint.spring_stiffness", "spring of a hinge or a slide", "drops the springs of joints"),
    Effect("joint.damping", "damping of a ball joint", "drops the damping of ball joints"),
    Effect("shapes", "plane", "replaces a plane by a cube of 1 m"),
)
SDF: Final = (
    Effect(REFUSED, "every file", "refuses versions above 1.6; use --profile 1.6", profiles=("1.9",)),
    SELF,
    EARTH,
    *RATINGS,
    Effect("joint.type", "tree that cannot move", "lets a static model move freely"),
    Effect("shapes", "plane", "replaces a plane by a box of 200 m x 200 m x 1 mm"),
)
