"""The model of a page besides its shapes: joints, loops and sums, named frames, which bodies may touch, loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simspec.errors import visible
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import FollowConstraint, Joint, Pose, WeldConstraint, World

DIGITS = 7
"""Of lengths in the page's own text: more than a screen shows."""
MOST_COMPARED = 600
"""Bodies of a world whose pairs are worked out: 180,000 pairs take a tenth of a second."""


def model_data(world: World, free: bool = False) -> dict[str, Any]:
    """The model as ``page/src/data.ts`` declares it. ``free``: with fixed and free joints, too."""
    index = {body.name: number for number, body in enumerate(world.bodies)}
    return {
        "joints": [
            _joint(number, body.joint, index)
            for number, body in enumerate(world.bodies)
            if free or body.joint.kind not in ("fixed", "free")
        ],
        **_couplings(world, index),
        "frames": [
            {"name": visible(frame.name), "body": index[frame.body], **placed(frame.pose)} for frame in world.frames
        ],
        "contacts": contacts(world),
        "loads": [
            {
                "body": index[force.body],
                "force": list(force.force),
                "torque": list(force.torque),
                "at": _rounded(force.at),
                "start": force.start,
                "until": force.until,
            }
            for force in world.forces
        ],
    }


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, DIGITS) for value in values]


def placed(pose: Pose) -> dict[str, Any]:
    """A pose, rounded to what a screen shows."""
    return {"position": _rounded(pose.position), "quaternion": _rounded(pose.quaternion)}


def _joint(number: int, joint: Joint, index: dict[str, int]) -> dict[str, Any]:
    return {
        "name": visible(joint.name),
        "kind": joint.kind,
        "body": number,
        "parent": -1 if joint.parent is None else index[joint.parent],
        **placed(joint.origin),
        "axis": _rounded(joint.axis),
        "limits": None if joint.position_limits is None else _rounded(joint.position_limits),
        "cone": joint.angle_limit,
        "start": _rounded(joint.position),
    }


def _couplings(world: World, index: dict[str, int]) -> dict[str, Any]:
    """Joints that follow others, loops, and limited sums of joints."""
    joints = {body.joint.name: number for number, body in enumerate(world.bodies)}
    follows, loops = [], []
    for constraint in world.constraints:
        if isinstance(constraint, FollowConstraint):
            follows.append(
                {
                    "body": joints[constraint.joint],
                    "leader": joints[constraint.leader],
                    "ratio": constraint.ratio,
                    "offset": constraint.offset,
                }
            )
            continue
        ends = {
            "name": visible(constraint.name),
            "first": index[constraint.first],
            "second": index[constraint.second],
        }
        if isinstance(constraint, WeldConstraint):
            loops.append({**ends, **placed(constraint.pose), "point": [0.0, 0.0, 0.0], "weld": True})
        else:
            at = Pose(constraint.first_point)
            loops.append({**ends, **placed(at), "point": _rounded(constraint.second_point), "weld": False})
    sums = [
        {
            "name": visible(joint_sum.name),
            "parts": [[joints[name], coefficient] for name, coefficient in joint_sum.joints],
            "limits": list(joint_sum.position_limits),
        }
        for joint_sum in world.sums
        if joint_sum.position_limits is not None
    ]
    return {"follows": follows, "loops": loops, "sums": sums}


def contacts(world: World) -> dict[str, Any]:
    """Which bodies may touch which: ``classes`` of bodies that may touch the same others, and the ``pairs`` of classes, a class
    with itself among them. Of a world of more than ``MOST_COMPARED`` bodies with collision shapes nothing is worked out."""
    solid = [number for number, body in enumerate(world.bodies) if any(shape.collision for shape in body.shapes)]
    if len(solid) > MOST_COMPARED:
        return {"classes": [], "pairs": [], "bodies": len(solid)}
    touching = _touching(world, solid)
    classes: list[list[int]] = []
    found: dict[tuple[bool, frozenset[int]], list[int]] = {}
    for body in solid:
        if not touching[body]:
            continue
        alike = found.get((False, touching[body])) or found.get((True, touching[body] | {body}))
        if alike is None:
            alike = [body]
            classes.append(alike)
            found[False, touching[body]] = found[True, touching[body] | {body}] = alike
        else:
            alike.append(body)
    pairs = [
        [first, second]
        for first, bodies in enumerate(classes)
        for second in range(first, len(classes))
        if any(other in touching[bodies[0]] for other in classes[second])
    ]
    return {"classes": classes, "pairs": pairs, "bodies": len(solid)}


def _touching(world: World, solid: list[int]) -> dict[int, frozenset[int]]:
    allowed, bodies = CollisionFilter(world), world.bodies
    found: dict[int, set[int]] = {body: set() for body in solid}
    for place, first in enumerate(solid):
        for second in solid[place + 1 :]:
            if allowed.may_touch(bodies[first].name, bodies[second].name):
                found[first].add(second)
                found[second].add(first)
    return {body: frozenset(others) for body, others in found.items()}


def loads_note(world: World) -> str | None:
    """The meaning of the arrows of loads; None without loads."""
    if not world.forces:
        return None
    return "Red arrows are forces on bodies, violet arrows torques, as long as their square roots."
