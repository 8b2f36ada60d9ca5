"""ODE: bodies and joints of the Open Dynamics Engine, stepped so that its joints move as their coordinates do.

Facts marked *measured*: ODE 0.16.2 in double precision, as Debian builds it (with trimeshes and libccd).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from simspec.contact import Rules
from simspec.engines.kit import capabilities
from simspec.engines.kit.capabilities import (
    UNKNOWN,
    Capability,
    Deviation,
    Reason,
    coarse,
    read_deviations,
    unconverged,
)
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.methods import IntegrationMethod, integration
from simspec.engines.kit.refinements import coupled, leans, static_planes
from simspec.engines.kit.settings import Setting, SettingGroup, of_mobility, resolve_settings
from simspec.engines.kit.simulated import outside_constraints
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.engines.ode import simulation
from simspec.engines.ode.readback import expected, inventory, neutral, read_back
from simspec.engines.ode.simulation import OdeSimulation
from simspec.support import classes, features
from simspec.support.declarations import (
    Attempt,
    Level,
    Refinement,
    Table,
    exact,
    exactly,
    for_each,
    never,
    not_yet,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import World

# Contact and motion that ODE 0.16.2 computes approximately. ``tools/deviations.py`` measures the tables of contact of several
# bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0 to 1, and ratios of masses of 1 to 1000.

_STEP, _QUICK = "solver=step", "solver=quick-step"
_CREEPS = unconverged("ODE's quick-step")
_FEW = coarse("slip, clamp or spin")
_PASSES_END = (
    "simspec ends its passes when friction is within 0.1 % of its law, which is up to 100 % for a "
    "body of a thousandth of the mass. More passes do not reduce it"
)

_NOT_CONVERGED = (
    "With `solver: quick-step`, normal and friction forces do not converge where several bodies are in contact. Use step; see "
    "docs/engines/ode.md"
)

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("stack*", capabilities.SWEEPS, _QUICK),
        Reason("stack-slides* stack-stays*", _PASSES_END),
        Reason("stack*", UNKNOWN),
        Reason("rod* clamp* jam* pile* carrier slide-spin", capabilities.BOUNCES, bounces=True),
        Reason("rod clamp jam* squeeze* pile*", _CREEPS, _QUICK),
        Reason("*", _FEW),
    ),
)
COUPLED: Table = coupled(
    "ode",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: (
            "With quick-step heavy bodies sink into light ones. With step, stacks move sideways at large "
            "timesteps, and bodies that slide under a load stop at a wrong distance; see "
            "docs/engines/ode.md",
            "with quick-step heavy bodies sink into light ones",
        ),
        Feature.EVEN_PRESSURE: (_NOT_CONVERGED, "with quick-step boxes that slip between fingers turn"),
        Feature.SELF_LOCKING: (_NOT_CONVERGED, "with quick-step a self-locking clamp creeps"),
    },
)
SWEEPS = Refinement(
    Level.APPROXIMATE, _NOT_CONVERGED, short="with quick-step piles creep, and slip too little where they should slip"
)

# Shapes with one point of contact along a line or on a face. ODE's cylinders touch cylinders and capsules by libccd's portal
# refinement, to 1 µm: smaller overlaps may be missed. In 60 random poses of each pair (0.003 to 3 m), depths are off by 1 µm
# at overlaps of 1e-4 of the size and by 20 % (median 0.4 %) at 1e-3, normals by 0.015 and 0.2 rad (median 6e-4). Cylinders
# that stand on each other have eight points, exact. Of parallel cylinders side by side the normal is 6 mrad off.

APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): "capsules",
    ("cylinder", "cylinder"): "cylinders",
}
"""Of cylinders, and the other shapes."""
OVERLOOKED: Mapping[tuple[str, str], str] = {
    (
        "box",
        "cylinder",
    ): "of 100 random overlaps of a tenth to a half of the smaller one's inner radius it overlooks 4 (of 144 "
    "six, in six draws of sizes; of spheres, capsules and other cylinders with cylinders none)",
}
"""Pairs of which ODE's own code misses some overlaps, as the same code in another engine does."""
BOX_AND_CAPSULE = "ODE computes one contact point of a box and a capsule along a line or on a face, on which they rock"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    others = " and ".join(pairs.values())
    text = (
        f"libccd computes contacts of cylinders with {others} to 1 µm in depth and with inaccurate normals, may miss "
        "smaller overlaps, and has one point along a line or on a face, on which they rock"
    )
    standing = ". Cylinders that stand on each other are exact" if ("cylinder", "cylinder") in pairs else ""
    return Refinement(
        Level.APPROXIMATE,
        f"{text}{standing}; see docs/engines/ode.md",
        short=f"cylinders touch {others} in one point, also along a line",
    )


def cylinders(world: World) -> Refinement | None:
    """The approximations of cylinders in a world; None without any."""
    met = {pair: how for pair, how in APPROXIMATE.items() if pair in meeting_kinds(world)}
    return _refinement(met) if met else None


def capsules(world: World) -> Refinement | None:
    """A note on capsules in a world: points and depths are exact, but a line or a face has one of them."""
    return Refinement(note=BOX_AND_CAPSULE) if ("box", "capsule") in meeting_kinds(world) else None


CASES = (_refinement(APPROXIMATE),)
"""Of cylinders, where all of these pairs may meet, for tables."""

# Motion by the steps of ODE, where a spec sets ``engines.ode.settings.native_motion``.

SWITCH = "native_motion"
NATIVE_STEPS = IntegrationMethod(
    "ODE's steps in maximal coordinates",
    1,
    "With `native_motion`, ODE integrates in maximal coordinates to first order, and corrects a fifth of the error of a "
    "joint in each step; see docs/engines/ode.md",
    requested=True,
)


def _method(world: World) -> IntegrationMethod | None:
    """Without the setting simspec moves bodies onto their joints before every step, which makes it semi-implicit Euler."""
    return NATIVE_STEPS if resolve_settings(Ode, world)[SWITCH] else None


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
    NEEDS: ClassVar[Needs] = simulation.NEEDS
    RULES: ClassVar[Rules] = Rules("table", "table", "table", "table", "table")
    LAYERS: ClassVar[bool] = False
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.NATIVE_CONTROLLERS: _MOTORS,
        Capability.FOREIGN_FILES: "ODE reads no files",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("ODE"),
        **exactly(*features.RESTITUTIONS, Feature.HARDNESS_COMMON, *features.FILTERS),
        **for_each(
            exact("simspec moves bodies onto their joints before every step"),
            *(Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_FREE),
        ),
        Feature.INTEGRATOR: integration(_method, NATIVE_STEPS),
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
        Feature.CONTROL_NATIVE: not_yet(_MOTORS, Attempt.BUILT_IN_CONTROLLER),
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
            "in place of simspec's projection of the bodies onto their joints before every step. It is a method of first "
            "order, proven in the limit of small timesteps.",
            only_with=SWITCH,
            usual=True,
            group=SettingGroup.INTEGRATION,
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
    def method(cls, world: World) -> IntegrationMethod | None:
        return _method(world)

    def set_timestep(self, timestep: float) -> None:
        self._simulation.set_timestep(timestep)
        if self._before is not None:
            self._before.set_timestep(timestep)

    @classmethod
    def overlooks(cls, world: World) -> frozenset[tuple[str, str]]:
        return frozenset(OVERLOOKED)

    @classmethod
    def prepare(cls) -> None:
        simulation.library()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
