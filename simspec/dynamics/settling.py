"""Where probes of constrained worlds begin: positions at which the constraints hold, away from the limits of joints."""

from __future__ import annotations

import numpy as np

from simspec.dynamics.oracle_tree import Tree
from simspec.world.kinematics import layout_of
from simspec.world.types import Follow

SEED = 20_212
ASTRAY = 0.3
"""rad or m that a closed loop is first moved away from where it begins, along a direction in which it may move; halved until
that leads somewhere."""
HALVINGS = 6
INWARDS = 150
"""Steps from the limits inwards: a leg of ten joints whose crank begins out of its range by 0.6 rad takes 20."""
STRIDE = 0.1
"""rad or m of the longest of these steps, halved where the constraints cannot be met from there ..."""
SHORTEST = 1e-3
"""... down to this."""
INSIDE = 0.2
"""Share of its range that a joint should be away from both limits."""
BEYOND = 0.02
"""Share of its range by which a step aims further, so that it arrives."""


def settled(tree: Tree, wanted: np.ndarray, start: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A position (nq,) at which the constraints hold: near ``wanted`` where joints are coupled alone; where loops are closed
    some way from ``start``, at which they hold, towards anywhere."""
    if tree.held is not None and all(isinstance(held, Follow) for held in tree.held.constraints):
        near = tree.settled(wanted)
        return start if near is None else near
    away = tree.constrained_velocity(start, generator.uniform(-1.0, 1.0, tree.nv))
    for halving in range(HALVINGS):
        near = tree.settled(tree.moved(start, away * ASTRAY / 2.0**halving))
        if near is not None:
            return near
    return start


def inwards(tree: Tree, q: np.ndarray) -> np.ndarray:
    """A position (nq,) at which the constraints hold as they do at ``q``, with the joints as far inside their limits as steps
    along the constraints lead: ``q`` itself where all are, and what came nearest where some cannot be."""
    layout = layout_of(tree.world)
    parts = zip(tree.world.bodies, layout.position, layout.velocity, strict=True)
    limited = [
        (at_q.start, at_v.start, body.joint.position_limits)
        for body, at_q, at_v in parts
        if body.joint.position_limits is not None and body.joint.position_limits[0] < body.joint.position_limits[1]
    ]
    if not limited:
        return q
    at_q, at_v = (np.array([row[column] for row in limited]) for column in (0, 1))
    low, high = (np.array([row[2][side] for row in limited]) for side in (0, 1))
    best, least, stride = q, np.inf, STRIDE
    for _ in range(INWARDS):
        up, down = low + INSIDE * (high - low) - q[at_q], q[at_q] - high + INSIDE * (high - low)
        lacking = float(np.square(np.maximum(np.maximum(up, down), 0.0) / (high - low)).sum())
        if lacking < least:
            best, least = q, lacking
        if not lacking:
            return q
        aim = np.zeros(tree.nv)
        further = BEYOND * (high - low)
        aim[at_v] = np.where(up > 0.0, up + further, np.where(down > 0.0, -down - further, 0.0))
        step = tree.constrained_velocity(q, aim)
        longest = float(np.abs(step).max())
        if not longest or stride < SHORTEST:
            break
        near = tree.settled(tree.moved(q, step * min(1.0, stride / longest)))
        if near is None:
            stride /= 2.0
        else:
            q = near
    return best
