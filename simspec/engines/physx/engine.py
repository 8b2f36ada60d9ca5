"""PhysX, as SAPIEN brings it: rigid bodies in single precision on the processor, stepped by its own solver under the common law
of contact.

Facts marked *measured*: SAPIEN 3.0.3, PhysX 5.3.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.contact.plan import contact_plan
from simspec.contact.rules import Rules
from simspec.engines.kit.capabilities import SINGLE, Capability
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.efforts import GIVEN_DAMPING, GIVEN_FLUID, GIVEN_GRAVITY_SCALE
from simspec.engines.kit.refinements import jointless, no_friction, planes_still, still_or_light
from simspec.engines.kit.settings import Group, Setting
from simspec.engines.kit.world_simulation import Parts, WorldEngine
from simspec.engines.physx.approximations import BOXES, DEVIATIONS, MASS_RATIO, MESHES, SELF_LOCKING, boxes, meshes
from simspec.engines.physx.building import apart, imported, kinds
from simspec.engines.physx.inventory import expected, inventory, neutral
from simspec.engines.physx.readback import read_back
from simspec.engines.physx.simulation import Simulation
from simspec.support.declarations import (
    AS_EFFORTS,
    FRAMES_ALONGSIDE,
    HEAVY,
    Attempt,
    Level,
    Refinement,
    Support,
    Table,
    approximate,
    exactly,
    never,
    not_yet,
    shape_kinds,
    unsupported_if,
    via_api,
)
from simspec.support.features import Feature
from simspec.world.contact_pairs import excluded_pairs, solid_shapes
from simspec.world.types import World

_NOT_YET = "simspec does not write it for PhysX"
_DRIFT = (
    "PhysX's articulations step by another law: after 2,000 steps of 1 ms two hinges are 4e-5 off and seven 4e-2 (measured), "
    "where the round-off of single precision makes 9e-4, and one with a free root 5e-2; they have no balls"
)
_COPIES = (
    "as copies of shapes with materials of their own, where one number for each material does not do: PhysX takes means"
)
_ONE_HARDNESS = "PhysX's contacts are rigid, and SAPIEN gives no access to compliant ones"
_still_or_light = still_or_light(
    "PhysX would move the common centre of mass of {name} and what it is fixed to, and coordinates are of one of them"
)
_planes_still = planes_still("PhysX's planes are of what cannot move, and {name} does")


def _bits_do(world: World) -> Refinement | None:
    """SAPIEN's filter has 32 bits for kinds of shapes, and 32 for bodies that must not touch."""
    plan = contact_plan(world, PhysX.RULES, PhysX.LAYERS)
    ignored = {frozenset(pair) for pair in world.contact.ignored_groups}

    def meet(one: tuple[str, str, int], other: tuple[str, str, int]) -> bool:
        return frozenset((one[0], other[0])) not in ignored and plan.meet(one[1:], other[1:])

    keys = dict.fromkeys(
        (body.collision_group, shape.material, layer)
        for body in world.bodies
        for shape in solid_shapes(body)
        for layer in plan.layers(shape.material)
    )
    try:
        kinds(list(keys), meet)
        apart(excluded_pairs(world))
    except ValueError as error:
        return unsupported_if(f"SAPIEN's filter {error}")
    return None


class PhysX(WorldEngine[Simulation]):
    """PhysX's rigid actors, by its PGS solver."""

    NAME: ClassVar[str] = "physx"
    TITLE: ClassVar[str] = "PhysX"
    DIALECT: ClassVar[str] = "physx"
    DISTRIBUTION: ClassVar[str] = "sapien"
    EXTRA: ClassVar[str] = "physx"
    PRECISION: ClassVar[str] = SINGLE
    RULES: ClassVar[Rules] = Rules("mean", "mean", most_restitution=1.0)
    LAYERS: ClassVar[bool] = True
    KEEPS_CONTACTS: ClassVar[bool] = True
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.DRY_FRICTION_OFF: "simspec gives PhysX no joints, which alone have dry friction",
        Capability.NATIVE_CONTROLLERS: "simspec gives PhysX no joints, which its drives would move",
        Capability.FOREIGN_FILES: "simspec does not use SAPIEN's loaders of robot files",
    }
    SUPPORT: ClassVar[Table] = {
        **exactly(
            *(Feature.JOINT_FREE, Feature.LIMIT_VELOCITY, Feature.LIMIT_EFFORT),
            *(Feature.INITIAL_POSITION, Feature.INITIAL_VELOCITY),
            *(Feature.INERTIA, Feature.INERTIA_FULL, Feature.INERTIA_SINGULAR, Feature.MASSLESS),
            *(Feature.TREE_SIZE, Feature.TREE_DEPTH),
            *(Feature.SHAPE_VISUAL, Feature.SHAPES_PER_BODY, Feature.MATERIALS_PER_BODY),
            *(Feature.FRICTION, Feature.IMPACT_FRICTION),
            *(Feature.TOUCHING_PAIRS, Feature.GRAVITY, Feature.TIMESTEP),
        ),
        **jointless("PhysX", _DRIFT, "drives"),
        **shape_kinds("PhysX", ("sphere", "box", "capsule")),
        Feature.SHAPE_CYLINDER: never(
            "PhysX has no cylinder; SAPIEN's is a prism of 32 sides, whose faces lie 0.48 % of the radius inside it (measured)"
        ),
        Feature.SHAPE_BOX: Support(
            Level.EXACT,
            "those that may meet other boxes are approximate, and accepted by name",
            refine=boxes,
            cases=(BOXES,),
        ),
        Feature.JOINT_FIXED: Support(
            Level.EXACT,
            "of what cannot move, and of bodies without mass on one that moves, which are parts of it",
            refine=_still_or_light,
        ),
        Feature.SHAPE_PLANE: Support(
            Level.EXACT,
            "of bodies that cannot move",
            refine=_planes_still,
        ),
        Feature.SHAPE_MESH: Support(
            Level.EXACT,
            "the convex hull, of up to 255 faces, each corner of which reaches further beyond the hull of the others than "
            "3.6e-4 of the sum of its extents: PhysX leaves others out. With all but planes approximate, and accepted by name",
            refine=meshes,
            cases=(MESHES,),
        ),
        Feature.SHAPE_MARGIN: never("PhysX's contact begins where shapes touch"),
        Feature.MARGIN_PAIRS: never("PhysX's contact begins where shapes touch"),
        Feature.SURFACE_VELOCITY: never("the format world has no surfaces that move by themselves"),
        Feature.CARRIED_FRICTION: Support(Level.EXACT),
        Feature.SELF_LOCKING: SELF_LOCKING,
        Feature.EVEN_PRESSURE: never("simspec gives PhysX no joints"),
        Feature.MASS_RATIO: MASS_RATIO,
        Feature.FRICTION_PAIRS: via_api(_COPIES),
        Feature.RESTITUTION: Support(
            Level.EXACT, "of what arrives with more than 2 / (1 − e) steps of gravity: what is slower does not bounce"
        ),
        Feature.RESTITUTION_PAIRS: via_api(_COPIES),
        Feature.RESTITUTION_THRESHOLD: via_api(
            "the scene's bounce threshold: one for all pairs that bounce, and at least 2 / (1 − e) steps of gravity, e the "
            "largest restitution up to 0.8 (0.1 m/s at 1 ms), as what rests would hop by PhysX's rule"
        ),
        Feature.TORSIONAL_FRICTION: never("PhysX's contacts have no torque about their normal"),
        Feature.ROLLING_FRICTION: never("PhysX's contacts have no torque against rolling"),
        Feature.HARDNESS_COMMON: via_api(
            "before each step every body's largest speed of depenetration is set to β depth/dt of its deepest contact"
        ),
        Feature.HARDNESS_TIME_CONSTANT: never(_ONE_HARDNESS),
        Feature.HARDNESS_STIFFNESS: never(_ONE_HARDNESS),
        Feature.HARDNESS_NATIVE: not_yet(_NOT_YET, Attempt.READ_BACK),
        Feature.HARDNESS_PAIRS: never(_ONE_HARDNESS),
        Feature.CONE_PYRAMID_INSCRIBED: never("PhysX's friction is bound by a circle"),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: never("PhysX's friction is bound by a circle"),
        Feature.CONE_ELLIPTIC: approximate(
            "the cone along and across the slip of the bodies' centres, at two anchors of a patch of contact: exact for what "
            "slides without a spin, in every direction; what spins as it slides is held by a square (a ball of 1 m/s whose "
            "surface slips aside at 3 m/s is up to 7 % off, a tripod that spins at 10 rad/s stops 10 % short), and cards that "
            "slide apart on their edges go a quarter of their way and aside; what leans or is piled holds below its threshold, "
            "and slips too little at 0.6 of it",
            no_friction,
            "friction is up to 1.4 times that of the cone where a body spins as it slides",
        ),
        Feature.PASSING_PAIRS: Support(Level.EXACT, "by collision groups", refine=_bits_do),
        Feature.COLLISION_GROUPS: Support(Level.EXACT, "by collision groups", refine=_bits_do),
        Feature.EXCLUDED_PAIRS: Support(Level.EXACT, "by collision groups", refine=_bits_do),
        Feature.KINEMATIC: via_api(HEAVY),
        Feature.FORCES: via_api(AS_EFFORTS),
        Feature.FRAME: FRAMES_ALONGSIDE,
        Feature.GRAVITY_SCALE: GIVEN_GRAVITY_SCALE,
        Feature.FREE_DAMPING: GIVEN_DAMPING,
        Feature.FLUID: GIVEN_FLUID,
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {
        "iterations": Setting(
            50,
            "Sweeps over all contacts in a step (solver_position_iterations). PhysX begins each step anew, so that stacks move "
            "by what sweeps leave over: ten boxes at 1 ms fall with 20, and move by 1 mm with 50 before they stand still.",
            minimum=1,
            maximum=255,
            group=Group.ACCURACY,
            finer=255,
        ),
    }
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = (
        *DEVIATIONS,
        Deviation(
            "overlap",
            1.0,
            "PhysX moves bodies by the speed that undoes an overlap and takes it away again before the step ends: the overlap "
            "is left as by the law, and no speed remains",
        ),
    )
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": "PhysX is told by bits what touches, and has no groups of that name",
        "static.inertial": "PhysX's static actors have no mass",
    }

    PARTS: ClassVar[Parts[Simulation]] = Parts(Simulation, read_back, inventory, neutral, expected)

    @classmethod
    def prepare(cls) -> None:
        imported()
