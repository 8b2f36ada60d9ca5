"""Declarations by class of engine, dialect and file format: a table starts from one of these and overrides its differences."""

from __future__ import annotations

from simspec.support.declarations import (
    Attempt,
    Support,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    not_yet,
    via_api,
)
from simspec.support.features import (
    ARMATURES,
    CONSTRAINTS,
    CONTROLS,
    COUPLED_CONTACT,
    DAMPERS_AND_SPRINGS,
    FILTERS,
    HARDNESSES,
    INERTIAS,
    INITIAL_STATE,
    JOINTS,
    LARGE_TREES,
    LIMIT_RATINGS,
    MARGINS,
    MOMENTS,
    PASSIVE_FORCES,
    PHYSICS,
    RESTITUTIONS,
    SHAPES_OF_BODIES,
    SUMS,
    Feature,
)

HEAVY = (
    "a free body of 1e5 times the mass of all that moves, to which an effort before every step gives the velocity that its "
    "motion asks for: contact and joints feel that velocity, and shift it by 1e-5 of what they would shift themselves"
)
"""Of a kinematic body, in engines."""
AS_EFFORTS = "as efforts Jᵀ F on the joints before every step, J from the engine's own poses"
"""Of forces on bodies."""
EFFORTS = "given as efforts before every step"
WEIGHTS = "the difference as a force at the centre of mass before every step"
DRAG = "its forces on each body as an effort before every step, from the engine's own velocities"
FRAMES_ALONGSIDE = exact("outside the engine: no motion depends on frames, and their places follow from bodies'")
"""Of named frames, for dialects and engines that have none."""
BETWEEN_JOINTS = exact("bodies without mass and shapes stand between the joints")
"""Of several joints of one body, for dialects and engines that represent such bodies."""
LUMPED: Table = for_each(
    exact("the topmost body of the rigid group has the inertia of the whole group"),
    *(Feature.MASSLESS, Feature.INERTIA_SINGULAR),
)
"""For dialects that write what ``formats/kit/contract.py`` gathers."""


def driven(engine: str) -> dict[Feature, Support]:
    """An engine of trees of rigid bodies that simspec drives by an effort before every step."""
    return {
        **exactly(*JOINTS, *LIMIT_RATINGS, *INITIAL_STATE, *INERTIAS, *LARGE_TREES, *SHAPES_OF_BODIES, *PHYSICS),
        **exactly(Feature.IMPACT_FRICTION, Feature.CARRIED_FRICTION),
        Feature.KINEMATIC: via_api(HEAVY),
        Feature.FORCES: via_api(AS_EFFORTS),
        Feature.FRAME: FRAMES_ALONGSIDE,
        Feature.GRAVITY_SCALE: via_api(WEIGHTS),
        Feature.FREE_DAMPING: via_api("as an effort before every step, from the engine's own velocities"),
        Feature.FLUID: via_api(DRAG),
        Feature.CONTROL: via_api("efforts given before every step"),
        **for_each(never(f"{engine}'s contact begins where shapes touch"), *MARGINS),
        Feature.FREE_ARMATURE: never(
            f"{engine} has no armature of free bodies, and contact would ignore a computed one"
        ),
        Feature.SUM: via_api(EFFORTS),
        Feature.SUM_DRY_FRICTION: never(
            f"{engine} has dry friction of single joints, and none along sums of their positions"
        ),
        Feature.SUM_LIMITS: never(f"{engine} stops joints one by one, and no sum of their positions"),
    }


def free_bodies_only(engine: str, drift: str, moved_by: str) -> dict[Feature, Support]:
    """A driven engine that simspec gives no joints. ``drift``: the reason; ``moved_by``: what of the engine would move them."""
    joints = never(f"simspec gives {engine} no joints, which alone have it: {drift}")
    return {
        **driven(engine),
        **for_each(never(drift), Feature.JOINT_HINGE, Feature.JOINT_SLIDE, Feature.JOINT_BALL, Feature.JOINT_SEVERAL),
        **for_each(joints, Feature.LIMIT_POSITION, Feature.BALL_LIMIT, *DAMPERS_AND_SPRINGS, Feature.DRY_FRICTION),
        **for_each(joints, Feature.ARMATURE, Feature.BALL_ARMATURE, Feature.CONTROL, *SUMS),
        Feature.CONSTRAINT_COUPLING: joints,
        Feature.CONSTRAINT_LOOP: never(f"loops are closed by joints: {drift}"),
        Feature.CONTROL_NATIVE: never(f"simspec gives {engine} no joints, which its {moved_by} would move"),
        Feature.EVEN_PRESSURE: never(f"simspec gives {engine} no joints"),
        **for_each(never(f"{engine}'s contacts transmit no torque"), *MOMENTS),
        Feature.SURFACE_VELOCITY: NO_BELTS,
        Feature.HARDNESS_NATIVE: unwritten(engine, Attempt.READ_BACK),
    }


NO_BELTS = never("the format world has no surfaces that move by themselves")


def unwritten(engine: str, attempt: Attempt) -> Support:
    """Supported by the engine, and not written by simspec."""
    return not_yet(f"simspec does not write it for {engine}", attempt)


def with_sidecar(engine: str, how: str) -> dict[Feature, Support]:
    """A dialect whose sidecar has what its files do not: ``how`` it gets into the engine."""
    return {
        **exactly(*JOINTS, Feature.DRY_FRICTION, *INITIAL_STATE, Feature.INERTIA, Feature.INERTIA_FULL, *LARGE_TREES),
        **exactly(*SHAPES_OF_BODIES, *MOMENTS, *RESTITUTIONS, *HARDNESSES, Feature.IMPACT_FRICTION, *COUPLED_CONTACT),
        **exactly(Feature.KINEMATIC, Feature.FORCES, *CONTROLS, *PHYSICS),
        **LUMPED,
        Feature.JOINT_SEVERAL: BETWEEN_JOINTS,
        Feature.FRAME: FRAMES_ALONGSIDE,
        **for_each(via_api(how), *PASSIVE_FORCES, *FILTERS, *CONSTRAINTS, *SUMS, Feature.ARMATURE),
        Feature.CONE_ELLIPTIC: via_api(how),
        Feature.CONE_PYRAMID_CIRCUMSCRIBED: via_api(how),
        Feature.CONE_PYRAMID_INSCRIBED: never(f"{engine} has the elliptic cone and the circumscribed pyramid only"),
        Feature.BALL_ARMATURE: never(f"{engine} has no armature: what stands for it is of one axis"),
        Feature.FREE_ARMATURE: never(f"{engine} has no armature of free bodies"),
        **for_each(never(f"{engine}'s contact begins where shapes touch"), *MARGINS),
    }


def file_language(language: str) -> dict[Feature, Support]:
    """A language of files that describes bodies, joints, shapes and their places, and no more."""
    return {
        **exactly(*JOINTS, *INERTIAS, *LARGE_TREES, *SHAPES_OF_BODIES, *PHYSICS),
        **for_each(never(f"{language} has no armature"), *ARMATURES),
        **for_each(never(f"{language} has no margins"), *MARGINS),
        Feature.SURFACE_VELOCITY: never(f"{language} has no surfaces that move by themselves"),
        Feature.FLUID: never(f"{language} has no fluids"),
        Feature.GRAVITY_SCALE: never(f"{language} has no weights of single bodies"),
        Feature.FREE_DAMPING: never(f"{language} has no damping of free bodies"),
        Feature.BALL_LIMIT: never(f"{language} has no limits of ball joints"),
        **for_each(never(f"{language} has nothing along sums of joint positions"), *SUMS),
        **for_each(never(f"{language} does not say which surfaces touch"), *FILTERS),
        Feature.FORCES: never(f"{language} has no forces on bodies"),
        **for_each(never(f"{language} has no gains of controllers"), *CONTROLS),
        Feature.KINEMATIC: approximate("a free body of 1e5 times the mass of all that moves, without its motion"),
    }
