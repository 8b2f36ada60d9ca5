"""The scene of a stage: gravity, materials, who does not touch whom."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from typing import Any, Final

from simspec.imports.draft import Draft, numbers, plain
from simspec.imports.usd.bodies import Body
from simspec.imports.usd.contact import LEFT_TO_SOLVER, Materials, filtered, groups
from simspec.imports.usd.joints import Joint
from simspec.imports.usd.places import UPRIGHT
from simspec.imports.usd.stage import Prim, Stage
from simspec.language.foreign import Fate
from simspec.world import frames
from simspec.world.types import Vector3

SELF_COLLISION: Final = ("physxArticulation:enabledSelfCollisions", "newton:selfCollisionEnabled")
"""Attributes of articulations beyond UsdPhysics: whether bodies of one touch each other."""
GRAVITY: Final = 9.81
"""m/s², where the scene does not say it."""


def physics_data(stage: Stage, draft: Draft) -> dict[str, Any] | None:
    """Gravity, and the timestep that only simspec says; None where the stage has no scene."""
    scenes = [prim for prim in stage.used() if prim.tag == "PhysicsScene"]
    for other in scenes[1:]:
        other.set_aside(None, Fate.LOST, "another scene of the file is in force")
    if not scenes:
        return None
    scene = scenes[0].take()
    assert isinstance(scene, Prim)
    along = scene.reals("physics:gravityDirection", 3) or (0.0, 0.0, 0.0)
    size = scene.real("physics:gravityMagnitude", -math.inf, infinite=True)
    length = math.sqrt(sum(value * value for value in along))
    size = GRAVITY if size < 0.0 else size * stage.metres
    down = (0.0, 0.0, -1.0) if stage.up == "Z" else (0.0, -1.0, 0.0)
    if not scene.flag("newton:gravityEnabled", True):
        size = 0.0
    unit = tuple(value / length for value in along) if length else down
    gravity = scene.exactly("gravity", [value * size for value in unit])
    vector = (gravity[0], gravity[1], gravity[2])
    if stage.up == "Y":
        vector = tidy(frames.rotate(UPRIGHT.quaternion, vector))
        draft.note(("physics", "gravity"), "y is up in the file: its world is turned by 90 deg about x")
    physics: dict[str, Any] = {"gravity": numbers([_short(value) for value in vector])}
    step = scene.own("timestep", 1)
    if step is not None and step[0] > 0.0:
        physics["timestep"] = plain(step[0])
    return physics


def contact_data(
    stage: Stage,
    draft: Draft,
    parts: Mapping[str, Prim],
    bodies: Mapping[int, Body],
    materials: Materials,
    every: Sequence[Body],
    joints: Sequence[Joint],
    data: dict[str, Any],
) -> dict[str, Any]:
    """Materials, groups and pairs; bodies in ``data`` are told their groups. ``parts``: the body of every prim that is part of
    one; ``bodies`` by the ``id`` of their prims."""
    contact: dict[str, Any] = {}
    if materials.data:
        contact["materials"] = materials.data
        if "" in materials.names:
            draft.note(("contact", "materials", materials.names[""]), LEFT_TO_SOLVER)
    full = {id(body.prim): f"{body.model}/{body.name}" if body.model else body.name for body in every}
    of_shape = {shape.prim.where: full[id(body.prim)] for body in every for shape in body.shapes if shape.collision}
    words, member = groups(stage, of_shape)
    if words:
        contact["groups"] = words
        for body in every:
            if full[id(body.prim)] in member:
                _words_of(body, data)["collision_group"] = member[full[id(body.prim)]]
    body_of = dict(parts)
    for body in every:
        if body.fixed:
            body_of[body.prim.where] = body.prim
            body_of |= {shape.prim.where: body.prim for shape in body.shapes}
    pairs = {
        tuple(sorted((full[id(one)], full[id(two)])))
        for one, two in filtered(stage, body_of)
        if id(one) in full and id(two) in full
    }
    if "model" in data and _keeps_apart(stage):
        contact["self_collision"] = False
    rigid = _rigid_groups(every, bodies)
    kept = sorted(pair for pair in pairs if rigid.get(pair[0]) != rigid.get(pair[1]) or pair[0] not in rigid)
    if kept:
        contact["exclude"] = [list(pair) for pair in kept]
    if touch := _touching(joints, full, set(of_shape.values()), rigid):
        contact["touch"] = [list(pair) for pair in touch]
    return contact


def _keeps_apart(stage: Stage) -> bool:
    """Whether an articulation says that its bodies do not touch each other, by a word of an engine that many files have."""
    said = [prim for prim in stage.used() for name in SELF_COLLISION if name in prim.told["attributes"]]
    flags = [prim.flag(name, True) for prim in said for name in SELF_COLLISION]
    return not all(flags)


def _touching(
    joints: Sequence[Joint], full: Mapping[int, str], solid: Container[str], rigid: Mapping[str, str]
) -> list[tuple[str, str]]:
    """Pairs of bodies that touch although a joint joins them."""
    pairs = set()
    for joint in joints:
        names = [full.get(id(side), "") for side in (joint.first, joint.second)]
        if joint.touching and all(name in solid for name in names) and rigid[names[0]] != rigid[names[1]]:
            pairs.add((min(names), max(names)))
    return sorted(pairs)


def _rigid_groups(every: Sequence[Body], bodies: Mapping[int, Body]) -> dict[str, str]:
    """Bodies that fixed joints hold together, by a name for each group."""
    group: dict[str, str] = {}
    for body in every:
        name = f"{body.model}/{body.name}" if body.model else body.name
        joint = body.link.joint
        rigid = joint is not None and not joint.freedoms
        if body.fixed or (rigid and body.link.parent is None):
            group[name] = "world"
        elif rigid and body.link.parent is not None:
            above = bodies[id(body.link.parent)]
            group[name] = group[f"{above.model}/{above.name}" if above.model else above.name]
        else:
            group[name] = name
    return group


def _words_of(body: Body, data: dict[str, Any]) -> dict[str, Any]:
    """The words of a body."""
    if "model" in data:
        table = data["model"]["bodies"]
    else:
        table = data["models"][body.model]["bodies"] if body.model else data["bodies"]
    words: dict[str, Any] = table[body.name]
    return words


def tidy(vector: Vector3) -> Vector3:
    """An axis whose components that rounding left are zero."""
    x, y, z = (0.0 if abs(value) < 1e-9 else value for value in vector)
    return (x, y, z)


def _short(value: float) -> float:
    """A number of single precision as a person wrote it, where it is one."""
    import numpy as np

    short = float(str(np.float32(value)))
    return short if abs(short - value) <= 1e-7 * abs(value) and float(np.float32(value)) == value else value
