"""Newton: trees of rigid bodies in single precision on the processor, by its solver Steel with the common law of contact."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from simspec.contact import Rules
from simspec.engines.kit.capabilities import (
    DEEP,
    JAMMED,
    SINGLE,
    SPRING_IN_SINGLES,
    SWEEPS,
    Capability,
    Deviation,
    NativeLaw,
    Reason,
    read_deviations,
    unconverged,
)
from simspec.engines.kit.refinements import (
    coupled,
    met_approximately,
    met_exactly,
    near_links,
    some_effort,
    static_planes,
)
from simspec.engines.kit.servos import implicit_spring
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.engines.kit.world_simulation import Parts, TrackingEngine
from simspec.engines.newton.building import imported
from simspec.engines.newton.readback import expected, inventory, neutral, read_back
from simspec.engines.newton.simulation import NewtonSimulation
from simspec.support import classes, features
from simspec.support.declarations import Attempt, Table, exact, exactly, for_each, never, shape_kinds, via_api
from simspec.support.features import Feature

# Contact of several bodies. ``tools/deviations.py`` measures the table at 1 ms, frictions of 0.05 to 1.2, restitutions of
# 0 to 1, and ratios of masses of 1 to 1000.

_UNEVEN = unconverged("Newton's solver")
DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (Reason("stack", DEEP, "warm_start=true"), Reason("stack*", SWEEPS), Reason("jam*", JAMMED), Reason("*", _UNEVEN)),
)
COUPLED: Table = coupled(
    "newton",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: classes.HEAVY_ON_LIGHT,
        Feature.SELF_LOCKING: classes.JAMMED,
        Feature.EVEN_PRESSURE: (
            "Newton's sweeps end before normal and friction forces have converged: a box that slips between fingers turns. "
            "Raise `iterations` to reduce it; see docs/engines/newton.md",
            "boxes that slip between fingers turn",
        ),
    },
)

APPROXIMATE = dict.fromkeys(
    (("box", "cylinder"), ("cylinder", "cylinder"), ("cylinder", "mesh")),
    "Newton's normals at curved sides are up to 0.05 rad off",
)
"""Newton searches contacts of these kinds (MPR, GJK) in single precision; errors of all kinds are in docs/engines/newton.md."""
ROUND = ("plane", "sphere", "capsule")
"""Kinds that touch ellipsoids exactly; coal has no exact distances of others to ellipsoids."""
ELLIPSOIDS = functools.partial(met_exactly, "ellipsoid", ROUND, "Newton's contacts of the two are not measured")


LARGEST_RATIO = 33.0
"""Of light links far from the root (:func:`near_links`): times the round-off of singles that is the proof's tolerance of a mass
matrix. At 26 motion is at the round-off, at 437 it is 11 times that after 2 s (measured)."""

_NO_FRICTION = "Newton's solver has dry friction of joints on graphics processors alone"
_NO_LOOPS = (
    "simspec's constraint forces, computed outside Newton, are 3e-4 rad/s off after 60 steps in single precision"
)


class Newton(TrackingEngine[NewtonSimulation]):
    """Newton's articulations, by its solver Steel."""

    NAME: ClassVar[str] = "newton"
    TITLE: ClassVar[str] = "Newton"
    DIALECT: ClassVar[str] = "newton"
    DISTRIBUTION: ClassVar[str] = "newton"
    EXTRA: ClassVar[str] = "newton"
    PRECISION: ClassVar[str] = SINGLE
    COMPILING: ClassVar[float] = 150.0
    RULES: ClassVar[Rules] = Rules("mean", "mean", most_restitution=1.0)
    LAYERS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.DRY_FRICTION_OFF: _NO_FRICTION,
        Capability.FOREIGN_FILES: "simspec does not use Newton's importers of robot files",
    }
    NATIVE_LAW: ClassVar[NativeLaw | None] = SPRING_IN_SINGLES
    SUPPORT: ClassVar[Table] = {
        **classes.driven(TITLE),
        **exactly(Feature.FRICTION, *features.FILTERS, Feature.HARDNESS_COMMON, Feature.CONE_ELLIPTIC),
        **exactly(Feature.CARRIED_FRICTION, Feature.IMPACT_FRICTION),
        Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS,
        **COUPLED,
        **shape_kinds(TITLE, ("sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh")),
        Feature.INERTIA: near_links(TITLE, LARGEST_RATIO),
        Feature.SHAPE_CYLINDER: met_approximately(
            APPROXIMATE,
            "Newton's cylinders are exact on planes, spheres and capsules. Accept `shape.cylinder` where they may touch other "
            "shapes",
            "normals of contacts at the curved sides of cylinders are up to 0.05 rad off",
        ),
        Feature.SHAPE_ELLIPSOID: exact(
            f"simspec supports contacts of ellipsoids with some kinds only: {', '.join(ROUND)}", refine=ELLIPSOIDS
        ),
        Feature.SHAPE_PLANE: static_planes("simspec passes only static planes to Newton, and {name} moves"),
        Feature.LIMIT_POSITION: exact("Newton stops joints within the step in which they reach a limit"),
        **exactly(Feature.DAMPING, Feature.BALL_DAMPING, Feature.ARMATURE, Feature.BALL_ARMATURE),
        Feature.DAMPING_IMPLICIT: exact(classes.AS_ARMATURE),
        **for_each(
            via_api("Newton's solver leaves springs out; simspec applies explicit efforts before each step"),
            *(Feature.SPRING, Feature.BALL_SPRING),
        ),
        Feature.DRY_FRICTION: never(_NO_FRICTION),
        **for_each(classes.LAYERS, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION: exact(),
        Feature.RESTITUTION_THRESHOLD: exact("Newton has one restitution threshold for all pairs"),
        **for_each(never("Newton's contacts have torques on graphics processors alone"), *features.MOMENTS),
        **for_each(never("Newton has compliant contact on graphics processors alone"), *features.COMPLIANCES),
        Feature.HARDNESS_NATIVE: classes.unwritten(TITLE, Attempt.READ_BACK),
        Feature.HARDNESS_PAIRS: never("Newton has one hardness of contact"),
        **for_each(never("Newton bounds friction by a circular cone"), *features.PYRAMIDS),
        **classes.NOT_IN_WORLD_JSON,
        Feature.CONTROL_NATIVE: exact(implicit_spring("Newton's drives"), refine=some_effort(TITLE)),
        **for_each(never(_NO_LOOPS), *features.CONSTRAINTS),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "iterations": Setting(
            50,
            "Number of sweeps over all rows of a step. Newton begins each step anew, so that stacks move by the "
            "remaining error (see docs/engines/newton.md).",
            minimum=1,
            group=SettingGroup.ACCURACY,
            finer=1000,
        ),
        "warm_start": Setting(
            False,
            "Begin each step with the contact impulses of the step before: see docs/engines/newton.md.",
            only_with="warm_start",
            group=SettingGroup.ACCURACY,
        ),
    }
    KEEPS_CONTACTS: ClassVar[bool] = True  # with the setting warm_start
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = DEVIATIONS
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "static.inertial": "mass properties of bodies that cannot move have no effect in Newton, and simspec gives it others",
        "collision_group": "simspec gives Newton the pairs of shapes that may touch, and no groups",
    }

    PARTS: ClassVar[Parts[NewtonSimulation]] = Parts(NewtonSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        imported([]).newton.solvers.SolverSteel  # noqa: B018 - a module that is imported when it is first looked up

    def set_timestep(self, timestep: float) -> None:
        self._simulation.set_timestep(timestep)
