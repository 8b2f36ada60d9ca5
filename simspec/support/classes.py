"""Declarations by class of engine, dialect and file format: a table starts from one of these and overrides its differences."""

from __future__ import annotations

from simspec.support.declarations import (
    Attempt,
    Refinement,
    Support,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    not_yet,
    unsupported_if,
    via_api,
)
from simspec.support.features import (
    ARMATURES,
    CONSTRAINTS,
    CONTROLS,
    COUPLED_CONTACT,
    FILTERS,
    HARDNESSES,
    INERTIAS,
    INITIAL_STATE,
    JOINTS,
    LARGE_TREES,
    LIMIT_RATINGS,
    MARGINS,
    MOMENTS,
    PHYSICS,
    RESTITUTIONS,
    SHAPES_OF_BODIES,
    SUMS,
    Feature,
)
from simspec.world.types import World

HEAVY = (
    "simspec represents a kinematic body by a free body of 1e5 times the mass of all moving bodies, and applies an "
    "effort before each step so that it follows its motion. Contact and joint forces change its velocity by 1e-5 "
    "of what they change of other bodies"
)
"""Of a kinematic body, in engines."""
SIDECAR = "simspec sets it through the engine's API"
"""Of what a file cannot carry."""
AS_EFFORTS = "simspec applies forces as joint efforts Jᵀ F before each step, with J from the engine's poses"
"""Of forces on bodies."""
EFFORTS = "simspec applies efforts before each step"
WEIGHTS = "simspec applies the difference from mass × gravity as a force at the centre of mass before each step"
DRAG = "simspec computes the force from the engine's velocities and applies it before each step"
FRAMES_ALONGSIDE = exact(
    "simspec computes frames outside the engine, from the poses of bodies: no motion depends on them"
)
"""Of named frames, for dialects and engines that have none."""
BETWEEN_JOINTS = exact("simspec inserts massless bodies without shapes between the joints")
"""Of several joints of one body, for dialects and engines that represent such bodies."""
AS_ARMATURE = "simspec adds dt × damping to the armature, with which explicit damping is implicit"
"""Of implicit damping, in engines with armature and explicit damping (``world/damping.py``)."""


AS_INERTIA = "simspec adds it to the inertia of the body, without the weight of the added mass"
"""Of armature of free joints, and of balls whose parents cannot move (``world/armature.py``)."""


def no_armed_ball(world: World) -> Refinement | None:
    """Not supported where a ball joint whose parent moves has armature. ``world``: as the engine has it."""
    ball = next((body.name for body in world.bodies if body.joint.kind == "ball" and body.joint.armature), None)
    why = f"the engine has no armature of ball joints, and the parent of {ball!r} moves, so that it is no inertia of the body"
    return unsupported_if(None if ball is None else why)


FREE_ARMATURE = exact(AS_INERTIA)
"""Of dialects that write it as inertia, and their engines."""
BALL_ARMATURE = exact(f"{AS_INERTIA}. The parent of the ball joint must not move", refine=no_armed_ball)
"""The same of ball joints."""


IMPLICIT_DAMPING = exact(AS_ARMATURE, refine=no_armed_ball)
"""Of engines with armature of hinges and slides."""
LUMPED: Table = for_each(
    exact("simspec assigns the inertia of a rigid group to its topmost body"),
    *(Feature.MASSLESS, Feature.INERTIA_SINGULAR),
)
"""For dialects that write what ``formats/kit/contract.py`` gathers."""


def no_margin(engine: str) -> Support:
    """Of margins, in engines and dialects."""
    return never(f"{engine} has no contact margin: contact begins where shapes touch")


def explicit(engine: str) -> Support:
    """Of springs and dampers of joints, in engines and dialects."""
    return via_api(
        f"{engine} integrates springs and dampers implicitly; simspec applies explicit efforts before each step"
    )


def driven(engine: str) -> dict[Feature, Support]:
    """An engine of trees of rigid bodies that simspec drives by an effort before every step."""
    return {
        **exactly(*JOINTS, *LIMIT_RATINGS, *INITIAL_STATE, *INERTIAS, *LARGE_TREES, *SHAPES_OF_BODIES, *PHYSICS),
        **exactly(Feature.IMPACT_FRICTION, Feature.CARRIED_FRICTION),
        Feature.KINEMATIC: via_api(HEAVY),
        Feature.FORCES: via_api(AS_EFFORTS),
        Feature.FRAME: FRAMES_ALONGSIDE,
        Feature.GRAVITY_SCALE: via_api(WEIGHTS),
        Feature.FREE_DAMPING: via_api(DRAG),
        Feature.FLUID: via_api(DRAG),
        Feature.CONTROL: via_api(EFFORTS),
        **for_each(no_margin(engine), *MARGINS),
        Feature.FREE_ARMATURE: FREE_ARMATURE,
        Feature.BALL_ARMATURE: BALL_ARMATURE,
        Feature.DAMPING_IMPLICIT: IMPLICIT_DAMPING,
        Feature.SUM: via_api(EFFORTS),
        Feature.SUM_DRY_FRICTION: never(
            f"{engine} has dry friction at single joints only, not along sums of joint positions"
        ),
        Feature.SUM_LIMITS: never(f"{engine} limits single joints only, not sums of joint positions"),
    }


def nothing(why: str) -> Table:
    """Of an engine that runs no world, for this reason."""
    return dict.fromkeys(Feature, never(why))


NOT_IN_WORLD_JSON = for_each(
    never("world.json has no field for it, since no engine that reads the format has it"),
    *(Feature.BALL_LIMIT, *MARGINS, Feature.SURFACE_VELOCITY),
)
"""Of the format ``world`` and of each engine that reads it."""


def unwritten(engine: str, attempt: Attempt) -> Support:
    """Supported by the engine, and not written by simspec."""
    return not_yet(f"simspec does not implement it for {engine}", attempt)


def with_sidecar(engine: str, how: str) -> dict[Feature, Support]:
    """A dialect whose sidecar has what its files do not: ``how`` it gets into the engine."""
    return {
        **exactly(*JOINTS, Feature.DRY_FRICTION, *INITIAL_STATE, Feature.INERTIA, Feature.INERTIA_FULL, *LARGE_TREES),
        **exactly(*SHAPES_OF_BODIES, *MOMENTS, *RESTITUTIONS, *HARDNESSES, Feature.IMPACT_FRICTION, *COUPLED_CONTACT),
        **exactly(Feature.KINEMATIC, Feature.FORCES, *CONTROLS, *PHYSICS),
        **LUMPED,
        Feature.JOINT_SEVERAL: BETWEEN_JOINTS,
        Feature.FRAME: FRAMES_ALONGSIDE,
        **for_each(via_api(how), *FILTERS, *CONSTRAINTS, *SUMS, Feature.ARMATURE),
        Feature.DAMPING_IMPLICIT: exact(AS_ARMATURE),
        Feature.GRAVITY_SCALE: via_api(WEIGHTS),
        **for_each(via_api(DRAG), Feature.FREE_DAMPING, Feature.FLUID),
        Feature.SUM: via_api(EFFORTS),
        Feature.CONE_ELLIPTIC: via_api(how),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(how),
        Feature.CONE_PYRAMID_INSCRIBED: never(f"{engine} has the elliptic cone and the circumscribed pyramid only"),
        Feature.BALL_ARMATURE: BALL_ARMATURE,
        Feature.FREE_ARMATURE: FREE_ARMATURE,
        **for_each(no_margin(engine), *MARGINS),
    }


def file_language(language: str) -> dict[Feature, Support]:
    """A language of files that describes bodies, joints, shapes and their places, and no more."""
    return {
        **exactly(*JOINTS, *INERTIAS, *LARGE_TREES, *SHAPES_OF_BODIES, *PHYSICS),
        **for_each(never(f"{language} has no armature"), *ARMATURES),
        Feature.DAMPING_IMPLICIT: approximate(f"{language} does not say whether damping is implicit in time"),
        **for_each(never(f"{language} has no contact margins"), *MARGINS),
        Feature.SURFACE_VELOCITY: never(f"{language} has no surface velocities"),
        Feature.FLUID: never(f"{language} has no fluids"),
        Feature.GRAVITY_SCALE: never(f"{language} has no gravity scale of single bodies"),
        Feature.FREE_DAMPING: never(f"{language} has no damping of free joints"),
        Feature.BALL_LIMIT: never(f"{language} has no limits of ball joints"),
        **for_each(
            never(f"{language} has no springs, dampers, friction or limits along sums of joint positions"), *SUMS
        ),
        **for_each(never(f"{language} has no collision filters"), *FILTERS),
        Feature.FORCES: never(f"{language} has no external forces on bodies"),
        **for_each(never(f"{language} has no controller gains"), *CONTROLS),
        Feature.KINEMATIC: approximate(
            "simspec writes a free body of 1e5 times the mass of all moving bodies, without its motion"
        ),
    }


# Reasons that several engines have in common. Figures stand in docs/engines.

LAW_AT_CONTACTS = exact("simspec sets the contact law of the two materials at every contact")
"""Of engines whose callback receives a law for each contact."""
LAYERS = via_api(
    "simspec copies shapes where one number for each material cannot express every pair, and filters the contacts of the copies"
)
ZERO_VELOCITY_MOTOR = "simspec represents dry friction by a motor with target velocity zero and this maximum effort"
CUSTOM_HULLS = via_api(
    "simspec adds convex hulls to the collision detector as a custom geom class with up to 16 contact points for each "
    "pair; see docs/engines"
)
NO_MASSLESS = never("several joints of one body need massless bodies between them, which are not supported")
IN_TREES_ONLY = never("simspec does not pass constraints outside the joint tree to the engine")
CIRCUMSCRIBED = (
    "the circumscribed pyramid replaces the elliptic cone: friction between its axes is up to 1.41 times as large"
)
CIRCUMSCRIBED_SHORT = "the circumscribed pyramid: between its axes friction is up to 1.41 times that of the cone"
JAMMED = (
    "solver iterations end before friction has built up the normal force of a self-locking clamp, so that the clamp may slip; "
    "see docs/engines",
    "a self-locking clamp may slip at low friction or low preload",
)
"""Of a solver that sweeps over single contacts: how, and in one line."""
HEAVY_ON_LIGHT = (
    "heavy bodies sink into light ones and push them aside, and bodies that slide under a load stop short. Raise `iterations` "
    "to reduce the overlaps; see docs/engines",
    "heavy bodies sink into light ones and push them aside",
)
"""The same of large ratios of masses."""
PREDICTED_RESTITUTION = (
    "the engine's restitution is e (1 + g dt / v), and bodies that would leave at less than 0.1 m/s do not bounce. Bodies "
    "leave at 100 m/s at most"
)
FIXED_THRESHOLD = approximate(
    "the engine's restitution threshold is fixed: bodies bounce if and only if they leave at 0.1 m/s or more, for any "
    "threshold in the spec",
    short="the engine's fixed threshold, 0.1 m/s after the impact, replaces the one in the spec",
)
