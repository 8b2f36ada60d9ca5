"""Models of SDF as scopes of names: links, joints, frames and models within them, with includes read."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Final, Protocol

from simspec.imports.elements import MOST_BODIES, SPLIT, Element, parse
from simspec.imports.files import Files
from simspec.imports.sdf.aside import NO_ACTOR
from simspec.imports.sdf.library import GROUND_NOTE, KNOWN, MODELS, SUN_NOTE, called, find_model
from simspec.imports.sdf.values import Placed, flag, flag_of, lost, pose_of, text_of, unused
from simspec.imports.sdf.versions import FLAT_BEFORE, UNIQUE_SINCE, Version, check_outermost, modernise, version_of
from simspec.language.foreign import Fate, Severity
from simspec.language.sources import shown_path

MOST_INCLUDES: Final = 1_000
"""Includes of one file, those of included files counted: each is a copy of a model."""
DEEPEST: Final = 20
"""Models within each other."""
SEPARATOR: Final = "::"
PARAMETERS: Final = "experimental:params"
"""Changes of an included model, an experiment of one reader."""


@dataclass(eq=False)
class Scope:
    """A model, or a world: what the names in it mean."""

    name: str
    element: Element
    version: Version
    parent: Scope | None = None
    placed: Placed = field(default_factory=Placed)
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
    """What is to be said of it in the spec."""
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
        own = [*self.links, *self.joints, *self.frames]
        own += [name for name, model in self.models.items() if not model.merged]
        return own + [name for model in self.models.values() if model.merged for name in model.names()]

    @property
    def is_world(self) -> bool:
        """Whether this is a world."""
        return self.element.tag == "world"

    def within(self) -> list[Scope]:
        """This model, and all models in it, in the order of the file."""
        return [self, *(inner for model in self.models.values() for inner in model.within())]


@dataclass
class Reader:
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
            check_outermost(element)
            modernise(element)
        return self._read[path]

    def model(
        self, element: Element, version: Version, folder: Path, parent: Scope | None, chain: tuple[Path, ...]
    ) -> Scope:
        """A ``<model>`` with what is in it. Raises SpecError."""
        scope = Scope(_named(element, version), element, version, parent, pose_of(element))
        scope.folder = folder
        scope.placement_frame = element.word("placement_frame") or ""
        scope.canonical = element.word("canonical_link") or ""
        scope.static = flag_of(element, "static", False) or (parent is not None and parent.static)
        scope.self_collide = flag_of(element, "self_collide", False)
        self.fill(scope, folder, chain)
        return scope

    def fill(self, scope: Scope, folder: Path, chain: tuple[Path, ...]) -> None:
        """Read the links, joints, frames and models of a scope."""
        depth, around = 0, scope.parent
        while around is not None:
            depth, around = depth + 1, around.parent
        if depth > DEEPEST:
            raise scope.element.error(f"more than {DEEPEST} models within each other")
        tables = {"link": scope.links, "joint": scope.joints, "frame": scope.frames}
        taken: set[str] = set()
        often: dict[str, int] = {}
        strict = scope.version >= UNIQUE_SINCE
        for child in scope.element.look("link", "joint", "frame", "model", "include"):
            if not strict and child.tag == "link" and child.attributes.get("name") == "world" and not child.look():
                unused(child, "an empty link of this name is the world itself")
                continue
            if child.tag in tables:
                name = _named(child, scope.version)
                if child.tag == "joint" and not strict and name in taken:
                    name = _another(child, name, taken, often)
                tables[child.tag][name] = child.take()
                self._links += child.tag in ("link", "frame")
            else:
                read: _Read = self.include if child.tag == "include" else self.model
                inner = read(child.take(), scope.version, folder, scope, chain)
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
                raise child.error(f"{name!r} is the name of two things in one model")
            taken.add(name)
            if self._links > MOST_BODIES:
                raise child.error(f"more than {MOST_BODIES:,} links and frames", hint=SPLIT)

    def _merge(self, element: Element, scope: Scope, inner: Scope, taken: set[str]) -> None:
        """Make the names of an included model names of the scope around it. Raises SpecError for those that are taken."""
        names = inner.names()
        for name in names:
            if name in taken:
                raise element.error(f"{name!r} is the name of two things in one model")
        taken.update(names)
        inner.name = next(name for number in count() if (name := f"__merged_{number}__") not in taken)
        taken.add(inner.name)
        inner.static, inner.self_collide = scope.static, scope.self_collide
        scope.models[inner.name] = inner

    def include(
        self, element: Element, version: Version, folder: Path, parent: Scope | None, chain: tuple[Path, ...]
    ) -> Scope | None:
        """The model of an ``<include>``, with what the include says of it; None for one without bodies. Raises SpecError."""
        self._includes += 1
        if self._includes > MOST_INCLUDES:
            raise element.error(f"more than {MOST_INCLUDES:,} includes")
        merges = flag(element, element.word("merge") or "false")
        if merges and (parent is None or parent.is_world):
            hint = "include the model as it is"
            raise element.error("an include that merges a model into a world is not supported", hint=hint)
        uri = element.child("uri")
        if uri is None or not uri.text:
            raise element.error("<include> has no <uri>")
        path = find_model(self.files, uri, folder)
        known = path is None
        if path is None:
            root = self._known(element, called(uri.text))
            path = Path(f"{MODELS}{called(uri.text)}")
        else:
            if path in chain:
                raise uri.error("files that include each other", found=uri.text[:200])
            if len(chain) > DEEPEST:
                raise uri.error(f"more than {DEEPEST} files include one another in a chain", found=uri.text[:200])
            root = self.root(path, self.files.bytes_of(path, uri), shown_path(path))
        if root is None or _without_bodies(element, root):
            return None
        models = root.look("model", "include")
        if len(models) != 1 or root.look("world"):
            raise uri.error(f"{path.name} is not a file of one model", found=uri.text[:200])
        read: _Read = self.include if models[0].tag == "include" else self.model
        scope = read(models[0].take(), version_of(root), path.parent, parent, (*chain, path))
        if scope is None:
            return None
        scope.note = GROUND_NOTE if known else ""
        scope.name, scope.merged = text_of(element, "name", scope.name), merges
        placed = pose_of(element)
        if placed.element is not None:
            if scope.placed.element is not None:
                scope.placed.element.set_aside(None, Fate.UNUSED, "an include says another pose", Severity.INFORMATION)
            scope.placed = placed
        scope.placement_frame = text_of(element, "placement_frame", scope.placement_frame)
        if element.look("static"):
            static = flag_of(element, "static", False)
            for inner in scope.within():
                inner.static = static
        for child in element.look("plugin"):
            lost(child, "a plugin is a program of another simulator, which may do anything")
        for child in element.look(PARAMETERS):
            lost(
                child, "changes of the included model by parameters are not applied", hint="change a copy of the model"
            )
        return scope

    def _known(self, element: Element, name: str) -> Element | None:
        """A model that is known without files; None for one of a light alone."""
        if name not in KNOWN:
            lost(element, SUN_NOTE, Severity.APPEARANCE)
            return None
        element.set_aside(None, Fate.CARRIED, GROUND_NOTE, Severity.INFORMATION)
        shown = f"{MODELS}{name}"
        return self.root(Path(shown), KNOWN[name].encode(), shown)


class _Read(Protocol):
    def __call__(
        self, element: Element, version: Version, folder: Path, parent: Scope | None, chain: tuple[Path, ...], /
    ) -> Scope | None: ...


def _without_bodies(element: Element, root: Element) -> bool:
    """Whether a file that is included has no model but lights or actors alone, of which it is then said that they are lost."""
    if root.look("model", "world") or not root.look("light", "actor"):
        return False
    moving = root.look("actor")
    reason, severity = (NO_ACTOR, Severity.PHYSICS) if moving else (SUN_NOTE, Severity.APPEARANCE)
    lost(element, reason, severity)
    for child in root.look():
        lost(child, reason, severity)
    return True


def _named(element: Element, version: Version) -> str:
    """The name of an element. A link could be called ``world`` before names were unique; its model's joints then mean it. What
    was written flat has the names of the models that it was in before its own."""
    name = element.need("name")
    strict = version >= UNIQUE_SINCE
    reserved = ("__model__", "__root__") if not strict and element.tag == "link" else ("__model__", "__root__", "world")
    if not name or name in reserved or (SEPARATOR in name and version >= FLAT_BEFORE):
        raise element.error(f"not a name of a <{element.tag}>", found=name[:80])
    return name


def _another(element: Element, name: str, taken: set[str], often: dict[str, int]) -> str:
    """A name for the second of two things of one name, in files where that was allowed; ``often``: the last number of each."""
    count = often.get(name, 1) + 1
    while f"{name}_{count}" in taken:
        count += 1
    often[name] = count
    reason = f"called {name}_{count}: another thing around it has the name"
    element.set_aside("name", Fate.CARRIED, reason, Severity.INFORMATION)
    return f"{name}_{count}"
