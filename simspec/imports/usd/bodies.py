"""Bodies of a stage: their trees, the loops between them, and named frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from simspec.imports.draft import numbers
from simspec.imports.elements import names
from simspec.imports.usd.joints import Freedom, UsdJointRead
from simspec.imports.usd.places import SAME, PrimPlaces
from simspec.imports.usd.shapes import UsdShapeRead, pose_data
from simspec.imports.usd.stage import PrimRead, StageRead
from simspec.world import frames
from simspec.world.types import Pose, Vector3


@dataclass
class UsdLinkRead:
    """A body in its tree: its parent (None: the world) and the joint that moves it (None: it is free)."""

    prim: PrimRead
    parent: PrimRead | None = None
    joint: UsdJointRead | None = None
    children: list[UsdLinkRead] = field(default_factory=list)

    @property
    def joints(self) -> list[UsdJointRead]:
        """All joints that move it, from its parent outwards."""
        return [] if self.joint is None else [*self.joint.outer, self.joint]


def reverse(joint: UsdJointRead) -> None:
    """Take a joint from its other side: its coordinates stay what they are."""
    hint = "exchange physics:body0 and physics:body1"
    if joint.outer:
        message = "several joints of two bodies, the first of which is the one that they move"
        raise joint.prim.error(message, hint=hint)
    joint.first, joint.second = joint.second, joint.first
    joint.in_first, joint.in_second = joint.in_second, joint.in_first
    if len(joint.freedoms) > 1 and joint.freedoms[-1].kind == "ball":
        message = "a joint with slides and three turns, whose first body is the one that it moves"
        raise joint.prim.error(message, hint=hint)
    joint.freedoms = [_turned(freedom) for freedom in reversed(joint.freedoms)]


def _turned(freedom: Freedom) -> Freedom:
    x, y, z = freedom.axis
    start = freedom.start
    if freedom.kind == "ball" and start:
        start = frames.conjugate((start[0], start[1], start[2], start[3]))
    return replace(freedom, axis=(0.0 - x, 0.0 - y, 0.0 - z), start=start)


def trees(
    bodies: list[PrimRead], joints: list[UsdJointRead], roots: list[PrimRead]
) -> tuple[list[UsdLinkRead], list[UsdJointRead]]:
    """The roots of the trees, in the file's order, and the joints that are in none. ``roots``: those that the file names."""
    inside = [joint for joint in joints if not joint.outside]
    joints_of: dict[int, list[UsdJointRead]] = {}
    for joint in inside:
        for side in (joint.first, joint.second):
            if side is not None:
                joints_of.setdefault(id(side), []).append(joint)
    links: dict[int, UsdLinkRead] = {}
    used: set[int] = set()
    tops: list[UsdLinkRead] = []

    def grow(top: UsdLinkRead) -> None:
        waiting = [top]
        while waiting:
            link = waiting.pop(0)
            for joint in joints_of.get(id(link.prim), ()):
                other = joint.other(link.prim)
                if id(joint) in used or other is None or id(other) in links:
                    continue
                used.add(id(joint))
                if joint.second is link.prim:
                    reverse(joint)
                links[id(other)] = child = UsdLinkRead(other, link.prim, joint)
                link.children.append(child)
                waiting.append(child)

    def start(body: PrimRead, joint: UsdJointRead | None) -> None:
        if joint is not None:
            used.add(id(joint))
            if joint.second is None:
                reverse(joint)
        links[id(body)] = link = UsdLinkRead(body, None, joint)
        tops.append(link)
        grow(link)

    # a chain between two walls is one tree with a loop: the first wall holds it, by a fixed joint where there is one
    to_world = [joint for joint in inside if joint.first is None or joint.second is None]
    for joint in sorted(to_world, key=lambda joint_read: bool(joint_read.freedoms)):
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


def in_order(top: UsdLinkRead) -> list[UsdLinkRead]:
    """A tree's links, parents first, each with all below it before the next."""
    links, waiting = [], [top]
    while waiting:
        link = waiting.pop()
        links.append(link)
        waiting.extend(reversed(link.children))
    return links


def frame_in_body(joint: UsdJointRead) -> Pose:
    """The frame of a spec's body in the rigid frame of its prim: at the joint, with the prim's axes."""
    turning = any(freedom.kind in ("hinge", "ball") for freedom in joint.freedoms)
    return Pose(joint.in_second.position if turning else (0.0, 0.0, 0.0))


def origin_of(joint: UsdJointRead) -> Pose:
    """The body's frame in the parent's rigid frame, with the joint at zero."""
    zero = frames.compose(joint.in_first, frames.inverse(joint.in_second))
    return frames.compose(zero, frame_in_body(joint))


@dataclass
class UsdBodyRead:
    """A body: its prim, its shapes in its rigid frame, and where its frame in the spec is in that."""

    prim: PrimRead
    link: UsdLinkRead
    shapes: list[UsdShapeRead]
    name: str = ""
    model: str = ""
    frame: Pose = field(default_factory=Pose)
    fixed: bool = False

    @property
    def offset(self) -> Vector3:
        """The origin of the spec's frame in the prim's."""
        return self.frame.position

    @property
    def full(self) -> str:
        """The name with that of its model."""
        return f"{self.model}/{self.name}" if self.model else self.name


def loop_data(joint: UsdJointRead, bodies: Mapping[int, UsdBodyRead]) -> tuple[str, dict[str, Any]] | None:
    """The model that a loop is in ("": none), and its words; None for what the language does not say, which is then lost."""
    prim = joint.prim
    if joint.first is None or joint.second is None:
        reason = "a loop that is closed against the world is not supported"
        prim.lose(None, reason, hint="join it to a body that is fixed")
        return None
    kinds = [freedom.kind for freedom in joint.freedoms]
    first, second = bodies[id(joint.first)], bodies[id(joint.second)]
    if first.model != second.model:
        prim.lose(None, "a loop of two models is not supported")
        return None
    names = [first.name, second.name]
    here = frames.compose(frames.inverse(first.frame), joint.in_first)
    there = frames.compose(frames.inverse(second.frame), joint.in_second)
    if not kinds:
        pose = frames.compose(here, frames.inverse(there))
        said = Pose(prim.exactly("origin", pose.position), prim.turn("orientation", pose.quaternion))  # type: ignore[arg-type]
        return first.model, {"weld": {"bodies": names, "pose": pose_data(said)}}
    if kinds not in (["ball"], ["hinge"]):
        prim.lose(None, "loops are closed by fixed, spherical and revolute joints only")
        return None
    if kinds == ["hinge"]:
        prim.lose(
            "physics:axis",
            "a loop is held at the joint's point; nothing holds the direction of its axis, unless the other joints do",
        )
    at = prim.exactly("origin", here.position)
    second_at = prim.exactly("second_point", there.position)
    return first.model, {"connect": {"bodies": names, "at": numbers(at), "second_at": numbers(second_at)}}


def holder_of(data: dict[str, Any], model: str) -> dict[str, Any]:
    """What has the bodies of a model ("": of none) in the data of a spec."""
    holder: dict[str, Any] = data.get("model") or (data["models"][model] if model else data)
    return holder


def constrain(data: dict[str, Any], model: str, name: str, words: dict[str, Any]) -> None:
    """Add a constraint of a model."""
    table = holder_of(data, model).setdefault("constraints", {})
    (given,) = names([name], list(table))
    table[given] = words


MARK = "simspec:frame"
"""The mark of frames that simspec writes: others have to stand elsewhere than their body."""


def add_frames(
    stage: StageRead,
    places: PrimPlaces,
    body_of: Mapping[str, PrimRead],
    bodies: Mapping[int, UsdBodyRead],
    data: dict[str, Any],
) -> None:
    """Put the frames of a stage into the data of its spec. ``body_of``: of paths the rigid body; ``bodies``: of the ``id`` of
    a prim the body that is made of it."""
    for prim in stage.used():
        holder = body_of.get(prim.where)
        if prim.tag != "Xform" or holder is None or holder is prim or id(holder) not in bodies or prim.look():
            continue
        marked = prim.flag(MARK, False)
        place = places.within(prim, holder).pose
        if place == SAME and not marked:
            continue
        body = bodies[id(holder)]
        around = holder_of(data, body.model)
        place_data = pose_data(frames.compose(frames.inverse(body.frame), place))
        (given,) = names([prim.called()], [*around.get("bodies", ()), *around.get("frames", ())])
        around.setdefault("frames", {})[given] = {"body": body.name, **({"pose": place_data} if place_data else {})}
