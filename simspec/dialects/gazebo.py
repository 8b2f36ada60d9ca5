"""Gazebo's dialect: ``world.json``, from which the engine generates SDF when it loads the world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import PASSIVE_BY_NAME, WORLD, FileAddition, Inert, table
from simspec.dialects.kit.world import WorldDialect
from simspec.support import classes
from simspec.support.declarations import Table, exact
from simspec.support.features import Feature

STOPS = exact("DART stops joints inelastically within the step")
NO_VELOCITY_LIMITS = exact("simspec does not pass velocity limits to DART, which would enforce them")


class GazeboDialect(WorldDialect):
    """The world and its contact plan as JSON."""

    NAME: ClassVar[str] = "gazebo"
    SUPPORT: ClassVar[Table] = {**WorldDialect.SUPPORT, Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS}


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "torsional friction": "DART's contacts have no torque",
    "rolling friction": "DART's contacts have no torque",
    "mesh, margin": "DART has no margin around hulls, and no file has a number for one",
    **dict.fromkeys(MARGINS, "DART's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives Gazebo no height fields"),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
    "hardness": "DART's contacts have the common hardness alone, without parameters",
}


TABLE = table(
    {"contact_solver": ("dantzig", "pgs")},
    (
        FileAddition("", "9.81", "strength"),
        FileAddition("settings", "true", "sleeping"),
        FileAddition("settings", "0.01", "softness"),
    ),
    (
        *PASSIVE_BY_NAME,
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
        Inert(
            "bodies.*.shapes.*.pose.position.*",
            "a translation of a plane within itself, which is the top of a box of 2.1 km",
            (),
            WORLD,
            within=1e-10,
        ),
        Inert(
            "bodies.*.shapes.*.pose.quaternion.*",
            "a rotation within a shape's symmetry, by which its corners are found in another order",
            ("swapped",),
            WORLD,
            within=1e-10,
        ),
    ),
)
