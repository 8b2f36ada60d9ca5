"""Models of SDF as scopes of names, with the files of models and meshes that they name."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from simspec.errors import Location, Problem, SpecError
from simspec.imports.draft import BEGINNING, Draft, NamedMesh, find_mesh, made_file
from simspec.imports.elements import (
    APPEARANCE,
    CARRIED,
    INFORMATION,
    MOST_BODIES,
    PHYSICS,
    SPLIT,
    Element,
    parse,
    plugin_loss,
)
from simspec.imports.files import CONFIGURATIONS, LIBRARY, PACKAGE, SCHEME, Files, MissingFileError
from simspec.imports.sdf import values
from simspec.imports.sdf.values import SdfPose, Version
from simspec.language.foreign import suffixes
from simspec.language.shapes import MESH_SUFFIXES as MESHES
from simspec.language.shapes import PIECES
from simspec.world.types import Vector3

ENDS: Final = (".sdf", ".world", ".xml")
"""Ends of names of files, where others are folders of models."""
MODELS: Final = "model://"
SUN: Final = "sun"
GROUND: Final = "ground_plane"
WITHOUT_FILES: Final = (SUN, GROUND)
"""Models of the public database that nearly every world includes, and that are known without it."""
GROUND_FRICTION: Final = 100.0
"""Of the database's model `ground_plane` (osrf/gazebo_models, `ground_plane/model.sdf`: `mu` 100 and `mu2` 50)."""
GROUND_TEXT: Final = f"""<sdf version="1.5"><model name="{GROUND}"><static>true</static><link name="link">
<collision name="collision"><geometry><plane><normal>0 0 1</normal></plane></geometry>
<surface><friction><ode><mu>{GROUND_FRICTION:g}</mu><mu2>{GROUND_FRICTION:g}</mu2></ode></friction></surface></collision>
<visual name="visual"><geometry><plane><normal>0 0 1</normal></plane></geometry></visual>
</link></model></sdf>"""
GROUND_NOTE: Final = (
    f"{MODELS}{GROUND} is not among the files: a fixed plane without an end, of friction {GROUND_FRICTION:g}, as the "
    "database has it in one direction; the 50 of the other exceed what nearly every surface has, and the smaller of two counts"
)
SUN_NOTE: Final = "simspec has no lights, and this model is one"
KNOWN: Final[Mapping[str, str]] = {GROUND: GROUND_TEXT}


def find_model(files: Files, uri: Element, folder: Path) -> Path | None:
    """The file of a URI: a file, or the folder of a model whose configuration names it; None for a model that is known without
    files and is not there. A path without a scheme starts from ``folder``, else is one in a package. Raises SpecError."""
    text = uri.text
    if text.lower().endswith(suffixes()) and not text.lower().endswith(ENDS):
        hint = f"use: {text} in a scenario, which places the robot"
        raise uri.error("only models in SDF can be included", found=text[:200], hint=hint, code="I106")
    bare = text.removeprefix("./")
    by_path = SCHEME.fullmatch(text) is not None or text.startswith("/")
    is_file = "/" not in bare and text.lower().endswith(ENDS)
    wordings = [text] if by_path or is_file else [text, f"{MODELS}{bare}"]
    missing: list[SpecError] = []
    for wording in wordings:
        try:
            return _file(files, wording, uri, folder)
        except MissingFileError as error:
            missing.append(error)
    if called(text) in WITHOUT_FILES:
        return None
    raise missing[0 if "/" in bare else -1]


def called(text: str) -> str:
    """The name of the model that a URI means, in small letters."""
    match = LIBRARY.fullmatch(text)
    name = match[1] if match is not None else text.removeprefix(MODELS).strip("/")
    return re.sub(r"\s+", "_", unquote(name)).lower()


def _file(files: Files, text: str, uri: Element, folder: Path) -> Path:
    if text.lower().endswith(ENDS):
        return files.find(text, uri, folder)
    place = text.rstrip("/")
    try:
        configuration = files.find(f"{place}/{CONFIGURATIONS[0]}", uri, folder)
    except MissingFileError:
        if PACKAGE.fullmatch(place) is None and SCHEME.fullmatch(place) is not None:
            raise
        configuration = _older(files, place, uri, folder)
    shown = files.options.shown(configuration)
    choices: list[tuple[Version, str]] = []
    for child in parse(files.bytes_of(configuration, uri), shown).look("sdf"):
        version = values.parsed(child.attributes.get("version", "1.4"))
        if version is not None and values.OLDEST <= version <= values.NEWEST and child.text:
            choices.append((version, child.text))
    if not choices:
        raise SpecError([Problem("names no SDF file that simspec reads", location=Location(shown, 1, 1), code="I106")])
    return files.find(f"{place}/{max(choices)[1]}", uri, folder)


def _older(files: Files, place: str, uri: Element, folder: Path) -> Path:
    """The configuration of a model under the name that it had before. Raises the error of the name that it has."""
    try:
        return files.find(f"{place}/{CONFIGURATIONS[1]}", uri, folder)
    except MissingFileError as error:
        problem = error.problems[0]
    hint = (problem.hint or "").replace(CONFIGURATIONS[1], CONFIGURATIONS[0])
    raise MissingFileError([uri.problem(problem.message, problem.found, hint=hint, code="I106")])


MISSING: Final = "missing-meshes"
RULES: Final[Mapping[str, str]] = {MISSING: "collision meshes that are not there, or cannot be read, are left out"}
NO_PART: Final = "a part of a file is not supported: all that is in it is one mesh"
DECOMPOSED: Final = "convex_decomposition"
OPTIMIZATIONS: Final = ("", "convex_hull", DECOMPOSED)


@dataclass
class SdfMeshes:
    """The meshes of one import."""

    draft: Draft

    def write(self, corners: Sequence[Vector3], faces: Sequence[Sequence[int]], called: str) -> NamedMesh:
        """The mesh of a solid that the file says by its corners (m) and faces, which are counted from 0. Raises SpecError."""
        lines = [BEGINNING.decode(), *(f"v {x!r} {y!r} {z!r}" for x, y, z in corners)]
        lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
        text, path = made_file(("\n".join(lines) + "\n").encode(), called)
        self.draft.meshes[text] = path
        self.draft.made.add(text)
        return NamedMesh(text, path)

    def read(self, shape: Element, kind: Element, folder: Path) -> tuple[dict[str, Any], NamedMesh] | None:
        """The word of a mesh; None for one that is left out, which is said. ``folder``: of the file that names it. Raises
        SpecError."""
        uri = kind.child("uri")
        if uri is None or not uri.text:
            raise kind.error("<mesh> has no <uri>", code="I106")
        scale = values.vector_of(kind, "scale", (1.0, 1.0, 1.0))
        as_pieces = self._pieces(shape, kind)
        try:
            for part in kind.look("submesh"):
                raise part.error(NO_PART, hint="save the part as a file of its own", code="I104")
            mesh = self._find(uri, scale, folder)
        except SpecError as error:
            known = isinstance(error, MissingFileError) or shape.tag == "visual"
            if not known and uri.text.lower().endswith(MESHES):
                raise
            self.draft.leave_out(shape, MISSING, error.problems[0])
            return None
        mesh = self._called(mesh)
        return {"mesh": {**mesh.data(), "as": PIECES} if as_pieces else mesh.data()}, mesh

    def _find(self, uri: Element, scale: Vector3, folder: Path) -> NamedMesh:
        """The mesh of a URI. A path from the root of all files that leads nowhere is one from the file's folder, as readers
        have it. Raises SpecError."""
        try:
            return find_mesh(uri.text, scale, uri, self.draft.files, folder)
        except SpecError:
            relative = uri.text.lstrip("/")
            if relative == uri.text or not (folder / relative).is_file():
                raise
        mesh = find_mesh(relative, scale, uri, self.draft.files, folder)
        uri.set_aside(None, CARRIED, "relative to the file: there is no such path from the root", INFORMATION)
        return mesh

    def _pieces(self, shape: Element, kind: Element) -> bool:
        how = kind.word("optimization", "") or ""
        if how not in OPTIMIZATIONS:
            raise kind.error(
                "not a way to simplify a mesh", found=how[:80], allowed=", ".join(OPTIMIZATIONS[1:]), code="I101"
            )
        reason = "how many pieces there are, and how they are found, is not in the language"
        kind.lose_children(DECOMPOSED, reason, INFORMATION)
        return how == DECOMPOSED and shape.tag == "collision"

    def _called(self, mesh: NamedMesh) -> NamedMesh:
        """The mesh as the spec calls its file: by the file's text, unless another file of this import has that."""
        if self.draft.meshes.get(mesh.text, mesh.path) != mesh.path:
            here = self.draft.files.path.resolve().parent
            mesh = replace(mesh, text=Path(os.path.relpath(mesh.path, here)).as_posix())
        self.draft.meshes[mesh.text] = mesh.path
        return mesh


MOST_INCLUDES: Final = 1_000
"""Includes of one file, those of included files counted: each is a copy of a model."""
DEEPEST: Final = 20
"""Models within each other."""
SEPARATOR: Final = "::"
PARAMETERS: Final = "experimental:params"
"""Changes of an included model, an experiment of one reader."""


@dataclass(eq=False)
class Scope:
    """A model, or a world: the meaning of the names in it."""

    name: str
    element: Element
    version: Version
    parent: Scope | None = None
    placed: SdfPose = field(default_factory=SdfPose)
    """Its pose, against the frame around it."""
    placement_frame: str = ""
    canonical: str = ""
    folder: Path = Path()
    """Of its file."""
    static: bool = False
    self_collide: bool = False
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)
    frames: dict[str, Element] = field(default_factory=dict)
    models: dict[str, Scope] = field(default_factory=dict)
    note: str = ""
    """A comment on it in the spec."""
    merged: bool = False
    """Whether the names in it are names of the scope around it too."""

    def owner(self, name: str) -> Scope | None:
        """The scope that a name here is in: this one, or one that is merged into it; None for an unknown name."""
        if any(name in table for table in (self.links, self.joints, self.frames, self.models)):
            return self
        inner = (model.owner(name) for model in self.models.values() if model.merged)
        return next((scope for scope in inner if scope is not None), None)

    def names(self) -> list[str]:
        """All names in it, those of merged models among them."""
        found = [*self.links, *self.joints, *self.frames]
        found += [name for name, model in self.models.items() if not model.merged]
        return found + [name for model in self.models.values() if model.merged for name in model.names()]

    @property
    def is_world(self) -> bool:
        """Whether this is a world."""
        return self.element.tag == "world"

    def within(self) -> list[Scope]:
        """This model, and all models in it, in the order of the file."""
        return [self, *(inner for model in self.models.values() for inner in model.within())]


@dataclass(frozen=True)
class SdfContext:
    """Where a model is read: the version and the folder of its file, the files that include each other up to it, and the scope
    that the model is in."""

    version: Version
    folder: Path
    chain: tuple[Path, ...]
    parent: Scope | None = None


@dataclass
class ModelReader:
    """Reads the models of a file, and of those that it includes."""

    files: Files
    roots: list[Element] = field(default_factory=list)
    """The outermost elements of all files that were read, each once."""
    _read: dict[Path, Element] = field(default_factory=dict)
    _includes: int = 0
    _links: int = 0

    def root(self, path: Path, content: bytes, shown: str) -> Element:
        """The outermost element of a file. Raises SpecError where it is no SDF."""
        if path not in self._read:
            element = parse(content, shown)
            self._read[path] = element
            self.roots.append(element)
            values.check_outermost(element)
            values.modernise(element)
        return self._read[path]

    def model(self, element: Element, around: SdfContext) -> Scope:
        """A ``<model>`` with what is in it. Raises SpecError."""
        version, parent = around.version, around.parent
        scope = Scope(_named(element, version), element, version, parent, values.pose_of(element))
        scope.folder = around.folder
        scope.placement_frame = element.word("placement_frame") or ""
        scope.canonical = element.word("canonical_link") or ""
        scope.static = values.flag_of(element, "static", False) or (parent is not None and parent.static)
        scope.self_collide = values.flag_of(element, "self_collide", False)
        self.fill(scope, around)
        return scope

    def fill(self, scope: Scope, around: SdfContext) -> None:
        """Read the links, joints, frames and models of a scope."""
        depth, outer = 0, scope.parent
        while outer is not None:
            depth, outer = depth + 1, outer.parent
        if depth > DEEPEST:
            raise scope.element.error(f"more than {DEEPEST} models within each other", code="I105")
        tables = {"link": scope.links, "joint": scope.joints, "frame": scope.frames}
        taken: set[str] = set()
        often: dict[str, int] = {}
        strict = scope.version >= values.UNIQUE_SINCE
        for child in scope.element.look("link", "joint", "frame", "model", "include"):
            if not strict and child.tag == "link" and child.attributes.get("name") == "world" and not child.look():
                child.ignore(None, "an empty link of this name is the world itself")
                continue
            if child.tag in tables:
                name = _named(child, scope.version)
                if child.tag == "joint" and not strict and name in taken:
                    name = _another(child, name, taken, often)
                tables[child.tag][name] = child.take()
                self._links += child.tag in ("link", "frame")
            else:
                inner = self.read(child, replace(around, parent=scope))
                if inner is None:
                    continue
                if inner.merged:
                    self._merge(child, scope, inner, taken)
                    continue
                if not strict and inner.name in taken:
                    inner.name = _another(child, inner.name, taken, often)
                name = inner.name
                scope.models[name] = inner
            if name in taken:
                raise child.error(f"{name!r} is the name of two things in one model", code="I101")
            taken.add(name)
            if self._links > MOST_BODIES:
                raise child.error(f"more than {MOST_BODIES:,} links and frames", hint=SPLIT, code="I105")

    def _merge(self, element: Element, scope: Scope, inner: Scope, taken: set[str]) -> None:
        names = inner.names()
        for name in names:
            if name in taken:
                raise element.error(f"{name!r} is the name of two things in one model", code="I101")
        taken.update(names)
        inner.name = next(name for number in count() if (name := f"__merged_{number}__") not in taken)
        taken.add(inner.name)
        inner.static, inner.self_collide = scope.static, scope.self_collide
        scope.models[inner.name] = inner

    def read(self, element: Element, around: SdfContext) -> Scope | None:
        """The model of a ``<model>`` or an ``<include>``, taken."""
        return (self.include if element.tag == "include" else self.model)(element.take(), around)

    def include(self, element: Element, around: SdfContext) -> Scope | None:
        """The model of an ``<include>``, with what the include says of it; None for one without bodies. Raises SpecError."""
        self._includes += 1
        if self._includes > MOST_INCLUDES:
            raise element.error(f"more than {MOST_INCLUDES:,} includes", code="I105")
        merges = values.flag(element, element.word("merge") or "false")
        if merges and (around.parent is None or around.parent.is_world):
            hint = "include the model as it is"
            raise element.error("an include that merges a model into a world is not supported", hint=hint, code="I104")
        uri = element.child("uri")
        if uri is None or not uri.text:
            raise element.error("<include> has no <uri>", code="I101")
        path = find_model(self.files, uri, around.folder)
        known = path is None
        if path is None:
            root = self._known(element, called(uri.text))
            path = Path(f"{MODELS}{called(uri.text)}")
        else:
            if path in around.chain:
                raise uri.error("files that include each other", found=uri.text[:200], code="I101")
            if len(around.chain) > DEEPEST:
                raise uri.error(
                    f"more than {DEEPEST} files include one another in a chain", found=uri.text[:200], code="I105"
                )
            root = self.root(path, self.files.bytes_of(path, uri), self.files.options.shown(path))
        if root is None or _without_bodies(element, root):
            return None
        models = root.look("model", "include")
        if len(models) != 1 or root.look("world"):
            raise uri.error(f"{path.name} is not a file of one model", found=uri.text[:200], code="I101")
        context = SdfContext(values.version_of(root), path.parent, (*around.chain, path), around.parent)
        scope = self.read(models[0], context)
        if scope is None:
            return None
        scope.note = GROUND_NOTE if known else ""
        scope.name, scope.merged = values.text_of(element, "name", scope.name), merges
        placed = values.pose_of(element)
        if placed.element is not None:
            if scope.placed.element is not None:
                scope.placed.element.ignore(None, "an include says another pose")
            scope.placed = placed
        scope.placement_frame = values.text_of(element, "placement_frame", scope.placement_frame)
        if element.look("static"):
            static = values.flag_of(element, "static", False)
            for inner in scope.within():
                inner.static = static
        for child in element.look("plugin"):
            severity, reason = plugin_loss(child)
            child.lose(None, reason, severity)
        reason = "changes of the included model by parameters are not applied"
        element.lose_children(PARAMETERS, reason, hint="change a copy of the model")
        return scope

    def _known(self, element: Element, name: str) -> Element | None:
        """A model that is known without files; None for one of a light alone."""
        if name not in KNOWN:
            element.lose(None, SUN_NOTE, APPEARANCE)
            return None
        element.set_aside(None, CARRIED, GROUND_NOTE, INFORMATION)
        shown = f"{MODELS}{name}"
        return self.root(Path(shown), KNOWN[name].encode(), shown)


def _without_bodies(element: Element, root: Element) -> bool:
    """Whether a file that is included has no model but lights or actors alone, of which it is then said that they are lost."""
    if root.look("model", "world") or not root.look("light", "actor"):
        return False
    moving = root.look("actor")
    reason, severity = (values.NO_ACTOR, PHYSICS) if moving else (SUN_NOTE, APPEARANCE)
    element.lose(None, reason, severity)
    for child in root.look():
        child.lose(None, reason, severity)
    return True


def _named(element: Element, version: Version) -> str:
    """The name of an element. A link could be called ``world`` before names were unique; its model's joints then mean it. A
    name was written flat has the names of the models that it was in before its own."""
    name = element.need("name")
    strict = version >= values.UNIQUE_SINCE
    reserved = ("__model__", "__root__") if not strict and element.tag == "link" else ("__model__", "__root__", "world")
    if not name or name in reserved or (SEPARATOR in name and version >= values.FLAT_BEFORE):
        raise element.error(f"not a name of a <{element.tag}>", found=name[:80], code="I101")
    return name


def _another(element: Element, name: str, taken: set[str], often: dict[str, int]) -> str:
    """A name for the second of two things of one name, in files where that was allowed; ``often``: the last number of each."""
    count = often.get(name, 1) + 1
    while f"{name}_{count}" in taken:
        count += 1
    often[name] = count
    reason = f"called {name}_{count}: another thing around it has the name"
    element.set_aside("name", CARRIED, reason, INFORMATION)
    return f"{name}_{count}"
