"""How far two values of a model are apart: numbers, vectors, orientations, poses of shapes, values of an inventory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeGuard

from simspec.world import frames
from simspec.world.shapes import SHAPES, Round
from simspec.world.types import Quaternion, Shape

SMALL_SHARE = 1e-6
"""Share of the largest number of a list below which another is held to that share, not to itself: what is zero but for
round-off must not fail, what is small must not hide."""
HALF_TURNS: tuple[Quaternion, ...] = ((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""By half a turn about its x, y and z axis; all leave a box and an ellipsoid as they are."""


def distance(a: Sequence[float], b: Sequence[float], scale: float = 1.0) -> float:
    """The length of a − b in units of ``scale``; None-safe callers check lengths first."""
    return math.dist(a, b) / scale


def turn_between(a: Quaternion, b: Quaternion) -> float:
    """The angle (rad) between two orientations: 2 |sin(angle/2)|, exact for small angles, at most 2."""
    _, x, y, z = frames.multiply(frames.conjugate(a), b)
    return 2.0 * math.sqrt(x * x + y * y + z * z)


def relative(expected: float, actual: float) -> float:
    """|found − expected| relative to the larger of both; 0 when both are 0."""
    largest = max(abs(expected), abs(actual))
    # beside a zero, max() passes a NaN over: the difference has it
    return abs(actual - expected) / (largest or 1.0)


def held_apart(expected: object, actual: object) -> float | None:
    """How far two held values are apart: relative for numbers, else 0 when they are the same and None when they are not."""
    if isinstance(expected, (list, tuple)) != isinstance(actual, (list, tuple)):
        return None
    values: Sequence[object] = expected if isinstance(expected, (list, tuple)) else (expected,)
    actual_values: Sequence[object] = actual if isinstance(actual, (list, tuple)) else (actual,)
    if len(values) != len(actual_values):
        return None
    scale = max((abs(x) for x in (*values, *actual_values) if _is_number(x)), default=0.0)
    apart = 0.0
    for a, b in zip(values, actual_values, strict=True):
        if _is_number(a) and _is_number(b) and math.isfinite(a) and math.isfinite(b):
            own = max(abs(a), abs(b), SMALL_SHARE * scale if math.isfinite(scale) else 0.0)
            apart = max(apart, abs(a - b) / own if own else 0.0)
        elif a != b or isinstance(a, bool) != isinstance(b, bool):
            return None
    return apart


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def unlikeness(shape: Shape, other: Shape) -> float:
    """How little two shapes of one kind resemble each other, to match shapes without names."""
    away, turned = pose_difference(shape, other)
    if SHAPES[shape.kind].points:
        sizes = distance(_bounds(shape.size), _bounds(other.size))
    else:
        sizes = distance(shape.size, other.size) if len(shape.size) == len(other.size) else math.inf
    return away + turned + sizes + (0.0 if shape.name == other.name else 1e-6)


def _bounds(points: Sequence[float]) -> tuple[float, ...]:
    """The least and the largest x, y and z of points."""
    columns = [points[axis::3] or (math.inf,) for axis in range(3)]
    return (*map(min, columns), *map(max, columns))


def pose_difference(shape: Shape, other: Shape) -> tuple[float, float]:
    """Metres and radians between two shapes' poses, without what the shape's symmetry makes meaningless."""
    kind = SHAPES[shape.kind]
    if kind.round is not Round.AXIS:
        turned = 0.0
        if kind.round is Round.NONE:
            turns = (frames.IDENTITY, *(HALF_TURNS if kind.upside_down else ()))
            own = shape.pose.quaternion
            turned = min(turn_between(own, frames.multiply(other.pose.quaternion, turn)) for turn in turns)
        return distance(shape.pose.position, other.pose.position), turned
    axis, other_axis = (frames.rotate(member.pose.quaternion, (0.0, 0.0, 1.0)) for member in (shape, other))
    turned = distance(axis, other_axis)
    if kind.upside_down:
        turned = min(turned, distance(axis, tuple(-x for x in other_axis)))
    if not kind.endless:
        return distance(shape.pose.position, other.pose.position), turned
    apart = frames.subtract(other.pose.position, shape.pose.position)
    return abs(frames.dot(axis, apart)), turned
