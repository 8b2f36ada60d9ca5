"""Poses of the spec as poses of the world, and the layout of arrays."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

from simspec.language.arrays import Array, Jitter
from simspec.language.motions import MotionPoint
from simspec.language.shapes import Inertia, Orientation
from simspec.language.shapes import Pose as SpecPose
from simspec.language.strict import required
from simspec.language.trajectory import ToolPlace
from simspec.world import frames
from simspec.world.types import Pose, Quaternion, Vector3

Z_AXIS: Vector3 = (0.0, 0.0, 1.0)


def orientation(written: SpecPose | Orientation | Inertia | ToolPlace | MotionPoint) -> Quaternion:
    """The rotation that `rpy` or `quat` says."""
    if written.quat is not None:
        return frames.normalise(written.quat)
    if written.rpy is not None:
        return frames.from_rpy(*written.rpy)
    return frames.IDENTITY


def pose(written: SpecPose | None) -> Pose:
    """A pose of the spec; None is the identity."""
    return Pose() if written is None else Pose(written.xyz, orientation(written))


def direction(vector: Vector3) -> Vector3:
    """The unit vector along a vector that is not zero."""
    scale = max(map(abs, vector))  # a tiny vector's squares would vanish
    x, y, z = vector[0] / scale, vector[1] / scale, vector[2] / scale
    squared = x * x + y * y + z * z
    if squared == 1.0:
        return (x + 0.0, y + 0.0, z + 0.0)
    length = math.sqrt(squared)
    return (x / length + 0.0, y / length + 0.0, z / length + 0.0)


def elements(array: Array | None) -> list[tuple[str, Pose]]:
    """The suffix of the name, and the pose in the array's frame, of every element; one without suffix for no array."""
    if array is None:
        return [("", Pose())]
    poses = layout(array)
    digits = len(str(len(poses) - 1))
    return [(f"_{index:0{digits}d}", place) for index, place in enumerate(poses)]


def layout(array: Array) -> list[Pose]:
    """The poses of an array's elements in the array's frame, jitter included."""
    elements = list(_layout(array))
    return elements if array.jitter is None else list(_jittered(elements, array.jitter))


def _layout(array: Array) -> Iterator[Pose]:
    if array.grid is not None:
        dx, dy, dz = required(array.spacing)
        nx, ny, nz = array.grid
        for i in range(nx):
            for j in range(ny):
                for k in range(nz):
                    yield Pose((i * dx, j * dy, k * dz))
    elif array.line is not None:
        x, y, z = required(array.step)
        for i in range(array.line):
            yield Pose((i * x, i * y, i * z))
    elif array.ring is not None:
        radius = required(array.radius)
        for i in range(array.ring):
            angle = 2.0 * math.pi * i / array.ring
            sine, cosine = frames.sine_cosine(angle)
            turn = frames.from_axis_angle(Z_AXIS, angle) if array.face else frames.IDENTITY
            yield Pose((radius * cosine, radius * sine, 0.0), turn)
    else:
        for element in required(array.poses):
            yield pose(element)


def _jittered(elements: list[Pose], jitter: Jitter) -> Iterator[Pose]:
    # random() is the one method whose numbers Python promises to keep for a seed
    draw = random.Random(jitter.seed).random
    for element in elements:
        x, y, z = element.position
        if jitter.radial is not None:
            scale = 1.0 - jitter.radial + 2.0 * jitter.radial * draw()
            yield Pose((x * scale, y * scale, z * scale), element.quaternion)
        else:
            reach = required(jitter.uniform)
            x, y, z = (value + (-reach + 2.0 * reach * draw()) for value in (x, y, z))
            yield Pose((x, y, z), element.quaternion)
