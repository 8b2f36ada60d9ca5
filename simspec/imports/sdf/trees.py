"""A model of SDF as trees of bodies: names, parents, frames.

A body's frame is its link's, moved to its joint where that turns about another point: bodies of the language have their frames
at their joints.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from simspec.imports import draft
from simspec.imports.elements import Element, outwards
from simspec.imports.sdf.joints import SECOND_AXIS, FrameGraph, Link, SdfJointRead, key_of, read_joint
from simspec.imports.sdf.loops import GEARBOX, closed, couple, refused, spanning
from simspec.imports.sdf.models import Scope, SdfMeshes
from simspec.imports.sdf.shapes import DENSITY, LinkContext, SdfShapeRead, read_shapes, surface_of_link
from simspec.imports.sdf.values import (
    IN_LINK,
    IN_MODEL,
    Placement,
    SdfNames,
    at,
    finite_of,
    flag,
    flag_of,
    pose_of,
    set_aside,
)
from simspec.language.moments import impossible, principal_moments
from simspec.world import frames
from simspec.world.types import Vector3

# Links: mass properties.

NO_INERTIAL: Final = "the file has no <inertial>; SDF then means 1 kg and a unit inertia"
UNIT_INERTIA: Final = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}


@dataclass
class SdfLinkRead:
    """The properties of a link for its body, in the body's frame."""

    mass: dict[str, Any]
    shapes: list[SdfShapeRead]
    comment: str = ""
    inertial: Element | None = None
    repaired: str = ""
    """The change by the rule of :mod:`simspec.imports.draft`."""
    given: list[tuple[str, str, str]] = field(default_factory=list)
    """Repairs of the body: the rule, the change, and the word of the body where it is seen."""

    @property
    def is_massless(self) -> bool:
        """Whether the file says that it has no mass."""
        return (
            self.inertial is not None
            and not self.mass.get("mass", 0.0)
            and not any("density" in shape.data for shape in self.shapes)
        )


def read_link(link: Element, offset: Vector3, meshes: SdfMeshes, folder: Path, *, static: bool) -> SdfLinkRead:
    """A link, for a body whose frame is at ``offset`` in the link's; ``folder``: of its file. Where it is ``static``, a mass
    that is not in the file has no effect. Raises SpecError."""
    move = at((-offset[0], -offset[1], -offset[2]))
    density = _computed(link)
    shapes = read_shapes(link, LinkContext(meshes, folder, move, density, surface_of_link(link), static))
    set_aside(link, IN_LINK)
    weight: dict[str, Any] = {} if flag_of(link, "gravity", True) or static else {"gravity_scale": 0.0}
    inertial = link.look("inertial")
    if density is not None:
        return SdfLinkRead(weight, shapes, inertial=inertial[0])
    if inertial:
        mass, repaired = _inertial(inertial[0].take(), move, meshes.draft)
        return SdfLinkRead({**mass, **weight}, shapes, inertial=inertial[0], repaired=repaired)
    if static:
        return SdfLinkRead({}, shapes)
    mass = {**weight, "mass": 1.0, **_centre(move), "inertia": {"principal": [1.0, 1.0, 1.0]}}
    return SdfLinkRead(mass, shapes, NO_INERTIAL)


def _computed(link: Element) -> float | None:
    """The density by which the link's inertia is to be computed from its collisions; None where the file gives the inertia."""
    for inertial in link.look("inertial"):
        if flag(inertial, inertial.word("auto") or "false"):
            inertial.take()
            if inertial.look("mass", "inertia", "pose"):
                raise inertial.error(
                    "an inertial that is computed and has numbers of its own is not supported", code="I104"
                )
            return finite_of(inertial, "density", DENSITY)
    return None


def _inertial(inertial: Element, move: Placement, spec: draft.Draft) -> tuple[dict[str, Any], str]:
    mass = finite_of(inertial, "mass", 1.0)
    pose = pose_of(inertial)
    if pose.relative_to:
        raise inertial.error(
            "the pose of an inertial is relative to its link", found=pose.relative_to[:80], code="I101"
        )
    place = move.then(pose.placement)
    tensor = inertial.child("inertia")
    values = [default if tensor is None else finite_of(tensor, key, default) for key, default in UNIT_INERTIA.items()]
    inertial.lose_child("fluid_added_mass", "simspec has no added mass: physics.fluid is drag and viscous resistance")
    inertial.ignore_child("density", "the file gives the mass")
    if not mass and not any(values):
        return {}, ""
    six, repaired = _possible(inertial, tuple(values), spec)
    return {"mass": mass, **_centre(place), "inertia": inertia_data(six, place)}, repaired


def _possible(inertial: Element, tensor: tuple[float, ...], spec: draft.Draft) -> tuple[tuple[float, ...], str]:
    """A tensor that breaks the triangle inequality as the nearest one that a body can have, and what that changed. Raises
    SpecError where the rule is not requested; the language refuses a tensor that is not positive."""
    before = principal_moments(tensor)
    why = impossible(before)
    if why is None or min(before) < 0.0:
        return tensor, ""
    if not spec.repairing(draft.RULE):
        raise inertial.error(why, hint=spec.way_out(draft.RULE), code="I102")
    after = draft.nearest(tensor)
    return after, draft.became(before, principal_moments(after))


def _centre(place: Placement) -> dict[str, Any]:
    return {"centre_of_mass": list(place.pose.position)} if any(place.pose.position) else {}


def inertia_data(values: tuple[float, ...], place: Placement) -> dict[str, Any]:
    """An inertia (xx, yy, zz, xy, xz, yz) in axes turned by ``place``, as the language has it in the body's axes."""
    turned = place.pose.quaternion != frames.IDENTITY
    if not any(values[3:]):
        data: dict[str, Any] = {"principal": list(values[:3])}
        if turned:
            data.update({key: value for key, value in place.data().items() if key != "xyz"})
        return data
    if turned:
        values = frames.rotate_inertia(place.pose.quaternion, values)
    return draft.tensor_words(values)


MASSLESS: Final = "massless"
RULES: Final = {MASSLESS: "a root without mass is fixed to the world"}
"""Rules of repair, with what they do."""


@dataclass
class SdfBodyRead:
    """A body: its link, its joint (None: free, or fixed by the model), and its frame in the model's."""

    name: str
    link: Link
    element: Element
    frame: Placement
    content: SdfLinkRead
    joint: SdfJointRead | None = None
    parent: SdfBodyRead | None = None
    offset: Vector3 = (0.0, 0.0, 0.0)
    """The frame's origin in the link's frame."""
    static: bool = False
    self_collide: bool = False
    joint_name: str = ""
    second_name: str = ""
    """Of the second hinge of a universal joint."""


@dataclass
class Closing:
    """A joint that closes a loop, between two bodies."""

    joint: SdfJointRead
    first: SdfBodyRead
    second: SdfBodyRead
    name: str


@dataclass
class SdfModelRead:
    """A model of the file: its bodies, parents first in each tree."""

    scope: Scope
    bodies: list[SdfBodyRead]
    graph: FrameGraph
    repairs: list[tuple[SdfBodyRead, str]] = field(default_factory=list)
    closing: list[Closing] = field(default_factory=list)
    """Joints that close loops."""

    @property
    def roots(self) -> list[SdfBodyRead]:
        """Bodies without a parent."""
        return [body for body in self.bodies if body.parent is None]


def read_model(graph: FrameGraph, model: Scope, meshes: SdfMeshes) -> SdfModelRead:
    """The bodies of a model with all that are within it. Raises SpecError with all problems."""
    problems = draft.Problems()
    joints: list[SdfJointRead] = []
    gearboxes: list[tuple[Scope, str]] = []
    scopes = model.within()
    for scope in scopes:
        set_aside(scope.element, IN_MODEL)
        for name in scope.frames:
            graph.link(scope, name, scope.frames[name])
            graph.pose(scope, name, scope.frames[name])
        for name, element in scope.joints.items():
            with problems.collecting():
                if element.word("type") == GEARBOX:
                    gearboxes.append((scope, name))
                else:
                    joints.append(read_joint(graph, scope, name))
    for scope, name in gearboxes if not problems else ():
        with problems.collecting():
            couple(graph, scope, name, joints)
    read = _bodies(graph, model, joints, meshes, problems)
    for root in read.roots:
        _massless(read, root, meshes.draft, problems)
    problems.demand_none()
    return read


def _massless(read: SdfModelRead, root: SdfBodyRead, spec: draft.Draft, problems: draft.Problems) -> None:
    if root.static or root.joint is not None or not root.content.is_massless:
        return
    if not spec.repairing(MASSLESS):
        problems.append(
            root.element.problem("a link that moves freely has no mass", hint=spec.way_out(MASSLESS), code="I102")
        )
        return
    root.static = True
    root.content.mass = {}
    read.repairs.append((root, "it has no mass, and nothing holds it: fixed to the world"))


def _bodies(
    graph: FrameGraph, model: Scope, joints: list[SdfJointRead], meshes: SdfMeshes, problems: draft.Problems
) -> SdfModelRead:
    of_child, closed_by = spanning(joints)
    closing = {id(joint) for joint in closed_by}
    actual = _fixed_to_world(of_child)
    names, joint_names = SdfNames(), SdfNames()
    bodies: dict[tuple[int, str], SdfBodyRead] = {}
    for scope in model.within():
        for name, element in scope.links.items():
            key = (id(scope), name)
            joint = of_child.get(key)
            if joint is not None and scope.static and joint.kind != "fixed":
                joint = None  # nothing moves in a static model
            offset = _offset(joint)
            frame = graph.in_scope(model, scope).then(graph.pose(scope, name, element)).then(at(offset))
            content = SdfLinkRead({}, [])
            with problems.collecting():
                is_static = scope.static or key in actual
                content = read_link(element, offset, meshes, scope.folder, static=is_static)
            given = names.give(_long_name(model, scope, name), element)
            body = bodies[key] = SdfBodyRead(given, (scope, name), element, frame, content, joint, offset=offset)
            body.static, body.self_collide = scope.static, flag_of(element, "self_collide", scope.self_collide)
    closed: list[Closing] = []
    for read in joints:
        body, parent = bodies[id(read.child[0]), read.child[1]], bodies.get(key_of(read.parent) or (0, ""))
        joint_name = joint_names.give(_long_name(model, read.scope, read.name), read.element)
        if body.joint is read:
            body.joint_name = joint_name
            if read.second is not None:
                body.second_name = joint_names.give(f"{joint_name}_{SECOND_AXIS}")
            body.parent = parent
        elif id(read) in closing and not read.scope.static:
            problems.extend(refused(read))
            if parent is None:
                hint = "let a link that is fixed to the world be the parent"
                problems.append(read.element.problem(TO_WORLD, hint=hint, code="I101"))
            elif parent is body:
                problems.append(read.element.problem("a joint between a link and itself", found=body.name, code="I101"))
            else:
                closed.append(Closing(read, parent, body, joint_name))
    _join_static(list(bodies.values()))
    return SdfModelRead(model, _parents_first(list(bodies.values())), graph, closing=closed)


TO_WORLD: Final = "a loop that is closed by a joint to the world is not supported"


def _fixed_to_world(of_child: dict[tuple[int, str], SdfJointRead]) -> set[tuple[int, str]]:
    below: dict[tuple[int, str] | None, list[tuple[int, str]]] = {}
    for key, joint in of_child.items():
        if joint.kind == "fixed":
            below.setdefault(key_of(joint.parent), []).append(key)
    actual: set[tuple[int, str]] = set()
    waiting = list(below.get(None, ()))
    while waiting:
        key = waiting.pop()
        actual.add(key)
        waiting.extend(below.get(key, ()))
    return actual


def _long_name(model: Scope, scope: Scope, name: str) -> str:
    """A name with those of the models that it is in, below the outermost."""
    parts = [name]
    while scope is not model and scope.parent is not None:
        if not scope.merged:
            parts.append(scope.name)
        scope = scope.parent
    return "_".join(reversed(parts))


def _offset(joint: SdfJointRead | None) -> Vector3:
    """Where a body's frame is in its link's: at its joint, unless it does not turn there."""
    if joint is None or joint.kind not in ("hinge", "ball", "universal"):
        return (0.0, 0.0, 0.0)
    return joint.in_child.pose.position


def _join_static(bodies: list[SdfBodyRead]) -> None:
    """Links of a static model are one rigid thing: those that no joint fixes are fixed to the first."""
    first: SdfBodyRead | None = None
    for body in bodies:
        if body.static and body.parent is None:
            if first is not None:
                body.parent = first
            first = first or body


def _parents_first(bodies: list[SdfBodyRead]) -> list[SdfBodyRead]:
    below: dict[int, list[SdfBodyRead]] = {}
    for body in bodies:
        below.setdefault(id(body.parent), []).append(body)
    order = outwards(below.get(id(None), []), lambda body: below.get(id(body), []))
    placed = {id(body) for body in order}
    for body in bodies:
        if id(body) not in placed:
            assert body.joint is not None
            raise body.joint.element.error("a loop: these links are each other's parents", code="I101")
    return order


def named_frames(read: SdfModelRead) -> dict[str, dict[str, Any]]:
    """The frames of a model that are attached to its links, as the language has them, by name; bodies have theirs already."""
    names = SdfNames(body.name for body in read.bodies)
    of_link = {key_of(body.link): body for body in read.bodies}
    made: dict[str, dict[str, Any]] = {}
    for scope in read.scope.within():
        for name, element in scope.frames.items():
            body = of_link.get(key_of(read.graph.link(scope, name, element)))
            if body is None:
                continue
            place = read.graph.in_scope(read.scope, scope).then(read.graph.pose(scope, name, element))
            data = body.frame.inverse().then(place).data()
            given = names.give(_long_name(read.scope, scope, name), element)
            made[given] = {"body": body.name, **({"pose": data} if data else {})}
    return made


def body_data(model: SdfModelRead, body: SdfBodyRead, around: Placement) -> dict[str, Any]:
    """A body as the language has it; ``around``: the pose of the model's frame in that of the placement."""
    data: dict[str, Any] = {}
    content, joint = body.content, body.joint
    if body.parent is not None:
        data["parent"] = body.parent.name
        data.update(_joint_data(body, "fixed" if joint is None else joint.kind, _origin(model.graph, body)))
    else:
        pose = around.then(body.frame)
        if joint is not None and not (joint.kind == "fixed" and body.joint_name == f"{body.name}_joint"):
            data.update(_joint_data(body, joint.kind, pose))
        else:
            if body.static or joint is not None:
                data["fixed"] = True
            if pose.data():
                data["pose"] = pose.data()
    data.update(content.mass)
    return data


def _origin(graph: FrameGraph, body: SdfBodyRead) -> Placement:
    """The pose of a body in its parent's; of a link that the file places against its parent, by the file's own numbers."""
    assert body.parent is not None
    scope, name = body.link
    placed, element = graph.placed(scope, name)
    if placed.relative_to and graph.home(scope, placed.relative_to, element) == body.parent.link:
        x, y, z = body.parent.offset
        return at((-x, -y, -z)).then(placed.placement).then(at(body.offset))
    return body.parent.frame.inverse().then(body.frame)


def _joint_data(body: SdfBodyRead, kind: str, origin: Placement) -> dict[str, Any]:
    data: dict[str, Any] = {"type": kind}
    if body.joint_name and body.joint_name != f"{body.name}_joint":
        data = {"name": body.joint_name, **data}
    if origin.data():
        data["origin"] = origin.data()
    if body.joint is None:
        return {"joint": data}
    data.update(body.joint.data)
    if body.joint.second is None:
        return {"joint": data}
    first = {"name": body.joint_name, **data, "type": "hinge"}
    return {"joints": [first, {"name": body.second_name, "type": "hinge", **body.joint.second}]}


def constraints(read: SdfModelRead) -> dict[str, dict[str, Any]]:
    """Joints that follow others, and joints that close loops, as constraints of the language, by name. Raises SpecError for
    joints that follow what has no position."""
    names = SdfNames()
    said: dict[str, dict[str, Any]] = {}
    by_joint = {key_of((body.joint.scope, body.joint.name)): body for body in read.bodies if body.joint is not None}
    problems = draft.Problems()
    for body in read.bodies:
        for mimic, word in body.joint.mimics if body.joint is not None else ():
            leader = by_joint.get(key_of(mimic.leader))
            driven = _axis_name(leader, mimic.axis) if leader is not None else ""
            if not driven:
                message = "this axis has no position to be followed"
                problems.append(mimic.element.problem(message, found=mimic.leader[1][:80], code="I101"))
                continue
            follower = _axis_name(body, word)
            said[names.give(follower)] = draft.follow(follower, driven, mimic.ratio, mimic.offset)
    for loop in read.closing:
        for constraint in _closed(loop):
            said[names.give(loop.name)] = constraint
    problems.demand_none()
    return said


def _axis_name(body: SdfBodyRead, axis: str) -> str:
    """The name of the hinge or slide that an axis of a body's joint is; "" for none."""
    if body.joint is None or (axis == SECOND_AXIS and body.joint.second is None):
        return ""
    if axis == SECOND_AXIS:
        return body.second_name
    return body.joint_name if "axis" in body.joint.data else ""


def _closed(loop: Closing) -> list[dict[str, Any]]:
    x, y, z = loop.second.offset
    joint = loop.joint
    second = at((-x, -y, -z)).then(joint.in_child)
    between = loop.first.frame.inverse().then(loop.second.frame)
    axis: Vector3 = joint.data["axis"] if joint.kind == "hinge" else (0.0, 0.0, 0.0)
    axes = (frames.rotate(between.pose.quaternion, axis), axis)
    return closed(joint, (loop.first.name, loop.second.name), (between.then(second).pose, second.pose), axes)
