"""Frames and joints of SDF."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import angle
from simspec.imports.elements import INFORMATION, NO_RATING, PHYSICS, SOLVER, Element
from simspec.imports.sdf import values
from simspec.imports.sdf.models import SEPARATOR, Scope
from simspec.imports.sdf.values import Placement, SdfPose
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Vector3

# Frames: poses relative to names, links that frames are attached to.

MODEL: Final = "__model__"
WORLD: Final = "world"

Link = tuple[Scope, str]
MOST_PARTS: Final = 100
"""Names of models that one name has before its own."""


def key_of(link: Link | None) -> tuple[int, str] | None:
    """A link as a key; None: the world."""
    return None if link is None else (id(link[0]), link[1])


def split(scope: Scope, name: str) -> tuple[str, str]:
    """The name of the model that a name begins with, and the rest, which is a name in that model; "" and the name itself where
    it is one of the scope's, also one with `::` in it."""
    if SEPARATOR not in name or scope.owner(name) is not None:
        return "", name
    parts = name.split(SEPARATOR, MOST_PARTS)
    for count in range(1, len(parts)):
        first = SEPARATOR.join(parts[:count])
        around = scope.owner(first)
        if around is not None and first in around.models:
            return first, SEPARATOR.join(parts[count:])
    return parts[0], SEPARATOR.join(parts[1:])


@dataclass
class FrameGraph:
    """Answers where things are. All poses are of the file's own configuration, in which every joint is at zero."""

    _poses: dict[tuple[int, str], Placement] = field(default_factory=dict)
    _placed: dict[tuple[int, str], SdfPose] = field(default_factory=dict)
    _open: list[tuple[int, str]] = field(default_factory=list)
    _attached: dict[tuple[int, str], Link | None] = field(default_factory=dict)

    def home(self, scope: Scope, name: str, asking: Element) -> tuple[Scope, str]:
        """The scope and the local name of ``name`` in ``scope``. Raises SpecError at the element ``asking``."""
        part, last = split(scope, name)
        while part:
            around = scope.owner(part)
            if around is None or part not in around.models:
                raise asking.error(f"no model is called {part[:80]!r} here", found=name[:200], code="I101")
            scope = around.models[part]
            part, last = split(scope, last)
        owner = scope.owner(last)
        if owner is None and last not in (MODEL, WORLD):
            known = ", ".join(sorted(scope.names())[:20])
            raise asking.error(
                f"nothing is called {last[:80]!r} here", found=name[:200], allowed=known or None, code="I101"
            )
        return owner or scope, last

    def link(self, scope: Scope, name: str, asking: Element) -> Link | None:
        """The link that a frame is fixed to; None: the world. Raises SpecError at the element ``asking``."""
        scope, name = self.home(scope, name, asking)
        known: set[str] = set()
        walked: list[tuple[int, str]] = []
        # a chain may be longer than Python's calls within each other
        while name in scope.frames and name not in known and (id(scope), name) not in self._attached:
            further = scope.frames[name].word("attached_to") or MODEL
            if split(scope, further)[0] or further == MODEL:
                break
            known.add(name)
            walked.append((id(scope), name))
            scope, name = self.home(scope, further, scope.frames[name])
        key = (id(scope), name)
        if key in self._open or name in known:
            raise asking.error("frames that are attached to each other", found=name[:80], code="I101")
        if key not in self._attached:
            self._open.append(key)
            self._attached[key] = self._link(scope, name, asking)
            self._open.pop()
        for entry in walked:  # for each frame of a chain
            self._attached[entry] = self._attached[key]
        return self._attached[key]

    def _link(self, scope: Scope, name: str, asking: Element) -> Link | None:
        if name in scope.links:
            return scope, name
        if name == WORLD or (name == MODEL and scope.is_world):
            return None
        if name in scope.joints:
            return self.link(scope, values.text_of(scope.joints[name], "child", ""), scope.joints[name])
        if name in scope.frames:
            frame = scope.frames[name]
            return self.link(scope, frame.word("attached_to") or MODEL, frame)
        if name in scope.models:
            return self.canonical(scope.models[name], asking)
        return self.canonical(scope, asking)

    def canonical(self, scope: Scope, asking: Element) -> Link | None:
        """The link that a model's own frame is fixed to. Raises SpecError where it has none."""
        if scope.canonical:
            return self.link(scope, scope.canonical, scope.element)
        if scope.links:
            return scope, next(iter(scope.links))
        for inner in scope.models.values():
            return self.canonical(inner, asking)
        raise asking.error(f"the model {scope.name[:80]!r} has no link", code="I101")

    def pose(self, scope: Scope, name: str, asking: Element) -> Placement:
        """The pose of a frame in that of the scope itself. Raises SpecError at the element ``asking``."""
        first, rest = split(scope, name)
        if first:
            self.home(scope, name, asking)
            around = scope.owner(first) or scope
            inner = self.pose(around, first, asking).then(self.pose(around.models[first], rest, asking))
            return self.in_scope(scope, around).then(inner)
        owner, name = self.home(scope, name, asking)
        if owner is not scope:  # one of a model that is merged into this one
            return self.in_scope(scope, owner).then(self.pose(owner, name, asking))
        if name == MODEL or (name == WORLD and scope.is_world):
            return Placement()
        if name == WORLD and name not in scope.links:
            raise asking.error("nothing in a model is relative to the world", found=name, code="I101")
        for below in reversed(self._chain(scope, name, asking)):
            self._poses[id(scope), below] = self._pose(scope, below)
        return self._poses[id(scope), name]

    def _chain(self, scope: Scope, name: str, asking: Element) -> list[str]:
        """The frame, and those of its own scope that its pose follows from, as far as they are not known; the first one last. A
        chain may be longer than Python's calls within each other."""
        chain: list[str] = []
        known: set[str] = set()
        while (id(scope), name) not in self._poses:
            if name in known or (id(scope), name) in self._open:
                raise asking.error("poses that are relative to each other", found=name[:80], code="I101")
            known.add(name)
            chain.append(name)
            placed, element = self.placed(scope, name)
            name = placed.relative_to or MODEL
            if name in (MODEL, WORLD) or split(scope, name)[0]:
                break
            owner, _ = self.home(scope, name, placed.element or element)
            if owner is not scope:
                break
        return chain

    def _pose(self, scope: Scope, name: str) -> Placement:
        self._open.append((id(scope), name))
        placed, element = self.placed(scope, name)
        pose = self.pose(scope, placed.relative_to or MODEL, placed.element or element).then(placed.placement)
        if name in scope.models and scope.models[name].placement_frame:
            inner = scope.models[name]
            pose = pose.then(self.pose(inner, inner.placement_frame, inner.element).inverse())
        self._open.pop()
        return pose

    def placed(self, scope: Scope, name: str) -> tuple[SdfPose, Element]:
        """The ``<pose>`` of a link, joint, frame or model, against the frame that it is relative to by default where the file
        does not say it."""
        if name in scope.models:
            return scope.models[name].placed, scope.models[name].element
        table, default = scope.links, MODEL
        if name in scope.joints:
            table, default = scope.joints, values.text_of(scope.joints[name], "child", "")
        elif name in scope.frames:
            table, default = scope.frames, scope.frames[name].word("attached_to") or MODEL
        key = (id(scope), name)
        if key not in self._placed:
            pose = values.pose_of(table[name])
            self._placed[key] = SdfPose(pose.placement, pose.relative_to or default, pose.element)
        return self._placed[key], table[name]

    def in_scope(self, outer: Scope, inner: Scope) -> Placement:
        """The pose of a model's frame in that of a scope around it."""
        path: list[Scope] = []
        around: Scope | None = inner
        while around is not None and around is not outer:
            path.append(around)
            around = around.parent
        pose = Placement()
        for model in reversed(path):
            assert model.parent is not None
            pose = pose.then(self.pose(model.parent, model.name, model.element))
        return pose


KINDS: Final[Mapping[str, str]] = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
    "ball": "ball",
    "fixed": "fixed",
    "universal": "universal",
    "revolute2": "universal",
}
"""Kinds of joints; a universal one is two hinges in a row, about the same point."""
REFUSED: Final[Mapping[str, str]] = {"screw": "a turn that is coupled to a displacement"}
FIRST_AXIS: Final = "axis"
SECOND_AXIS: Final = "axis2"
UNLIMITED: Final = 1e16
"""A limit from here on is none."""
HARD_STOP: Final = f"a limit is a hard, inelastic stop: {SOLVER}"
ACTING: Final[Mapping[str, str]] = {
    "max_force": "a motor of one solver; write the actuators as `control` of the scenario",
    "bounce": "limits are inelastic",
}
"""Elements of a joint's `physics` that are not about how hard its constraints are."""


@dataclass(frozen=True)
class SdfMimicRead:
    """That a joint follows another: ``axis`` is which of the leader's axes."""

    element: Element
    leader: tuple[Scope, str]
    axis: str
    ratio: float
    offset: float


@dataclass
class SdfJointRead:
    """A joint: the links that it joins, its place, and its words in the language. ``parent`` None: the world."""

    scope: Scope
    name: str
    element: Element
    kind: str
    parent: Link | None
    child: Link
    in_child: Placement
    """The joint's frame in that of the child link."""
    data: dict[str, Any]
    """Limits, damping, and the like; the axis in the child link's axes."""
    second: dict[str, Any] | None = None
    """The same of the second axis of a universal joint."""
    mimic: SdfMimicRead | None = None
    second_mimic: SdfMimicRead | None = None

    @property
    def mimics(self) -> list[tuple[SdfMimicRead, str]]:
        """The leaders of its axes, each with the word of the axis."""
        both = ((self.mimic, FIRST_AXIS), (self.second_mimic, SECOND_AXIS))
        return [(mimic, word) for mimic, word in both if mimic is not None]


def read_joint(graph: FrameGraph, scope: Scope, name: str) -> SdfJointRead:
    """A joint of a model. Raises SpecError for kinds that the language does not have."""
    element = scope.joints[name]
    word = element.need("type")
    if word in REFUSED:
        message = f"simspec does not support joints of the type {word}: {REFUSED[word]}"
        raise element.error(message, hint="leave it out, or fix it", code="I104")
    if word not in KINDS:
        raise element.error(
            "not a type of joint", found=word[:60], allowed=", ".join((*KINDS, "gearbox", *REFUSED)), code="I101"
        )
    parent, child = side_of(graph, scope, element, "parent"), child_of(graph, scope, element)
    in_child = _between(graph, scope, element, name, child)
    kind = KINDS[word]
    read = SdfJointRead(scope, name, element, kind, parent, child, in_child, {})
    if kind in SCALAR_JOINTS or kind == "universal":
        limited, turns = word != "continuous", kind != "slide"
        read.data, read.mimic = _axis(graph, read, FIRST_AXIS, limited=limited, turns=turns)
        if kind == "universal":
            read.second, read.second_mimic = _axis(graph, read, SECOND_AXIS, limited=limited, turns=turns)
    elif element.look(FIRST_AXIS):
        element.look(FIRST_AXIS)[0].ignore(None, f"a {word} joint has no axis")
    if kind != "universal":
        element.ignore_child(SECOND_AXIS, f"a {word} joint has one axis at most")
    values.set_aside(element, values.IN_JOINT)
    solver_of(element)
    _rotor(element, read.data)
    return read


def side_of(graph: FrameGraph, scope: Scope, element: Element, tag: str) -> Link | None:
    """The link on one side of a joint (``parent`` or ``child``); None: the world. Raises SpecError where there is none."""
    side = element.child(tag)
    if side is None or not side.text:
        raise element.error(f"<joint> has no <{tag}>", code="I101")
    if side.text == WORLD and WORLD not in scope.links:
        return None
    return graph.link(scope, side.text, side)


def child_of(graph: FrameGraph, scope: Scope, element: Element) -> Link:
    """The link that a joint moves. Raises SpecError where there is none."""
    child = side_of(graph, scope, element, "child")
    if child is None:
        raise element.error(
            "the child of a joint is a link, not the world", hint="exchange parent and child", code="I101"
        )
    return child


def _between(graph: FrameGraph, scope: Scope, element: Element, name: str, child: Link) -> Placement:
    placed, _ = graph.placed(scope, name)
    if not placed.relative_to or graph.home(scope, placed.relative_to, element) == child:
        return placed.placement
    link = graph.in_scope(scope, child[0]).then(graph.pose(*child, element))
    return link.inverse().then(graph.pose(scope, name, element))


def _axis(
    graph: FrameGraph, joint: SdfJointRead, word: str, *, limited: bool, turns: bool
) -> tuple[dict[str, Any], SdfMimicRead | None]:
    element = joint.element
    axis = axis_of(element, word)
    data: dict[str, Any] = {"axis": list(direction_of(graph, joint.scope, joint.name, joint.child, axis))}
    limit = axis.child("limit")
    if limit is not None and (limits := _limits(limit, limited=limited, turns=turns)):
        data["limits"] = limits
    if (dynamics := axis.child("dynamics")) is not None:
        for tag, key in (("damping", "damping"), ("friction", "dry_friction")):
            if value := values.finite_of(dynamics, tag, 0.0):
                data[key] = value
        stiffness = values.finite_of(dynamics, "spring_stiffness", 0.0)
        rest = values.finite_of(dynamics, "spring_reference", 0.0)
        if stiffness:
            data["spring"] = {"stiffness": stiffness}
        if stiffness and rest:
            data["spring"]["rest"] = angle(rest) if turns else rest
    hint = "`positions` of the placed model"
    axis.lose_children("initial_position", "where a joint begins is not read", PHYSICS, hint)
    mimics = axis.look("mimic")
    if len(mimics) > 1:
        raise mimics[1].error("a joint follows one other at most", code="I101")
    return data, _mimic(graph, joint.scope, mimics[0].take()) if mimics else None


def axis_of(element: Element, word: str) -> Element:
    """The element of an axis of a joint; an empty one where the file has none."""
    return element.child(word) or Element(word, {}, element.location, "", element)


def _mimic(graph: FrameGraph, scope: Scope, element: Element) -> SdfMimicRead | None:
    """The leader of an axis: q = multiplier × (q of the leader − reference) + offset. None where it has none."""
    leader = graph.home(scope, element.need("joint"), element)
    axis = element.word("axis") or FIRST_AXIS
    if leader[1] not in leader[0].joints:
        raise element.error("not a joint", found=element.attributes["joint"][:80], code="I101")
    if axis not in (FIRST_AXIS, SECOND_AXIS):
        raise element.error(
            "not an axis of a joint", found=axis[:80], allowed=f"{FIRST_AXIS}, {SECOND_AXIS}", code="I101"
        )
    ratio, offset = values.finite_of(element, "multiplier", 1.0), values.finite_of(element, "offset", 0.0)
    reference = values.finite_of(element, "reference", 0.0)
    if ratio == 0.0:
        reason = "with a multiplier of 0 the joint follows nothing: it moves on its own"
        element.lose(None, reason, hint="make the joint fixed")
        return None
    return SdfMimicRead(element, leader, axis, ratio, offset - ratio * reference)


def direction_of(graph: FrameGraph, scope: Scope, name: str, child: Link, axis: Element) -> Vector3:
    """An axis of a joint in the axes of its child link. Raises SpecError for one without length."""
    element = scope.joints[name]
    xyz = axis.child("xyz")
    direction: Vector3 = (0.0, 0.0, 1.0) if xyz is None else values.vector(xyz)
    if not any(direction):
        raise axis.error("the axis of a joint has no length", code="I101")
    by_frame = scope.version >= values.JOINT_FRAME_SINCE
    by_flag = by_frame and scope.version < values.EXPRESSED_SINCE
    of_model = values.flag_of(axis, "use_parent_model_frame", False) if by_flag else not by_frame
    frame = MODEL if of_model else name
    if xyz is not None:
        frame = xyz.word("expressed_in") or frame
    if frame == name:
        turn = _between(graph, scope, element, name, child).pose.quaternion
    else:
        link = graph.in_scope(scope, child[0]).then(graph.pose(*child, element))
        turn = link.inverse().then(graph.pose(scope, frame, axis)).pose.quaternion
    return frames.rotate(turn, direction)


def _limits(limit: Element, *, limited: bool, turns: bool) -> dict[str, Any]:
    data: dict[str, Any] = {}
    lower, upper = values.number_of(limit, "lower", -math.inf), values.number_of(limit, "upper", math.inf)
    if not limited:
        for child in limit.look("lower", "upper"):
            child.ignore(None, "a continuous joint has no limits")
    elif lower > -UNLIMITED or upper < UNLIMITED:
        if not (lower > -UNLIMITED and upper < UNLIMITED):
            raise limit.error("a joint with one limit is not supported", hint="give both limits, or none", code="I104")
        if math.inf in (lower, -upper):
            raise limit.error("a limit that nothing reaches", found=f"{lower:g} to {upper:g}", code="I102")
        data["position"] = [angle(value) if turns else value for value in (lower, upper)]
    for tag in ("velocity", "effort"):
        value = values.number_of(limit, tag, -1.0)
        if 0.0 < value < UNLIMITED:
            data[tag] = value
        elif value == 0.0:
            limit.lose_children(tag, NO_RATING, INFORMATION)
    limit.lose_children("stiffness dissipation", HARD_STOP, INFORMATION)
    return data


def solver_of(element: Element) -> None:
    """Numbers of solvers: of most it is said how hard constraints are, some are forces."""
    for physics in element.look("physics"):
        waiting = [physics]
        while waiting:
            child = waiting.pop()
            if child.tag in ACTING and values.number(child):
                child.lose(None, ACTING[child.tag])
                for around in (physics, child.parent):
                    around.take() if around is not None else None
            else:
                child.lose(None, SOLVER, INFORMATION)
                waiting.extend(child.look())


def _rotor(element: Element, data: dict[str, Any]) -> None:
    """The inertia of a rotor behind a gear, which one reader of the language has as elements of its own."""
    inertia = ratio = None
    for child in element.look():
        if child.tag.endswith(":rotor_inertia"):
            (inertia,) = child.content(1)
        elif child.tag.endswith(":gear_ratio"):
            (ratio,) = child.content(1)
    if inertia and "axis" in data:
        data["armature"] = inertia * (1.0 if ratio is None else ratio) ** 2
