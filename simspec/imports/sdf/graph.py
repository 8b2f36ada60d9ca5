"""Where the frames of SDF are: poses by the names that they are relative to, and links that frames are attached to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from simspec.imports.elements import Element
from simspec.imports.sdf.models import SEPARATOR, Scope
from simspec.imports.sdf.values import Placed, Placement, pose_of, text_of

MODEL: Final = "__model__"
WORLD: Final = "world"

Link = tuple[Scope, str]
MOST_PARTS: Final = 100
"""Names of models that one name has before its own."""


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
class Graph:
    """Answers where things are. All poses are of the file's own configuration, in which every joint is at zero."""

    _poses: dict[tuple[int, str], Placement] = field(default_factory=dict)
    _placed: dict[tuple[int, str], Placed] = field(default_factory=dict)
    _open: list[tuple[int, str]] = field(default_factory=list)
    _attached: dict[tuple[int, str], Link | None] = field(default_factory=dict)

    # --- names ------------------------------------------------------------------------------------------------

    def home(self, scope: Scope, name: str, asking: Element) -> tuple[Scope, str]:
        """The scope and the own name of what ``name`` means in ``scope``. Raises SpecError at the element that asks."""
        last = name
        while True:
            part, last = split(scope, last)
            if not part:
                break
            around = scope.owner(part)
            if around is None or part not in around.models:
                raise asking.error(f"no model is called {part[:80]!r} here", found=name[:200])
            scope = around.models[part]
        owner = scope.owner(last)
        if owner is None and last not in (MODEL, WORLD):
            known = ", ".join(sorted(scope.names())[:20])
            raise asking.error(f"nothing is called {last[:80]!r} here", found=name[:200], allowed=known or None)
        return owner or scope, last

    def link(self, scope: Scope, name: str, asking: Element) -> Link | None:
        """The link that a frame is fixed to; None: the world. Raises SpecError at the element that asks."""
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
            raise asking.error("frames that are attached to each other", found=name[:80])
        if key not in self._attached:
            self._open.append(key)
            self._attached[key] = self._link(scope, name, asking)
            self._open.pop()
        for one in walked:  # each frame of a chain asks
            self._attached[one] = self._attached[key]
        return self._attached[key]

    def _link(self, scope: Scope, name: str, asking: Element) -> Link | None:
        if name in scope.links:
            return scope, name
        if name == WORLD or (name == MODEL and scope.is_world):
            return None
        if name in scope.joints:
            return self.link(scope, text_of(scope.joints[name], "child", ""), scope.joints[name])
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
        raise asking.error(f"the model {scope.name[:80]!r} has no link")

    # --- poses ------------------------------------------------------------------------------------------------

    def pose(self, scope: Scope, name: str, asking: Element) -> Placement:
        """The pose of a frame in that of the scope itself. Raises SpecError at the element that asks."""
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
            raise asking.error("nothing in a model is relative to the world", found=name)
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
                raise asking.error("poses that are relative to each other", found=name[:80])
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

    def placed(self, scope: Scope, name: str) -> tuple[Placed, Element]:
        """The ``<pose>`` of a link, joint, frame or model, against the frame that it is relative to by default where the file
        does not say it."""
        if name in scope.models:
            return scope.models[name].placed, scope.models[name].element
        table, default = scope.links, MODEL
        if name in scope.joints:
            table, default = scope.joints, text_of(scope.joints[name], "child", "")
        elif name in scope.frames:
            table, default = scope.frames, scope.frames[name].word("attached_to") or MODEL
        key = (id(scope), name)
        if key not in self._placed:
            own = pose_of(table[name])
            self._placed[key] = Placed(own.placement, own.relative_to or default, own.element)
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
