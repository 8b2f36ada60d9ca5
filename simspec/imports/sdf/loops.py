"""Joints that close loops: which joints of SDF span the tree of bodies, and what stands for the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from simspec.errors import Problem
from simspec.imports.sdf.joints import JointRead
from simspec.imports.sdf.values import lost
from simspec.language.foreign import Severity
from simspec.resolve.poses import direction
from simspec.world import frames
from simspec.world.types import Pose, Vector3

LEVER: Final = 0.1
"""m between the two points that close a loop by a hinge: they hold its axis."""
CLOSED: Final = ("ball", "hinge", "fixed")
"""Kinds of joints that a constraint stands for."""

_Key = tuple[int, str]
_WORLD: Final = (0, "")
"""Stands for the world among links: no object has this ``id``."""


def spanning(joints: Sequence[JointRead]) -> tuple[dict[_Key, JointRead], list[JointRead]]:
    """The joint that each link hangs on, by the link, and the joints that close loops, in the order of the file. Joints to the
    world hang links first, then those that no constraint stands for, those whose efforts or limits would be lost, and others,
    in the order of the file."""
    of_child: dict[_Key, JointRead] = {}
    closing: list[JointRead] = []
    above: dict[_Key, _Key] = {}
    for joint in sorted(joints, key=_order):
        child = (id(joint.child[0]), joint.child[1])
        parent = _WORLD if joint.parent is None else (id(joint.parent[0]), joint.parent[1])
        # a link that carries the parent already is the topmost of that: it hangs on nothing yet
        if child in of_child or _topmost(parent, above) == child:
            closing.append(joint)
        else:
            of_child[child], above[child] = joint, parent
    position = {id(joint): index for index, joint in enumerate(joints)}
    return of_child, sorted(closing, key=lambda joint: position[id(joint)])


def _order(joint: JointRead) -> tuple[bool, int]:
    if joint.kind not in CLOSED or joint.mimic is not None:
        rank = 0
    else:
        rank = 2 if joint.kind != "hinge" or not joint.data.keys() - {"axis"} else 1
    return joint.parent is not None, rank


def _topmost(key: _Key, above: dict[_Key, _Key]) -> _Key:
    """The link that a link hangs on in the end, or the world. The way there becomes shorter for the next that asks."""
    top = key
    while top in above:
        top = above[top]
    while key != top:
        above[key], key = top, above[key]
    return top


def refused(joint: JointRead) -> Iterator[Problem]:
    """Why no constraint stands for a joint that closes a loop."""
    if joint.kind not in CLOSED:
        message = (
            f"a loop that is closed by a joint of the type {joint.element.attributes['type'][:40]} is not supported"
        )
        hint = "make another joint of the loop hang on two links, or leave this one out"
        yield joint.element.problem(message, allowed="ball, revolute, fixed", hint=hint)
    elif joint.mimic is not None:
        yield joint.element.problem("a joint that closes a loop follows no other", hint="leave <mimic> out")


def closed(
    joint: JointRead, names: tuple[str, str], places: tuple[Pose, Pose], axes: tuple[Vector3, Vector3]
) -> list[dict[str, Any]]:
    """The constraints that stand for a joint between the bodies ``names``; ``places``: the joint's frame in each of them,
    ``axes``: its axis there. What they do not say is lost."""
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


def _lose(joint: JointRead) -> None:
    """Say what a joint has that its constraint has not."""
    words = {"limits": ("limit",), "damping": ("dynamics",), "dry_friction": ("dynamics",), "spring": ("dynamics",)}
    acting = set(joint.data) - {"axis"}
    if "position" not in joint.data.get("limits", {"position": None}):
        acting -= {"limits"}
        _said(joint, ("limit",), "a constraint has no ratings", Severity.INFORMATION)
    for word in sorted(acting & words.keys()):
        _said(joint, words[word], "the joint closes a loop: it has no limits and no efforts", Severity.PHYSICS)
    if "armature" in acting:
        lost(joint.element, "the joint closes a loop: its rotor has no inertia")


def _said(joint: JointRead, tags: tuple[str, ...], reason: str, severity: Severity) -> None:
    for axis in joint.element.look("axis"):
        for element in axis.look(*tags):
            lost(element, reason, severity)
            for child in element.look():
                lost(child, reason, severity)
