"""Visual and collision elements of a link as shapes of a body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from simspec.imports.draft import Draft, names, numbers, plain, pose, renamed
from simspec.imports.elements import Element
from simspec.imports.urdf.table import APPEARANCE, LOST

GEOMETRIES: Final = ("box", "sphere", "cylinder", "mesh")


@dataclass
class Shape:
    """A shape of a body: ``data`` without the words that say whether it is seen or collides."""

    element: Element
    collision: bool
    data: dict[str, Any]
    colour: list[float] | None = None
    visual: bool = False
    name: str = ""
    named: Element | None = None
    """The element that says the name, where it is another."""

    def written(self) -> dict[str, Any]:
        """The shape as the spec says it."""
        data = {"name": self.name, **self.data} if self.name else dict(self.data)
        if not self.collision:
            data["collision"] = False
        if not self.visual:
            data["visual"] = False
        if self.colour is not None:
            data["colour"] = self.colour
        return data

    def merge(self, seen: Shape) -> bool:
        """Take a visual shape into this one, where both are the same solid in the same place; whether that was so."""
        if self.visual or not self.collision or self.data != seen.data or (self.name and seen.name):
            return False
        self.visual, self.colour = True, seen.colour
        if seen.name:
            self.name, self.named = seen.name, seen.element
        return True


def colours(root: Element) -> dict[str, list[float] | None]:
    """The materials of the file by name, each with its colour; the first of a name counts."""
    known: dict[str, list[float] | None] = {}
    for material in root.children("material"):
        name = material.word("name") or ""
        colour = _colour(material)
        known.setdefault(name, colour)
    return known


def _colour(material: Element) -> list[float] | None:
    """The colour that a material says itself; None where it says none that can be shown."""
    element = material.child("color")
    if element is None or not element.has("rgba"):
        return None
    try:
        rgba = [float(part) for part in element.attributes["rgba"].split()]
    except ValueError:
        rgba = []
    if len(rgba) not in (3, 4) or not all(0.0 <= value <= 1.0 for value in rgba):
        element.set_aside("rgba", LOST, "a colour is 3 or 4 numbers between 0 and 1", APPEARANCE)
        return None
    element.word("rgba")
    return numbers(rgba)


def read_shapes(link: Element, known: Mapping[str, list[float] | None], draft: Draft) -> list[Shape]:
    """All shapes of a link; a visual shape that is the same as a collision shape is one with it."""
    shapes: list[Shape] = []
    for element in link.children("collision", "visual"):
        with draft.collecting():
            shape = _shape(element, draft)
            if shape is None:
                continue
            if element.tag == "visual":
                shape.visual, shape.colour = True, _of_visual(element, known)
            shape.name = element.word("name") or ""
            shapes.append(shape)
    return _merged(shapes)


def _merged(shapes: Sequence[Shape]) -> list[Shape]:
    solid = [shape for shape in shapes if shape.collision]
    seen = [shape for shape in shapes if not shape.collision]
    return [*solid, *(shape for shape in seen if not any(other.merge(shape) for other in solid))]


def name_shapes(shapes: Sequence[Shape]) -> None:
    """Give every shape that has a name one that the language allows, and that no other has."""
    named = [shape for shape in shapes if shape.name]
    for shape, given in zip(named, names([shape.name for shape in named]), strict=True):
        renamed(shape.named or shape.element, "name", given)
        shape.name = given


def _of_visual(element: Element, known: Mapping[str, list[float] | None]) -> list[float] | None:
    material = element.child("material")
    if material is None:
        return None
    own = _colour(material)
    if own is not None:
        return own
    name = material.word("name") or ""
    if name not in known and material.child("color") is None and not material.look("texture"):
        material.set_aside("name", LOST, "the file defines no such material", APPEARANCE)
    return known.get(name)


def _shape(element: Element, draft: Draft) -> Shape | None:
    """The shape of a visual or collision element; None where it has none that is carried."""
    collides = element.tag == "collision"
    geometry = element.child("geometry")
    kinds = geometry.look(*GEOMETRIES) if geometry is not None else []
    if geometry is None or not kinds:
        others = [child.tag for child in geometry.look()] if geometry is not None else []
        if not collides:
            element.set_aside(None, LOST, "no geometry that simspec reads", APPEARANCE)
            return None
        found = ", ".join(others)[:80] or "nothing"
        raise element.error("a collision shape without a known geometry", found, ", ".join(GEOMETRIES))
    kind = kinds[0]
    if len(kinds) > 1:
        raise geometry.error("one <geometry> holds one shape", ", ".join(child.tag for child in kinds))
    if kind.tag == "mesh":
        if collides:
            raise kind.error("meshes are not supported yet", kind.attributes.get("filename"), "box, sphere, cylinder")
        element.set_aside(None, LOST, "meshes are not supported yet", APPEARANCE)
        return None
    sizes = _sizes(kind.take())
    if min(size for value in sizes.values() for size in (value if isinstance(value, list) else [value])) <= 0.0:
        _empty(element, kind, draft)
        return None
    data: dict[str, Any] = {kind.tag: sizes}
    origin = element.child("origin")
    if origin is not None and (where := pose(origin.vector("xyz"), origin.vector("rpy"))):
        data["pose"] = where
    return Shape(element, collides, data)


def _empty(element: Element, kind: Element, draft: Draft) -> None:
    """A shape with a length that is not above 0."""
    said = " ".join(f'{name}="{value[:40]}"' for name, value in kind.attributes.items())
    if element.tag == "visual":
        element.set_aside(None, LOST, f"a {kind.tag} without volume is not drawn: {said}", APPEARANCE)
    elif not draft.repairing(EMPTY):
        draft.defect(kind, "the lengths of a shape must be above 0", EMPTY, RULES[EMPTY], found=said)
    else:
        element.set_aside(None, LOST, f"left out by the rule {EMPTY}: {said}")
        draft.repaired(EMPTY, element, f"a {kind.tag} without volume is left out: {said}", ("model", "bodies"))


def _sizes(element: Element) -> dict[str, Any]:
    """The lengths of a shape. Raises SpecError for what are no numbers."""
    names = ("size",) if element.tag == "box" else ("radius",) if element.tag == "sphere" else ("radius", "length")
    for name in names:
        element.need(name)
    if element.tag == "box":
        return {"size": numbers(element.vector("size"))}
    return {name: plain(element.number(name) or 0.0) for name in names}


EMPTY: Final = "empty-shapes"
RULES: Final = {EMPTY: "collision shapes without volume are left out"}
