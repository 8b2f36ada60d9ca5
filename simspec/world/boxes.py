"""The boxes by which bodies feel a fluid (``world/fluid.py``), from their inertia."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import replace

from simspec.world import frames
from simspec.world.fluid import LEAST, Box
from simspec.world.gathering import lumped, rigid_members
from simspec.world.principal import clip_flat, principal_axes
from simspec.world.types import Body, Inertial, Quaternion, Vector3, World

ALONG = 1e-9
"""Share of the trace of a tensor up to which its products of inertia in some axes are round-off: these are principal axes."""


def moments_along(inertia: tuple[float, ...], axes: Quaternion) -> Vector3 | None:
    """The principal moments about ``axes`` of a tensor (xx, yy, zz, xy, xz, yz) that is given in the body's axes; None where
    these are not its principal axes."""
    xx, yy, zz, *products = frames.rotate_inertia(frames.conjugate(axes), inertia)
    if max(map(abs, products)) > ALONG * (xx + yy + zz):
        return None
    return clip_flat((xx, yy, zz))


def box_of(inertial: Inertial, axes: Quaternion | None = None) -> Box:
    """The box of a body with mass, along ``axes`` where they are principal ones; else along those that its tensor gives."""
    moments = None if axes is None else moments_along(inertial.inertia, axes)
    if axes is None or moments is None:
        moments, axes = principal_axes(inertial.inertia)
    x, y, z = moments
    return Box(
        (_edge(inertial.mass, y + z - x), _edge(inertial.mass, x + z - y), _edge(inertial.mass, x + y - z)), axes
    )


def _edge(mass: float, moment: float) -> float:
    return math.sqrt(6.0 * max(moment, LEAST) / mass)


def boxed(bodies: Sequence[Body], kinematic: Container[str]) -> tuple[Body, ...]:
    """The bodies of a world with a fluid, each with the box by which it feels it: of what cannot move none, and of a rigid
    group that is told as one (``world/gathering.py``) one, at its topmost body. ``bodies``: those with mass have a box of their
    own already; ``kinematic``: the names of those whose mass is another since."""
    told = lumped(World("", tuple(bodies)))
    boxes: dict[str, Box] = {}
    for top, members in rigid_members(bodies).items():
        if top not in told:
            boxes.update(
                (body.name, body.box if body.box is not None and body.name not in kinematic else box_of(body.inertial))
                for body, _ in members
                if body.inertial.mass > 0.0
            )
            continue
        heavy = [(body, pose) for body, pose in members if body.inertial.mass > 0.0]
        axes = None
        if len(heavy) == 1 and heavy[0][0].box is not None:
            axes = frames.multiply(heavy[0][1].quaternion, heavy[0][0].box.quaternion)
        boxes[top] = box_of(told[top], axes)
    return tuple(
        body if body.box == boxes.get(body.name) else replace(body, box=boxes.get(body.name)) for body in bodies
    )
