"""MuJoCo: an MJCF file in, arrays out. Its declarations; the simulation is in ``simulation.py``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import NativeLaw, ServoLaw
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.foreign import EngineAddition, Reads
from simspec.engines.kit.settings import Setting, resolve_settings
from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS, CONTACT_SUPPORT, HEIGHT_FIELDS
from simspec.engines.mujoco.expectation import MujocoExpectation
from simspec.engines.mujoco.foreign import FOREIGN, FOREIGN_ADDITIONS, load
from simspec.engines.mujoco.inventory import expected_inventory
from simspec.engines.mujoco.joints import NATIVE as NATIVE_CONTROL
from simspec.engines.mujoco.joints import explicit_servos_hold
from simspec.engines.mujoco.readback import UNREADABLE
from simspec.engines.mujoco.settings import SETTINGS
from simspec.engines.mujoco.simulation import MujocoSimulation, import_mujoco
from simspec.formats.mjcf.bodies import FRAME_SITE, GRAVCOMP, KINDS
from simspec.support import classes, features
from simspec.support.declarations import Table, approximate, exact, exactly, for_each, never, shape_kinds
from simspec.support.features import Feature
from simspec.world.types import EngineValue, ReadBack, World

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
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        return expected_inventory(
            MujocoExpectation(world, resolve_settings(cls, world), neutral, cls.RULES, cls.LAYERS)
        )

    def load_foreign(self, file: Path, language: str, packages: Mapping[str, str], log: list[str]) -> ReadBack:
        return load(import_mujoco(), file, log)
