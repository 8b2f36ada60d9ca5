"""The closed list of things a spec can say, what formats and engines declare about each, and the negotiation.

Every format and every engine declares every feature (a missing declaration is an error at import). Negotiation finds
*all* features a world needs, holds them against a target's declarations, and returns the decisions or raises one error
with all problems. An approximation happens only where the spec accepts it by name; a computation outside the engine only
where the spec asks for it by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from simspec.errors import Location, Problem, UnsupportedError
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.types import World


class Feature(StrEnum):
    """One thing a spec can say."""

    JOINT_FIXED = "joint.fixed"
    JOINT_HINGE = "joint.hinge"
    JOINT_SLIDE = "joint.slide"
    JOINT_BALL = "joint.ball"
    JOINT_FREE = "joint.free"
    LIMIT_POSITION = "joint.limits.position"
    LIMIT_VELOCITY = "joint.limits.velocity"
    LIMIT_EFFORT = "joint.limits.effort"
    DAMPING = "joint.damping"
    BALL_DAMPING = "joint.ball.damping"
    DRY_FRICTION = "joint.dry_friction"
    ARMATURE = "joint.armature"
    SPRING = "joint.spring"
    BALL_SPRING = "joint.ball.spring"
    INITIAL_POSITION = "joint.position"
    INITIAL_VELOCITY = "joint.velocity"
    INERTIA = "body.inertia"
    INERTIA_FULL = "body.inertia.full"
    TREE_SIZE = "tree.size"
    TREE_DEPTH = "tree.depth"
    SHAPE_SPHERE = "shape.sphere"
    SHAPE_BOX = "shape.box"
    SHAPE_CYLINDER = "shape.cylinder"
    SHAPE_CAPSULE = "shape.capsule"
    SHAPE_ELLIPSOID = "shape.ellipsoid"
    SHAPE_PLANE = "shape.plane"
    SHAPE_VISUAL = "shape.visual"
    SHAPES_PER_BODY = "shape.several"
    MATERIALS_PER_BODY = "material.several"
    FRICTION = "material.friction"
    FRICTION_PAIRS = "material.friction.pairs"
    RESTITUTION = "material.restitution"
    RESTITUTION_PAIRS = "material.restitution.pairs"
    RESTITUTION_THRESHOLD = "material.restitution.threshold"
    TORSIONAL_FRICTION = "material.friction.torsional"
    ROLLING_FRICTION = "material.friction.rolling"
    HARDNESS_COMMON = "contact.hardness.common"
    HARDNESS_TIME_CONSTANT = "contact.hardness.time-constant"
    HARDNESS_STIFFNESS = "contact.hardness.stiffness"
    HARDNESS_NATIVE = "contact.hardness.native"
    HARDNESS_PAIRS = "contact.hardness.pairs"
    PASSING_PAIRS = "contact.pairs.collide"
    IMPACT_FRICTION = "contact.friction.impact"
    CONE_ELLIPTIC = "contact.cone.elliptic"
    CONE_PYRAMID_INSCRIBED = "contact.cone.pyramid-inscribed"
    CONE_PYRAMID_CIRCUMSCRIBED = "contact.cone.pyramid-circumscribed"
    COLLISION_GROUPS = "contact.groups"
    EXCLUDED_PAIRS = "contact.exclude"
    CONTROL = "control"
    CONTROL_NATIVE = "control.native"
    GRAVITY = "physics.gravity"
    TIMESTEP = "physics.timestep"


MEANING: Mapping[Feature, str] = {
    Feature.JOINT_FIXED: "two bodies joined rigidly, kept as two bodies",
    Feature.JOINT_HINGE: "rotation about one axis",
    Feature.JOINT_SLIDE: "translation along one axis",
    Feature.JOINT_BALL: "rotation about a point",
    Feature.JOINT_FREE: "a root body that moves freely",
    Feature.LIMIT_POSITION: "a hard, inelastic stop at the position limits",
    Feature.LIMIT_VELOCITY: "the velocity rating, held but not enforced",
    Feature.LIMIT_EFFORT: "the effort rating, held but not enforced",
    Feature.DAMPING: "effort −d v, explicit in time",
    Feature.BALL_DAMPING: "torque −d ω on a ball joint",
    Feature.DRY_FRICTION: "dry friction of at most f at a hinge or slide",
    Feature.ARMATURE: "inertia added to a joint's diagonal of the mass matrix",
    Feature.SPRING: "effort −k (q − rest) at a hinge or slide",
    Feature.BALL_SPRING: "torque −k log R at a ball joint",
    Feature.INITIAL_POSITION: "joint positions at time zero",
    Feature.INITIAL_VELOCITY: "joint velocities at time zero",
    Feature.INERTIA: "mass, centre of mass and principal moments",
    Feature.INERTIA_FULL: "an inertia tensor with products of inertia",
    Feature.TREE_SIZE: "a tree of more than 127 bodies",
    Feature.TREE_DEPTH: "a chain of more than 400 bodies",
    Feature.SHAPE_SPHERE: "sphere",
    Feature.SHAPE_BOX: "box",
    Feature.SHAPE_CYLINDER: "cylinder",
    Feature.SHAPE_CAPSULE: "capsule",
    Feature.SHAPE_ELLIPSOID: "ellipsoid",
    Feature.SHAPE_PLANE: "infinite plane",
    Feature.SHAPE_VISUAL: "visual shapes apart from collision shapes",
    Feature.SHAPES_PER_BODY: "several collision shapes on one body",
    Feature.MATERIALS_PER_BODY: "shapes of different materials on one body",
    Feature.FRICTION: "sliding friction of materials",
    Feature.FRICTION_PAIRS: "pair frictions that the engine's combination rule does not give",
    Feature.RESTITUTION: "restitution above zero",
    Feature.RESTITUTION_PAIRS: "pair restitutions that the engine's combination rule does not give",
    Feature.RESTITUTION_THRESHOLD: "a speed below which nothing bounces",
    Feature.TORSIONAL_FRICTION: "a torque of at most c N about the normal of a contact",
    Feature.ROLLING_FRICTION: "a torque of at most c N across the normal of a contact",
    Feature.HARDNESS_COMMON: "rigid contact that takes back 1 % of an overlap in each step",
    Feature.HARDNESS_TIME_CONSTANT: "compliant contact by time constant and damping ratio",
    Feature.HARDNESS_STIFFNESS: "compliant contact by stiffness and damping",
    Feature.HARDNESS_NATIVE: "contact as hard as the engine makes it by default: a declared difference",
    Feature.HARDNESS_PAIRS: "a hardness for each pair of materials",
    Feature.PASSING_PAIRS: "pairs of materials that do not collide",
    Feature.IMPACT_FRICTION: "friction of bodies that hit each other obliquely, in the step of the impact",
    Feature.CONE_ELLIPTIC: "|f| ≤ μ N",
    Feature.CONE_PYRAMID_INSCRIBED: "|fx| + |fy| ≤ μ N",
    Feature.CONE_PYRAMID_CIRCUMSCRIBED: "|fx| ≤ μ N and |fy| ≤ μ N",
    Feature.COLLISION_GROUPS: "collision groups that ignore each other",
    Feature.EXCLUDED_PAIRS: "pairs of bodies that do not touch",
    Feature.CONTROL: "control laws, written once and given as efforts",
    Feature.CONTROL_NATIVE: "the engine's own position or velocity controller: a declared difference",
    Feature.GRAVITY: "gravity, any direction",
    Feature.TIMESTEP: "the length of one step",
}


class Level(StrEnum):
    """How well a feature is supported, best first."""

    EXACT = "exact"
    VIA_API = "via_api"
    OUTSIDE = "outside"
    APPROXIMATE = "approximate"
    UNSUPPORTED = "unsupported"


_ORDER = list(Level)


@dataclass(frozen=True, slots=True)
class Support:
    """One declaration: the level, how (or why not), and tests of the world.

    ``only_if`` takes the world and gives None, or the reason why this world is not covered (then the feature counts as
    unsupported for it). ``exact_if``, for APPROXIMATE, gives the reason why nothing in this world can show the
    difference (then it counts as VIA_API, and needs no acceptance), or None. ``outside_if``, for APPROXIMATE too, gives how
    it is computed outside the engine where a setting of the spec asks for that (then it counts as OUTSIDE, asked for by
    name), or None. ``accepted_in`` gives what is approximate in this world because the spec accepts the feature by name, or
    None; it is for what depends on more than the feature (which shapes may meet), and which the format refuses by itself
    where it is not accepted. ``noted_in`` gives what must be known of it in this world, whatever its level, or None.

    ``short`` says in one line of at most 100 characters what is lost where it is approximate, or what is done where it is
    computed outside: a text of its own, for comments and tables; ``outside_short`` of what ``outside_if`` says.
    """

    level: Level
    how: str = ""
    only_if: Callable[[World], str | None] | None = None
    exact_if: Callable[[World], str | None] | None = None
    outside_if: Callable[[World], str | None] | None = None
    accepted_in: Callable[[World], str | None] | None = None
    short: str = ""
    outside_short: str = ""
    noted_in: Callable[[World], str | None] | None = None

    def brief(self, level: Level) -> str:
        """What is lost, or done outside, in one line; all that is said of it where nothing shorter is."""
        outside = level is Level.OUTSIDE and self.level is not Level.OUTSIDE
        return (self.outside_short if outside else self.short) or self.how


EXACT = Support(Level.EXACT)


def via_api(how: str) -> Support:
    """Exact, but set through the engine's API (the file cannot carry it; it goes into the sidecar)."""
    return Support(Level.VIA_API, how)


def outside(how: str, only_if: Callable[[World], str | None] | None = None, short: str = "") -> Support:
    """Exact, computed outside the engine at every step, where the spec asks for it by name; ``short`` in one line."""
    return Support(Level.OUTSIDE, how, only_if, short=short)


def approximate(how: str, exact_if: Callable[[World], str | None] | None = None, short: str = "") -> Support:
    """Not exact; allowed where the spec's ``accept`` names it. ``how`` says what the difference is, with its size; ``short`` in
    one line."""
    return Support(Level.APPROXIMATE, how, exact_if=exact_if, short=short)


def unsupported(why: str) -> Support:
    """Cannot be had."""
    return Support(Level.UNSUPPORTED, why)


Table = Mapping[Feature, Support]


def check_total(owner: str, table: Table) -> None:
    """Raise TypeError unless ``table`` declares every feature and no other."""
    missing = [feature.value for feature in Feature if feature not in table]
    unknown = [str(feature) for feature in table if not isinstance(feature, Feature)]
    if missing or unknown:
        raise TypeError(f"{owner} must declare every feature: missing {missing}, unknown {unknown}")


def combine(file: Table, engine: Table) -> dict[Feature, Support]:
    """What a format and an engine reading it support together: for each feature the weaker declaration, and where both are
    of one level what both say."""
    return {feature: _weaker(file[feature], engine[feature]) for feature in Feature}


def _weaker(file: Support, engine: Support) -> Support:
    if file.level is not engine.level:
        return max(file, engine, key=lambda support: _ORDER.index(support.level))
    if file.level is Level.UNSUPPORTED:  # one reason is enough
        return file
    said = dict.fromkeys(how for how in (file.how, engine.how) if how)
    return replace(engine, how="; ".join(said), short=engine.short or file.short)


@dataclass(frozen=True, slots=True)
class Need:
    """A feature that a world uses, and the places that use it (``bodies.NAME.joint.damping``; the first is shown)."""

    feature: Feature
    paths: tuple[str, ...]


_NUMERIC_JOINT_FEATURES = (
    ("damping", Feature.DAMPING, Feature.BALL_DAMPING),
    ("dry_friction", Feature.DRY_FRICTION, Feature.DRY_FRICTION),
    ("armature", Feature.ARMATURE, Feature.ARMATURE),
    ("spring_stiffness", Feature.SPRING, Feature.BALL_SPRING),
)
_LIMIT_FEATURES = (
    ("position_limits", Feature.LIMIT_POSITION),
    ("velocity_limit", Feature.LIMIT_VELOCITY),
    ("effort_limit", Feature.LIMIT_EFFORT),
)
LARGE_TREE = 127
DEEP_TREE = 400


def needs(world: World) -> list[Need]:
    """Every feature that ``world`` uses, with the paths that use it."""
    found: dict[Feature, list[str]] = {Feature.GRAVITY: ["physics.gravity"], Feature.TIMESTEP: ["physics.timestep"]}

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
            if getattr(joint, name):
                note(
                    ball_feature if joint.kind == "ball" else feature, f"{path}.joint.{name.replace('_stiffness', '')}"
                )
        for name, feature in _LIMIT_FEATURES:
            if getattr(joint, name) is not None:
                note(feature, f"{path}.joint.limits.{name.split('_')[0]}")
        if any(joint.velocity):
            note(Feature.INITIAL_VELOCITY, f"{path}.joint.velocity" if joint.kind != "free" else f"{path}.velocity")
        if (joint.kind in ("hinge", "slide") and any(joint.position)) or (
            joint.kind == "ball" and any(joint.position[1:])
        ):
            note(Feature.INITIAL_POSITION, f"{path}.joint.position")
        if groups[body.name] != "world":
            note(Feature.INERTIA, f"{path}.mass")
            if any(body.inertial.inertia[3:]):
                note(Feature.INERTIA_FULL, f"{path}.inertia")
        for index, shape in enumerate(body.shapes):
            note(Feature(f"shape.{shape.kind}"), f"{path}.shapes.{index}")
            if not (shape.collision and shape.visual):
                note(Feature.SHAPE_VISUAL, f"{path}.shapes.{index}")
        solid = [shape for shape in body.shapes if shape.collision]
        if len(solid) > 1:
            note(Feature.SHAPES_PER_BODY, f"{path}.shapes")
        if len({shape.material for shape in solid}) > 1:
            note(Feature.MATERIALS_PER_BODY, f"{path}.shapes")
    for root, bodies in trees(world).items():
        if len(bodies) > LARGE_TREE:
            note(Feature.TREE_SIZE, f"bodies.{root}")
    for controller in world.controllers:
        note(Feature.CONTROL_NATIVE if controller.law == "native" else Feature.CONTROL, f"control.{controller.name}")
    _contact_needs(world, note)
    return [Need(feature, tuple(found[feature])) for feature in Feature if feature in found]


_CONTACT_FEATURES = (
    ("friction", Feature.FRICTION),
    ("torsional_friction", Feature.TORSIONAL_FRICTION),
    ("rolling_friction", Feature.ROLLING_FRICTION),
    ("restitution", Feature.RESTITUTION),
    ("restitution_threshold", Feature.RESTITUTION_THRESHOLD),
)


def _contact_needs(world: World, note: Callable[[Feature, str], None]) -> None:
    if any(shape.collision for body in world.bodies for shape in body.shapes):
        note(Feature(f"contact.cone.{world.contact.friction_cone}"), "contact.friction_cone")
    for pair in world.contact.pairs:
        path = f"contact.pairs.{pair.first}.{pair.second}"
        if not pair.collide:
            note(Feature.PASSING_PAIRS, f"{path}.collide")
            continue
        for quantity, feature in _CONTACT_FEATURES:
            if getattr(pair, quantity):
                note(feature, f"{path}.{quantity}")
        note(Feature(f"contact.hardness.{pair.hardness.kind}"), f"{path}.hardness")
    if world.contact.ignored_groups:
        note(Feature.COLLISION_GROUPS, "contact.groups")
    parents = {tuple(sorted((body.name, body.joint.parent))) for body in world.bodies if body.joint.parent is not None}
    if any(pair not in parents for pair in world.contact.excluded_bodies):
        note(Feature.EXCLUDED_PAIRS, "contact.exclude")


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
) -> list[Decision]:
    """Hold what ``world`` needs against what ``target`` declares.

    ``locate`` gives the place in the spec of a path. Returns one decision per needed feature; raises UnsupportedError
    with every problem found.
    """
    options = world.options(target)
    decisions: list[Decision] = []
    problems: list[Problem] = []
    for need in [*needs(world), *extra_needs]:
        support = table[need.feature]
        level, how = support.level, support.how
        if support.only_if is not None and (reason := support.only_if(world)):
            level, how = Level.UNSUPPORTED, reason
        if level is Level.APPROXIMATE and support.exact_if is not None and (reason := support.exact_if(world)):
            level, how = Level.VIA_API, reason
        asked = None if level is not Level.APPROXIMATE or support.outside_if is None else support.outside_if(world)
        if asked is not None:
            level, how = Level.OUTSIDE, asked
        if (
            level is not Level.UNSUPPORTED
            and support.accepted_in is not None
            and (reason := support.accepted_in(world))
        ):
            level, how = Level.APPROXIMATE, reason
        name, path = need.feature.value, need.paths[0]
        more = f" (and {len(need.paths) - 1} more places)" if len(need.paths) > 1 else ""
        if level is Level.UNSUPPORTED:
            problems.append(
                Problem(
                    f"{target} cannot have {name}: {how}{more}",
                    path,
                    locate(path),
                    found=f"{name}: {MEANING[need.feature]}",
                    hint=f"leave it out of the spec, or run without --engine {target}",
                )
            )
        elif level is Level.APPROXIMATE and name not in options.accept:
            problems.append(
                Problem(
                    f"{target} has {name} only approximately: {how}{more}",
                    path,
                    locate(path),
                    found=f"{name}: {MEANING[need.feature]}",
                    hint=f"accept it by name: engines.{target}.accept: [{name}]",
                )
            )
        elif level is Level.OUTSIDE and asked is None and name not in options.outside:
            problems.append(
                Problem(
                    f"{target} has no {name} of its own; simspec can compute it outside the engine: {how}{more}",
                    path,
                    locate(path),
                    found=f"{name}: {MEANING[need.feature]}",
                    hint=f"ask for it by name: engines.{target}.outside: [{name}]",
                )
            )
        else:
            if support.noted_in is not None and (note := support.noted_in(world)):
                how = f"{how}; {note}" if how else note
            decisions.append(Decision(need.feature, level, how, need.paths, support.brief(level) or how))
    if problems:
        raise UnsupportedError(problems)
    return decisions
