"""ODE: bodies and joints of the Open Dynamics Engine, stepped so that its joints move as their coordinates do.

Facts marked *measured*: ODE 0.16.2 in double precision, as Debian builds it (with trimeshes and libccd).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.efforts import outside_constraints
from simspec.engines.kit.refinements import leans, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup, of_mobility
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.engines.ode import building
from simspec.engines.ode.approximations import (
    CASES,
    COUPLED,
    DEVIATIONS,
    JOINTS,
    OVERLOOKED,
    SWEEPS,
    SWITCH,
    capsules,
    cylinders,
)
from simspec.engines.ode.inventory import expected, inventory, neutral
from simspec.engines.ode.readback import read_back
from simspec.engines.ode.simulation import OdeSimulation
from simspec.support import classes, features
from simspec.support.declarations import (
    Attempt,
    Refinement,
    Table,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import World

_PASSES = exact(
    "simspec solves each step several times, with friction bounded by the normal forces of the previous pass; see "
    "docs/engines/ode.md"
)
_MOMENTS = (
    "simspec adds a motor with target velocity zero at every contact "
    "point, bounded by the normal force of the previous solution"
)
_MOTORS = "ODE's motors control velocity, and simspec does not use them as controllers"


def _settled(world: World) -> Refinement | None:
    """Friction by quick-step is accepted by name where it can change a normal force."""
    return SWEEPS if ("solver", "quick-step") in world.options(Ode.NAME).settings and leans(world) else None


LARGEST_MASS_RATIO = 5e6
"""Of what joints connect, up to which the mass matrix that acts is the world's to 1e-9: at 1e7 it is 1e-9 off, at 1e9 6e-8, and
at 1e12 6e-5 (measured, for ratios of masses and of moments)."""


def _light_links(world: World) -> Refinement | None:
    """Not supported where joints connect what is light out of all proportion: ODE's joints are constraints between bodies."""
    groups = rigid_groups(world)
    for bodies in trees(world).values():
        masses: dict[str, float] = {}
        moments: dict[str, float] = {}
        for body in bodies:
            if (group := groups[body.name]) != "world":
                masses[group] = masses.get(group, 0.0) + body.inertial.mass
                moments[group] = moments.get(group, 0.0) + sum(body.inertial.inertia[:3])
        for by, unit in ((masses, "kg"), (moments, "kg m²")):
            by = {group: value for group, value in by.items() if value > 0.0}
            if by and (ratio := max(by.values()) / min(by.values())) > LARGEST_MASS_RATIO:
                light, heavy = min(by, key=by.__getitem__), max(by, key=by.__getitem__)
                return unsupported_if(
                    f"ODE loses digits in proportion to the ratio of jointed bodies, here {ratio:.1g}: {light!r} has "
                    f"{by[light]:.3g} {unit}, {heavy!r} {by[heavy]:.3g}. Increase that of {light!r}, or fix it to its parent"
                )
    return None


class Ode(WorldEngine[OdeSimulation]):
    """ODE's worlds, by dWorldStep or dWorldQuickStep."""

    NAME: ClassVar[str] = "ode"
    TITLE: ClassVar[str] = "ODE"
    DIALECT: ClassVar[str] = "ode"
    DISTRIBUTION: ClassVar[str] = ""
    EXTRA: ClassVar[str] = ""
    NEEDS: ClassVar[Needs] = building.NEEDS
    RULES: ClassVar[Rules] = Rules("table", "table", "table", "table", "table")
    LAYERS: ClassVar[bool] = False
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.NATIVE_CONTROLLERS: _MOTORS,
        Capability.FOREIGN_FILES: "ODE reads no files",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("ODE"),
        **exactly(*features.RESTITUTIONS, Feature.HARDNESS_COMMON, *features.FILTERS),
        **JOINTS,
        Feature.INERTIA: exact(
            f"ODE is exact for trees whose masses, and moments, differ by a factor below {LARGEST_MASS_RATIO:g}",
            refine=_light_links,
        ),
        **shape_kinds("ODE", ("sphere", "box", "capsule")),
        Feature.JOINT_SEVERAL: classes.NO_MASSLESS,
        Feature.LIMIT_POSITION: exact("ODE stops joints within the step in which they reach a limit"),
        **for_each(
            via_api("ODE has no springs or dampers in joints; simspec applies explicit efforts before each step"),
            *features.DAMPERS_AND_SPRINGS,
        ),
        Feature.DRY_FRICTION: exact(classes.ZERO_VELOCITY_MOTOR),
        Feature.ARMATURE: exact(
            "simspec adds a motor at the present velocity with softness dt/armature, which ODE solves with contact"
        ),
        **for_each(
            classes.unwritten(TITLE, Attempt.READ_BACK),
            *(Feature.HARDNESS_NATIVE, Feature.HARDNESS_PAIRS),
        ),
        Feature.SHAPE_CYLINDER: exact(
            "ODE misses some overlaps of cylinders with boxes. Accept `shape.cylinder` where cylinders may touch cylinders or "
            "capsules, along a line in one point; see docs/engines/ode.md",
            refine=cylinders,
            cases=CASES,
        ),
        Feature.SHAPE_CAPSULE: exact(refine=capsules),
        Feature.SHAPE_PLANE: static_planes("ODE's planes are static, and {name} moves"),
        Feature.SHAPE_MESH: classes.CUSTOM_HULLS,
        **classes.NOT_IN_WORLD_JSON,
        Feature.FRICTION: dataclasses.replace(classes.LAW_AT_CONTACTS, refine=_settled, cases=(SWEEPS,)),
        Feature.FRICTION_PAIRS: classes.LAW_AT_CONTACTS,
        **for_each(exact(_MOMENTS), *features.MOMENTS),
        **COUPLED,
        Feature.HARDNESS_TIME_CONSTANT: never("ODE's contact stiffness in N/m does not scale with mass"),
        Feature.HARDNESS_STIFFNESS: classes.unwritten(TITLE, Attempt.CONTACT_PROBES),
        **for_each(_PASSES, *features.CONES),
        Feature.CONTROL_NATIVE: never(_MOTORS),
        **outside_constraints(TITLE),
        Feature.SUM_DRY_FRICTION: never("ODE's motors act on single joints only, not on sums of joint positions"),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "solver": Setting(
            "step",
            "step: dWorldStep, a direct solver; its time grows with the cube of the constraint rows of connected "
            "bodies. It bounds friction by the normal forces of the frictionless problem, so simspec solves each step "
            "in passes, with bounds from the normal forces of the last pass. quick-step: dWorldQuickStep, an "
            "iterative solver, with pyramids in one pass (see docs/engines/ode.md).",
            ("step", "quick-step"),
            group=SettingGroup.SOLVER,
        ),
        "iterations": Setting(
            100,
            "Number of iterations of quick-step in a step. Fewer lose energy in piles (see docs/engines/ode.md).",
            minimum=1,
            needs=("solver", ("quick-step",)),
            group=SettingGroup.ACCURACY,
            finer=2000,
        ),
        SWITCH: Setting(
            False,
            "Integrate as other programs with ODE do: ODE's gyroscopic torques, rotations and error reduction (0.2), "
            "in place of simspec's projection of the bodies onto their joints before every step. The spec must then "
            "accept the joints by name; L6 reports the deviation from the exact motion, and certificates are not "
            "valid.",
            only_with=SWITCH,
            group=SettingGroup.ROTATION,
        ),
        "softness": Setting(
            1e-10,
            "soft_cfm and slip of ODE's contacts (m/(N s)). With 0, dWorldStep fails on redundant points and leaves "
            "out friction. simspec repeats a step that fails, with slightly different velocities at the contact "
            "points (see docs/engines/ode.md).",
            minimum=0.0,
            at_most=of_mobility,
            group=SettingGroup.SOFTNESS,
        ),
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = DEVIATIONS
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "simspec's callback selects the pairs that may touch: ODE has no groups"
    }

    PARTS: ClassVar[Parts[OdeSimulation]] = Parts(OdeSimulation, read_back, inventory, neutral, expected)

    @classmethod
    def overlooks(cls, world: World) -> frozenset[tuple[str, str]]:
        return frozenset(OVERLOOKED)

    @classmethod
    def prepare(cls) -> None:
        building.library()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
