"""Armature that simspec computes outside an engine, as an effort before every step: in which worlds that is exact."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import natively_driven, rigid_groups, trees
from simspec.world.types import Body, World


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
