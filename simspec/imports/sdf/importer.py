"""SDF as specs: one model is a model file; a world, several models, or a model of several trees a scenario."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any, Final

from simspec.errors import Location, Problem, SpecError
from simspec.imports import draft
from simspec.imports.draft import (
    FROM_SHAPES,
    MOMENTS,
    NOT_POSITIVE,
    OF_SHAPES,
    OF_SHAPES_OR_BALL,
    Draft,
    Materials,
    ball,
    even,
    given,
    plain,
    shown,
    solids_of,
    tidy,
)
from simspec.imports.elements import APPEARANCE, INFORMATION, Element, outermost
from simspec.imports.files import Files
from simspec.imports.sdf import SUFFIXES
from simspec.imports.sdf.joints import FrameGraph
from simspec.imports.sdf.models import RULES as RULES_OF_MESHES
from simspec.imports.sdf.models import ModelReader, Scope, SdfContext, SdfMeshes
from simspec.imports.sdf.shapes import SdfShapeRead, judge_meshes
from simspec.imports.sdf.trees import (
    MASSLESS,
    SdfBodyRead,
    SdfModelRead,
    body_data,
    constraints,
    named_frames,
    read_model,
)
from simspec.imports.sdf.trees import RULES as RULES_OF_TREES
from simspec.imports.sdf.values import (
    IN_WORLD,
    OLD_OUTERMOST,
    OUTERMOST,
    SETTINGS,
    Placement,
    SdfNames,
    finite_of,
    set_aside,
    vector_of,
    version_of,
)
from simspec.imports.writing import add_timestep
from simspec.language.document import Path_
from simspec.language.foreign import Imported, ImportOptions
from simspec.language.moments import principal_moments

# Masses that no body can have, or that are missing, in what joints of SDF move: the rules of repair that give them.
#
# A link without `<inertial>` has 1 kg and a unit inertia in SDF, so that only masses of 0 or below are missing.

MASS_RULES: Final = {FROM_SHAPES: OF_SHAPES, NOT_POSITIVE: OF_SHAPES_OR_BALL}
"""Rules of repair, with what they do."""
OF_MASS: Final = ("mass", "centre_of_mass", "inertia")


def give_masses(models: Sequence[SdfModelRead], draft: Draft, density: float) -> None:
    """Give what moves its masses and moments by the rules that are requested, and report what no rule repairs. ``density``:
    kg/m³ of :data:`FROM_SHAPES`."""
    for model in models:
        for group in _moving(model):
            # a free root without mass is fixed by another rule
            dense = any("density" in shape.data for body in group for shape in body.content.shapes)
            weigh = dense or any(_mass(body) > 0.0 for body in group)
            has_none = group[0].joint is not None and not weigh
            for body in group:
                if _mass(body) < 0.0 or (has_none and (body is group[0] or solids_of(body.content.shapes))):
                    _give_mass(body, draft, density)
                elif (why := _wrong_moments(body, len(group) == 1)) is not None:
                    _give_moments(body, why, draft)


def _moving(model: SdfModelRead) -> Iterator[list[SdfBodyRead]]:
    """Bodies that move as one, free or below a joint that moves them, the first nearest to the root."""
    top: dict[int, SdfBodyRead] = {}
    groups: dict[int, list[SdfBodyRead]] = {}
    for body in model.bodies:
        rigid = body.joint is None or body.joint.kind == "fixed"
        head = top[id(body.parent)] if body.parent is not None and rigid else body
        top[id(body)] = head
        groups.setdefault(id(head), []).append(body)
    for group in groups.values():
        head = group[0]
        if not head.static and (head.joint is None or head.joint.kind != "fixed"):
            yield group


def _mass(body: SdfBodyRead) -> float:
    mass: float = body.content.mass.get("mass", 0.0)
    return mass


def _give_mass(body: SdfBodyRead, draft: Draft, density: float) -> None:
    element = body.content.inertial or body.element
    solids, before = solids_of(body.content.shapes), _mass(body)
    found = f"{before:g} kg" if before else None
    if not solids:
        return draft.defect(element, "a moving body has no mass, and no shapes that it could follow from", found=found)
    if not draft.repairing(FROM_SHAPES):
        return draft.defect(element, "a moving body has no mass", FROM_SHAPES, found)
    for word in OF_MASS:
        body.content.mass.pop(word, None)
    for shape in solids:
        shape.data["density"] = plain(density)
        shape.fill()
    body.content.given.append((FROM_SHAPES, given(body.name, before, solids, density), "shapes"))
    return None


def _wrong_moments(body: SdfBodyRead, alone: bool) -> tuple[float, ...] | None:
    """The principal moments of a body with a mass, where one is below 0, or 0 in a body that moves ``alone``."""
    said = body.content.mass.get("inertia")
    if said is None or _mass(body) <= 0.0:
        return None
    principal = [*said.get("principal", ()), 0.0, 0.0, 0.0]
    moments = principal_moments([said["tensor"].get(name, 0.0) for name in MOMENTS] if "tensor" in said else principal)
    return moments if min(moments) < 0.0 or (alone and min(moments) == 0.0) else None


def _give_moments(body: SdfBodyRead, moments: Sequence[float], draft: Draft) -> None:
    element = body.content.inertial or body.element
    if not draft.repairing(NOT_POSITIVE):
        message = "the principal moments of what moves must be above 0"
        return draft.defect(element, message, NOT_POSITIVE, f"{shown(moments)} kg m²")
    moment, what = ball(_mass(body))
    if solids := solids_of(body.content.shapes):
        body.content.mass.pop("centre_of_mass", None)
        del body.content.mass["inertia"]
        for shape in solids:
            shape.fill()
        count = sum(shape.is_open for shape in solids)
        what = even(_mass(body)) + (f" ({count} not closed: the hull is filled)" if count else "")
    else:
        body.content.mass["inertia"] = {"principal": [moment] * 3}
    body.content.given.append((NOT_POSITIVE, f"{body.name}: {what}", "mass"))
    return None


def silent(model: SdfModelRead) -> list[SdfBodyRead]:
    """Bodies of a model that do not touch each other: colliding ones without ``self_collide``. [] where the joints between them
    say as much."""
    bodies = [
        body
        for body in model.bodies
        if not body.self_collide and any(shape.surface is not None for shape in body.content.shapes)
    ]
    return bodies if excluded(bodies) else []


def excluded(bodies: list[SdfBodyRead]) -> list[list[str]]:
    """Every pair of bodies that do not touch, but those that a joint connects."""
    return [
        [first.name, second.name]
        for first, second in combinations(bodies, 2)
        if first.parent is not second and second.parent is not first
    ]


GRAVITY: Final = (0.0, 0.0, -9.8)
"""SDF's default; the language's is -9.81."""
ONLY_LINK: Final = "link"
"""The name of the only link of a model that stands for a link without a name."""
STEP: Final = 0.001
RULES: Final = {**MASS_RULES, **RULES_OF_TREES, **RULES_OF_MESHES, draft.RULE: draft.MEANING}
"""Rules of repair, with what they do."""
TOO_LARGE: Final = "a value that follows from these numbers is beyond the largest double"
MOST_PAIRS: Final = 20_000
"""Pairs of bodies of one model that do not touch each other."""


class SdfImporter:
    """The importer of SDF."""

    NAME: Final = "sdf"
    SUFFIXES = SUFFIXES

    def recognises(self, content: bytes) -> bool:
        """Whether the outermost element of a file is one of the language."""
        return outermost(content).decode(errors="replace") in (OUTERMOST, OLD_OUTERMOST)

    @staticmethod
    def rules() -> dict[str, str]:
        """The rules of repair."""
        return dict(RULES)

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """A file as a spec. Raises SpecError with the places of what it does not support."""
        files = Files(path, shown, options)
        reader = ModelReader(files)
        root = reader.root(path.resolve(), files.content(), shown)
        scopes, world = _outermost(reader, root, path)
        made = Draft(files, options, RULES, (draft.FROM_SHAPES,))
        graph, meshes = FrameGraph(), SdfMeshes(made)
        made.problems += options.repairs.problems(shown, RULES, (draft.FROM_SHAPES,))
        models: list[SdfModelRead] = []
        for scope in scopes:
            with made.collecting():
                models.append(read_model(graph, scope, meshes))
        judge_meshes((body.content.shapes for read in models for body in read.bodies), made)
        density, wrong = draft.density_of(options.repairs, shown)
        made.problems += wrong
        if not made.problems:
            give_masses(models, made, density)
        made.problems.demand_none()
        spec = SdfAssembly(path, graph, world, models, made)
        spec.fill()
        made.repairs.sort(key=lambda repair: not repair.path)  # those of meshes last
        imported = made.imported(spec.data, [account for root in reader.roots for account in root.accounts()])
        add_timestep(imported)
        return imported


def _outermost(reader: ModelReader, root: Element, path: Path) -> tuple[list[Scope], Scope | None]:
    """The models of a file, and its world where it has one. Raises SpecError where there is nothing to import."""
    around = SdfContext(version_of(root), path.resolve().parent, (path.resolve(),))
    worlds = root.look("world")
    if len(worlds) > 1:
        raise worlds[1].error(
            "a file of several worlds is not supported", hint="save each world in a file of its own", code="I104"
        )
    if worlds:
        for other in root.look("model", "include"):
            message = "a file with both a world and a model next to it is not supported"
            raise other.error(message, hint="put it into the world", code="I104")
        world = Scope(worlds[0].word("name") or "world", worlds[0].take(), around.version)
        reader.fill(world, around)
        if world.joints:
            element = next(iter(world.joints.values()))
            raise element.error(
                "joints between models of a world are not supported", hint="put them into one model", code="I104"
            )
        if not world.models:
            raise worlds[0].error("this world has no models", code="I113")
        return list(world.models.values()), world
    root.lose_children("light actor", "simspec has no lights and no actors", APPEARANCE)
    models = root.look("model")
    if not models and not root.look("include"):
        raise root.error("this file has no model and no world", code="I113")
    read = [reader.read(element, around) for element in (*models, *root.look("include"))]
    scopes = [scope for scope in read if scope is not None]
    if not scopes:
        raise root.error("this file has no model", code="I113")
    for scope in scopes:
        if scope.placed.relative_to:
            raise scope.element.error("a model that is alone is not relative to another frame", code="I101")
    return scopes, None


@dataclass
class SdfAssembly:
    """The spec that is made."""

    path: Path
    graph: FrameGraph
    world: Scope | None
    models: list[SdfModelRead]
    draft: Draft
    data: dict[str, Any] = field(default_factory=dict)
    materials: Materials = field(default_factory=Materials)
    groups: dict[str, Any] = field(default_factory=dict)
    exclude: list[list[str]] = field(default_factory=list)

    def fill(self) -> None:
        """Make the spec of the models."""
        for empty in [model for model in self.models if not model.bodies]:
            if self.world is None:
                raise empty.scope.element.error("this model has no link", code="I113")
            empty.scope.element.ignore(None, "a model without links")
            self.models.remove(empty)
        if not self.models:
            assert self.world is not None
            raise self.world.element.error("this world has no links", code="I113")
        self._name_shapes()
        model = self.models[0]
        alone = self.world is None and len(self.models) == 1 and len(model.roots) == 1
        name = model.scope.name if len(self.models) == 1 else self.path.name.partition(".")[0]
        if self.world is not None and self.world.name not in ("default", "world"):
            name = self.world.name
        self.data.update({"simspec": 1, "name": SdfNames().give(name)})
        if self.world is not None:
            self.data["physics"] = _physics(self.world)
        contact: dict[str, Any] = {}
        self.data["contact"] = contact
        for shape in (shape for read in self.models for body in read.bodies for shape in body.content.shapes):
            if shape.surface is not None:
                self.materials.name(shape.surface)
        if alone:
            self.data["model"] = {"bodies": self._bodies(model, ("model", "bodies"))}
            self._constrain(model, self.data["model"], ("model",))
            self._separate(model, "")
        else:
            self._scenario()
        said = {"materials": self.materials.data() if self.materials.names else {}, "groups": self.groups}
        contact.update({word: value for word, value in {**said, "exclude": self.exclude}.items() if value})
        if not contact:
            del self.data["contact"]
        wrong: list[Path_] = []
        self.data = tidy(self.data, (), wrong)
        if wrong:
            raise SpecError([Problem(TOO_LARGE, location=self._place_of(path), code="I105") for path in wrong])

    def _place_of(self, path: Path_) -> Location:
        """Where a value of the data comes from: its own place, or that of the nearest value around it."""
        around = (path[:length] for length in range(len(path), -1, -1))
        return next(
            (self.draft.places[part] for part in around if part in self.draft.places),
            self.models[0].scope.element.location,
        )

    def _name_shapes(self) -> None:
        """Shapes keep their names where no other of the file has the same: names of shapes are unique."""
        loose = [body for model in self.models if not _is_placed(model) for body in model.bodies]
        for bodies in [loose, *(model.bodies for model in self.models if _is_placed(model))]:
            _give_names([shape for body in bodies for shape in body.content.shapes])

    def _scenario(self) -> None:
        """Models of one tree under ``models``; single links, and models of several trees, under ``bodies``."""
        names = SdfNames()
        for model in self.models:
            roots = model.roots
            if _is_placed(model):
                name = names.give(model.scope.name, model.scope.element)
                bodies = self._bodies(model, ("models", name, "bodies"))
                self.data.setdefault("models", {})[name] = {"bodies": bodies}
                self.draft.places["models", name] = model.scope.element.location
                self._constrain(model, self.data["models"][name], ("models", name))
                self._separate(model, f"{name}/", group=name)
                continue
            loose = roots[0].name == model.scope.name or len(model.bodies) == 1
            renamed: dict[str, str] = {}
            for body in model.bodies:
                text = body.name if loose else f"{model.scope.name}_{body.name}"
                renamed[body.name] = names.give(text if len(model.bodies) > 1 else model.scope.name, body.element)
            for body in model.bodies:
                if body.joint_name and not loose:
                    body.joint_name = f"{model.scope.name}_{body.joint_name}"
                    body.second_name = f"{model.scope.name}_{body.second_name}"
                elif body.joint_name == f"{body.name}_joint":
                    body.joint_name = f"{renamed[body.name]}_joint"
                body.name = renamed[body.name]
            self.data.setdefault("bodies", {}).update(self._bodies(model, ("bodies",)))
            self._constrain(model, self.data, ())
            self._separate(model, "", group=names.give(model.scope.name))

    def _constrain(self, model: SdfModelRead, around: dict[str, Any], path: Path_) -> None:
        """The named frames of a model, and what holds its bodies together outside its trees."""
        if said := named_frames(model):
            taken = SdfNames([*around.get("frames", ()), *around.get("bodies", ())])
            given = {taken.give(name): frame for name, frame in said.items()}
            around.setdefault("frames", {}).update(given)
        said = constraints(model)
        if not said:
            return
        names = SdfNames(around.get("constraints", ()))
        actual = {names.give(name): constraint for name, constraint in said.items()}
        around.setdefault("constraints", {}).update(actual)
        for name in actual:
            self.draft.places[(*path, "constraints", name)] = model.scope.element.location

    def _bodies(self, model: SdfModelRead, path: tuple[str, ...]) -> dict[str, Any]:
        if self.world is not None:
            around = self.graph.pose(self.world, model.scope.name, model.scope.element)
        else:
            around = self._alone(model.scope)
        bodies: dict[str, Any] = {}
        for body in model.bodies:
            data = body_data(model, body, around)
            at = (*path, body.name)
            self._place(body, data, at)
            shapes = [self._shape(body, index, (*at, "shapes", index)) for index in range(len(body.content.shapes))]
            if shapes:
                data["shapes"] = shapes
            if body.content.comment:
                self.draft.comments[".".join((*at, "mass"))] = body.content.comment
            if body.content.repaired:
                element = body.content.inertial or body.element
                self.draft.repaired(draft.RULE, element, body.content.repaired, (*at, "inertia"))
            for rule, what, word in body.content.given:
                self.draft.repaired(rule, body.content.inertial or body.element, what, (*at, word))
            bodies[body.name] = data
        for note in (scope.note for scope in model.scope.within() if scope.note):
            self.draft.comments[".".join((*path, model.bodies[0].name))] = note
        for body, what in model.repairs:
            self.draft.repaired(MASSLESS, body.element, what, (*path, body.name, "fixed"))
        return bodies

    def _alone(self, scope: Scope) -> Placement:
        pose = scope.placed.placement
        if scope.placement_frame:
            pose = pose.then(self.graph.pose(scope, scope.placement_frame, scope.element).inverse())
        return pose

    def _place(self, body: SdfBodyRead, data: dict[str, Any], at: tuple[str, ...]) -> None:
        self.draft.places[at] = body.element.location
        if body.joint is not None:
            self.draft.places[(*at, "joint")] = body.joint.element.location
        if body.content.inertial is not None:
            for key in ("mass", "centre_of_mass", "inertia"):
                if key in data:
                    self.draft.places[(*at, key)] = body.content.inertial.location

    def _shape(self, body: SdfBodyRead, index: int, path: Path_) -> dict[str, Any]:
        shape = body.content.shapes[index]
        self.draft.places[path] = shape.element.location
        named = {} if shape.name in ("", f"{body.name}_{index}") else {"name": shape.name}
        data = {**named, **shape.data}
        if shape.surface is not None and len(self.materials.names) > 1:
            data["material"] = self.materials.name(shape.surface)
        return data

    def _separate(self, model: SdfModelRead, prefix: str, group: str | None = None) -> None:
        """Bodies of a model that do not touch each other: pairs in a model file, which may be placed twice, else a group."""
        bodies = silent(model)
        if not bodies:
            return
        if group is None:
            self.exclude.extend(excluded(bodies))
            return
        self.groups[group] = {"ignores": [group]}
        tables = self.data["models"][prefix[:-1]]["bodies"] if prefix else self.data["bodies"]
        for body in bodies:
            table = tables[body.name]
            shapes = table.pop("shapes")
            table.update({"collision_group": group, "shapes": shapes})


def _is_placed(model: SdfModelRead) -> bool:
    """Whether a model is one of the scenario's models: one tree, of more than one body without a name of its own. The bodies of
    others are loose."""
    names = [body.name for body in model.bodies]
    return len(model.roots) == 1 and names[0] != model.scope.name and names != [ONLY_LINK]


def _give_names(shapes: list[SdfShapeRead]) -> None:
    often = Counter(shape.name for shape in shapes)
    names = SdfNames()
    for shape in shapes:
        if shape.name and often[shape.name] == 1:
            shape.name = names.give(shape.name, shape.element)
        else:
            reason = "names of shapes are unique in a spec"
            shape.element.lose("name", reason, INFORMATION)
            shape.name = ""


def _physics(world: Scope) -> dict[str, Any]:
    element = world.element
    set_aside(element, IN_WORLD)
    gravity, step = GRAVITY, STEP
    profiles = element.look("physics")
    chosen = next((profile for profile in profiles if profile.attributes.get("default", "") in ("1", "true")), None)
    chosen = chosen or (profiles[0] if profiles else None)
    for profile in profiles:
        if profile is not chosen:
            profile.ignore(None, "another of the file's settings of physics is in force")
            continue
        profile.take()
        for name in ("name", "type", "default"):
            profile.word(name)
        gravity = vector_of(profile, "gravity", gravity)
        step = finite_of(profile, "max_step_size", step)
        for child in profile.look():
            if child.tag not in ("gravity", "max_step_size"):
                child.set_aside(None, SETTINGS[0], SETTINGS[2], SETTINGS[1])
    gravity = vector_of(element, "gravity", gravity)
    return {"gravity": list(gravity), "timestep": step}
