"""Positions within the limits of sums of joint positions, for probes that stay away from limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from simspec.world.kinematics import layout_of
from simspec.world.passive_forces import JointSums
from simspec.world.types import Follow, World

Floats = NDArray[np.float64]
ROUNDS = 500
"""Of projections onto each sum in turn, and into the ranges of the joints; pairs of fingers need three."""
MIDDLE = 0.4
"""Share of their ranges by which sums begin away from their limits where a probe has room to move."""
CALM = 0.2
"""Of its range per second: the speed with which a sum begins at most."""
CLOSE = 1e-12
"""rad or m of a joint by which positions may miss what is asked of them."""


def followers(world: World) -> dict[str, list[tuple[str, float, float]]]:
    """By the first joint of each chain of joints that follow one other: the joints of the chain, itself among them, with the
    ratio and offset by which their positions are those of the first."""
    leaders = {one.joint: one for one in world.constraints if isinstance(one, Follow)}
    chains: dict[str, list[tuple[str, float, float]]] = {}
    for name in leaders:
        ratio, offset, first = 1.0, 0.0, name
        for _ in leaders:  # no chain is longer, and none goes round
            if first not in leaders:
                break
            one = leaders[first]
            ratio, offset, first = ratio * one.ratio, ratio * one.offset + offset, one.leader
        chains.setdefault(first, [(first, 1.0, 0.0)]).append((name, ratio, offset))
    return chains


def left_to(
    chain: Sequence[tuple[str, float, float]], limits: Mapping[str, tuple[float, float] | None], margin: float = 0.0
) -> tuple[float, float]:
    """The lowest and highest position of the first joint of a chain of :func:`followers` at which every joint of it is a share
    of its range away from its ``limits`` (None: it has none); the lowest is above the highest where there is none such."""
    low, high = -np.inf, np.inf
    for name, ratio, offset in chain:
        own = limits[name]
        if own is not None and ratio:
            room = margin * (own[1] - own[0])
            ends = sorted((limit - offset) / ratio for limit in (own[0] + room, own[1] - room))
            low, high = max(low, ends[0]), min(high, ends[1])
    return low, high


class Stops:
    """The sums of a world that have limits: ``along``, and ``low`` and ``high`` (sums,)."""

    def __init__(self, world: World):
        limited = [one for one in world.sums if one.position_limits is not None]
        self.along = JointSums(world.bodies, limited)
        ends = np.array([one.position_limits for one in limited], dtype=float).reshape(-1, 2)
        self.low, self.high = ends.T
        where = layout_of(world)
        self.places = np.zeros(where.nv, dtype=np.intp)
        """Where in q each coordinate of a hinge or slide is that stands in v; 0 of others, which no sum has."""
        self._own: dict[str, int] = {}
        self.floor, self.ceiling = np.full(where.nq, -np.inf), np.full(where.nq, np.inf)
        for body, q, v in zip(world.bodies, where.position, where.velocity, strict=True):
            if q.stop - q.start == 1:
                self.places[v] = q.start
            self._own[body.joint.name] = v.start
            if body.joint.position_limits is not None:
                self.floor[q], self.ceiling[q] = body.joint.position_limits

    def near(self, states: Floats, margin: float) -> NDArray[np.bool_]:
        """Whether, at each of some positions (n, nq), a sum is within a share of its range to a limit, or beyond."""
        lengths, room = self.along.lengths(states), margin * (self.high - self.low)
        near: NDArray[np.bool_] = ((lengths < self.low + room) | (lengths > self.high - room)).any(axis=1)
        return near

    def moved(
        self, q: Floats, targets: Sequence[tuple[int, float, float]], margin: float, coupled: Sequence[Follow] = ()
    ) -> Floats | None:
        """Positions near ``q`` (nq,) at which each of some sums (row, lower, upper) is between two values, joints follow those
        that they are ``coupled`` to, and every joint that is in any of these is a share of its range away from its limits; None
        where none are found."""
        q = q.copy()
        rows = [(self.along.weights[row], lower, upper) for row, lower, upper in targets]
        rows += [(self._weights(one), one.offset, one.offset) for one in coupled]
        touched = np.any([weights != 0.0 for weights, _, _ in rows], axis=0)
        at = self.places[touched]
        span = np.where(np.isfinite(self.ceiling - self.floor), self.ceiling - self.floor, 0.0)[at]
        low, high = self.floor[at] + margin * span, self.ceiling[at] - margin * span
        for _ in range(ROUNDS):
            off = 0.0
            q[at] = np.clip(q[at], low, high)
            for weights, lower, upper in rows:
                acting = np.flatnonzero(weights)
                length = float(weights[acting] @ q[self.places[acting]])
                gap = min(max(length, lower), upper) - length
                off = max(off, abs(gap) / float(np.abs(weights).max()))
                q[self.places[acting]] += weights[acting] * gap / float(weights @ weights)
            if off < CLOSE:
                return q
        return None

    def _weights(self, one: Follow) -> Floats:
        weights = np.zeros(len(self.places))
        weights[self._own[one.joint]], weights[self._own[one.leader]] = 1.0, -one.ratio
        return weights


def inside(world: World, q: Floats, margin: float) -> Floats:
    """``q`` (nq,), or positions near it at which all sums are ``margin`` of their ranges away from their limits; ``q`` where
    there are none."""
    if not any(one.position_limits for one in world.sums):
        return q
    stops = Stops(world)
    room = margin * (stops.high - stops.low)
    targets = list(zip(range(len(room)), (stops.low + room).tolist(), (stops.high - room).tolist(), strict=True))
    coupled = [held for held in world.constraints if isinstance(held, Follow)]
    moved = stops.moved(q, targets, margin, coupled)
    return q if moved is None else moved


def calmed(world: World, v: Floats, most: float) -> Floats:
    """``v`` (nv,) with no sum faster than ``most`` of its range per second."""
    stops = Stops(world)
    for weights, span in zip(stops.along.weights, stops.high - stops.low, strict=True):
        speed = float(weights @ v)
        v = v - weights * (speed - np.clip(speed, -most * span, most * span)) / float(weights @ weights)
    return v
