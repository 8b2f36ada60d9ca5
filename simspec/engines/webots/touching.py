"""Which bodies touch in Webots, where that is not what a world says: it has no filter but for what joints join.

Two bodies that a joint joins never touch; a joint to what cannot move joins to all that cannot; and bodies between which there
are hinges or balls alone, all with one anchor in the Solids around them, do not touch either (its collision callback, R2023b).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from simspec.language.vocabulary import TREE_JOINTS
from simspec.support.declarations import Level, Refinement, not_here
from simspec.world import frames
from simspec.world.derived import derived
from simspec.world.kinematics import CollisionFilter, poses, rigid_groups
from simspec.world.meeting import solid_shapes
from simspec.world.types import Body, Vector3, World

ALIKE = 1e-4
"""Metres within which two anchors may be one to Webots."""
ROUND = ("hinge", "ball")


@derived
def kept_apart(world: World) -> tuple[tuple[str, str], ...]:
    """The sorted pairs of bodies that may touch in ``world`` and never do in Webots."""
    groups = rigid_groups(world)
    solid: dict[str, list[str]] = {}
    for body in world.bodies:
        if solid_shapes(body):
            solid.setdefault(groups[body.name], []).append(body.name)
    allowed = CollisionFilter(world)
    found = {
        (min(one, other), max(one, other))
        for first, second in _joined(world)
        for one in solid.get(first, ())
        for other in solid.get(second, ())
        if allowed.may_touch(one, other)
    }
    return tuple(sorted(found))


def _joined(world: World) -> Iterator[tuple[str, str]]:
    """Pairs of rigid groups that Webots keeps apart."""
    groups = rigid_groups(world)
    bodies = {body.name: body for body in world.bodies}
    anchors = _anchors(world)
    for body in world.bodies:
        if body.joint.kind not in TREE_JOINTS:
            continue
        top: Body | None = body
        first: Vector3 | None = None
        near = True
        while top is not None and top.joint.parent is not None:
            if top.joint.kind in ROUND:
                if first is None:
                    first = anchors[top.name]
                elif math.dist(first, anchors[top.name]) > ALIKE:
                    break
            above = groups[top.joint.parent]
            if near or (first is not None and above != "world"):
                yield groups[body.name], above
            near = False
            top = bodies.get(above)


def _anchors(world: World) -> dict[str, Vector3]:
    """Where joints stand in the Solids around them, at the initial state."""
    placed = poses(world)
    return {
        body.name: frames.compose(frames.inverse(placed[body.joint.parent]), placed[body.name]).position
        for body in world.bodies
        if body.joint.parent is not None
    }


def touches_less(world: World) -> str:
    """What a world's pairs that Webots keeps apart are, in words; "" where there is none."""
    pairs = kept_apart(world)
    if not pairs:
        return ""
    (one, other), more = pairs[0], len(pairs) - 1
    others = f" and {more} more pair{'s' if more > 1 else ''}" if more else ""
    return f"{one!r} never touches {other!r}{others}, since Webots passes over what joints join"


def only_joined(world: World) -> Refinement | None:
    """Not supported where bodies are kept apart that no joint joins."""
    groups = rigid_groups(world)
    joined = {frozenset(pair) for pair in _joined(world)}
    solid = {body.name for body in world.bodies if solid_shapes(body)}
    for one, other in world.contact.excluded_bodies:
        pair = frozenset((groups[one], groups[other]))
        if len(pair) > 1 and {one, other} <= solid and pair not in joined:
            return not_here(f"Webots has no filter of bodies, and would let {one!r} touch {other!r}")
    return Refinement(Level.EXACT, "of bodies that a joint joins")
