"""Gearboxes of SDF: two hinges on one reference body, of which the one follows the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from simspec.imports.elements import Element
from simspec.imports.sdf.aside import IN_JOINT, set_aside
from simspec.imports.sdf.graph import Graph, Link
from simspec.imports.sdf.joints import FIRST_AXIS, SECOND_AXIS, JointRead, Mimic, direction_of, side_of, solver_of
from simspec.imports.sdf.models import Scope
from simspec.imports.sdf.values import finite_of
from simspec.world import frames
from simspec.world.types import Vector3

GEARBOX: Final = "gearbox"
"""The type of joint."""
REFERENCE: Final = "gearbox_reference_body"
PARALLEL: Final = 1e-6
"""By how much the cosine of the angle between an axis of a gearbox and that of a joint may miss 1."""


def couple(graph: Graph, scope: Scope, name: str, joints: Sequence[JointRead]) -> None:
    """Let a joint of ``joints`` follow another as a gearbox says: θ₂ = −ratio θ₁, the angles from the reference body to the
    parent about ``axis`` and to the child about ``axis2``. Raises SpecError where no two hinges are these angles."""
    element = scope.joints[name]
    reference = element.child(REFERENCE)
    if reference is None:
        raise element.error(f"<joint> has no <{REFERENCE}>", hint="it names the link that both shafts turn against")
    body = graph.link(scope, reference.text, reference)
    ratio = finite_of(element, "gearbox_ratio", 1.0)
    if ratio == 0.0:
        raise element.error("with a ratio of 0 the gearbox couples nothing", hint="make the joint of the child fixed")
    parent, child = (side_of(graph, scope, element, tag) for tag in ("parent", "child"))
    (leader, first), (follower, second) = (
        _shaft(graph, scope, name, (body, link), word, joints)
        for link, word in ((parent, FIRST_AXIS), (child, SECOND_AXIS))
    )
    factor = -ratio * first * second
    if _bounded(follower) and not _bounded(leader) and leader.mimic is None:
        leader, follower, factor = (
            follower,
            leader,
            1.0 / factor,
        )  # a follower begins within its limits, a leader anywhere
    if follower.mimic is not None or follower is leader:
        raise element.error(f"the joint {follower.name!r} follows another already", hint="leave the gearbox out")
    follower.mimic = Mimic(element, (leader.scope, leader.name), FIRST_AXIS, factor, 0.0)
    set_aside(element, IN_JOINT)
    solver_of(element)


def _bounded(joint: JointRead) -> bool:
    return "position" in joint.data.get("limits", {})


def _shaft(
    graph: Graph,
    scope: Scope,
    name: str,
    ends: tuple[Link | None, Link | None],
    word: str,
    joints: Sequence[JointRead],
) -> tuple[JointRead, float]:
    """The hinge between two links, and the sign with which its angle is that from the first to the second about an axis of the
    gearbox. Raises SpecError where there is none."""
    element, wanted = scope.joints[name], [_key(end) for end in ends]
    for joint in joints:
        between = [_key(joint.parent), _key(joint.child)]
        if joint.kind != "hinge" or sorted(between, key=str) != sorted(wanted, key=str):
            continue
        own = _turned(graph, scope, joint.child, tuple(joint.data["axis"]), element)
        axis = element.child(word)
        if axis is None:
            axis = Element(word, {}, element.location, "", element)
        carried = _child(graph, scope, element)
        asked = _turned(graph, scope, carried, direction_of(graph, scope, name, carried, axis), element)
        along = frames.dot(own, asked) / math.sqrt(frames.dot(own, own) * frames.dot(asked, asked))
        if not abs(along) > 1.0 - PARALLEL:
            raise axis.error(f"the axis of a gearbox is that of the joint {joint.name!r}, whose angle it is about")
        sign = 1.0 if between == wanted else -1.0
        return joint, sign if along > 0.0 else -sign
    message = f"no hinge joins the reference body of the gearbox and its {'parent' if word == FIRST_AXIS else 'child'}"
    raise element.error(message, hint="leave it out, or write `constraints` of the scenario")


def _key(link: Link | None) -> tuple[int, str] | None:
    return None if link is None else (id(link[0]), link[1])


def _child(graph: Graph, scope: Scope, element: Element) -> Link:
    child = side_of(graph, scope, element, "child")
    if child is None:
        raise element.error("the child of a joint is a link, not the world", hint="exchange parent and child")
    return child


def _turned(graph: Graph, scope: Scope, link: Link, vector: Vector3, element: Element) -> Vector3:
    """A vector in a link's axes in those of the scope."""
    place = graph.in_scope(scope, link[0]).then(graph.pose(*link, element))
    return frames.rotate(place.pose.quaternion, vector)
