"""Joints whose lower limit is their upper one: they cannot move, and are fixed joints of the language.

Engines would hold such a joint at a limit, by forces that some compute step by step, and others refuse it. A joint that follows
another, or that another follows, stays what it is: how far it may move is then a matter of both.
"""

from __future__ import annotations

from collections.abc import Sequence

from simspec.imports.draft import plain
from simspec.imports.elements import LOCKED
from simspec.imports.urdf.joints import Joint
from simspec.imports.urdf.table import CARRIED, INFORMATION, UNUSED
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Pose, Vector3


def lock(joints: Sequence[Joint]) -> None:
    """Make joints fixed whose limits leave them one position, at that position."""
    led = {mimic.attributes.get("joint", "").strip() for joint in joints for mimic in joint.element.look("mimic")}
    for joint in joints:
        name = joint.element.attributes["name"].strip()
        if joint.kind not in SCALAR_JOINTS or name in led or joint.element.look("mimic"):
            continue
        for limit in joint.element.look("limit"):
            at = limit.number("lower", 0.0) or 0.0
            if "position" in joint.data.get("limits", {}) and at == (limit.number("upper", 0.0) or 0.0):
                _fix(joint, at)


def _fix(joint: Joint, at: float) -> None:
    held = f"the joint is fixed at {at:g}: {LOCKED}"
    for element in joint.element.look("axis", "limit", "dynamics"):
        for name in element.attributes:
            fate = CARRIED if name in ("lower", "upper", "xyz") else UNUSED
            element.set_aside(name, fate, held, INFORMATION)
    if at:
        axis = joint.data["axis"]
        joint.origin = frames.compose(joint.origin, _moved(joint.kind, (axis[0], axis[1], axis[2]), at))
    joint.data = _origin(joint, at)
    joint.kind = "fixed"


def _moved(kind: str, axis: Vector3, at: float) -> Pose:
    length = frames.dot(axis, axis) ** 0.5
    x, y, z = (value / length for value in axis)
    if kind == "hinge":
        return Pose(quaternion=frames.from_axis_angle((x, y, z), at))
    return Pose((x * at, y * at, z * at))


def _origin(joint: Joint, at: float) -> dict[str, object]:
    """The word `origin`: as it was where the joint is held at 0, else where it is held."""
    if not at:
        return {"origin": joint.data["origin"]} if "origin" in joint.data else {}
    said: dict[str, object] = {"quat": [plain(value) for value in joint.origin.quaternion]}
    if any(joint.origin.position):
        said["xyz"] = [plain(value) for value in joint.origin.position]
    return {"origin": said}
