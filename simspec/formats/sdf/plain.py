"""A world as plain SDF for any tool: a model for each tree. Losses are listed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import combinations
from typing import Final

from simspec.formats.kit.contract import Loss, LossFate, readable
from simspec.formats.sdf import tree
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support import classes, features
from simspec.support.declarations import (
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    unsupported_if,
)
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.canonical import derived
from simspec.world.contact_pairs import CollisionFilter, meeting_laws
from simspec.world.kinematics import poses, rigid_groups, trees
from simspec.world.types import (
    Body,
    ConnectConstraint,
    FollowConstraint,
    Inertial,
    PairContact,
    Pose,
    Shape,
    WeldConstraint,
    World,
)

# --- constraints: mimic joints, and a further joint of a link for a loop in a tree ---
# A joint stands where its child has it, and joins what both links have there with all joints at zero: the file does not state a
# loop that is open there.

CLOSED: Final = 1e-12
"""m and rad: how far a loop may be open where all joints are at zero."""

Names = Mapping[tuple[str, str], str]


def couplings_in_trees(world: World) -> Refinement | None:
    """Not supported where a joint follows one of another tree, which is another model."""
    root = {body.joint.name: root for root, bodies in trees(world).items() for body in bodies}
    across = [constraint.name for constraint in _follows(world) if root[constraint.joint] != root[constraint.leader]]
    return (
        unsupported_if(f"{across[0]!r} couples joints of two models, and SDF couples joints of one model only")
        if across
        else None
    )


def loops_in_trees(world: World) -> Refinement | None:
    """Not supported where a loop joins two trees, or is open where all joints are at zero."""
    root = {body.name: root for root, bodies in trees(world).items() for body in bodies}
    for loop in _loops(world):
        if root[loop.first] != root[loop.second]:
            return unsupported_if(f"{loop.name!r} joins bodies of two models, and SDF joins links of one model only")
        if loop.name not in _closed(world):
            return unsupported_if(
                f"{loop.name!r} is open where all joints are at zero, and SDF defines a loop by that position"
            )
    return None


def _follows(world: World) -> Iterator[FollowConstraint]:
    return (constraint for constraint in world.constraints if isinstance(constraint, FollowConstraint))


def _loops(world: World) -> Iterator[ConnectConstraint | WeldConstraint]:
    return (constraint for constraint in world.constraints if not isinstance(constraint, FollowConstraint))


@derived
def _closed(world: World) -> Set[str]:
    """The names of the loops that are closed where all joints are at zero."""
    loops = list(_loops(world))
    return {loop.name for loop, away in zip(loops, _openings(world, loops), strict=True) if away <= CLOSED}


def _openings(world: World, loops: Sequence[ConnectConstraint | WeldConstraint]) -> Iterator[float]:
    """How far each loop is open where all joints are at zero."""
    at_zero = poses(world, at_zero=True) if loops else {}
    for loop in loops:
        between = frames.compose(frames.inverse(at_zero[loop.first]), at_zero[loop.second])
        if isinstance(loop, ConnectConstraint):
            yield math.dist(frames.compose(between, Pose(loop.second_point)).position, loop.first_point)
        else:
            turn = frames.multiply(frames.conjugate(loop.pose.quaternion), between.quaternion)
            yield max(math.dist(between.position, loop.pose.position), math.hypot(*turn[1:]))


def loops_within(world: World, bodies: tuple[Body, ...]) -> list[ConnectConstraint | WeldConstraint]:
    """The loops of a tree that a file says."""
    if not world.constraints:
        return []
    names = {body.name for body in bodies}
    return [loop for loop in _loops(world) if {loop.first, loop.second} <= names and loop.name in _closed(world)]


def mimics(world: World, bodies: tuple[Body, ...], names: Names) -> dict[str, tree.SdfMimic]:
    """The couplings of joints of a tree, by the names of their bodies."""
    owner = {body.joint.name: body.name for body in bodies}
    return {
        owner[constraint.joint]: tree.SdfMimic(
            names["joint", owner[constraint.leader]], constraint.ratio, constraint.offset
        )
        for constraint in _follows(world)
        if {constraint.joint, constraint.leader} <= owner.keys()
    }


def closing_joints(world: World, bodies: tuple[Body, ...], names: Names) -> Iterator[tree.SdfJoint]:
    """The joints that close the loops of a tree."""
    for loop in loops_within(world, bodies):
        first, second = names["body", loop.first], names["body", loop.second]
        name = names["constraint", loop.name]
        if isinstance(loop, ConnectConstraint):
            yield tree.SdfJoint(name, "ball", first, second, place=loop.second_point)
        else:
            yield tree.SdfJoint(name, "fixed", first, second)


SIZES: Final = {
    "sphere": (("radius", slice(0, 1)),),
    "box": (("size", slice(0, 3)),),
    "cylinder": (("radius", slice(0, 1)), ("length", slice(1, 2))),
    "capsule": (("radius", slice(0, 1)), ("length", slice(1, 2))),
    "ellipsoid": (("radii", slice(0, 3)),),
}
"""For each kind of shape which part of its size goes into which element."""
KINDS: Final = ("plane", *SIZES, "mesh")
RESERVED: Final = re.compile(r"__.*__|world")
NOT_ALLOWED: Final = re.compile(r"[^A-Za-z0-9_-]")
"""Characters that occur in names of placed models and of bodies between joints, and in no name of a spec."""
SMALLEST_MASS: Final = 1e-9
"""kg, of a body that has none: the language demands a positive one."""
SMALLEST_MOMENT: Final = 1e-12
"""kg m², for the same reason."""
_SOLVER: Final = "SDF defines it by parameters of one solver only"


def _by_self_collide(world: World) -> Refinement | None:
    """That the pairs which do not touch are not those that ``self_collide`` can say."""
    between = any(
        not CollisionFilter(world).may_touch(first.name, second.name) for first, second in _between_trees(world)
    )
    if between or any(self_collide(world, bodies) is None for bodies in trees(world).values()):
        return Refinement(Level.APPROXIMATE, "self_collide applies to whole links, and not to links of two models")
    return None


def on_or_off(world: World) -> Refinement | None:
    """That a body has a part of its weight, or more than it."""
    other = next((body.name for body in world.bodies if body.gravity_scale not in (0.0, 1.0)), None)
    return (
        None
        if other is None
        else unsupported_if(f"SDF switches the gravity of a link on or off, and {other!r} has another scale")
    )


SUPPORT: Final[Table] = {
    **classes.file_language("SDF"),
    **exactly(
        *(Feature.LIMIT_POSITION, Feature.DAMPING, Feature.DRY_FRICTION, Feature.SPRING, Feature.FRICTION),
        *(Feature.RESTITUTION, Feature.RESTITUTION_THRESHOLD),
    ),
    **shape_kinds("SDF", KINDS),
    **for_each(never("simspec writes no margins into SDF"), *features.MARGINS),
    Feature.SURFACE_VELOCITY: never("SDF defines it by plugins of a simulator, which simspec does not write"),
    Feature.FLUID: never("SDF leaves the effect of wind to plugins, and simspec writes no drag"),
    Feature.GRAVITY_SCALE: exact("<gravity> of a link, on or off", refine=on_or_off),
    Feature.FREE_DAMPING: never("simspec writes no damping of free bodies into SDF"),
    Feature.FREE_ARMATURE: never("simspec writes no armature of free bodies into SDF"),
    Feature.INERTIA_FULL: exact("the full tensor"),
    Feature.INERTIA_SINGULAR: approximate("SDF requires positive moments: simspec writes 1e-12 kg m² in place of zero"),
    Feature.JOINT_SEVERAL: approximate(
        "simspec inserts bodies of 1e-9 kg between the joints, since SDF requires a positive mass"
    ),
    Feature.MASSLESS: approximate("SDF requires a positive mass: simspec writes 1e-9 kg"),
    Feature.LIMIT_VELOCITY: exact("as <velocity>, which some readers enforce"),
    Feature.LIMIT_EFFORT: exact("as <effort>, which some readers enforce"),
    Feature.BALL_DAMPING: never("SDF has damping along axes only"),
    Feature.BALL_SPRING: never("SDF has springs along axes only"),
    Feature.INITIAL_POSITION: never("SDF has no initial joint positions"),
    Feature.INITIAL_VELOCITY: never("SDF has no initial velocities"),
    Feature.TORSIONAL_FRICTION: exact("simspec writes a coefficient with the radius of the patch"),
    Feature.ROLLING_FRICTION: never("SDF has no rolling friction as a length"),
    **for_each(
        approximate("SDF has one number for each shape, and readers take the smaller one"),
        Feature.FRICTION_PAIRS,
        Feature.RESTITUTION_PAIRS,
    ),
    **for_each(
        never(_SOLVER), *features.HARDNESSES, Feature.IMPACT_FRICTION, *features.COUPLED_CONTACT, *features.CONES
    ),
    Feature.PASSING_PAIRS: never("SDF has no contact filter of pairs of materials"),
    **for_each(exact("as self_collide", refine=_by_self_collide), Feature.COLLISION_GROUPS, Feature.EXCLUDED_PAIRS),
    Feature.FORCES: never("simspec writes no forces into SDF"),
    Feature.TOUCHING_PAIRS: never("SDF excludes contact of links that a joint joins"),
    **for_each(never("SDF leaves controllers to plugins of a simulator"), *features.CONTROLS),
    Feature.CONSTRAINT_LOOP: exact(
        "as a further joint of a link, which many readers do not support", refine=loops_in_trees
    ),
    Feature.CONSTRAINT_COUPLING: exact("as mimic of a joint, in SDF 1.11", refine=couplings_in_trees),
    Feature.BALL_LIMIT: never("SDF has limits along axes only"),
    Feature.FRAME: exact("<frame>"),
}
"""The support of each feature in plain SDF."""


def plain_tree(world: World) -> tree.SdfWorld:
    """The file of a world."""
    laws = {pair.first: pair for pair in world.contact.pairs if pair.first == pair.second}
    static = {name for name, group in rigid_groups(world).items() if group == "world"}
    names = _names(world)
    models = tuple(_model(world, bodies, names, laws, static) for bodies in trees(world).values())
    return tree.SdfWorld(world.name, world.physics.timestep, world.physics.gravity, models)


def more_losses(world: World) -> Iterator[Loss]:
    """Losses of this world beyond the table: names that are reserved or taken, laws of pairs that no rule gives."""
    names = _names(world)
    bodies = {body.name: body for body in world.bodies}
    for kind in ("body", "joint"):
        paths = tuple(
            f"bodies.{body}.joint.name" if kind == "joint" else f"bodies.{body}"
            for (what, body), name in names.items()
            if what == kind and name != _local(bodies[body], kind == "joint")
        )
        if paths:
            yield Loss(
                f"{kind}.name", LossFate.APPROXIMATED, "another name: SDF reserves it, or has it once in a model", paths
            )
    laws = {pair.first: pair for pair in world.contact.pairs if pair.first == pair.second}
    for feature, quantity, rule in (
        (Feature.FRICTION_PAIRS, "friction", min),
        (Feature.RESTITUTION_PAIRS, "restitution", min),
        (Feature.TORSIONAL_FRICTION, "torsional_friction", min),
        (Feature.RESTITUTION_THRESHOLD, "restitution_threshold", max),
    ):
        other = tuple(
            f"contact.pairs.{law.first}.{law.second}.{quantity}"
            for law in meeting_laws(world).values()
            if law.first != law.second
            and getattr(law, quantity) != rule(getattr(laws[law.first], quantity), getattr(laws[law.second], quantity))
        )
        if other:
            yield Loss(feature.value, LossFate.APPROXIMATED, "each shape has its own material's number", other)


def self_collide(world: World, bodies: tuple[Body, ...]) -> dict[str, bool] | None:
    """``self_collide`` of each body of a tree: two bodies touch where either of them has it. None where pairs are left out
    that no such flags leave out."""
    allowed = CollisionFilter(world)
    rigid = rigid_groups(world)
    solid = [body for body in bodies if any(shape.collision for shape in body.shapes)]
    separate = {
        frozenset((first.name, second.name))
        for first, second in combinations(solid, 2)
        if rigid[first.name] != rigid[second.name]
        and first.joint.parent != second.name
        and second.joint.parent != first.name
        and not allowed.may_touch(first.name, second.name)
    }
    silent = {name for pair in separate for name in pair}
    flags = {body.name: body.name not in silent for body in bodies}
    for first, second in combinations(solid, 2):
        touching = allowed.may_touch(first.name, second.name)
        if touching and not (flags[first.name] or flags[second.name]):
            return None
    return flags


def _between_trees(world: World) -> Iterator[tuple[Body, Body]]:
    """Pairs of bodies of two trees that could touch but for filters, one of each kind: a world may have 100,000 bodies."""
    static = {name for name, group in rigid_groups(world).items() if group == "world"}
    filtered = {name for pair in world.contact.excluded_bodies for name in pair}
    seen: dict[tuple[str, str], set[tuple[str, bool]]] = {}
    chosen: list[tuple[str, Body]] = []
    for root, bodies in trees(world).items():
        for body in bodies:
            if not any(shape.collision for shape in body.shapes):
                continue
            kind = (body.collision_group, body.name in static)
            key = (body.collision_group, "")
            known = seen.setdefault(key, set())
            if body.name not in filtered and kind in known and len(seen[key]) >= 2:
                continue
            known.add(kind)
            chosen.append((root, body))
            if len(chosen) > MOST_COMPARED:
                break
    for (root, first), (other, second) in combinations(chosen[:MOST_COMPARED], 2):
        if root != other and not (first.name in static and second.name in static):
            yield first, second


MOST_COMPARED: Final = 2_000


# --- names ------------------------------------------------------------------------------------------------------


def _model_name(bodies: tuple[Body, ...]) -> str:
    """The name of a tree: that of its model where all bodies are called after it, else that of its root."""
    model = bodies[0].model
    return model if bodies[0].name.startswith(f"{model}/") else bodies[0].name


def _local(body: Body, joint: bool) -> str:
    """The name of a body or of its joint within its model."""
    return (body.joint.name if joint else body.name).removeprefix(f"{body.model}/")


def _names(world: World) -> dict[tuple[str, str], str]:
    """Names in the file: ``(body or joint, name of the body)``, ``(constraint, its name)``, ``(frame, its name)``; in a model
    all differ."""
    names: dict[tuple[str, str], str] = {}
    for bodies in trees(world).values():
        taken: set[str] = set()
        prefix = f"{_model_name(bodies)}/"
        wanted = [("body", body.name, body.name) for body in bodies]
        wanted += [("joint", body.name, body.joint.name) for body in bodies]
        local = {body.name for body in bodies}
        wanted += [("frame", frame.name, frame.name) for frame in world.frames if frame.body in local]
        wanted += [("constraint", loop.name, loop.name) for loop in loops_within(world, bodies)]
        for what, key, text in wanted:
            clean = NOT_ALLOWED.sub("_", text.removeprefix(prefix))
            plain = f"n{clean}" if RESERVED.fullmatch(clean) else clean
            name, count = plain, 2
            while name in taken:
                name, count = f"{plain}_{count}", count + 1
            taken.add(name)
            names[what, key] = name
    return names


# --- models -----------------------------------------------------------------------------------------------------


def _model(
    world: World,
    bodies: tuple[Body, ...],
    names: dict[tuple[str, str], str],
    laws: dict[str, PairContact],
    static: set[str],
) -> tree.SdfModel:
    root = bodies[0]
    prefix = f"{_model_name(bodies)}/"
    pose = Pose(root.joint.position[:3], root.joint.position[3:]) if root.joint.kind == "free" else root.joint.origin  # type: ignore[arg-type]
    immovable = all(body.name in static for body in bodies)
    following = mimics(world, bodies, names)
    flags = self_collide(world, bodies) or dict.fromkeys((body.name for body in bodies), True)
    return tree.SdfModel(
        _model_name(bodies),
        pose,
        immovable,
        all(flags.values()),
        tuple(_link(body, names, laws, flags[body.name], static, prefix) for body in bodies),
        (
            *(
                _joint(body, names, following)
                for body in bodies
                if body.joint.kind != "free"
                and not (immovable and body is root and (body.joint.name == f"{body.name}_joint"))
            ),
            *closing_joints(world, bodies, names),
        ),
        tuple(
            tree.SdfFrame(names["frame", frame.name], names["body", frame.body], frame.pose)
            for frame in world.frames
            if any(body.name == frame.body for body in bodies)
        ),
    )


def _link(
    body: Body,
    names: dict[tuple[str, str], str],
    laws: dict[str, PairContact],
    touches: bool,
    static: set[str],
    prefix: str,
) -> tree.SdfLink:
    joint = body.joint
    child = joint.parent is not None
    massless_and_fixed = body.name in static and not body.inertial.mass
    return tree.SdfLink(
        names["body", body.name],
        names["body", joint.parent] if joint.parent is not None else None,
        joint.origin if child else Pose(),
        None if massless_and_fixed else _positive(body.inertial),
        touches,
        tuple(_shape(shape, laws, prefix) for shape in body.shapes if shape.kind in KINDS),
        body.gravity_scale != 0.0,
    )


def _positive(inertial: Inertial) -> Inertial:
    """Mass and moments as the language allows them."""
    xx, yy, zz, *products = inertial.inertia
    moments = tuple(max(moment, SMALLEST_MOMENT) for moment in (xx, yy, zz))
    return Inertial(max(inertial.mass, SMALLEST_MASS), inertial.centre_of_mass, (*moments, *products))  # type: ignore[arg-type]


def _shape(shape: Shape, laws: dict[str, PairContact], prefix: str) -> tree.SdfShape:
    surface = None
    if shape.collision:
        law = laws[shape.material]
        surface = tree.SdfSurface(law.friction, law.torsional_friction, law.restitution, law.restitution_threshold)
    colour = shape.colour if shape.visual else None
    return tree.SdfShape(
        NOT_ALLOWED.sub("_", shape.name.removeprefix(prefix)), shape.kind, shape.size, shape.pose, surface, colour
    )


def _joint(body: Body, names: dict[tuple[str, str], str], following: dict[str, tree.SdfMimic]) -> tree.SdfJoint:
    joint = body.joint
    name = names["joint", body.name]
    parent = None if joint.parent is None else names["body", joint.parent]
    child = names["body", body.name]
    if joint.kind not in SCALAR_JOINTS:
        return tree.SdfJoint(name, joint.kind, parent, child)
    return tree.SdfJoint(
        name,
        joint.kind,
        parent,
        child,
        readable(joint.axis),
        joint.position_limits,
        joint.effort_limit,
        joint.velocity_limit,
        joint.damping,
        joint.dry_friction,
        joint.spring_rest,
        joint.spring_stiffness,
        following.get(body.name),
    )
