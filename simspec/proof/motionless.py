"""Worlds of which every motion is at a limit of a joint, where motion proofs cannot follow: why, from the world alone."""

from __future__ import annotations

import numpy as np

from simspec.proof.inside import followers, left_to
from simspec.proof.touch.plan import oracle_of
from simspec.world.canonical import derived
from simspec.world.kinematics import initial_state
from simspec.world.types import World

LOCKED = 1e-9
"""Share of a joint's speed that constraints leave it, below which they hold it: of what they leave free it is 0.1 and more, of
what they hold round-off (measured: 1e-13 at most)."""
MARGIN = 0.05
"""Share of its range within which a joint is near a limit."""


@derived
def motionless(world: World) -> str:
    """Why every motion of a world is at a limit; "" where one may be found that is not."""
    for body in world.bodies:
        limits = body.joint.position_limits
        if limits is not None and limits[0] >= limits[1]:
            return f"the limits of joint {body.joint.name!r} leave it one position, so that every motion is at a limit"
    return (_without_room(world) or _held_at_a_limit(world)) if world.constraints else ""


def _without_room(world: World) -> str:
    """The same of a world in which joints that follow one other have no position at which all are inside their limits, as two
    that turn against each other and may both turn one way only."""
    limits = {body.joint.name: body.joint.position_limits for body in world.bodies}
    for first, chain in followers(world).items():
        low, high = left_to(chain, limits, MARGIN)
        if low >= high:
            names = ", ".join(repr(name) for name, _, _ in chain)
            return (
                f"no position of joint {first!r} leaves all of {names} away from their limits by {MARGIN:.0%} of their ranges, "
                "so that every motion is at a limit"
            )
    return ""


def _held_at_a_limit(world: World) -> str:
    """The same of a world whose constraints hold a joint where it begins, and that is at a limit or beyond. It is held where it
    cannot move at the beginning, nor where the other joints are as far inside their limits as they come: in one of the two a
    linkage that can move may be at the end of its way."""
    oracle = oracle_of(world)
    start, _ = initial_state(world)
    q = oracle.inwards(start)
    for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
        if body.joint.position_limits is None:
            continue
        low, high = body.joint.position_limits
        own = float(q[at_q.start])
        if low + MARGIN * (high - low) <= own <= high - MARGIN * (high - low):
            continue
        unit = np.zeros(oracle.nv)
        unit[at_v.start] = 1.0
        if all(abs(oracle.constrained_velocity(where, unit)[at_v.start]) < LOCKED for where in (start, q)):
            at = f"at {own + 0.0:.6g}, within {MARGIN:.0%} of its range to a limit, or beyond: {low:g} to {high:g}"
            return f"constraints hold joint {body.joint.name!r} {at}, so that every motion is at a limit"
    return ""
