"""Where prims are: their stacks of operations as rigid poses and factors along axes, in metres.

Operations that only move and turn are composed as they are written, in doubles; a place below other factors than 1 is taken
from the matrix that USD computes.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.imports.elements import CARRIED
from simspec.imports.usd.stage import PrimRead
from simspec.world import frames
from simspec.world.types import Pose, Quaternion, Vector3

UNIT_SCALE: Final = (1.0, 1.0, 1.0)
SAME: Final = Pose()
SHEARED: Final = 1e-4
"""Cosine between two axes of a shape up to which they are at right angles: files have single precision."""
ROTATIONS: Final = "unit-rotations"
UNIT: Final = 1e-2
"""How far from 1 a quaternion's length may be; the language's own bound."""
ALIKE: Final = 1e-6
"""Relative deviation of factors that are the same but for single precision."""


@dataclass(frozen=True, slots=True)
class PrimPlace:
    """A rigid pose (m), and factors along the axes that it gives."""

    pose: Pose = SAME
    scale: Vector3 = UNIT_SCALE


class PrimPlaces:
    """Where prims are against each other. ``metres``: of one unit of the stage."""

    def __init__(self, metres: float, upright: bool):
        self.metres = metres
        self.upright = upright
        """Whether z is up; else y is, and the world is turned."""
        self._local = functools.cache(self._read)

    def world(self, prim: PrimRead) -> PrimPlace:
        """The place of a prim in the world. Raises SpecError where axes are not at right angles."""
        place = self.within(prim, None)
        return place if self.upright else PrimPlace(frames.compose(UPRIGHT, place.pose), place.scale)

    def within(self, prim: PrimRead, body: PrimRead | None) -> PrimPlace:
        """The place of a prim in the rigid frame of one that it is in, or itself; None: in the stage."""
        chain: list[PrimRead] = []
        closed = False
        for above in prim.ancestors():
            if above is body:
                closed = True
                break
            chain.append(above)
            if above.record.get("reset"):
                break
        if body is not None and not closed:  # a prim that stands in the body does not move with its place
            place = self.within(prim, None)
            return PrimPlace(frames.compose(frames.inverse(self.within(body, None).pose), place.pose), place.scale)
        start = UNIT_SCALE if body is None else self.within(body, None).scale
        return (self._composed(chain) if start == UNIT_SCALE else None) or self._by_matrix(prim, body)

    def _composed(self, chain: list[PrimRead]) -> PrimPlace | None:
        """The place of the first of a chain of prims in what is around the last; None where factors stand in between."""
        pose = Pose()
        for index, prim in enumerate(reversed(chain)):
            operations = self._local(prim)
            if operations is None or (operations.scale != UNIT_SCALE and index < len(chain) - 1):
                return None
            pose = frames.compose(pose, operations.pose)
        scale = self._local(chain[0]) if chain else None
        return PrimPlace(pose, scale.scale if scale is not None else UNIT_SCALE)

    def _by_matrix(self, prim: PrimRead, body: PrimRead | None) -> PrimPlace:
        matrix = _matrix(prim)
        if body is not None:
            around = self.within(body, None).pose
            rigid = np.eye(4)
            rigid[:3, :3] = frames.matrix(around.quaternion)
            rigid[:3, 3] = np.array(around.position) / self.metres
            matrix = np.linalg.inv(rigid) @ matrix
        return self._of_matrix(matrix, prim)

    def _of_matrix(self, matrix: NDArray[np.float64], prim: PrimRead) -> PrimPlace:
        """A matrix as a pose and factors. Raises SpecError where it has none."""
        axes = matrix[:3, :3]
        factors = np.linalg.norm(axes, axis=0)
        if not np.isfinite(matrix).all() or factors.min() == 0.0:
            raise prim.error("its transformation leaves no volume, or is not finite")
        if float(np.ptp(factors)) <= ALIKE * float(factors.max()):
            factors[:] = factors.mean()
        factors[np.abs(factors - 1.0) <= ALIKE] = 1.0
        unit = axes / np.linalg.norm(axes, axis=0)
        if np.abs(unit.T @ unit - np.eye(3)).max() > SHEARED:
            raise prim.error("its axes are not at right angles to each other: sheared shapes are not supported")
        if np.linalg.det(unit) < 0.0:
            unit[:, 0], factors[0] = -unit[:, 0], -factors[0]
        rows: Any = tuple(tuple(row) for row in unit.tolist())
        turn = frames.from_matrix(rows)
        origin = frames.vector3(float(value) * self.metres for value in matrix[:3, 3])
        return PrimPlace(Pose(origin, frames.IDENTITY if 1.0 - turn[0] < 1e-14 else turn), tuple(factors.tolist()))

    def _read(self, prim: PrimRead) -> PrimPlace | None:
        """A prim's own operations; None where they are no pose with factors after it."""
        pose, scale = Pose(), UNIT_SCALE
        for name, kind, inverse, value in prim.record.get("ops", ()):
            prim._taken.add(name.removeprefix("!invert!"))
            if value is None:
                continue
            if scale != UNIT_SCALE:
                return None
            if kind == "Scale":
                if inverse:
                    return None
                scale = tuple(map(float, value))  # type: ignore[assignment]
                if 0.0 in scale:
                    raise prim.error("a factor of 0 leaves no volume", found=str(value)[:80])
                continue
            operations = self._pose(prim, kind, value)
            if operations is None:
                return None
            pose = frames.compose(pose, frames.inverse(operations) if inverse else operations)
        return PrimPlace(pose, scale)

    def _pose(self, prim: PrimRead, kind: str, value: Any) -> Pose | None:
        values = value if isinstance(value, list) else [value]
        if any(not isinstance(item, (int, float)) for item in values):
            raise prim.error("a transformation should be finite", found=str(value)[:80])
        if kind == "Translate":
            return Pose(frames.vector3(self.metres * item for item in values))
        if kind == "Orient":
            return Pose(quaternion=quaternion(prim, "xformOp:orient", values))
        if kind.startswith("Rotate"):
            axes = kind.removeprefix("Rotate")
            if len(axes) != len(values):
                return None
            turn = frames.IDENTITY
            angles = dict(zip("XYZ" if len(axes) == 3 else axes, values, strict=True))
            for axis in axes:  # the first is the innermost
                turn = frames.multiply(_about(axis, math.radians(angles[axis])), turn)
            return Pose(quaternion=turn)
        return None


def quaternion(prim: PrimRead, name: str, values: Any) -> Quaternion:
    """A unit quaternion w x y z. Raises SpecError for what is none; another length than 1 is a defect, which a rule repairs."""
    w, x, y, z = values
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length == 0.0 or not (abs(length - 1.0) <= UNIT or prim.forgiving):
        hint = f"simspec import --repair {ROTATIONS}: quaternions of another length than 1 become unit quaternions"
        message = f"{name} is no rotation: its length is {length:g}"
        raise prim.error(message, found=str(values)[:80], hint=hint if length else None)
    if abs(length - 1.0) > UNIT:
        prim.set_aside(name, CARRIED, f"made a unit quaternion by the rule {ROTATIONS}")
    return frames.normalise((w, x, y, z))


def _about(axis: str, angle: float) -> Quaternion:
    unit: Vector3 = tuple(1.0 if axis == word else 0.0 for word in "XYZ")  # type: ignore[assignment]
    return frames.from_axis_angle(unit, angle)


UPRIGHT: Final = Pose(quaternion=_about("X", math.pi / 2.0))
"""Where the axes of a stage with y up are in a world with z up."""


def _matrix(prim: PrimRead) -> NDArray[np.float64]:
    for above in prim.ancestors():
        if "world" in above.record:
            values = above.record["world"]
            if any(not isinstance(item, (int, float)) for item in values):
                raise above.error("a transformation should be finite")
            return np.array(values, float).reshape(4, 4).T
    return np.eye(4)
