"""The features that a world needs, each with the places that use it, and what a target declares about them.

All features that a world needs are decided, or one error names all problems. An approximation happens only where the spec
accepts it by name; a computation outside the engine only where the spec requests it by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from simspec.errors import EngineRefusal, Location, UnsupportedError, more_places
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Absence, Level, Support, Table, acceptance
from simspec.support.features import ARMATURES, INERTIAS, MEANING, Feature
from simspec.world.contact_pairs import CollisionFilter, meeting_laws
from simspec.world.damping import armature_of_spec, implicitly_damped
from simspec.world.frames import sorted_pair
from simspec.world.inertia import singular
from simspec.world.kinematics import is_carrier, joined, owner_of, rigid_groups, trees
from simspec.world.types import EngineOptions, FollowConstraint, Inertial, PairContact, World

# The features that a world needs, each with the places that use it.

LARGE_TREE = 127


DEEP_TREE = 400


_NUMERIC_JOINT_FEATURES = (
    ("damping", Feature.DAMPING, Feature.BALL_DAMPING),
    ("dry_friction", Feature.DRY_FRICTION, Feature.DRY_FRICTION),
    ("armature", Feature.ARMATURE, Feature.BALL_ARMATURE),
    ("spring_stiffness", Feature.SPRING, Feature.BALL_SPRING),
)


_FREE_FEATURES = (("damping", Feature.FREE_DAMPING), ("armature", Feature.FREE_ARMATURE))


_LIMIT_FEATURES = (
    ("position_limits", Feature.LIMIT_POSITION),
    ("angle_limit", Feature.BALL_LIMIT),
    ("velocity_limit", Feature.LIMIT_VELOCITY),
    ("effort_limit", Feature.LIMIT_EFFORT),
)


_CONTACT_FEATURES = (
    ("friction", Feature.FRICTION),
    ("torsional_friction", Feature.TORSIONAL_FRICTION),
    ("rolling_friction", Feature.ROLLING_FRICTION),
    ("restitution", Feature.RESTITUTION),
    ("restitution_threshold", Feature.RESTITUTION_THRESHOLD),
)


_CONSTRAINT_FEATURES = {
    "connect": Feature.CONSTRAINT_LOOP,
    "weld": Feature.CONSTRAINT_LOOP,
    "follow": Feature.CONSTRAINT_COUPLING,
}


OF_RECEIVED = frozenset((*INERTIAS, *ARMATURES, Feature.GRAVITY_SCALE, Feature.DAMPING_IMPLICIT))
"""Features whose support depends on the inertia and the armature that a target receives (``world/armature.py``)."""


CODES = {"accept": "E101", "outside": "E102", "": "E103"}
"""Codes of refusals by the option that accepts them."""


@dataclass(frozen=True, slots=True)
class Need:
    """A feature that a world uses, and the places that use it (``bodies.NAME.joint.damping``; the first is shown)."""

    feature: Feature
    paths: tuple[str, ...]


def needs(world: World, laws: Iterable[PairContact] | None = None) -> list[Need]:
    """Every feature that ``world`` uses, with the paths that use it.

    ``laws``: those of the pairs of materials that count; without them those of the pairs that can meet in this world (a file
    for other worlds keeps all of them).
    """
    always = (Feature.GRAVITY, Feature.TIMESTEP, Feature.INTEGRATOR)
    found: dict[Feature, list[str]] = {feature: [feature.value] for feature in always}

    def note(feature: Feature, path: str) -> None:
        found.setdefault(feature, []).append(path)

    groups = rigid_groups(world)
    depth: dict[str, int] = {}
    for body in world.bodies:
        path, joint = f"bodies.{body.name}", body.joint
        depth[body.name] = 1 + (depth[joint.parent] if joint.parent is not None else 0)
        if depth[body.name] == DEEP_TREE + 1:
            note(Feature.TREE_DEPTH, path)
        note(Feature(f"joint.{joint.kind}"), f"{path}.joint")
        for name, feature, ball_feature in _NUMERIC_JOINT_FEATURES:
            value = armature_of_spec(joint) if name == "armature" else getattr(joint, name)
            if value and joint.kind != "free":
                note(
                    ball_feature if joint.kind == "ball" else feature, f"{path}.joint.{name.replace('_stiffness', '')}"
                )
        for name, feature in _FREE_FEATURES:
            if joint.kind == "free" and (getattr(joint, name) or getattr(joint, f"angular_{name}")):
                note(feature, f"{path}.joint.{name}")
        if body.gravity_scale != 1.0:
            note(Feature.GRAVITY_SCALE, f"{path}.gravity_scale")
        for name, feature in _LIMIT_FEATURES:
            if getattr(joint, name) is not None:
                note(feature, f"{path}.joint.limits.{name.split('_')[0]}")
        if any(joint.velocity):
            note(Feature.INITIAL_VELOCITY, f"{path}.joint.velocity" if joint.kind != "free" else f"{path}.velocity")
        if (joint.kind in SCALAR_JOINTS and any(joint.position)) or (joint.kind == "ball" and any(joint.position[1:])):
            note(Feature.INITIAL_POSITION, f"{path}.joint.position")
        if is_carrier(body.name) and not body.inertial.mass:
            note(Feature.JOINT_SEVERAL, f"bodies.{owner_of(body.name)}.joints")
        elif groups[body.name] != "world":
            for feature, field in _inertia_needs(body.inertial):
                note(feature, f"{path}.{field}")
        for index, shape in enumerate(body.shapes):
            note(Feature(f"shape.{shape.kind}"), f"{path}.shapes.{index}")
            if not (shape.collision and shape.visual):
                note(Feature.SHAPE_VISUAL, f"{path}.shapes.{index}")
            if shape.collision and shape.margin:
                note(Feature.SHAPE_MARGIN, f"{path}.shapes.{index}.margin")
            if any(shape.surface_velocity):
                note(Feature.SURFACE_VELOCITY, f"{path}.shapes.{index}.surface_velocity")
        solid = [shape for shape in body.shapes if shape.collision]
        if len(solid) > 1:
            note(Feature.SHAPES_PER_BODY, f"{path}.shapes")
        if len({shape.material for shape in solid}) > 1:
            note(Feature.MATERIALS_PER_BODY, f"{path}.shapes")
    for body in implicitly_damped(world):
        note(Feature.DAMPING_IMPLICIT, f"bodies.{body.name}.joint.damping")
    for root, bodies in trees(world).items():
        if len(bodies) > LARGE_TREE:
            note(Feature.TREE_SIZE, f"bodies.{root}")
    _world_needs(world, note)
    _contact_needs(world, meeting_laws(world).values() if laws is None else laws, note)
    return [Need(feature, tuple(found[feature])) for feature in Feature if feature in found]


def _world_needs(world: World, note: Callable[[Feature, str], None]) -> None:
    """Needs of a fluid, constraints, frames, motions, forces and controllers."""
    if world.physics.fluid is not None and any(body.box is not None for body in world.bodies):
        note(Feature.FLUID, "physics.fluid")
    for constraint in world.constraints:
        note(_CONSTRAINT_FEATURES[constraint.kind], f"constraints.{constraint.name}")
    for joint_sum in world.sums:
        if joint_sum.stiffness or joint_sum.damping:
            note(Feature.SUM, f"constraints.{joint_sum.name}")
        if joint_sum.dry_friction:
            note(Feature.SUM_DRY_FRICTION, f"constraints.{joint_sum.name}.sum.dry_friction")
        if joint_sum.position_limits is not None:
            note(Feature.SUM_LIMITS, f"constraints.{joint_sum.name}.sum.limits")
    for frame in world.frames:
        note(Feature.FRAME, f"frames.{frame.name}")
    for motion in world.motions:
        note(Feature.KINEMATIC, f"bodies.{motion.body}.kinematic")
    for index in range(len(world.forces)):
        note(Feature.FORCES, f"forces.{index}")
    for controller in world.controllers:
        note(Feature.CONTROL_NATIVE if controller.law == "native" else Feature.CONTROL, f"control.{controller.name}")


def _inertia_needs(inertial: Inertial) -> Iterator[tuple[Feature, str]]:
    """Needs of the mass properties of a body that moves, with the field that states them."""
    if not inertial.mass:
        yield Feature.MASSLESS, "mass"
        return
    yield Feature.INERTIA, "mass"
    if any(inertial.inertia[3:]):
        yield Feature.INERTIA_FULL, "inertia"
    if singular(inertial):
        yield Feature.INERTIA_SINGULAR, "inertia"


def _contact_needs(world: World, laws: Iterable[PairContact], note: Callable[[Feature, str], None]) -> None:
    if any(shape.collision for body in world.bodies for shape in body.shapes):
        note(Feature(f"contact.cone.{world.contact.friction_cone}"), "contact.friction_cone")
    for pair in world.contact.pairs:
        if not pair.collide:
            note(Feature.PASSING_PAIRS, f"contact.pairs.{pair.first}.{pair.second}.collide")
    for pair in laws:
        path = f"contact.pairs.{pair.first}.{pair.second}"
        if not pair.collide:
            continue
        for quantity, feature in _CONTACT_FEATURES:
            if getattr(pair, quantity):
                note(feature, f"{path}.{quantity}")
        note(Feature(f"contact.hardness.{pair.hardness.kind}"), f"{path}.hardness")
        if pair.margin is not None:
            note(Feature.MARGIN_PAIRS, f"{path}.margin")
    if world.contact.ignored_groups:
        note(Feature.COLLISION_GROUPS, "contact.groups")
    joints = joined(world.bodies)
    if any(pair not in joints for pair in world.contact.excluded_bodies):
        note(Feature.EXCLUDED_PAIRS, "contact.exclude")
    excluded = {
        sorted_pair(constraint.first, constraint.second)
        for constraint in world.constraints
        if not isinstance(constraint, FollowConstraint)
    }
    excluded = set(world.contact.excluded_bodies)
    if any(CollisionFilter(world).may_touch(*pair) for pair in sorted((joints | excluded) - excluded)):
        note(Feature.TOUCHING_PAIRS, "contact.touch")


# The needs of a world, compared to the declarations of a target.
#
# All features that a world needs are decided, or one error names all problems. An approximation happens only where the spec
# accepts it by name; a computation outside the engine only where the spec requests it by name.


@dataclass(frozen=True, slots=True)
class Decision:
    """How a needed feature is realised in one target; ``short`` in one line."""

    feature: Feature
    level: Level
    how: str
    paths: tuple[str, ...]
    short: str = ""


def negotiate(
    world: World,
    target: str,
    table: Table,
    locate: Callable[[str], Location | None] = lambda path: None,
    extra_needs: Iterable[Need] = (),
    title: str = "",
    version: str | None = None,
    received: World | None = None,
) -> list[Decision]:
    """Hold what ``world`` needs against what ``target`` declares.

    ``locate`` gives the place in the spec of a path; ``title`` is the target's name in sentences; ``version`` the release
    that is at work, None where it is not known; ``received``: the world as the target has it, by which features of
    ``OF_RECEIVED`` are decided (default: the same). Returns one decision per needed feature; raises UnsupportedError with every
    problem found.
    """
    options = world.options(target)
    decisions: list[Decision] = []
    problems: list[EngineRefusal] = []
    for need in [*needs(world), *extra_needs]:
        seen = received if received is not None and need.feature in OF_RECEIVED else world
        support = table[need.feature].at_version(title or target, version).in_world(seen)
        refused = _refusal(need.feature, support, options, title or target)
        if refused is None:
            short = support.short or support.how
            decisions.append(Decision(need.feature, support.level, support.how, need.paths, short))
            continue
        message, hint, option = refused
        more, path = more_places(need.paths), need.paths[0]
        meaning = f"{need.feature.value}: {MEANING[need.feature]}"
        place = locate(path)
        problems.append(
            EngineRefusal(
                f"{message}{more}",
                path,
                place,
                meaning,
                None,
                hint,
                target,
                need.feature.value,
                option,
                code=CODES[option],
            )
        )
    if problems:
        raise UnsupportedError(problems)
    return decisions


def _refusal(feature: Feature, support: Support, options: EngineOptions, title: str) -> tuple[str, str, str] | None:
    """Why a feature is refused, what can be done, and the option that accepts it ("": none); None where the spec may have it
    so."""
    name, target = feature.value, options.engine
    if support.level is Level.UNSUPPORTED:
        yet = " yet" if support.absence is Absence.NOT_YET else ""
        return (
            f"{title} does not support {name}{yet}: {support.how}",
            f"leave it out of the spec, or run without --engine {target}",
            "",
        )
    if support.level is Level.APPROXIMATE and not support.requested and name not in options.accept:
        return (
            f"{title} supports {name} only approximately: {support.how}",
            acceptance(target, name),
            "accept",
        )
    if support.level is Level.OUTSIDE and not support.requested and name not in options.outside:
        return (
            f"{title} does not support {name} itself; simspec can compute it outside the engine: {support.how}",
            f"ask for it by name: engines.{target}.outside: [{name}], or --accept {name}",
            "outside",
        )
    return None
