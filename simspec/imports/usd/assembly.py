"""A stage as the data of a spec: bodies, their trees, the scene around them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from simspec.errors import SpecError
from simspec.imports.draft import Draft, follow, numbers, plain
from simspec.imports.elements import names
from simspec.imports.usd.bodies import (
    OF_FILLING,
    MassReader,
    UsdBodyRead,
    UsdLinkRead,
    add_frames,
    constrain,
    frame_in_body,
    in_order,
    loop_data,
    origin_of,
    trees,
)
from simspec.imports.usd.contact import UsdMaterials, bind, contact_data, physics_data, tidy
from simspec.imports.usd.joints import (
    STACKED,
    TYPES,
    Freedom,
    JointReader,
    UsdJointRead,
    stacked,
    start_of,
    start_words,
)
from simspec.imports.usd.shapes import GEOMETRY, UPRIGHT, PrimPlaces, ShapeReader, UsdShapeRead, name_meshes, pose_data
from simspec.imports.usd.stage import PrimRead, StageRead, agree
from simspec.imports.writing import has_drives, stable_timestep
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.language.words import clean_name
from simspec.world import frames
from simspec.world.frames import direction
from simspec.world.types import Pose

RIGID: Final = "PhysicsRigidBodyAPI"
NO_GRAVITY: Final = "physxRigidBody:disableGravity"
COMPENSATED: Final = "mjc:body:gravcomp"
"""The part of a body's weight that is away."""
ARTICULATION: Final = "PhysicsArticulationRootAPI"
LARGEST_GAP: Final = 1e-3
"""m and rad allowed between the frames of a joint: files are written by hand and in single precision."""
MASSLESS: Final = "massless"


MODEL_FILE: Final = ("simspec", "name", "physics", "contact", "model")
"""The words of a model file, in their order."""


class UsdAssembly:
    """Makes the spec of a stage."""

    def __init__(self, stage: StageRead, draft: Draft):
        self.stage, self.draft = stage, draft
        self.places = PrimPlaces(stage.metres, stage.up == "Z")
        self.data: dict[str, Any] = {}
        self.body_of: dict[str, PrimRead] = {}
        self.bodies: dict[int, UsdBodyRead] = {}
        self.alone = False
        """Whether the spec is a model file."""
        self.shapes = ShapeReader(self.places, draft)
        self.masses = MassReader(stage, self.places, draft)

    def fill(self) -> None:
        """Make the data. Problems are kept in the draft; raises SpecError where nothing can be made."""
        prims = self._rigid()
        joints = self._joints()
        roots = [
            body
            for prim in self.stage.used()
            if prim.applies(ARTICULATION) and (body := self._root(prim, prims)) is not None
        ]
        shapes = self._shapes()
        if self.draft.problems:
            self.draft.finish()
        tops, loops = trees(prims, joints, roots)
        order: list[UsdBodyRead] = []
        for top in tops:
            for link in in_order(top):
                order.append(self._body(link, shapes.pop(link.prim.where, [])))
        static = self._static_bodies(shapes)
        if not order and not static:
            raise self.stage.root.error("this stage has no bodies and nothing that they could touch", code="I113")
        self.alone = self._stands_alone(tops, static)
        self._name(tops, order, static)
        self._scenario(tops, order, static, loops)

    def _rigid(self) -> list[PrimRead]:
        bodies: list[PrimRead] = []
        for prim in self.stage.used():
            if prim.applies(RIGID):
                if prim.flag("physics:rigidBodyEnabled", True):
                    bodies.append(prim)
                    self.body_of[prim.where] = prim
                prim.value("physics:startsAsleep")
            if prim.where not in self.body_of and prim.above is not None and prim.above.where in self.body_of:
                self.body_of[prim.where] = self.body_of[prim.above.where]
        return bodies

    def _root(self, prim: PrimRead, bodies: list[PrimRead]) -> PrimRead | None:
        if prim.where in self.body_of:
            return self.body_of[prim.where]
        for name in ("physics:body1", "physics:body0"):
            for target in prim.record["relationships"].get(name, ()):
                if target in self.body_of:
                    return self.body_of[target]
        return None

    def _joints(self) -> list[UsdJointRead]:
        reader = JointReader(self.stage, self.places, lambda prim: self.body_of.get(prim.where))
        joints: list[UsdJointRead] = []
        for prim in self.stage.used():
            if prim.tag not in TYPES:
                continue
            with self.draft.collecting():
                joint = reader.read(prim)
                if joint is None:
                    continue
                sides = (joint.first, joint.second)
                start_of(joint, *(Pose() if side is None else self.places.world(side).pose for side in sides))
                joints.append(joint)
        adding = [prim for prim in self.stage.used() if prim.has(STACKED) and prim.flag(STACKED, False)]
        return stacked(joints, bool(adding))

    def _shapes(self) -> dict[str, list[UsdShapeRead]]:
        """Shapes by the path of their body; those of the world by the path of what they are fixed on."""
        shapes: dict[str, list[UsdShapeRead]] = {}
        for prim in self.stage.used():
            if prim.tag not in GEOMETRY:
                continue
            with self.draft.collecting():
                body = self.body_of.get(prim.where)
                shape = self.shapes.read(prim, body)
                if shape is None:
                    continue
                if shape.collision:
                    bind(shape, self.stage)
                shapes.setdefault((body or self._holder(prim)).where, []).append(shape)
        readable = name_meshes([shape for found in shapes.values() for shape in found], self.draft)
        kept = {path: [shape for shape in found if id(shape) in readable] for path, found in shapes.items()}
        return {path: found for path, found in kept.items() if found}

    def _holder(self, prim: PrimRead) -> PrimRead:
        """The prim that a shape of the world is fixed on: the prim around it, unless that is around bodies or other such
        prims."""
        above = prim.above
        if above is None or above is self.stage.root or above.where == self.stage.default:
            return prim
        if above.tag not in ("Xform", "prim"):
            return prim
        inside = [other for other in above.look() if isinstance(other, PrimRead)]
        return above if all(other.tag in GEOMETRY for other in inside) else prim

    def _body(self, link: UsdLinkRead, shapes: list[UsdShapeRead]) -> UsdBodyRead:
        body = UsdBodyRead(link.prim, link, shapes)
        if link.joint is not None:
            body.frame = frame_in_body(link.joint)
            for joint in link.joints:
                start_words(joint)
            if link.joint.gap > LARGEST_GAP:
                away = f"{link.joint.gap:.3g} m or rad from each other where the bodies are"
                reason = f"the joint's frames are {away}: the joint places {link.prim.name}"
                link.prim.lose("xformOp:translate", reason)
                link.joint.prim.lose("physics:body1", reason)
        self.bodies[id(link.prim)] = body
        return body

    def _static_bodies(self, shapes: dict[str, list[UsdShapeRead]]) -> list[UsdBodyRead]:
        bodies = []
        for path, found in shapes.items():
            prim = self.stage.prims[path]
            body = UsdBodyRead(prim, UsdLinkRead(prim), found, fixed=True)
            back = frames.inverse(self.places.world(prim).pose)
            for shape in found:
                if shape.prim is not prim and shape.prim.tag in ("Cube", "Sphere", "Mesh"):
                    shape.pose = self.places.within(shape.prim, prim).pose
                else:
                    shape.pose = frames.compose(back, shape.pose)
            bodies.append(body)
            self.bodies[id(prim)] = body
        return bodies

    def _name(self, tops: list[UsdLinkRead], order: list[UsdBodyRead], static: list[UsdBodyRead]) -> None:
        """Names of bodies, models and joints. A tree that stands alone within a prim is a model, called as that."""
        holders = {} if self.alone else {id(top): self._model(top, tops) for top in tops}
        of_model = {key: holder for key, holder in holders.items() if holder is not None}
        loose = [self.bodies[id(link.prim)] for top in tops if id(top) not in of_model for link in in_order(top)]
        loose += static
        models = [top for top in tops if id(top) in of_model]
        given = names([*(body.prim.called() for body in loose), *(of_model[id(top)].called() for top in models)])
        for body, name in zip(loose, given, strict=False):
            body.name = name
        for top, name in zip(models, given[len(loose) :], strict=True):
            inside = [self.bodies[id(link.prim)] for link in in_order(top)]
            for body, given_name in zip(inside, names([body.prim.called() for body in inside]), strict=True):
                body.name, body.model = given_name, name
        for model in {body.model: None for body in order}:
            _name_all([joint for body in order if body.model == model for joint in body.link.joints])
        for group in (loose, *([body for body in order if body.model == name] for name in given[len(loose) :])):
            _name_all([shape for body in group for shape in body.shapes])

    def _model(self, top: UsdLinkRead, tops: list[UsdLinkRead]) -> PrimRead | None:
        """The prim that all bodies of a tree are in, and no others."""
        paths = [link.prim.where for link in in_order(top)]
        for holder in top.prim.ancestors():
            if holder is self.stage.root or holder.where == self.stage.default:
                return None
            if holder is top.prim or holder.where in self.body_of:
                continue
            start = f"{holder.where}/"
            if all(path.startswith(start) for path in paths):
                others = (link.prim.where for other in tops if other is not top for link in in_order(other))
                return None if any(path.startswith(start) for path in others) else holder
        return None

    def _stands_alone(self, tops: list[UsdLinkRead], static: list[UsdBodyRead]) -> bool:
        """Whether the stage is one tree: a model file, unless simspec wrote it as a scenario that places a model."""
        default = self.stage.prims.get(self.stage.default)
        if len(tops) != 1 or static:
            return False
        return default is None or not default.has("simspec:world") or self._model(tops[0], tops) is None

    def _scenario(
        self, tops: list[UsdLinkRead], order: list[UsdBodyRead], static: list[UsdBodyRead], loops: list[UsdJointRead]
    ) -> None:
        draft = self.draft
        default = self.stage.prims.get(self.stage.default)
        stem = draft.files.path.name.partition(".")[0]
        name = default.name if default is not None and default.name != "World" else stem
        if default is not None and (said := default.token("simspec:world")):
            name = said
        self.data |= {"simspec": 1, "name": clean_name(name)[:150]}
        draft.places[()] = self.stage.root.location
        if (physics := physics_data(self.stage, draft)) is not None:
            self.data["physics"] = physics
        materials = UsdMaterials(self.stage)
        # in the order of the file: trees by their roots
        index = {path: number for number, path in enumerate(self.stage.prims)}
        above = {id(link.prim): index[top.prim.where] for top in tops for link in in_order(top)}
        every = sorted([*order, *static], key=lambda body: above.get(id(body.prim), index[body.prim.where]))
        materials.read([shape for body in every for shape in body.shapes], self.alone)
        for body in every:
            around = ("model",) if self.alone else ("models", body.model) if body.model else ()
            base = (*around, "bodies")
            with draft.collecting():
                words = self._words(body, (*base, body.name), materials)
                holder: Any = self.data
                for step in base:
                    holder = holder.setdefault(step, {})
                holder[body.name] = words
        add_frames(self.stage, self.places, self.body_of, self.bodies, self.data)
        for joint in loops:
            if (made := loop_data(joint, self.bodies)) is not None:
                constrain(self.data, made[0], joint.name, made[1])
        self._follow(every)
        inner = [*loops, *(body.link.joint for body in every if body.link.joint is not None)]
        contact = contact_data(self.stage, draft, self.body_of, self.bodies, materials, every, inner, self.data)
        if contact:
            self.data["contact"] = contact
        if has_drives(self.data):
            self._drives(every)
        if self.alone and "contact" in self.data:
            self.data = {word: self.data[word] for word in MODEL_FILE if word in self.data}

    def _follow(self, every: list[UsdBodyRead]) -> None:
        of_prim = {joint.prim.where: (joint, body.model) for body in every for joint in body.link.joints}
        for joint, model in of_prim.values():
            said = joint.freedoms[0].mimic if len(joint.freedoms) == 1 else None
            if said is None:
                continue
            leader, other = of_prim.get(said.leader, (None, ""))
            kinds = [] if leader is None or other != model else [freedom.kind for freedom in leader.freedoms]
            if leader is None or len(kinds) != 1 or kinds[0] not in SCALAR_JOINTS:
                reason = "it is to follow what is no hinge or slide of its model: the joint moves on its own"
                joint.prim.lose("newton:mimicJoint", reason)
                continue
            words = follow(joint.name, leader.name, said.ratio, said.offset, joint.freedoms[0].kind == "hinge")
            constrain(self.data, model, joint.name, words)

    def _drives(self, every: list[UsdBodyRead]) -> None:
        if "timestep" in self.data.get("physics", {}) or self.draft.problems:
            return
        prims = {body.full: body.link.joint.prim for body in every if body.link.joint is not None}

        def leave_out(name: str, step: float) -> None:
            reason = f"too stiff a drive for a spring that is explicit in time, which is stable up to {step:.2g} s"
            for attribute in prims[name].attributes if name in prims else ():
                if attribute.startswith("drive:"):
                    prims[name].lose(attribute, reason, hint="write the actuators as `control:` of the scenario")

        try:
            step = stable_timestep(self.data, self.draft.meshes, leave_out)
        except SpecError:
            return  # a spec that does not resolve is reported by its reader, with its places
        if step is not None:
            self.data.setdefault("physics", {})["timestep"] = step
            self.draft.note(("physics", "timestep"), "the file says no timestep; its drives are stable at this one")

    def _words(self, body: UsdBodyRead, path: tuple[str, ...], materials: UsdMaterials) -> dict[str, Any]:
        draft, prim, joint = self.draft, body.prim, body.link.joint
        draft.place(path, prim)
        data: dict[str, Any] = {}
        if body.fixed:
            data["fixed"] = True
            if pose := pose_data(self.places.world(prim).pose):
                data["pose"] = pose
        elif body.link.parent is not None or joint is not None:
            assert joint is not None
            if body.link.parent is not None:
                data["parent"] = self.bodies[id(body.link.parent)].name
            self._join(body, joint, data, path)
            for name in ("physics:velocity", "physics:angularVelocity"):
                if any(prim.reals(name, 3) or ()):
                    prim.lose(name, "bodies of a tree start with the velocities of their joints")
            if prim.flag("physics:kinematicEnabled", False):
                prim.lose("physics:kinematicEnabled", "a kinematic body that joints hold moves with them")
        else:
            self._free(body, data)
        if not body.fixed:
            data |= self.masses.read(body, path)
            self._massless(body, data, path)
            if not data.get("kinematic") and prim.flag(NO_GRAVITY, False):
                data["gravity_scale"] = 0.0
            elif (away := prim.real(COMPENSATED, 0.0)) and not data.get("kinematic"):
                data["gravity_scale"] = plain(1.0 - away)
        shapes = []
        for index, shape in enumerate(body.shapes):
            if body.fixed:
                for name in OF_FILLING:
                    shape.prim.ignore(name, "it does not move")
            words = shape.written(body.offset, f"{body.name}_{index}")
            if shape.collision and len(materials.data) > 1:
                words["material"] = materials.names[shape.material]
            shapes.append(words)
            draft.place((*path, "shapes", index), shape.prim)
        if shapes:
            data["shapes"] = shapes
        if body.name != prim.name and body.name != prim.called():
            draft.note(path, f"{prim.path} in the file")
        return data

    def _join(self, body: UsdBodyRead, joint: UsdJointRead, data: dict[str, Any], path: tuple[str, ...]) -> None:
        self.draft.place((*path, "joint"), joint.prim)
        words: list[dict[str, Any]] = []
        around = Pose()
        if body.link.parent is not None:
            around = frames.inverse(self.bodies[id(body.link.parent)].frame)
        for part in body.link.joints:
            frame = origin_of(part)
            origin = frames.compose(around, frame) if around != Pose() else frame
            around = frames.inverse(frame)  # joints of one body follow each other
            first = len(words)
            words += [self._freedom_words(part, freedom) for freedom in part.freedoms]
            words = words or [{"type": "fixed"}]
            position = part.prim.exactly("origin", origin.position)
            if position == tuple(origin.position) or agree(position, origin.position):
                turn = part.prim.turn("orientation", origin.quaternion)
                origin = Pose(position, turn)  # type: ignore[arg-type]
            if place := pose_data(origin):
                words[first] = {"type": words[first]["type"], "origin": place, **words[first]}
        default = f"{body.name}_joint"
        if len(words) == 1:
            named = {"name": joint.name} if joint.name != default else {}
            if body.link.parent is None and words[0]["type"] == "fixed" and not named:
                data["fixed"] = True
                if place:
                    data["pose"] = place
                return
            data["joint"] = {**named, **words[0]}
            return
        called = (
            (freedom.name or (f"{part.name}_{freedom.word}" if len(part.freedoms) > 1 else part.name))
            for part in body.link.joints
            for freedom in part.freedoms
        )
        data["joints"] = [{"name": name, **word} for name, word in zip(called, words, strict=True)]

    def _freedom_words(self, joint: UsdJointRead, freedom: Freedom) -> dict[str, Any]:
        entry: dict[str, Any] = {"type": freedom.kind}
        if freedom.kind != "ball":
            axis = frames.rotate(joint.in_second.quaternion, freedom.axis)
            stored = joint.stored(freedom, "axis")
            if stored is not None and len(stored) == 3 and any(stored):
                exact = frames.vector3(stored)
                axis = exact if agree(direction(exact), axis) else axis
            entry["axis"] = numbers(tidy(axis))
        return entry | freedom.data

    def _free(self, body: UsdBodyRead, data: dict[str, Any]) -> None:
        prim = body.prim
        place = self.places.world(prim)
        if prim.flag("physics:kinematicEnabled", False):
            data["kinematic"] = True
        if pose := pose_data(place.pose):
            data["pose"] = pose
        speeds: list[tuple[float, ...]] = []
        for name, text, unit in (
            ("velocity", "velocity", self.stage.metres),
            ("angularVelocity", "angular_velocity", math.pi / 180.0),
        ):
            said = prim.reals(f"physics:{name}", 3) or (0.0, 0.0, 0.0)
            speeds.append(prim.exactly(text, [value * unit for value in said]))
        if self.stage.up == "Y":
            speeds = [frames.rotate(UPRIGHT.quaternion, frames.vector3(speed)) for speed in speeds]
        moving = {word: numbers(v) for word, v in zip(("linear", "angular"), speeds, strict=True) if any(v)}
        if moving and not data.keys() & {"fixed", "kinematic"}:
            data["velocity"] = moving
        said_name = prim.token("simspec:joint_name")
        if said_name and "fixed" not in data:
            data["joint"] = {"name": said_name, "type": "free"}

    def _massless(self, body: UsdBodyRead, data: dict[str, Any], path: tuple[str, ...]) -> None:
        if body.link.parent is not None or body.link.joint is not None or "fixed" in data or "kinematic" in data:
            return

        def weighs(other: UsdBodyRead) -> bool:
            said = other.prim.record["attributes"].get("physics:mass", {}).get("value")
            return bool(said) or any(shape.collision for shape in other.shapes)

        if any(weighs(self.bodies[id(link.prim)]) for link in in_order(body.link)):
            return
        message = "a body that moves freely has no mass"
        repair = "it has no mass, and nothing holds it: fixed to the world"
        if self.draft.mend(MASSLESS, body.prim, message, repair, (*path, "fixed")):
            data["fixed"] = True
            data.pop("velocity", None)


def _name_all(items: Sequence[Any]) -> None:
    """Give joints, or shapes, names that the language allows, none twice."""
    for item, name in zip(items, names([item.name for item in items]), strict=True):
        item.name = name
