"""A world's bodies as those of a file: depth first, and one body for all joints that a body has.

Joints of one body act in sequence, each about the place and axis that it has in the body's frame where all are at zero. With
C_i the frame of the i-th joint in the parent's body, all joints at zero, and J_i its displacement, the world's
O_1 J_1 O_2 J_2 … O_n J_n is C_n Π (D_i J_i D_i⁻¹), D_i = C_n⁻¹ C_i: a hinge or slide about the axis of its frame D_i. Of a ball
the coordinates are turned by D_i, so that it is the last, whose D is the identity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from simspec.world import frames
from simspec.world.kinematics import carried
from simspec.world.types import Body, Joint, Pose, Quaternion, World


@dataclass(frozen=True, slots=True)
class Row:
    """A body of the file.

    body    the body of the world
    depth   how many bodies it stands in
    place   its frame in its parent's, all joints at zero
    joints  its joints in order, each with its frame in the body's, all joints at zero; none where it is fixed
    """

    body: Body
    depth: int
    place: Pose
    joints: tuple[tuple[Joint, Pose], ...]


def depth_first(world: World) -> list[Row]:
    """The bodies in the order of the file."""
    rows = carried(world)
    above = {body: row[0].joint.parent for body, row in rows.items()}
    inside = {carrier.name for row in rows.values() for carrier in row}
    children: dict[str | None, list[Body]] = {}
    for body in world.bodies:
        if body.name not in inside:
            children.setdefault(above.get(body.name, body.joint.parent), []).append(body)
    order: list[Row] = []
    waiting = [(body, 0) for body in reversed(children.get(None, []))]
    while waiting:
        body, depth = waiting.pop()
        order.append(_row(body, depth, rows.get(body.name, ())))
        waiting.extend((child, depth + 1) for child in reversed(children.get(body.name, [])))
    return order


def _row(body: Body, depth: int, carriers: Sequence[Body]) -> Row:
    joint = body.joint
    if joint.kind == "free":  # it stands where it begins
        place = Pose(joint.position[:3], joint.position[3:7])  # type: ignore[arg-type]
        return Row(body, depth, place, ((joint, Pose()),))
    if not carriers:
        return Row(body, depth, joint.origin, () if joint.kind == "fixed" else ((joint, Pose()),))
    joints = [*(carrier.joint for carrier in carriers), joint]
    placed = [joints[0].origin]
    for following in joints[1:]:
        placed.append(frames.compose(placed[-1], following.origin))
    # backwards from the body, so that a step that is zero stays zero
    in_body = [Pose()]
    for following in reversed(joints[1:]):
        in_body.insert(0, frames.compose(in_body[0], frames.inverse(following.origin)))
    return Row(body, depth, placed[-1], tuple(zip(joints, in_body, strict=True)))


def carrier_frames(rows: Sequence[Row], world: World) -> Mapping[str, Quaternion]:
    """What stands between two joints of one body, by name: the orientation of its frame in the body's, all joints at zero."""
    held = carried(world)
    return {
        carrier.name: frame.quaternion
        for row in rows
        for carrier, (_, frame) in zip(held.get(row.body.name, ()), row.joints[:-1], strict=True)
    }
