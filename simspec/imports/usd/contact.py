"""Who touches whom, and how, on a stage: materials, collision groups, pairs that are filtered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import names, plain
from simspec.imports.usd.shapes import Shape
from simspec.imports.usd.stage import Prim, Stage
from simspec.language.foreign import Fate, Severity

MATERIAL: Final = "PhysicsMaterialAPI"
BINDINGS: Final = ("material:binding:physics", "material:binding")
UNBOUND: Final = "unbound"
"""The material of shapes that have none."""
FRICTION: Final = 0.5
CONDIM: Final = "mjc:condim"
"""Of a shape, beyond UsdPhysics: how many directions friction has there."""
LEFT_TO_SOLVER: Final = "the file binds no material to these shapes, which UsdPhysics leaves to the solver"


def bind(shape: Shape, stage: Stage) -> None:
    """Give a shape that collides the material that it, or the nearest prim around it, is bound to."""
    for name in BINDINGS:
        for holder in shape.prim.ancestors():
            targets = holder.told["relationships"].get(name)
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
class Materials:
    """The materials of physics that shapes have."""

    stage: Stage
    names: dict[str, str] = field(default_factory=dict)
    """By their paths; "" for shapes that have none."""
    data: dict[str, Any] = field(default_factory=dict)

    def read(self, shapes: Sequence[Shape], alone: bool) -> None:
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
            self.data[name] = self._material(self.stage.prims[path], [one for one in solid if one.material == path])
        if (paths or not alone) and any(not shape.material for shape in solid):
            (self.names[""],) = names([UNBOUND], called)
            self.data[self.names[""]] = {"friction": FRICTION}

    def _material(self, prim: Prim, shapes: Sequence[Shape]) -> dict[str, Any]:
        prim.take()
        prim.applies(MATERIAL)
        sticking, sliding = (prim.real(f"physics:{name}Friction", 0.0) for name in ("static", "dynamic"))
        bounce = prim.real("physics:restitution", 0.0)
        if prim.has("physics:density"):
            prim.value("physics:density")
        if sticking != sliding:
            prim.set_aside("physics:staticFriction", Fate.LOST, "friction is one number; `dynamicFriction` is carried")
        friction = prim.exactly("friction", (sliding,))[0]
        data: dict[str, Any] = {"friction": plain(friction)}
        if bounce:
            data["restitution"] = plain(prim.exactly("restitution", (bounce,))[0])
        else:
            prim.own("restitution")
        return data | self._turning(prim, shapes)

    def _turning(self, prim: Prim, shapes: Sequence[Shape]) -> dict[str, Any]:
        """Torsional and rolling friction (m) of a material. Where shapes say in how many directions friction acts
        (:data:`CONDIM`, 3 unless it is said), the first needs 4 of these, and the second 6."""
        governed = any("MjcCollisionAPI" in one.prim.schemas or one.prim.has(CONDIM) for one in shapes)
        directions = {one.prim.real(CONDIM, 3.0) if governed else 6.0 for one in shapes}
        data: dict[str, Any] = {}
        for least, word, attributes in (
            (4.0, "torsional_friction", ("newton:torsionalFriction", "mjc:torsionalfriction")),
            (6.0, "rolling_friction", ("newton:rollingFriction", "mjc:rollingfriction")),
        ):
            said = [prim.real(name, 0.0) * self.stage.metres for name in attributes if prim.has(name)]
            acting = {number >= least for number in directions}
            if True not in acting:
                for name in attributes:
                    prim.set_aside(name, Fate.UNUSED, f"no shape has {CONDIM} of {least:g}", Severity.INFORMATION)
            elif len(acting) > 1:
                for name in attributes:
                    prim.set_aside(name, Fate.LOST, f"shapes of one material differ in {CONDIM}")
            elif said and said[0]:
                data[word] = plain(said[0])
        for one in shapes:
            if one.prim.has(CONDIM) and one.prim.real(CONDIM, 3.0) < 3.0:
                one.prim.set_aside(CONDIM, Fate.LOST, "two such shapes touch without friction")
        return data


def filtered(stage: Stage, body_of: Mapping[str, Prim]) -> list[tuple[Prim, Prim]]:
    """Pairs of bodies that do not touch. ``body_of``: the body of every prim that is part of one, by its path."""
    pairs: list[tuple[Prim, Prim]] = []
    for prim in stage.used():
        if not prim.applies("PhysicsFilteredPairsAPI"):
            continue
        for target in prim.targets("physics:filteredPairs"):
            first, second = body_of.get(prim.where), body_of.get(target)
            if first is None or second is None:
                prim.set_aside("physics:filteredPairs", Fate.LOST, "names what is no body, or a part of none")
            elif first is not second:
                pairs.append((first, second))
                for one, path in ((first, prim.where), (second, target)):
                    if one.where != path and len(_solid(stage, one, body_of)) > 1:
                        prim.set_aside(
                            "physics:filteredPairs",
                            Fate.LOST,
                            "pairs are of whole bodies: all their shapes do not touch",
                        )
    return pairs


def _solid(stage: Stage, body: Prim, body_of: Mapping[str, Prim]) -> list[Prim]:
    return [
        prim
        for path, holder in body_of.items()
        if holder is body and "PhysicsCollisionAPI" in (prim := stage.prims[path]).schemas
    ]


def groups(stage: Stage, shapes: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, str]]:
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
            prim.set_aside(None, Fate.LOST, "groups that are inverted or merged are not supported")
            continue
        for other in others:
            if other in called:
                table[name].add(called[other])
    # what ignores no group that has a shape is as if it were in none
    held = {name for said in member.values() for names in said.values() for name in names}
    acting = {name for name in held for other in held if other in table[name] or name in table[other]}
    of_body: dict[str, str] = {}
    for body, said in member.items():
        sets = {frozenset(said.get(path, set()) & acting) for path, holder in shapes.items() if holder == body}
        if len(sets) == 1 and len(only := next(iter(sets))) <= 1:
            of_body |= dict.fromkeys((body,), *only) if only else {}
            continue
        for path in said:
            stage.prims[path].set_aside(
                "apiSchemas:PhysicsCollisionAPI", Fate.LOST, "shapes of one body are in several collision groups"
            )
    words = {
        name: {"ignores": sorted(ignored & held)} for name, ignored in table.items() if name in held and ignored & held
    }
    return words, {
        body: name for body, name in of_body.items() if name in words or any(name in one for one in table.values())
    }


def _in(path: str, targets: Sequence[str], rule: str) -> bool:
    if rule == "explicitOnly":
        return path in targets
    return any(path == target or path.startswith(f"{target}/") for target in targets)
