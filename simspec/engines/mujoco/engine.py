"""MuJoCo: an MJCF file in, arrays out. Its settings and declarations; the simulation is in ``simulation.py``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from simspec.contact import Rules
from simspec.dialects.mujoco.sidecar import COULOMB, NATIVE
from simspec.engines.kit.capabilities import Deviation, NativeLaw, ServoLaw
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.methods import IntegrationMethod
from simspec.engines.kit.settings import COARSE, SHARE, ByPair, Setting, SettingGroup, of_thinnest, resolve_settings
from simspec.engines.mujoco import integrators
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS, CONTACT_SUPPORT, HEIGHT_FIELDS
from simspec.engines.mujoco.expectation import MujocoExpectation
from simspec.engines.mujoco.foreign import FOREIGN, FOREIGN_ADDITIONS, load
from simspec.engines.mujoco.inventory import expected_inventory
from simspec.engines.mujoco.joints import NATIVE as NATIVE_CONTROL
from simspec.engines.mujoco.joints import explicit_servos_hold
from simspec.engines.mujoco.readback import UNREADABLE
from simspec.engines.mujoco.simulation import MujocoSimulation, import_mujoco
from simspec.formats.mjcf.bodies import FRAME_SITE, GRAVCOMP, KINDS
from simspec.support import classes, features
from simspec.support.declarations import Table, approximate, exact, exactly, for_each, never, shape_kinds
from simspec.support.features import Feature
from simspec.world.types import EngineValue, ReadBack, World

# Solver settings, each with the reason for its default.

_RIGID = ByPair(("common",))
_SLIDING = ByPair(("common",), ("elliptic",), friction=True)
_SLIDING_ON_SPRINGS_TOO = ByPair(("common", "time-constant", "stiffness"), ("elliptic",), friction=True)
_CUSHIONED = ByPair(("common",), ("elliptic",), friction=True, inelastic=True)

SETTINGS: Mapping[str, Setting] = {
    "integrator": integrators.SETTING,
    "solver": Setting(
        "newton",
        "The constraint solver. newton solves MuJoCo's convex problem to round-off in a few iterations; cg and "
        "pgs approach it. pgs for free balls without friction, for which it is faster at equal accuracy.",
        ("newton", "cg", "pgs"),
        group=SettingGroup.SOLVER,
        frictionless="pgs",
        frictionless_unless=("friction", "coulomb"),
    ),
    "iterations": Setting(
        100,
        "Maximum number of solver iterations in a step; Newton needs far fewer. MuJoCo's default.",
        minimum=1,
        group=SettingGroup.ACCURACY,
        finer=1000,
    ),
    "ls_iterations": Setting(
        50,
        "Maximum number of line search iterations. MuJoCo's default.",
        minimum=1,
        needs=("solver", ("newton", "cg")),
        group=SettingGroup.ACCURACY,
        finer=500,
    ),
    "tolerance": Setting(
        1e-8,
        "The solver ends when the improvement is below this. MuJoCo's default. It is relative to the heaviest "
        "bodies: smaller with kinematic bodies, constraints or dry friction in joints, and for balls at rest "
        "with pgs (see docs/engines/mujoco.md).",
        minimum=0.0,
        maximum=1.0,
        group=SettingGroup.ACCURACY,
        finer=1e-14,
        frictionless=1e-10,
        kinematic=1e-14,
        light=1e-14,
    ),
    "ls_tolerance": Setting(
        0.01,
        "The line search ends below this fraction of the gradient. MuJoCo's default.",
        minimum=0.0,
        maximum=1.0,
        needs=("solver", ("newton", "cg")),
        group=SettingGroup.ACCURACY,
        finer=1e-4,
    ),
    "friction": Setting(
        NATIVE,
        "native: MuJoCo's friction, which leaves out most of the friction of an impact, since it takes slip "
        "back at friction_rate. The spec must accept contact.friction.impact, and contact.friction.carried for "
        "bodies on turning carriers. coulomb: Coulomb's law in impacts and slides, by a loop around MuJoCo's "
        "solver, at additional cost; a run counts the steps that do not converge (docs/records/contact.md). "
        "friction_rate, friction_share and friction_cushion apply to native only.",
        (NATIVE, COULOMB),
        group=SettingGroup.FRICTION,
    ),
    "impratio": Setting(
        1000.0,
        "Stiffness of friction relative to the normal direction, which friction_cushion makes soft. Creep "
        "below the friction limit decreases with it.",
        minimum=1e-6,
        group=SettingGroup.FRICTION,
    ),
    "high_impratio": Setting(
        1e7,
        "impratio of worlds with friction in compliant contact, and the maximum of it with torsional or "
        "rolling friction c: MuJoCo makes friction as soft as its contact, and moments softer by (μ/c)². For "
        "moments impratio is raised to 0.01 (μ/c)² (0.5 ms/dt)²; higher values let piled and squeezed bodies "
        "slip (see docs/engines/mujoco.md).",
        minimum=1e-6,
        group=SettingGroup.FRICTION,
    ),
    "noslip_iterations": Setting(
        0,
        "Sweeps after the solver that remove slow slip. 0: none, since they leave the solver's optimum.",
        minimum=0,
        group=SettingGroup.FRICTION,
    ),
    "multiccd": Setting(
        True,
        (
            "Compute several contact points between shapes that meet in a face (the default of MuJoCo 4, off in "
            "MuJoCo 3)."
        ),
        group=SettingGroup.GEOMETRY,
    ),
    "ccd_tolerance": Setting(
        1e-6,
        "The search for the overlap of two convex shapes ends when the improvement is below this (m). MuJoCo's "
        "default; it misjudges a few states of a cylinder on another, which 1e-8 avoids at additional cost "
        "(see docs/engines/mujoco.md).",
        minimum=1e-12,
        at_most=of_thinnest(SHARE),
        group=SettingGroup.ACCURACY,
        finer=1e-8,
    ),
    "warmstart": Setting(True, "Begin each solve at the solution of the last step.", group=SettingGroup.ACCURACY),
    "island": Setting(
        False,
        (
            "Solve groups of bodies without mutual contact separately. Off, since its results differ between "
            "versions of MuJoCo."
        ),
        needs=("sleeping", (False,)),
        group=SettingGroup.SOLVER,
    ),
    "arena": Setting(
        0,
        "Memory (MiB) for the contacts, constraints and solver of a state. 0: MuJoCo's default, or in worlds "
        "of more than 2,500 velocities an estimate from bodies, shapes and friction, since the default grows "
        "with the square of the bodies. A run ends with an error when it is too small; the motion does not "
        "depend on it.",
        minimum=0,
        maximum=2**20,
        only_with="arena",
        group=SettingGroup.BOUNDS,
    ),
    "sleeping": Setting(
        False,
        "Exclude free rigid bodies at rest from the simulation until a contact wakes them (MuJoCo 4; enables island).",
        only_with="sleeping",
        group=SettingGroup.SLEEPING,
    ),
    "sleep_tolerance": Setting(
        1e-5,
        "With sleeping: the speed (m/s, angular times length) below which a body falls asleep after ten steps.",
        minimum=0.0,
        maximum=0.01,
        only_with="sleeping",
        needs=("sleeping", (True,)),
        group=SettingGroup.SLEEPING,
    ),
    "contact_error_reduction": Setting(
        0.01,
        "Fraction β of an overlap that each step removes; 0.01 is the common law of the core engines. Higher "
        "values separate overlapping bodies at β times overlap over timestep.",
        minimum=0.0,
        maximum=1.0,
        group=SettingGroup.ERROR_REDUCTION,
        by_pair=_RIGID,
    ),
    "contact_impedance": Setting(
        0.999,
        "Fraction of its reference acceleration that a contact reaches. Higher values reduce the depth at "
        "rest, and solve worse.",
        minimum=1e-4,
        maximum=0.9999,
        group=SettingGroup.SOFTNESS,
        finer=0.9999,
        by_pair=_RIGID,
    ),
    "friction_rate": Setting(
        100.0,
        "Rate (1/s) at which friction removes slip that it could stop at once, at most friction_share in a "
        "step. Higher values throw sliding bodies up; lower values stop them too late (see "
        "docs/engines/mujoco.md).",
        minimum=1e-3,
        needs=("friction", (NATIVE,)),
        group=SettingGroup.FRICTION,
        by_pair=_SLIDING,
    ),
    "friction_share": Setting(
        0.3,
        "Maximum fraction of a slip that friction removes in one step. Where friction cannot stop a slip, "
        "MuJoCo's associated cone raises the normal velocity by μ times the requested change: higher values "
        "let sliding bodies hop, lower values let bodies on moving carriers slip (see docs/engines/mujoco.md).",
        minimum=1e-3,
        maximum=1.0,
        needs=("friction", (NATIVE,)),
        group=SettingGroup.FRICTION,
        by_pair=_SLIDING_ON_SPRINGS_TOO,
    ),
    "friction_cushion": Setting(
        1e-4,
        "Depth (m) over which a contact with friction and without restitution becomes rigid. It absorbs the "
        "lift of MuJoCo's friction, so that sliding bodies do not hop; bodies at rest lie deeper (see "
        "docs/engines/mujoco.md). 0: none.",
        minimum=0.0,
        maximum=0.1,
        at_most=of_thinnest(COARSE),
        depth=True,
        needs=("friction", (NATIVE,)),
        group=SettingGroup.SOFTNESS,
        finer=0.0,
        by_pair=_CUSHIONED,
    ),
    "explicit_pairs_limit": Setting(
        5000,
        "Maximum number of explicit pairs of shapes with friction, which alone have a friction_rate. Beyond "
        "the limit simspec writes no pair, and sliding bodies hop.",
        minimum=0,
        group=SettingGroup.FRICTION,
    ),
    "limit_error_reduction": Setting(
        0.01,
        (
            "Fraction of a joint limit's violation that each step removes; as for contact, so that a stop does "
            "not bounce."
        ),
        minimum=0.0,
        maximum=1.0,
        group=SettingGroup.JOINTS,
    ),
    "limit_impedance": Setting(
        0.999,
        "As contact_impedance, for joint limits.",
        minimum=1e-4,
        maximum=0.9999,
        group=SettingGroup.JOINTS,
        finer=0.9999,
    ),
    "dry_friction_impedance": Setting(
        0.9999,
        "As contact_impedance, for dry friction in joints, whose creep decreases with it.",
        minimum=1e-4,
        maximum=0.9999,
        group=SettingGroup.JOINTS,
    ),
}

EQUALITIES = (
    "simspec solves MuJoCo's equality constraints about three times in a step, each time with the remaining "
    "error as reference"
)

_LATE = (
    "MuJoCo stops joints inelastically, but one step late: they pass a limit by up to v dt, and return by "
    "limit_error_reduction of that in each step"
)
_CREEPS = (
    "MuJoCo's dry friction is soft: a joint at rest creeps at up to 1e-4 dt times the acceleration that it resists"
)


class MuJoCo(MujocoSimulation):
    """MuJoCo's semi-implicit Euler in generalised coordinates, with its convex contact solver.

    Every quantity of two shapes is the larger of their numbers; explicit pairs of shapes override both. Contact is one
    constraint law for all pairs (see :class:`MujocoDialect`). MuJoCo's friction cone is associated (convex): sliding bodies are
    lifted. On the cushion of frictional pairs that lift stays below 0.1 mm at 1 m/s and μ = 0.5; at 5 m/s and μ = 1 bodies hop
    by 3 to 4 mm. A body at rest under load creeps, 1.7e-6 m/s at 60 % of the limit, and of an impact's friction 80 to 90 % is
    missing (measured). The setting ``friction: coulomb`` has neither (``coulomb.py``).
    """

    NAME: ClassVar[str] = "mujoco"
    TITLE: ClassVar[str] = "MuJoCo"
    DIALECT: ClassVar[str] = "mujoco"
    DISTRIBUTION: ClassVar[str] = "mujoco-core"
    OTHER_DISTRIBUTIONS: ClassVar[tuple[str, ...]] = ("mujoco",)
    FORMER_DISTRIBUTIONS: ClassVar[Mapping[str, str]] = {"<4": "mujoco"}
    OLDEST: ClassVar[str] = "3.3.6"  # flags for springs and for dampers; until then one for both
    EXTRA: ClassVar[str] = "mujoco"
    RULES: ClassVar[Rules] = Rules("max", "max", "max", "max", "same")
    LAYERS: ClassVar[bool] = False
    FOREIGN: ClassVar[Mapping[str, Reads]] = FOREIGN
    FOREIGN_ADDITIONS: ClassVar[Mapping[str, EngineAddition]] = FOREIGN_ADDITIONS
    NATIVE_LAW: ClassVar[NativeLaw | None] = NativeLaw(ServoLaw.EXPLICIT_SPRING, accuracy=1e-13)
    SUPPORT: ClassVar[Table] = {
        **classes.driven("MuJoCo"),
        **exactly(
            *(Feature.JOINT_SEVERAL, *features.DAMPERS_AND_SPRINGS, *features.ARMATURES, Feature.FREE_DAMPING),
            *(Feature.SHAPE_MARGIN, Feature.FRICTION, Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS),
            Feature.TOUCHING_PAIRS,
        ),
        **shape_kinds("MuJoCo", KINDS),
        Feature.SHAPE_HEIGHTFIELD: HEIGHT_FIELDS,
        Feature.LIMIT_POSITION: approximate(
            _LATE,
            short="a joint passes its limit by up to one step's motion before it stops",
        ),
        Feature.BALL_LIMIT: approximate(
            _LATE,
            short="a ball joint passes its largest angle by up to one step's motion before it stops",
        ),
        Feature.DRY_FRICTION: approximate(
            _CREEPS,
            short="a joint at rest by dry friction creeps: by 1e-7 m/s at 1 ms and 1 m/s²",
        ),
        Feature.TREE_DEPTH: never(
            "MuJoCo's XML reader accepts at most 500 nested elements, which are 496 bodies in a chain"
        ),
        Feature.INTEGRATOR: integrators.SUPPORT,
        Feature.DAMPING_IMPLICIT: integrators.IMPLICIT_DAMPING,
        Feature.GRAVITY_SCALE: exact(GRAVCOMP),
        Feature.FLUID: exact(
            "MuJoCo computes fluid forces from density, viscosity and wind, on boxes of equal inertia"
        ),
        Feature.CONTROL_NATIVE: exact(NATIVE_CONTROL, refine=explicit_servos_hold),
        **CONTACT_SUPPORT,
        **for_each(exact(EQUALITIES), *features.CONSTRAINTS),
        Feature.FRAME: exact(FRAME_SITE),
        Feature.SUM: exact("simspec writes a fixed tendon, whose spring and damper are explicit in time"),
        Feature.SUM_DRY_FRICTION: approximate(
            _CREEPS,
            short="a sum at rest by dry friction creeps: by 1e-7 m/s at 1 ms and 1 m/s²",
        ),
        Feature.SUM_LIMITS: approximate(
            _LATE,
            short="a sum passes its limit by up to one step's motion before it stops",
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = SETTINGS
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = CONTACT_DEVIATIONS
    HULL_PRECISION: ClassVar[float] = 3e-7  # it reads single precision, and moves what it has read (1e-7 measured)
    DRY_FRICTION_CREEP: ClassVar[float] = 1e-7
    # Newton's solver ends at its tolerance, which leaves speeds of 1.5e-8 where frictions are of 2e-3 N m (measured)
    UNREADABLE: ClassVar[Mapping[str, str]] = UNREADABLE

    @classmethod
    def method(cls, world: World) -> IntegrationMethod | None:
        return integrators.method(world)

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        return expected_inventory(
            MujocoExpectation(world, resolve_settings(cls, world), neutral, cls.RULES, cls.LAYERS)
        )

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        return load(import_mujoco(), file, log)
