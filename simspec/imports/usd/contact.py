"""Gravity, materials, collision groups and filtered pairs of a stage."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import Draft, numbers, plain
from simspec.imports.elements import names
from simspec.imports.usd.bodies import UsdBodyRead, holder_of
from simspec.imports.usd.joints import UsdJointRead
from simspec.imports.usd.shapes import UPRIGHT, UsdShapeRead
from simspec.imports.usd.stage import PrimRead, StageRead, first_of
from simspec.world import frames
from simspec.world.types import Vector3

MATERIAL: Final = "PhysicsMaterialAPI"
BINDINGS: Final = ("material:binding:physics", "material:binding")
UNBOUND: Final = "unbound"
"""The material of shapes that have none."""
FRICTION: Final = 0.5
CONDIM: Final = "mjc:condim"
"""Of a shape, beyond UsdPhysics: how many directions friction has there."""
LEFT_TO_SOLVER: Final = "the file binds no material to these shapes, which UsdPhysics leaves to the solver"


def bind(shape: UsdShapeRead, stage: StageRead) -> None:
    """Give a shape that collides the material that it, or the nearest prim around it, is bound to."""
    for name in BINDINGS:
        for holder in shape.prim.ancestors():
            targets = holder.record["relationships"].get(name)
            if not targets:
                continue
            material = stage.prims.get(targets[0])
            if material is not None and material.used and MATERIAL in material.schemas:
                holder.targets(name)
                holder.applies("MaterialBindingAPI")
                shape.material = material.where
                return
            break


@dataclass
class UsdMaterials:
    """The materials of physics that shapes have."""

    stage: StageRead
    names: dict[str, str] = field(default_factory=dict)
    """By their paths; "" for shapes that have none."""
    data: dict[str, Any] = field(default_factory=dict)

    def read(self, shapes: Sequence[UsdShapeRead], alone: bool) -> None:
        """Name the materials of shapes that collide. In a model file (``alone``) shapes need none."""
        solid = [shape for shape in shapes if shape.collision]
        bound = {shape.material for shape in solid}
        paths = [
            prim.where
            for prim in self.stage.used()
            if prim.where in bound or (prim.tag == "Material" and MATERIAL in prim.schemas)
        ]
        called = names([self.stage.prims[path].called() for path in paths])
        for path, name in zip(paths, called, strict=True):
            self.names[path] = name
            using = [shape for shape in solid if shape.material == path]
            self.data[name] = self._material(self.stage.prims[path], using)
        if (paths or not alone) and any(not shape.material for shape in solid):
            (self.names[""],) = names([UNBOUND], called)
            self.data[self.names[""]] = {"friction": FRICTION}

    def _material(self, prim: PrimRead, shapes: Sequence[UsdShapeRead]) -> dict[str, Any]:
        prim.take()
        prim.applies(MATERIAL)
        sticking, sliding = (prim.real(f"physics:{name}Friction", 0.0) for name in ("static", "dynamic"))
        bounce = prim.real("physics:restitution", 0.0)
        prim.value("physics:density")
        if sticking != sliding:
            prim.lose("physics:staticFriction", "friction is one number; `dynamicFriction` is carried")
        data: dict[str, Any] = {"friction": plain(prim.exact("friction", sliding))}
        if bounce:
            data["restitution"] = plain(prim.exact("restitution", bounce))
        else:
            prim.stored("restitution")
        return data | self._turning(prim, shapes)

    def _turning(self, prim: PrimRead, shapes: Sequence[UsdShapeRead]) -> dict[str, Any]:
        """Torsional and rolling friction (m) of a material. Where shapes say in how many directions friction acts
        (:data:`CONDIM`, 3 unless it is said), the first needs 4 of these, and the second 6."""
        governed = any("MjcCollisionAPI" in shape.prim.schemas or shape.prim.has(CONDIM) for shape in shapes)
        directions = {shape.prim.real(CONDIM, 3.0) if governed else 6.0 for shape in shapes}
        data: dict[str, Any] = {}
        for least, word, attributes in (
            (4.0, "torsional_friction", ("newton:torsionalFriction", "mjc:torsionalfriction")),
            (6.0, "rolling_friction", ("newton:rollingFriction", "mjc:rollingfriction")),
        ):
            friction = first_of(prim, dict.fromkeys(attributes, self.stage.metres))
            acting = {number >= least for number in directions}
            for name in attributes:
                if True not in acting:
                    prim.ignore(name, f"no shape has {CONDIM} of {least:g}")
                elif len(acting) > 1:
                    prim.lose(name, f"shapes of one material differ in {CONDIM}")
            if acting == {True} and friction:
                data[word] = plain(friction)
        for shape in shapes:
            if shape.prim.has(CONDIM) and shape.prim.real(CONDIM, 3.0) < 3.0:
                shape.prim.lose(CONDIM, "two such shapes touch without friction")
        return data


def filtered(stage: StageRead, body_of: Mapping[str, PrimRead]) -> list[tuple[PrimRead, PrimRead]]:
    """Pairs of bodies that do not touch. ``body_of``: the body of every prim that is part of one, by its path."""
    pairs: list[tuple[PrimRead, PrimRead]] = []
    for prim in stage.used():
        if not prim.applies("PhysicsFilteredPairsAPI"):
            continue
        for target in prim.targets("physics:filteredPairs"):
            first, second = body_of.get(prim.where), body_of.get(target)
            if first is None or second is None:
                prim.lose("physics:filteredPairs", "names what is no body, or a part of none")
            elif first is not second:
                pairs.append((first, second))
                for body, path in ((first, prim.where), (second, target)):
                    if body.where != path and len(_solid(stage, body, body_of)) > 1:
                        prim.lose("physics:filteredPairs", "pairs are of whole bodies: all their shapes do not touch")
    return pairs


def _solid(stage: StageRead, body: PrimRead, body_of: Mapping[str, PrimRead]) -> list[PrimRead]:
    return [
        prim
        for path, holder in body_of.items()
        if holder is body and "PhysicsCollisionAPI" in (prim := stage.prims[path]).schemas
    ]


def groups(stage: StageRead, shapes: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, str]]:
    """The words of ``contact.groups``, and the group of each body that is in one. ``shapes``: the bodies' names by the paths of
    their shapes that collide."""
    prims = [prim for prim in stage.used() if prim.tag == "PhysicsCollisionGroup"]
    called = dict(zip((prim.where for prim in prims), names([prim.called() for prim in prims]), strict=True))
    table: dict[str, set[str]] = {name: set() for name in called.values()}
    member: dict[str, dict[str, set[str]]] = {}
    for prim in prims:
        name = called[prim.where]
        prim.take()
        prim.applies("CollectionAPI:colliders")
        rule = prim.token("collection:colliders:expansionRule", "expandPrims")
        includes, excludes = (prim.targets(f"collection:colliders:{word}") for word in ("includes", "excludes"))
        for path, body in shapes.items():
            if _in(path, includes, rule) and not _in(path, excludes, "expandPrims"):
                member.setdefault(body, {}).setdefault(path, set()).add(name)
        others = prim.targets("physics:filteredGroups")
        merge = prim.token("physics:mergeGroup")
        if prim.flag("physics:invertFilteredGroups", False) or merge:
            prim.lose(None, "groups that are inverted or merged are not supported")
            continue
        for other in others:
            if other in called:
                table[name].add(called[other])
    # a group that ignores no group with a shape has no effect
    actual = {name for said in member.values() for names in said.values() for name in names}
    acting = {name for name in actual for other in actual if other in table[name] or name in table[other]}
    of_body: dict[str, str] = {}
    for body, said in member.items():
        sets = {frozenset(said.get(path, set()) & acting) for path, holder in shapes.items() if holder == body}
        if len(sets) == 1 and len(only := next(iter(sets))) <= 1:
            of_body |= dict.fromkeys((body,), *only) if only else {}
            continue
        for path in said:
            reason = "shapes of one body are in several collision groups"
            stage.prims[path].lose("apiSchemas:PhysicsCollisionAPI", reason)
    ignores = {name: sorted(ignored & actual) for name, ignored in table.items() if name in actual}
    words = {name: {"ignores": ignored} for name, ignored in ignores.items() if ignored}
    named = words.keys() | {name for entry in table.values() for name in entry}
    return words, {body: name for body, name in of_body.items() if name in named}


def _in(path: str, targets: Sequence[str], rule: str) -> bool:
    if rule == "explicitOnly":
        return path in targets
    return any(path == target or path.startswith(f"{target}/") for target in targets)


SELF_COLLISION: Final = ("physxArticulation:enabledSelfCollisions", "newton:selfCollisionEnabled")
"""Attributes of articulations beyond UsdPhysics: whether bodies of one touch each other."""
GRAVITY: Final = 9.81
"""m/s², where the scene does not say it."""


def physics_data(stage: StageRead, draft: Draft) -> dict[str, Any] | None:
    """Gravity, and the timestep that only simspec says; None where the stage has no scene."""
    scenes = [prim for prim in stage.used() if prim.tag == "PhysicsScene"]
    for other in scenes[1:]:
        other.lose(None, "another scene of the file is in force")
    if not scenes:
        return None
    scene = scenes[0].take()
    assert isinstance(scene, PrimRead)
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
    step = scene.stored_number("timestep")
    if step is not None and step > 0.0:
        physics["timestep"] = plain(step)
    return physics


def contact_data(
    stage: StageRead,
    draft: Draft,
    parts: Mapping[str, PrimRead],
    bodies: Mapping[int, UsdBodyRead],
    materials: UsdMaterials,
    every: Sequence[UsdBodyRead],
    joints: Sequence[UsdJointRead],
    data: dict[str, Any],
) -> dict[str, Any]:
    """Materials, groups and pairs; bodies in ``data`` get their groups. ``parts``: the body of every prim that is part of
    one; ``bodies`` by the ``id`` of their prims."""
    contact: dict[str, Any] = {}
    if materials.data:
        contact["materials"] = materials.data
        if "" in materials.names:
            draft.note(("contact", "materials", materials.names[""]), LEFT_TO_SOLVER)
    full = {id(body.prim): body.full for body in every}
    of_shape = {shape.prim.where: full[id(body.prim)] for body in every for shape in body.shapes if shape.collision}
    words, member = groups(stage, of_shape)
    if words:
        contact["groups"] = words
        for body in every:
            if full[id(body.prim)] in member:
                holder_of(data, body.model)["bodies"][body.name]["collision_group"] = member[full[id(body.prim)]]
    body_of = dict(parts)
    for body in every:
        if body.fixed:
            body_of[body.prim.where] = body.prim
            body_of |= {shape.prim.where: body.prim for shape in body.shapes}
    pairs = {
        tuple(sorted((full[id(first)], full[id(second)])))
        for first, second in filtered(stage, body_of)
        if id(first) in full and id(second) in full
    }
    if "model" in data and _excludes_self_collision(stage):
        contact["self_collision"] = False
    rigid = _rigid_groups(every, bodies)
    kept = sorted(pair for pair in pairs if rigid.get(pair[0]) != rigid.get(pair[1]) or pair[0] not in rigid)
    if kept:
        contact["exclude"] = [list(pair) for pair in kept]
    if touch := _touching(joints, full, set(of_shape.values()), rigid):
        contact["touch"] = [list(pair) for pair in touch]
    return contact


def _excludes_self_collision(stage: StageRead) -> bool:
    """Whether an articulation says that its bodies do not touch each other, by a word of an engine that many files have."""
    said = [prim for prim in stage.used() for name in SELF_COLLISION if name in prim.record["attributes"]]
    flags = [prim.flag(name, True) for prim in said for name in SELF_COLLISION]
    return not all(flags)


def _touching(
    joints: Sequence[UsdJointRead], full: Mapping[int, str], solid: Container[str], rigid: Mapping[str, str]
) -> list[tuple[str, str]]:
    pairs = set()
    for joint in joints:
        names = [full.get(id(side), "") for side in (joint.first, joint.second)]
        if joint.touching and all(name in solid for name in names) and rigid[names[0]] != rigid[names[1]]:
            pairs.add((min(names), max(names)))
    return sorted(pairs)


def _rigid_groups(every: Sequence[UsdBodyRead], bodies: Mapping[int, UsdBodyRead]) -> dict[str, str]:
    group: dict[str, str] = {}
    for body in every:
        name = body.full
        joint = body.link.joint
        rigid = joint is not None and not joint.freedoms
        if body.fixed or (rigid and body.link.parent is None):
            group[name] = "world"
        elif rigid and body.link.parent is not None:
            above = bodies[id(body.link.parent)]
            group[name] = group[above.full]
        else:
            group[name] = name
    return group


def tidy(vector: Vector3) -> Vector3:
    """An axis whose components that rounding left are zero."""
    x, y, z = (0.0 if abs(value) < 1e-9 else value for value in vector)
    return (x, y, z)


def _short(value: float) -> float:
    """A number of single precision as a person wrote it, where it is one."""
    import numpy as np

    short = float(str(np.float32(value)))
    return short if abs(short - value) <= 1e-7 * abs(value) and float(np.float32(value)) == value else value
