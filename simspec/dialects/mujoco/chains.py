"""Bodies with several joints, for those who read a file or a model: what each joint of a body moves in the world.

Nothing here is known to what writes them (``formats/mjcf/bodies.py``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from simspec.dialects.mujoco.sidecar import MujocoSidecar
from simspec.world import frames
from simspec.world.kinematics import owner_of
from simspec.world.types import Pose, Quaternion

Chain = tuple[tuple[str, Quaternion], ...]
"""Names of the world's bodies that the joints of one body move, in order, itself last, each with the orientation of its frame
in the body's, all joints at zero."""


def chains(sidecar: MujocoSidecar) -> Mapping[str, Chain]:
    """The chain of each body of the file, by its name in the world; of one on a single joint, or on none, itself alone."""
    turns = sidecar.carriers or {}
    above: dict[str, list[tuple[str, Quaternion]]] = {}
    for body in sidecar.bodies:
        if body.name in turns:
            above.setdefault(owner_of(body.name), []).append((body.name, frames.normalise(turns[body.name])))
    return {
        body.name: (*above.get(body.name, ()), (body.name, frames.IDENTITY))
        for body in sidecar.bodies
        if body.name not in turns
    }


def origins(place: Pose, in_body: Sequence[Pose]) -> list[Pose]:
    """Of frames in one body's frame, which stands at ``place`` in its parent's: the first in the parent's, and each further one
    in that before it."""
    first = frames.compose(place, in_body[0])
    return [first, *(frames.compose(frames.inverse(one), other) for one, other in pairwise(in_body))]
