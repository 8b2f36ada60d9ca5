"""Gazebo: its physics library gz-physics with its engine dartsim, which is DART behind SDF.

Facts marked *measured*: gz-physics 5.1.0, libdart 6.12.1, libsdformat 12.3.0, as Debian 12 has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from simspec.contact import Rules
from simspec.dialects.gazebo import NO_VELOCITY_LIMITS, STOPS
from simspec.engines.gazebo import building
from simspec.engines.gazebo.readback import expected, inventory, neutral, read_back
from simspec.engines.gazebo.simulation import GazeboSimulation
from simspec.engines.kit import capabilities
from simspec.engines.kit.capabilities import (
    DEEP,
    FIXED_TIMESTEP,
    HOPS,
    NEAR_LIMIT,
    PREDICTED,
    PYRAMID,
    THRESHOLD,
    Capability,
    Deviation,
    Reason,
    coarse,
    read_deviations,
    unconverged,
)
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.refinements import (
    coupled,
    implicit_damping_armature,
    leans,
    native_implicit_damping,
    no_friction,
    only_static_planes,
)
from simspec.engines.kit.settings import Setting, SettingGroup
from simspec.engines.kit.simulated import outside_constraints
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.support import classes, features
from simspec.support.declarations import (
    EXACT,
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    for_each,
    never,
    shape_kinds,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.types import World

# Contact that Gazebo's DART 6.12 computes approximately. ``tools/deviations.py`` measures the tables of contact of several
# bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1, and ratios of masses of 1 to 1000.

_PGS = "contact_solver=pgs"
_CREEPS = unconverged("DART's pgs solver")
_FEW = coarse("slip, clamp or spin")

_NOT_CONVERGED = (
    "With `contact_solver: pgs`, normal and friction forces of several bodies in contact do not converge. Use dantzig"
)
_PAGE = "see docs/engines/gazebo.md"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("rod* clamp* jam* squeeze* pile* cross* carrier slide-spin", capabilities.PRESSED, bounces=True),
        Reason("rod-slips pile-slips slide-spin", PYRAMID, cone="elliptic"),
        Reason("stack*", capabilities.SWEEPS, _PGS),
        Reason("stack-slides* stack-stays*", NEAR_LIMIT),
        Reason("stack*", DEEP),
        Reason("rod clamp jam* squeeze* pile", _CREEPS, _PGS),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "gazebo",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            f"{_NOT_CONVERGED} with a small timestep; {_PAGE}",
            "with pgs heavy bodies sink into light ones",
        ),
        Feature.EVEN_PRESSURE: (
            f"{_NOT_CONVERGED}; {_PAGE}. With both solvers fingers bounce off bodies with restitution",
            "with pgs boxes that slip between fingers turn",
        ),
        Feature.SELF_LOCKING: (
            f"{_NOT_CONVERGED} with a small timestep; {_PAGE}",
            "with pgs a self-locking clamp slips",
        ),
    },
)
SWEEPS = Refinement(Level.APPROXIMATE, f"{_NOT_CONVERGED}; {_PAGE}", short="with pgs clamps creep")

# Shapes that DART's detector ``ode`` gives one point of contact where they touch along a line or on a face. gz-physics makes
# a box of a plane.

APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): "capsules",
    ("cylinder", "cylinder"): "cylinders",
}
"""Of cylinders, and the other shapes."""
ON_BOXES = "capsules have one contact point on boxes and planes, also along a line, on which they rock"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    others = " and ".join(pairs.values())
    text = (
        f"libccd computes contacts of cylinders with {others} to 1 µm in depth, may miss smaller overlaps, and has one "
        "point along a line or on a face, on which they rock"
    )
    standing = ". Cylinders that stand on each other are exact" if ("cylinder", "cylinder") in pairs else ""
    return Refinement(
        Level.APPROXIMATE,
        f"{text}{standing}; {_PAGE}",
        short=f"a cylinder and {others} touch in one point, also along a line",
    )


def cylinders(world: World) -> Refinement | None:
    """The approximations of cylinders in a world; None where there are none."""
    met = {pair: how for pair, how in APPROXIMATE.items() if pair in meeting_kinds(world)}
    return _refinement(met) if met else None


def capsules(world: World) -> Refinement | None:
    """The approximation of capsules in a world: points and depths are exact, but a line or a face has one of them."""
    met = {("box", "capsule"), ("capsule", "plane")} & set(meeting_kinds(world))
    return Refinement(note=ON_BOXES) if met else None


CASES = (_refinement(APPROXIMATE),)
"""Of cylinders, where all of these pairs may meet, for tables."""

TINY_FRICTION = 0.001
"""DART treats a friction coefficient of up to this as zero."""
_NO_TORQUE = "DART's contacts have one normal and two tangential constraints, and transmit no torque"
_NO_POSITIONS = "gz-physics' dartsim has velocity motors only, which simspec does not use"
_LIVELY = "DART lets bodies of high restitution hop without end, since every bounce adds e g dt. Pushed bodies slide"
_LATE = "Gazebo stops sliders late between the axes of the pyramid, where its friction is 1.41 times that along them"


_TINY = Refinement(
    Level.APPROXIMATE,
    f"DART treats friction coefficients up to {TINY_FRICTION} as zero",
    short=f"friction coefficients up to {TINY_FRICTION} are treated as zero",
)


def _friction(world: World) -> Refinement | None:
    """Friction below DART's least, and by pgs where it can change a normal force, is accepted by name."""
    if any(pair.collide and 0.0 < pair.friction <= TINY_FRICTION for pair in world.contact.pairs):
        return _TINY
    return SWEEPS if ("contact_solver", "pgs") in world.options(Gazebo.NAME).settings and leans(world) else None


class Gazebo(WorldEngine[GazeboSimulation]):
    """gz-physics' dartsim: DART's Featherstone dynamics (semi-implicit Euler) and its boxed solvers."""

    NAME: ClassVar[str] = "gazebo"
    TITLE: ClassVar[str] = "Gazebo"
    DIALECT: ClassVar[str] = "gazebo"
    DISTRIBUTION: ClassVar[str] = ""
    EXTRA: ClassVar[str] = ""
    NEEDS: ClassVar[Needs] = building.NEEDS
    CLASHES: ClassVar[Mapping[str, str]] = {
        "dartpy": "each brings a version of libdart, whose symbols one takes for its own (a segmentation fault, measured)"
    }
    RULES: ClassVar[Rules] = Rules("min", "product")
    LAYERS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.TIMESTEP: FIXED_TIMESTEP,
        Capability.NATIVE_CONTROLLERS: _NO_POSITIONS,
        Capability.FOREIGN_FILES: "simspec does not load users' SDF files through gz-physics yet",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("DART"),
        **shape_kinds("Gazebo's DART", ("sphere", "box", "cylinder", "capsule", "plane")),
        Feature.DRY_FRICTION: EXACT,
        Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS,
        Feature.LIMIT_POSITION: STOPS,
        Feature.LIMIT_VELOCITY: NO_VELOCITY_LIMITS,
        **for_each(classes.explicit("DART"), *features.DAMPERS_AND_SPRINGS),
        Feature.DAMPING_IMPLICIT: native_implicit_damping(TITLE, balls=False),
        Feature.ARMATURE: implicit_damping_armature(
            TITLE, "simspec substitutes implicit damping and an opposite effort for armature at every step"
        ),
        **classes.NOT_IN_WORLD_JSON,
        Feature.SHAPE_PLANE: exact(
            "gz-physics represents a static plane by the top of a box of 2.1 km, beyond which nothing bears",
            refine=only_static_planes("gz-physics represents planes by boxes, and {name} would move as a box"),
        ),
        Feature.SHAPE_CYLINDER: exact(
            "DART represents a flat face by the corners of an octagon around the circle", refine=cylinders, cases=CASES
        ),
        Feature.SHAPE_CAPSULE: exact(refine=capsules),
        Feature.SHAPE_MESH: classes.CUSTOM_HULLS,
        Feature.FRICTION: exact(
            "DART treats friction coefficients up to 0.001 as zero. Accept `material.friction` for them",
            refine=_friction,
            cases=(_TINY, SWEEPS),
        ),
        **COUPLED,
        **for_each(classes.LAYERS, Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
        Feature.RESTITUTION: approximate(
            classes.PREDICTED_RESTITUTION,
            short="no bounce at less than 0.1 m/s after the impact; above that e is slightly too large",
        ),
        Feature.RESTITUTION_THRESHOLD: classes.FIXED_THRESHOLD,
        **for_each(never(_NO_TORQUE), *features.MOMENTS),
        Feature.HARDNESS_COMMON: via_api(
            "simspec raises the maximum velocity of DART's error reduction, which then removes 0.01 of an overlap in each step"
        ),
        **for_each(
            never("DART's contacts share one set of hardness parameters, which simspec sets to the common law"),
            *features.COMPLIANCES,
            Feature.HARDNESS_PAIRS,
        ),
        Feature.HARDNESS_NATIVE: never(
            "simspec replaces DART's default hardness, which removes overlaps at 0.01 m/s at most"
        ),
        Feature.CONE_ELLIPTIC: approximate(
            classes.CIRCUMSCRIBED,
            no_friction,
            classes.CIRCUMSCRIBED_SHORT,
        ),
        Feature.CONE_PYRAMID_INSCRIBED: never("Gazebo's DART has the circumscribed pyramid only"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(
            "simspec repeats DART's Dantzig solver with friction bounded by the normal forces of the previous pass"
        ),
        **for_each(via_api("simspec's collision filter replaces gz-physics' bit masks"), *features.FILTERS),
        Feature.CONTROL_NATIVE: never(_NO_POSITIONS),
        **outside_constraints(TITLE),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "contact_solver": Setting(
            "dantzig",
            "dantzig: gz-physics' default; DART falls back to pgs where it fails. It bounds friction by the normal "
            "forces of the frictionless problem, so simspec's extension in C++ solves each group of touching bodies "
            "in up to 20 passes, each bounded by the normal forces of the pass before, until they agree within 0.1 %; "
            "a run counts the steps that end earlier. pgs: sweeps over the constraint rows, approximate for stacks "
            "(see docs/engines/gazebo.md).",
            ("dantzig", "pgs"),
            group=SettingGroup.SOLVER,
        )
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation("restitution", 0.08, PREDICTED, relative=False, timestep=0.008),
        Deviation("restitution", 0.16, PREDICTED, relative=False, timestep=0.016),
        Deviation("threshold", 1.02, THRESHOLD, relative=False),
        Deviation("rest", 0.16, HOPS, relative=False, timestep=0.016),
        Deviation("rest", 0.005, _LIVELY, relative=False, timestep=0.008, restitution=0.8),
        Deviation("stick", 0.18, _LIVELY, relative=False, timestep=0.008, restitution=0.8),
        *(Deviation(name, 0.065, _LATE, friction=1.0, timestep=0.008) for name in ("stop", "stop-oblong")),
        *(Deviation(name, 0.125, _LATE, friction=1.0, timestep=0.016) for name in ("stop", "stop-oblong")),
        *(Deviation(name, 0.415, PYRAMID, friction_cone="elliptic") for name in ("push", "push-oblong")),
        *(Deviation(name, 0.36, PYRAMID, friction_cone="elliptic") for name in ("stop", "stop-oblong")),
        # slips of 1.6 times what friction takes, 39° from an axis: 0.435, and DART's own 2.6 % on top
        Deviation("oblique", 0.46, PYRAMID, friction_cone="elliptic"),
    )
    ACCEPTED_CONES: ClassVar[Mapping[str, str]] = {"elliptic": "pyramid-circumscribed"}
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "simspec's filter has classes of shapes, and merges groups with materials"
    }

    PARTS: ClassVar[Parts[GazeboSimulation]] = Parts(GazeboSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        building.library()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
