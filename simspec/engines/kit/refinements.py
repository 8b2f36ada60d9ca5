"""What of a world decides what an engine has of it, where several engines ask the same (``refine`` of their declarations)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from simspec.support.declarations import Level, Refine, Refinement, Support, exact, outside, unsupported_if
from simspec.world.contact_pairs import CollisionFilter, frictionless, meeting_kinds, meeting_laws, solid_shapes
from simspec.world.inertia import lumped
from simspec.world.kinematics import natively_driven, rigid_groups, trees
from simspec.world.types import Body, Pair, Shape, World

ROUND_OFF = 1e-9
"""Relative: what calculating an inertia or a centre of mass may cost."""
NO_FRICTION = Refinement(Level.VIA_API, "nothing has friction")


def no_friction(world: World) -> Refinement | None:
    """No cone matters where nothing has friction."""
    return NO_FRICTION if frictionless(world) else None


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


def still_or_light(why: str) -> Support:
    """Of fixed joints: not where a body that has a mass is fixed to one that moves, in an engine whose coordinates are those of
    their common centre of mass. ``why`` names the body as ``{name}``."""

    def refine(world: World) -> Refinement | None:
        groups, told = rigid_groups(world), lumped(world)
        heavy = (
            body.name
            for body in world.bodies
            if body.joint.kind == "fixed"
            and groups[body.name] != "world"
            and told.get(body.name, body.inertial).mass > 0.0
        )
        name = next(heavy, None)
        return unsupported_if(None if name is None else why.format(name=repr(name)))

    return exact("of what cannot move, and of bodies without mass on one that moves, which are parts of it", refine)


def static_planes(why: str) -> Support:
    """Planes of bodies that cannot move alone. ``why`` names a plane that would move as ``{name}``."""
    return exact("of bodies that cannot move", planes_still(why))


def planes_still(why: str) -> Refine:
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


def met_pairs(world: World, told: Mapping[Pair, str]) -> Mapping[Pair, str]:
    """Of what is told of sorted pairs of kinds of shapes, that of those that may meet here."""
    met = meeting_kinds(world)
    return {pair: how for pair, how in told.items() if pair in met}


def approximate_pairs(told: Mapping[Pair, str], short: str) -> Refinement:
    """Approximate, with what is told of each pair of kinds of shapes; ``short`` is one line on what is lost."""
    how = "; ".join(f"{one} and {other}: {lost}" for (one, other), lost in told.items())
    return Refinement(Level.APPROXIMATE, how, short)


# Armature that simspec computes outside an engine, as an effort before every step: in which worlds that is exact.


def armature_felt(world: World, title: str, impulses: Callable[[str, Sequence[Body]], str | None]) -> Refinement | None:
    """Not supported where something in a tree with armature would not feel it: a controller of the engine (``title``), what
    ``impulses`` names, or contact. What they say of constraints is the engine's to say, in ``impulses``.

    ``impulses`` is given the name of a body whose joint has armature and all bodies of its tree, and gives the
    reason why what else the engine solves in the tree would not feel it; None where it would.
    """
    allowed, groups = CollisionFilter(world), rigid_groups(world)
    for bodies in trees(world).values():
        armed = next((body.name for body in bodies if body.joint.armature), None)
        if armed is None:
            continue
        if served := natively_driven(bodies, world):
            return unsupported_if(
                f"{served[0]!r} has {title}'s own controller, whose impulses would ignore the armature"
            )
        if (why := impulses(armed, bodies)) is not None:
            return unsupported_if(why)
        for body in bodies:
            for other in world.bodies:
                if groups[body.name] != "world" and allowed.may_touch(body.name, other.name):
                    return unsupported_if(
                        f"{body.name!r} may touch {other.name!r}, and contact would ignore the armature"
                    )
    return None


def implicit_damping_armature(title: str, short: str) -> Support:
    """Armature by an engine's implicit damping; not where impulses of dry friction or limits would ignore it."""

    def not_felt(_: str, bodies: Sequence[Body]) -> str | None:
        for body in bodies:
            if body.joint.dry_friction or body.joint.position_limits is not None:
                return f"{body.name!r} has dry friction or position limits, whose impulses would ignore the armature"
        return None

    return outside(
        "the engine's implicit damping A / dt with the effort (A / dt) v against it",
        lambda world: armature_felt(world, title, not_felt),
        short,
    )
