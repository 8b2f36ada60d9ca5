"""Rotations as PyBullet tells them."""

from __future__ import annotations

from collections.abc import Sequence

from simspec.world import frames
from simspec.world.rotations import from_xyzw_of
from simspec.world.types import Quaternion


def told_turn(q: Sequence[float]) -> Quaternion:
    """The rotation of a quaternion x y z w, brought to unit length: some that PyBullet tells have single precision."""
    return frames.normalise(from_xyzw_of(q))
