"""The bodies of a stage as trees: which joint moves which body, and which joints close loops."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from simspec.imports.usd.joints import Freedom, Joint
from simspec.imports.usd.stage import Prim
from simspec.world import frames
from simspec.world.types import Pose


@dataclass
class Link:
    """A body in its tree: its parent (None: the world) and the joint that moves it (None: it is free)."""

    prim: Prim
    parent: Prim | None = None
    joint: Joint | None = None
    children: list[Link] = field(default_factory=list)


def reverse(joint: Joint) -> None:
    """Take a joint from its other side: its coordinates stay what they are."""
    if joint.outer:
        raise joint.prim.error(
            "several joints of two bodies, the first of which is the one that they move",
            hint="exchange physics:body0 and physics:body1",
        )
    joint.first, joint.second = joint.second, joint.first
    joint.in_first, joint.in_second = joint.in_second, joint.in_first
    if len(joint.freedoms) > 1 and joint.freedoms[-1].kind == "ball":
        hint = "exchange physics:body0 and physics:body1"
        raise joint.prim.error(
            "a joint with slides and three turns, whose first body is the one that it moves", hint=hint
        )
    joint.freedoms = [_turned(one) for one in reversed(joint.freedoms)]


def _turned(freedom: Freedom) -> Freedom:
    x, y, z = freedom.axis
    start = freedom.start
    if freedom.kind == "ball" and start:
        start = frames.conjugate((start[0], start[1], start[2], start[3]))
    return replace(freedom, axis=(0.0 - x, 0.0 - y, 0.0 - z), start=start)


def trees(bodies: list[Prim], joints: list[Joint], roots: list[Prim]) -> tuple[list[Link], list[Joint]]:
    """The roots of the trees, in the file's order, and the joints that are in none. ``roots``: those that the file names."""
    inside = [joint for joint in joints if not joint.outside]
    beside: dict[int, list[Joint]] = {}
    for joint in inside:
        for side in (joint.first, joint.second):
            if side is not None:
                beside.setdefault(id(side), []).append(joint)
    links: dict[int, Link] = {}
    used: set[int] = set()
    tops: list[Link] = []

    def grow(top: Link) -> None:
        waiting = [top]
        while waiting:
            link = waiting.pop(0)
            for joint in beside.get(id(link.prim), ()):
                other = joint.other(link.prim)
                if id(joint) in used or other is None or id(other) in links:
                    continue
                used.add(id(joint))
                if joint.second is link.prim:
                    reverse(joint)
                links[id(other)] = child = Link(other, link.prim, joint)
                link.children.append(child)
                waiting.append(child)

    def start(body: Prim, joint: Joint | None) -> None:
        if joint is not None:
            used.add(id(joint))
            if joint.second is None:
                reverse(joint)
        links[id(body)] = link = Link(body, None, joint)
        tops.append(link)
        grow(link)

    # a chain between two walls is one tree with a loop: the first wall holds it, by a fixed joint where there is one
    to_world = [joint for joint in inside if joint.first is None or joint.second is None]
    for joint in sorted(to_world, key=lambda one: bool(one.freedoms)):
        body = joint.first if joint.second is None else joint.second
        if body is not None and id(body) not in links:
            start(body, joint)
    for body in roots:
        if id(body) not in links:
            start(body, None)
    moved = {id(joint.second) for joint in inside}
    for body in (*(body for body in bodies if id(body) not in moved), *bodies):
        if id(body) not in links:
            start(body, None)
    order = {id(body): index for index, body in enumerate(bodies)}
    tops.sort(key=lambda link: order[id(link.prim)])
    return tops, [joint for joint in joints if id(joint) not in used]


def in_order(top: Link) -> list[Link]:
    """A tree's links, parents first, each with all below it before the next."""
    links, waiting = [], [top]
    while waiting:
        link = waiting.pop()
        links.append(link)
        waiting.extend(reversed(link.children))
    return links


def frame_in_body(joint: Joint) -> Pose:
    """The frame of a spec's body in the rigid frame of its prim: at the joint, with the prim's axes."""
    turning = any(freedom.kind in ("hinge", "ball") for freedom in joint.freedoms)
    return Pose(joint.in_second.position if turning else (0.0, 0.0, 0.0))


def origin_of(joint: Joint) -> Pose:
    """The body's frame in the parent's rigid frame, with the joint at zero."""
    zero = frames.compose(joint.in_first, frames.inverse(joint.in_second))
    return frames.compose(zero, frame_in_body(joint))
