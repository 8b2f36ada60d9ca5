"""Properties of a world that refine declarations of several engines (``refine``)."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from simspec.contact import HEAVY_ON_LIGHT
from simspec.control.reference import natives
from simspec.engines.kit.capabilities import Deviation
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import written_settings
from simspec.support import classes
from simspec.support.declarations import Level, Refine, Refinement, Support, approximate, exact, outside, unsupported_if
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter, frictionless, meeting_kinds, meeting_laws, solid_shapes
from simspec.world.hull import hull_of
from simspec.world.inertia import summed_inertial
from simspec.world.kinematics import natively_driven, poses, rigid_groups, trees
from simspec.world.reach import MaterialReach, largest_ratio, reach
from simspec.world.types import Body, Inertial, Pair, PairContact, Pose, Shape, World

ROUND_OFF = 1e-9
"""Relative error of calculating an inertia or a centre of mass."""
NO_FRICTION = Refinement(Level.VIA_API, "nothing has friction")


def no_friction(world: World) -> Refinement | None:
    """No cone matters where nothing has friction."""
    return NO_FRICTION if frictionless(world) else None


def single_motor(title: str) -> Refine:
    """Not supported where a natively driven joint has dry friction, which is the joint's motor in the engine ``title``."""

    def refine(world: World) -> Refinement | None:
        rough = [body.name for body in world.bodies if body.joint.dry_friction]
        served = [name for name in natively_driven(world.bodies, world) if name in rough]
        why = f"{title} has one motor for each joint, and that of {{!r}} is its dry friction"
        return unsupported_if(why.format(served[0])) if served else None

    return refine


def some_effort(title: str) -> Refine:
    """Not supported where a natively driven joint has an effort limit of zero, which the engine ``title`` takes for none."""

    def refine(world: World) -> Refinement | None:
        for controller in natives(world):
            for joint, limit in zip(controller.joints, controller.effort_limits, strict=True):
                if limit == 0.0:
                    return unsupported_if(
                        f"{title}'s controllers have an effort limit above zero, and that of {joint!r} is 0"
                    )
        return None

    return refine


def only_balls_slide(how: str) -> Refine:
    """Exact, as ``how`` says, where all that has friction and moves is a free ball; also where nothing has friction."""

    def refine(world: World) -> Refinement | None:
        if frictionless(world):
            return NO_FRICTION
        rough = {name for pair in meeting_laws(world).values() if pair.friction for name in (pair.first, pair.second)}
        groups = rigid_groups(world)
        alone = {root for root, bodies in trees(world).items() if len(bodies) == 1 and bodies[0].joint.kind == "free"}
        for body in world.bodies:
            sliding = [shape for shape in body.shapes if shape.collision and shape.material in rough]
            if sliding and groups[body.name] != "world" and not (body.name in alone and _is_ball(body, sliding)):
                return None
        return Refinement(Level.VIA_API, f"{how}; nothing in this world but free balls has friction and moves")

    return refine


def _is_ball(body: Body, shapes: Sequence[Shape]) -> bool:
    """Whether a point of contact of these shapes is as easily moved along every axis of its plane."""
    x, y, z, *products = body.inertial.inertia
    least = ROUND_OFF * max(x, y, z)
    round_inertia = max(x, y, z) - min(x, y, z) <= least and all(abs(product) <= least for product in products)
    centred = all(
        math.dist(shape.pose.position, body.inertial.centre_of_mass) <= ROUND_OFF * shape.size[0]
        for shape in shapes
        if shape.kind == "sphere"
    )
    return round_inertia and centred and all(shape.kind == "sphere" for shape in shapes)


def static_planes(why: str) -> Support:
    """Planes of bodies that cannot move alone. ``why`` names a plane that would move as ``{name}``."""
    return exact("simspec rejects planes on moving bodies", only_static_planes(why))


def only_static_planes(why: str) -> Refine:
    """Not where a plane would move. ``why`` names it as ``{name}``."""

    def refine(world: World) -> Refinement | None:
        groups = rigid_groups(world)
        moving = (
            shape.name
            for body in world.bodies
            for shape in solid_shapes(body)
            if shape.kind == "plane" and groups[body.name] != "world"
        )
        name = next(moving, None)
        return unsupported_if(None if name is None else why.format(name=repr(name)))

    return refine


def met_pairs(world: World, given: Mapping[Pair, str]) -> Mapping[Pair, str]:
    """The texts of those sorted pairs of kinds of shapes that may meet here."""
    met = meeting_kinds(world)
    return {pair: how for pair, how in given.items() if pair in met}


def approximate_pairs(given: Mapping[Pair, str], short: str) -> Refinement:
    """Approximate, with the text of each pair of kinds of shapes; ``short`` is one line on what is lost."""
    how = "; ".join(f"{name} and {other}: {lost}" for (name, other), lost in given.items())
    return Refinement(Level.APPROXIMATE, how, short)


def met_approximately(given: Mapping[Pair, str], how: str, short: str) -> Support:
    """Exact, except where one of these pairs may meet: then accepted by name (:func:`approximate_pairs`). ``how`` says so."""
    approximation = approximate_pairs(given, short)
    return exact(how, lambda world: approximation if met_pairs(world, given) else None, (approximation,))


def met_exactly(kind: str, exactly: Collection[str], why: str, world: World) -> Refinement | None:
    """Refused, as ``why`` says, where a ``kind`` of shape may meet others than ``exactly``."""
    for name, other in sorted(meeting_kinds(world)):
        met = other if name == kind else name
        if kind in (name, other) and met not in exactly:
            return unsupported_if(f"a {kind} may touch a {met}: {why}")
    return None


def distant_light_link(world: World) -> tuple[float, str]:
    """The largest ratio, over hinges in the initial state, of m d² to the moment about the hinge's axis of all that it carries,
    of mass m at the distance d from the centre of mass of the tree's root, and the body of that hinge; 0 without hinges.
    Engines whose spatial vectors are about that point lose as many digits of the moment. Where the root cannot move its mass
    properties have no effect, and the point is the centre of mass of the lightest link."""
    at, groups, worst = poses(world), rigid_groups(world), (0.0, "")
    for root, bodies in trees(world).items():
        moving = [body for body in bodies if groups[body.name] != "world" and body.inertial.mass]
        about = bodies[0] if groups[root] != "world" or not moving else min(moving, key=lambda body: body.inertial.mass)
        origin = np.array(frames.compose(at[about.name], Pose(about.inertial.centre_of_mass)).position)
        carried: dict[str, list[tuple[Inertial, Pose]]] = {body.name: [] for body in bodies}
        for body in reversed(bodies):  # parents come before children
            parts = carried[body.name]
            parts.append((body.inertial, at[body.name]))
            if body.joint.parent in carried:
                carried[body.joint.parent] += parts
            whole = summed_inertial(parts)
            if body.joint.kind != "hinge" or not whole.mass:
                continue
            axis = np.array(frames.rotate(at[body.name].quaternion, body.joint.axis))
            centre = np.array(whole.centre_of_mass)
            xx, yy, zz, xy, xz, yz = whole.inertia
            arm = np.cross(centre - at[body.name].position, axis)
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            moment = body.joint.armature + axis @ tensor @ axis + whole.mass * (arm @ arm)
            away = centre - origin
            if moment > 0.0:
                worst = max(worst, (float(whole.mass * (away @ away) / moment), body.name))
    return worst


def near_links(title: str, largest: float) -> Support:
    """Inertias in single precision of an engine (``title``): exact where the ratio of :func:`distant_light_link` is up to
    ``largest``, else accepted by name."""
    lost = Refinement(
        Level.APPROXIMATE,
        f"{title}'s spatial vectors are about the root's centre of mass, and moments of light links far from it lose digits in "
        f"single precision; see docs/engines/{title.lower()}.md",
        "moments of light links far from the root lose digits",
    )
    how = f"{title} is exact for trees without light links far from a root that moves. Accept `body.inertia` for others"
    return exact(how, lambda world: lost if distant_light_link(world)[0] > largest else None, (lost,))


# Armature that simspec computes outside an engine, as an effort before every step: in which worlds that is exact.


def armature_felt(world: World, title: str, impulses: Callable[[str, Sequence[Body]], str | None]) -> Refinement | None:
    """Not supported where something in a tree with armature would not feel it (:func:`_unfelt`)."""
    return unsupported_if(_unfelt(world, title, impulses))


def _unfelt(world: World, title: str, impulses: Callable[[str, Sequence[Body]], str | None]) -> str | None:
    """Why a part of a tree with armature would not feel it: a controller of the engine (``title``), a reason by ``impulses``,
    or contact; None where all would. Constraints are described by the engine, in ``impulses``.

    ``impulses`` is given the name of a body whose joint has armature and all bodies of its tree, and gives the
    reason why what else the engine solves in the tree would not feel it; None where it would.
    """
    allowed, groups = CollisionFilter(world), rigid_groups(world)
    for bodies in trees(world).values():
        armed = next((body.name for body in bodies if body.joint.armature), None)
        if armed is None:
            continue
        if served := natively_driven(bodies, world):
            return f"{served[0]!r} has {title}'s own controller, whose impulses would ignore the armature"
        if (why := impulses(armed, bodies)) is not None:
            return why
        for body in bodies:
            for other in world.bodies:
                if groups[body.name] != "world" and allowed.may_touch(body.name, other.name):
                    return f"{body.name!r} may touch {other.name!r}, and contact would ignore the armature"
    return None


def _rough_or_limited(_: str, bodies: Sequence[Body]) -> str | None:
    for body in bodies:
        if body.joint.dry_friction or body.joint.position_limits is not None:
            return f"{body.name!r} has dry friction or position limits, whose impulses would ignore the armature"
    return None


def native_implicit_damping(title: str, balls: bool) -> Support:
    """Implicit damping by that of an engine (``title``) whose impulses meet the mass matrix without dt D: exact where there are
    no impulses, else accepted by name. ``balls``: of ball joints whose parents move, too."""
    how = f"{title} integrates damping implicitly"
    late = "damping is implicit, but impulses of contact, limits and dry friction meet the mass matrix without dt × damping"

    def refine(world: World) -> Refinement | None:
        if not balls and (armed := classes.no_armed_ball(world)) is not None:
            return armed
        unfelt = _unfelt(world, title, _rough_or_limited)
        return None if unfelt is None else Refinement(Level.APPROXIMATE, late, IMPULSES_UNDAMPED)

    return exact(how, refine, (Refinement(Level.APPROXIMATE, late, IMPULSES_UNDAMPED),))


IMPULSES_UNDAMPED: Final = "impulses of contact, limits and dry friction ignore dt × damping"


BY_IMPLICIT_DAMPING: Final = (
    "simspec adds implicit damping A/dt and the opposite effort (A/dt) v, which together act as the armature A"
)


def implicit_damping_armature(title: str, short: str) -> Support:
    """Armature by an engine's implicit damping; not where impulses of dry friction or limits would ignore it."""
    return outside(
        BY_IMPLICIT_DAMPING,
        lambda world: armature_felt(world, title, _rough_or_limited),
        short,
    )


def implicit_damping_ball_armature(title: str, short: str) -> Support:
    """That of balls: the same where the parent of a ball moves, and otherwise inertia of the body."""

    def refine(world: World) -> Refinement | None:
        if classes.no_armed_ball(world) is None:
            return None
        unfelt = armature_felt(world, title, _rough_or_limited)
        return unfelt or Refinement(Level.OUTSIDE, BY_IMPLICIT_DAMPING, short)

    return exact(classes.AS_INERTIA, refine, (Refinement(Level.OUTSIDE, BY_IMPLICIT_DAMPING, short),))


# Detectors that find the distance of convex shapes by iterations: these end before the nearest point of a side that is curved,
# or of many small faces. Measured with a ball of 1 cm at 150 points at each of 6 gaps, for 168 cylinders and hulls of 8 to 800
# vertices: the side of a cylinder of 2 to 30 mm length is felt up to 0.25 mm inside of its place, 0.07 mm with 50 mm, 0.03 mm
# with 200 mm; with a radius up to 4 mm, or a length up to 1 mm, it is exact to 0.05 mm. Hulls whose shortest edge is 1 cm and
# more are exact to 0.03 mm, others to 0.25 mm; boxes, capsules, flat ends of cylinders and hulls of up to six faces to 0.01 mm.

BLUNT: Final = 2.5e-4
"""m by which the curved side of a short cylinder, and a face of a fine hull, are felt inside of where they are at most."""
SHORT: Final = (1e-3, 30e-3)
"""m between which a cylinder's length is, where its side is felt inside by more than a probe's tolerance (0.1 mm)."""
SLENDER: Final = 4e-3
"""m of a cylinder's radius, up to which its side is exact."""
FINE: Final = 0.01
"""m below which the shortest edge of a hull is, where its faces are felt inside."""
FEW_FACES: Final = 6
"""Up to so many plane faces hulls are exact, however small."""


def blunted(kind: str, world: World) -> Iterator[Shape]:
    """The colliding shapes of a kind whose sides or faces are felt inside of where they are."""
    for body in world.bodies:
        for shape in body.shapes:
            if shape.collision and shape.kind == kind == "cylinder":
                radius, length = shape.size
                if radius > SLENDER and SHORT[0] < length < SHORT[1]:
                    yield shape
            elif shape.collision and shape.kind == kind == "mesh" and _is_fine(shape.size):
                yield shape


@functools.lru_cache(maxsize=1024)
def _is_fine(size: tuple[float, ...]) -> bool:
    """Whether a hull (flat vertices, m) has an edge shorter than ``FINE`` and more than ``FEW_FACES`` plane faces."""
    solid = hull_of(size)
    if len(np.unique(np.round(solid.normals, 6), axis=0)) <= FEW_FACES:
        return False
    corners = solid.vertices[solid.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return bool(edges.min() < FINE)


# Support for contact of several bodies: exact where no declared deviation of its probes counts, else accepted by name.

SLIDING = ("stack-slides", "stack-stays", "stack-slides-plane", "stack-stays-plane")
"""Probes of stacks that slide: their rows say nothing of worlds in which no body that moves has faces, or of those without a
plane."""


Settings = Callable[[World], Mapping[str, Any]]


def in_force(engine: str) -> Settings:
    """The settings that are in force in a world: those that its spec gives the engine, and the engine's own."""
    return lambda world: written_settings(find_engine(engine), world)


def _happens(row: Deviation, law: PairContact, there: MaterialReach) -> bool:
    """Whether two materials can do what a row is of; stacks at rest below ``HEAVY_ON_LIGHT`` are near enough to the law."""
    if row.probe not in SLIDING:
        return not row.probe.startswith("stack") or there.ratio >= HEAVY_ON_LIGHT
    return (
        law.friction > 0.0 and there.ratio > 0.0 and there.corners and (there.plane or not row.probe.endswith("-plane"))
    )


def leans(world: World) -> bool:
    """Whether friction can change a normal force in ``world``: a body with friction may lean, clamp or be piled."""
    return any(law.friction and reach(world, *pair).leans for pair, law in meeting_laws(world).items())


PROBES: Mapping[Feature, str] = {
    Feature.MASS_RATIO: "stack",
    Feature.EVEN_PRESSURE: "squeeze",
    Feature.SELF_LOCKING: "jam",
}
"""Beginnings of the names of the probes that measure features of contact of several bodies."""


def coupled(
    settings: str | Settings,
    rows: Sequence[Deviation],
    texts: Mapping[Feature, tuple[str, str]],
    stacks: Callable[[Deviation], bool] = lambda row: True,
) -> dict[Feature, Support]:
    """For each feature of ``texts`` (how, short): exact where no deviation of its probes counts, else accepted by name.
    ``settings``: an engine's name, or its settings in a world; ``stacks``: the rows of stacks that count here."""
    chosen = in_force(settings) if isinstance(settings, str) else settings
    return {
        feature: _exact_without(
            [
                row
                for row in rows
                if row.probe.startswith(PROBES[feature]) and (feature is not Feature.MASS_RATIO or stacks(row))
            ],
            chosen,
            *text,
        )
        for feature, text in texts.items()
    }


def _exact_without(rows: Sequence[Deviation], settings: Settings, how: str, short: str) -> Support:
    def exact(world: World) -> Refinement | None:
        ratio, timestep, cone = largest_ratio(world), world.physics.timestep, world.contact.friction_cone
        chosen = settings(world) if rows else {}
        counting = any(
            row.counts_for(law, cone, timestep, chosen, ratio) and _happens(row, law, reach(world, *pair))
            for pair, law in meeting_laws(world).items()
            for row in rows
        )
        return None if counting else Refinement(Level.EXACT, "")

    return approximate(how, exact, short)
