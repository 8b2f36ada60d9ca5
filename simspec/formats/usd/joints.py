"""Joints of a world as prims: which bodies they join, where, along which axes, with limits, drives and ratings.

Attributes of simspec's own have the doubles; those of a joint of several axes begin with the word of the axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from simspec.control.native import Drive
from simspec.formats.kit.axes import readable
from simspec.formats.usd.several import Several
from simspec.formats.usd.tree import Prim
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Joint, Pose, Quaternion, Vector3

DEGREES: Final = 180.0 / math.pi
KINDS: Final = {"fixed": "Fixed", "hinge": "Revolute", "slide": "Prismatic", "ball": "Spherical"}
AXES: Final = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
UNLIMITED: Final = (-math.inf, math.inf)
LOCKED: Final = (1.0, -1.0)
"""Limits of an axis that does not move: the schema says so of a lower one above the upper one."""
EVERY_AXIS: Final = tuple(f"{kind}{axis}" for kind in ("trans", "rot") for axis in AXES)


@dataclass(frozen=True, slots=True)
class Joined:
    """What a joint joins: paths of prims (``first`` None: the world). ``loop``: it is outside the tree."""

    first: str | None
    second: str
    touching: bool = False
    loop: bool = False


def single(prim: Prim, joint: Joint, joined: Joined, drives: Mapping[str, Drive]) -> None:
    """A joint of one kind. ``drives``: the driven joints of the world, by name."""
    axis, turn = _towards(joint.axis) if any(joint.axis) else ("X", frames.IDENTITY)
    here = Pose(joint.origin.position, frames.multiply(joint.origin.quaternion, turn))
    stand(prim, joined, here, Pose((0.0, 0.0, 0.0), turn))
    if joint.kind != "fixed":
        prim.uniform("physics:axis", axis)
    if joint.kind == "ball":
        prim.say("float", "physics:coneAngle0Limit", -1.0)
        prim.say("float", "physics:coneAngle1Limit", -1.0)
        prim.own("double", "spring_stiffness", joint.spring_stiffness or None)
        prim.own("double", "damping", joint.damping or None)
    _origin(prim, joint.origin)
    if any(joint.axis):
        prim.own("double3", "axis", readable(joint.axis))
    if joint.kind in SCALAR_JOINTS:
        _limits(prim, joint, "physics:lowerLimit", "physics:upperLimit", "")
        _drive(prim, joint, "angular" if joint.kind == "hinge" else "linear", "", drives.get(joint.name))
        _ratings(prim, joint, "")
    _state(prim, joint, "")


def axes(prim: Prim, chain: Several, joined: Joined, names: Sequence[str], drives: Mapping[str, Drive]) -> None:
    """A joint of several axes. ``names`` of the spec's joints, within their model."""
    origin = chain.joints[0].origin
    here = Pose(origin.position, frames.multiply(origin.quaternion, chain.turn))
    stand(prim, joined, here, Pose((0.0, 0.0, 0.0), chain.turn))
    _origin(prim, origin)
    free = set(chain.words) | ({f"rot{axis}" for axis in AXES} if "rot" in chain.words else set())
    limited = {word for word, joint in zip(chain.words, chain.joints, strict=True) if joint.position_limits is not None}
    for word in EVERY_AXIS:
        prim.apply(f"PhysicsLimitAPI:{word}")
        if word in limited:
            continue
        for end, value in zip(("low", "high"), UNLIMITED if word in free else LOCKED, strict=True):
            prim.say("float", f"limit:{word}:physics:{end}", value)
    for word, joint, name in zip(chain.words, chain.joints, names, strict=True):
        prim.own("string", f"{word}:name", name)
        if joint.kind in SCALAR_JOINTS:
            prim.own("double3", f"{word}:axis", readable(joint.axis))
            if joint.position_limits is not None:
                _limits(prim, joint, f"limit:{word}:physics:low", f"limit:{word}:physics:high", f"{word}:")
            _drive(prim, joint, word, f"{word}:", drives.get(joint.name))
            _ratings(prim, joint, f"{word}:")
        _state(prim, joint, f"{word}:")


def stand(prim: Prim, joined: Joined, in_first: Pose, in_second: Pose) -> None:
    """What every joint has: its bodies, its frames in theirs, and how it is taken."""
    if joined.first is not None:
        prim.relate("physics:body0", [joined.first])
    prim.relate("physics:body1", [joined.second])
    for number, pose in enumerate((in_first, in_second)):
        prim.say("point3f", f"physics:localPos{number}", pose.position)
        prim.say("quatf", f"physics:localRot{number}", pose.quaternion)
    prim.say("bool", "physics:jointEnabled", True)
    prim.say("bool", "physics:collisionEnabled", joined.touching)
    prim.say("bool", "physics:excludeFromArticulation", joined.loop)
    prim.say("float", "physics:breakForce", math.inf)
    prim.say("float", "physics:breakTorque", math.inf)


def _towards(axis: Vector3) -> tuple[str, Quaternion]:
    """The word for an axis, and the rotation from that axis to it."""
    for word, unit in AXES.items():
        if axis == unit:
            return word, frames.IDENTITY
    x, y, z = axis
    if x <= -1.0:
        return "X", (0.0, 0.0, 0.0, 1.0)
    # (1 + cos, axis × sin) of the turn from x, not yet of unit length
    return "X", frames.normalise((1.0 + x, 0.0, 0.0 - z, y))


def _origin(prim: Prim, origin: Pose) -> None:
    prim.own("double3", "origin", origin.position)
    prim.own("quatd", "orientation", origin.quaternion)


def _limits(prim: Prim, joint: Joint, low: str, high: str, own: str) -> None:
    turns = DEGREES if joint.kind == "hinge" else 1.0
    lower, upper = joint.position_limits or UNLIMITED
    prim.say("float", low, turns * lower)
    prim.say("float", high, turns * upper)
    if joint.position_limits is not None:
        prim.own("double2", f"{own}limits", joint.position_limits)


def _drive(prim: Prim, joint: Joint, name: str, own: str, control: Drive | None) -> None:
    """The spring and the damper of a hinge or a slide, and the gains of its controller, as one drive: what springs and dampers
    add up to. Its targets are those at time 0, its largest effort the controller's."""
    if control is not None and (control.effort_limit == 0 or not (control.kp or control.kd)):
        control = None
    if not joint.damping and not joint.spring_stiffness and control is None:
        return
    stiffness, damping, pull, push = (
        joint.spring_stiffness,
        joint.damping,
        joint.spring_stiffness * joint.spring_rest,
        0.0,
    )
    if control is not None:
        stiffness, damping = stiffness + control.kp, damping + control.kd
        pull, push = pull + control.kp * control.position, control.kd * control.velocity
        pull += control.effort if stiffness else 0.0
    turns = DEGREES if joint.kind == "hinge" else 1.0
    prim.apply(f"PhysicsDriveAPI:{name}")
    drive = f"drive:{name}:physics:"
    passive = control is None
    target = joint.spring_rest if passive else (pull / stiffness if stiffness else 0.0)
    limit = math.inf if control is None or control.effort_limit is None else control.effort_limit
    prim.uniform(f"{drive}type", "force")
    prim.say("float", f"{drive}stiffness", stiffness / turns)
    prim.say("float", f"{drive}damping", damping / turns)
    prim.say("float", f"{drive}targetPosition", turns * target)
    prim.say("float", f"{drive}targetVelocity", turns * push / damping if push else 0.0)
    prim.say("float", f"{drive}maxForce", limit)
    for word, value in (
        ("spring_stiffness", joint.spring_stiffness),
        ("damping", joint.damping),
        ("spring_rest", joint.spring_rest),
    ):
        prim.own("double", f"{own}{word}", value)
    if control is not None:
        prim.own("double2", f"{own}gains", (control.kp, control.kd))


def _ratings(prim: Prim, joint: Joint, own: str) -> None:
    """What the schemas do not have of a hinge or a slide."""
    for word, said in (("velocity_limit", joint.velocity_limit), ("effort_limit", joint.effort_limit)):
        prim.own("double", f"{own}{word}", said)
    for word, value in (("dry_friction", joint.dry_friction), ("armature", joint.armature)):
        prim.own("double", f"{own}{word}", value or None)


def _state(prim: Prim, joint: Joint, own: str) -> None:
    """Where a joint stands and how fast it moves, but at zero."""
    if joint.kind != "fixed" and (any(joint.position[1:]) if joint.kind == "ball" else any(joint.position)):
        prim.own("double[]", f"{own}position", list(joint.position))
    if any(joint.velocity):
        prim.own("double[]", f"{own}velocity", list(joint.velocity))
