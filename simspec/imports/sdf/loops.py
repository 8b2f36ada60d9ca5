"""Joints of SDF that close loops, and gearboxes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from simspec.errors import Problem
from simspec.imports.elements import INFORMATION, PHYSICS, Element
from simspec.imports.sdf.joints import (
    FIRST_AXIS,
    SECOND_AXIS,
    FrameGraph,
    Link,
    SdfJointRead,
    SdfMimicRead,
    axis_of,
    child_of,
    direction_of,
    key_of,
    side_of,
    solver_of,
)
from simspec.imports.sdf.models import Scope
from simspec.imports.sdf.values import IN_JOINT, finite_of, set_aside
from simspec.language.foreign import LossSeverity
from simspec.world import frames
from simspec.world.frames import direction
from simspec.world.types import Pose, Vector3

LEVER: Final = 0.1
"""m between the two points that close a loop by a hinge: they hold its axis."""
CLOSED: Final = ("ball", "hinge", "fixed")
"""Kinds of joints that a constraint stands for."""

_Key = tuple[int, str]
_WORLD: Final = (0, "")
"""Stands for the world among links: no object has this ``id``."""


def spanning(joints: Sequence[SdfJointRead]) -> tuple[dict[_Key, SdfJointRead], list[SdfJointRead]]:
    """The joint that each link hangs on, by the link, and the joints that close loops, in the order of the file. Joints to the
    world hang links first, then those that no constraint stands for, those whose efforts or limits would be lost, and others,
    in the order of the file."""
    of_child: dict[_Key, SdfJointRead] = {}
    closing: list[SdfJointRead] = []
    above: dict[_Key, _Key] = {}
    for joint in sorted(joints, key=_order):
        child, parent = key_of(joint.child) or _WORLD, key_of(joint.parent) or _WORLD
        # a link that carries the parent already is the topmost of that: it hangs on nothing yet
        if child in of_child or _topmost(parent, above) == child:
            closing.append(joint)
        else:
            of_child[child], above[child] = joint, parent
    position = {id(joint): index for index, joint in enumerate(joints)}
    return of_child, sorted(closing, key=lambda joint: position[id(joint)])


def _order(joint: SdfJointRead) -> tuple[bool, int]:
    if joint.kind not in CLOSED or joint.mimic is not None:
        rank = 0
    else:
        rank = 2 if joint.kind != "hinge" or not joint.data.keys() - {"axis"} else 1
    return joint.parent is not None, rank


def _topmost(key: _Key, above: dict[_Key, _Key]) -> _Key:
    """The topmost link above a link, or the world. The way there becomes shorter for the next call."""
    top = key
    while top in above:
        top = above[top]
    while key != top:
        above[key], key = top, above[key]
    return top


def refused(joint: SdfJointRead) -> Iterator[Problem]:
    """Why no constraint stands for a joint that closes a loop."""
    if joint.kind not in CLOSED:
        kind = joint.element.attributes["type"][:40]
        message = f"a loop that is closed by a joint of the type {kind} is not supported"
        hint = "make another joint of the loop hang on two links, or leave this one out"
        yield joint.element.problem(message, allowed="ball, revolute, fixed", hint=hint, code="I104")
    elif joint.mimic is not None:
        yield joint.element.problem(
            "a joint that closes a loop follows no other", hint="leave <mimic> out", code="I104"
        )


def closed(
    joint: SdfJointRead, names: tuple[str, str], places: tuple[Pose, Pose], axes: tuple[Vector3, Vector3]
) -> list[dict[str, Any]]:
    """The constraints that stand for a joint between the bodies ``names``; ``places``: the joint's frame in each of them,
    ``axes``: its axis there. Properties that they do not have are lost."""
    _lose(joint)
    if joint.kind == "fixed":
        return [{"weld": {"bodies": list(names)}}]
    points = [[list(place.position) for place in places]]
    if joint.kind == "hinge":
        points.append([_along(place.position, axis) for place, axis in zip(places, axes, strict=True)])
    return [{"connect": {"bodies": list(names), "at": at, "second_at": second}} for at, second in points]


def _along(point: Vector3, axis: Vector3) -> list[float]:
    x, y, z = direction(axis)
    return list(frames.add(point, (LEVER * x, LEVER * y, LEVER * z)))


def _lose(joint: SdfJointRead) -> None:
    """Say what a joint has that its constraint has not."""
    words = {"limits": ("limit",), "damping": ("dynamics",), "dry_friction": ("dynamics",), "spring": ("dynamics",)}
    acting = set(joint.data) - {"axis"}
    if "position" not in joint.data.get("limits", {"position": None}):
        acting -= {"limits"}
        _said(joint, ("limit",), "a constraint has no ratings", INFORMATION)
    for word in sorted(acting & words.keys()):
        _said(joint, words[word], "the joint closes a loop: it has no limits and no efforts", PHYSICS)
    if "armature" in acting:
        joint.element.lose(None, "the joint closes a loop: its rotor has no inertia")


def _said(joint: SdfJointRead, tags: tuple[str, ...], reason: str, severity: LossSeverity) -> None:
    for axis in joint.element.look("axis"):
        for element in axis.look(*tags):
            element.lose(None, reason, severity)
            for child in element.look():
                child.lose(None, reason, severity)


# Gearboxes: two hinges on one reference body, one of which follows the other.

GEARBOX: Final = "gearbox"
"""The type of joint."""
REFERENCE: Final = "gearbox_reference_body"
PARALLEL: Final = 1e-6
"""By how much the cosine of the angle between an axis of a gearbox and that of a joint may miss 1."""


def couple(graph: FrameGraph, scope: Scope, name: str, joints: Sequence[SdfJointRead]) -> None:
    """Let a joint of ``joints`` follow another as a gearbox says: θ₂ = −ratio θ₁, the angles from the reference body to the
    parent about ``axis`` and to the child about ``axis2``. Raises SpecError where no two hinges are these angles."""
    element = scope.joints[name]
    reference = element.child(REFERENCE)
    if reference is None:
        raise element.error(
            f"<joint> has no <{REFERENCE}>", hint="it names the link that both shafts turn against", code="I101"
        )
    body = graph.link(scope, reference.text, reference)
    ratio = finite_of(element, "gearbox_ratio", 1.0)
    if ratio == 0.0:
        raise element.error(
            "with a ratio of 0 the gearbox couples nothing", hint="make the joint of the child fixed", code="I102"
        )
    parent, child = (side_of(graph, scope, element, tag) for tag in ("parent", "child"))
    (leader, first), (follower, second) = (
        _shaft(graph, scope, name, (body, link), word, joints)
        for link, word in ((parent, FIRST_AXIS), (child, SECOND_AXIS))
    )
    factor = -ratio * first * second
    if _bounded(follower) and not _bounded(leader) and leader.mimic is None:
        # a follower begins within its limits, a leader anywhere
        leader, follower, factor = follower, leader, 1.0 / factor
    if follower.mimic is not None or follower is leader:
        raise element.error(
            f"the joint {follower.name!r} follows another already", hint="leave the gearbox out", code="I101"
        )
    follower.mimic = SdfMimicRead(element, (leader.scope, leader.name), FIRST_AXIS, factor, 0.0)
    set_aside(element, IN_JOINT)
    solver_of(element)


def _bounded(joint: SdfJointRead) -> bool:
    return "position" in joint.data.get("limits", {})


def _shaft(
    graph: FrameGraph,
    scope: Scope,
    name: str,
    ends: tuple[Link | None, Link | None],
    word: str,
    joints: Sequence[SdfJointRead],
) -> tuple[SdfJointRead, float]:
    """The hinge between two links, and the sign with which its angle is that from the first to the second about an axis of the
    gearbox. Raises SpecError where there is none."""
    element, wanted = scope.joints[name], [key_of(end) for end in ends]
    for joint in joints:
        between = [key_of(joint.parent), key_of(joint.child)]
        if joint.kind != "hinge" or sorted(between, key=str) != sorted(wanted, key=str):
            continue
        joint_axis = _turned(graph, scope, joint.child, tuple(joint.data["axis"]), element)
        axis, carried = axis_of(element, word), child_of(graph, scope, element)
        turned = _turned(graph, scope, carried, direction_of(graph, scope, name, carried, axis), element)
        squares = frames.dot(joint_axis, joint_axis) * frames.dot(turned, turned)
        along = frames.dot(joint_axis, turned) / math.sqrt(squares)
        if not abs(along) > 1.0 - PARALLEL:
            raise axis.error(
                f"the axis of a gearbox is that of the joint {joint.name!r}, whose angle it is about", code="I104"
            )
        sign = 1.0 if between == wanted else -1.0
        return joint, sign if along > 0.0 else -sign
    message = f"no hinge joins the reference body of the gearbox and its {'parent' if word == FIRST_AXIS else 'child'}"
    raise element.error(message, hint="leave it out, or write `constraints` of the scenario", code="I104")


def _turned(graph: FrameGraph, scope: Scope, link: Link, vector: Vector3, element: Element) -> Vector3:
    place = graph.in_scope(scope, link[0]).then(graph.pose(*link, element))
    return frames.rotate(place.pose.quaternion, vector)
