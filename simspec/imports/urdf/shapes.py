"""Visual and collision elements of a link as shapes of a body."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from simspec import numerals
from simspec.errors import SpecError
from simspec.imports.draft import (
    FEWER,
    MOVING_PLANE,
    SIZES,
    Draft,
    LinkShape,
    find_mesh,
    kept_vertices,
    measure_meshes,
    not_drawn,
    numbers,
    pose,
    read_meshes,
    shape_data,
)
from simspec.imports.elements import APPEARANCE, CARRIED, INFORMATION, Element, names, renamed
from simspec.imports.files import MissingFileError
from simspec.imports.urdf.elements import DIALECTS, LENGTHS
from simspec.imports.urdf.joints import across
from simspec.language.shapes import MESH_SUFFIXES as MESHES
from simspec.meshes.load import FlatMeshError, MadeMesh, ManyVerticesError
from simspec.world import frames
from simspec.world.shapes import SHAPES

BODIES: Final = ("model", "bodies")
"""Where repairs of shapes are seen in the data."""
EMPTY: Final = "empty-shapes"
MISSING: Final = "missing-meshes"
RULES: Final = {
    EMPTY: "collision shapes without volume, flat meshes among them, are left out",
    MISSING: "collision meshes that are not there, or cannot be read, are left out",
}
GEOMETRIES: Final = (*LENGTHS, "plane", "mesh")
OF_DIALECTS: Final = "a word that some readers add to URDF, carried as they mean it"


@dataclass
class UrdfShapeRead(LinkShape):
    """A shape of a body: ``data`` without the words that say whether it is seen or collides."""

    colour: list[float] | None = None
    visual: bool = False
    named: Element | None = None
    """The element that says the name, where it is another."""
    radius: float = math.inf
    """m: how far it reaches from its frame's origin; infinite for a plane."""
    material: str = ""
    """Of `contact.materials`; "" for the only one."""

    def written(self) -> dict[str, Any]:
        """The shape as the spec says it."""
        data = {"name": self.name, **self.data} if self.name else dict(self.data)
        if not self.collides:
            data["collision"] = False
        if not self.visual:
            data["visual"] = False
        if self.material:
            data["material"] = self.material
        if self.colour is not None:
            data["colour"] = self.colour
        return data

    def measured(self, mesh: MadeMesh) -> None:
        super().measured(mesh)
        self.radius = max(
            math.hypot(*part.pose.position)
            + max(math.hypot(*part.size[k : k + 3]) for k in range(0, len(part.size), 3))
            for part in mesh.parts
        )
        if (kept := kept_vertices(mesh)) is not None and self.source is not None:
            part = mesh.parts[0]
            self.data["mesh"] = {**self.data["mesh"], "max_vertices": kept}
            away = f"{part.error * 1e3:.2g} mm are between the two"
            reason = f"{kept} of the hull's {part.vertices:,} vertices are kept: {away}"
            self.source.lose("filename", reason, INFORMATION, "`max_vertices`")

    def merge(self, seen: UrdfShapeRead) -> bool:
        """Take a visual shape into this one, where both are the same solid in the same place; whether that was so."""
        same = self.data == seen.data and (not self.name or seen.name in ("", self.name))
        if self.visual or not self.collides or not same:
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
        rgba = list(numerals.numbers(element.attributes["rgba"]))
    except numerals.NumeralError:
        rgba = []
    if len(rgba) not in (3, 4) or not all(0.0 <= value <= 1.0 for value in rgba):
        element.lose("rgba", "a colour is 3 or 4 numbers between 0 and 1", APPEARANCE)
        return None
    element.word("rgba")
    return numbers(rgba)


def read_shapes(link: Element, known: Mapping[str, list[float] | None], draft: Draft) -> list[UrdfShapeRead]:
    """All shapes of a link."""
    shapes: list[UrdfShapeRead] = []
    for element in link.children("collision", "visual"):
        with draft.collecting():
            try:
                shape = _shape(element, draft)
            except SpecError as error:
                if element.tag != "visual":
                    raise
                not_drawn(element, error.problems[0])
                continue
            if shape is None:
                continue
            if element.tag == "visual":
                shape.visual, shape.colour = True, _of_visual(element, known)
            shape.name = element.word("name") or ""
            shapes.append(shape)
    return shapes


def without_planes(shapes: Sequence[UrdfShapeRead]) -> list[UrdfShapeRead]:
    """The shapes of a body that moves: a plane that is only drawn does not move with one."""
    kept = [shape for shape in shapes if shape.collides or "plane" not in shape.data]
    for shape in shapes:
        if not shape.collides and "plane" in shape.data:
            shape.element.forget()
            shape.element.lose(None, MOVING_PLANE, APPEARANCE)
    return kept


def merged(shapes: Sequence[UrdfShapeRead]) -> list[UrdfShapeRead]:
    """The shapes, a visual one that is the same as a collision shape as one with it."""
    solid = [shape for shape in shapes if shape.collides]
    seen = [shape for shape in shapes if not shape.collides]
    return [*solid, *(shape for shape in seen if not any(other.merge(shape) for other in solid))]


def name_shapes(shapes: Sequence[UrdfShapeRead]) -> None:
    """Give every shape that has a name one that the language allows, and that no other has."""
    named = [shape for shape in shapes if shape.name]
    for shape, given in zip(named, names([shape.name for shape in named]), strict=True):
        renamed(shape.named or shape.element, "name", given)
        shape.name = given


def _of_visual(element: Element, known: Mapping[str, list[float] | None]) -> list[float] | None:
    material = element.child("material")
    if material is None:
        return None
    colour = _colour(material)
    if colour is not None:
        return colour
    name = material.word("name") or ""
    if name not in known and material.child("color") is None and not material.look("texture"):
        material.lose("name", "the file defines no such material", APPEARANCE)
    return known.get(name)


def _shape(element: Element, draft: Draft) -> UrdfShapeRead | None:
    """The shape of a visual or collision element; None where it has none that is carried."""
    collides = element.tag == "collision"
    geometry = element.child("geometry")
    kinds = [kind for kind in geometry.look() if _word(kind) in GEOMETRIES] if geometry is not None else []
    if geometry is None or not kinds:
        if not collides:
            element.lose(None, "no geometry that simspec reads", APPEARANCE)
            return None
        found = ", ".join(child.tag for child in geometry.look())[:80] if geometry is not None else ""
        found = found or "nothing"
        raise element.error("a collision shape without a known geometry", found, ", ".join(GEOMETRIES), code="I101")
    if len(kinds) > 1:
        raise geometry.error("one <geometry> holds one shape", ", ".join(child.tag for child in kinds), code="I101")
    kind = kinds[0].take()
    word, size = _word(kind), list[float]()
    if kind.tag == "mesh":
        return _mesh(element, kind, draft)
    if word in DIALECTS:
        kind.set_aside(None, CARRIED, OF_DIALECTS, INFORMATION)
    if word == "plane":
        return UrdfShapeRead(element, {"plane": {}, **_upright(element, kind)}, collides)
    for name in LENGTHS[word]:
        kind.need(name)
    for name in LENGTHS[word]:
        size += kind.numbers(name, 3 if word in SIZES and len(LENGTHS[word]) == 1 else 1) or ()
    if min(size) <= 0.0:
        _empty(element, kind, draft)
        return None
    made = SHAPES[word]
    data = {**shape_data(word, size), **_pose(element)}
    return UrdfShapeRead(element, data, collides, radius=made.outer_radius(size), volume=made.volume(size))


def _word(kind: Element) -> str:
    """The tag of a geometry, which stands behind a prefix where a program has it in a namespace of its own."""
    prefix, _, local = kind.tag.rpartition(":")
    return local if not prefix or local in DIALECTS else kind.tag


def _upright(element: Element, kind: Element) -> dict[str, Any]:
    """The pose of a plane, whose normal the language has along z."""
    normal = kind.vector("normal", (0.0, 0.0, 1.0))
    if not any(normal):
        raise kind.error("a normal of length 0", kind.attributes["normal"], code="I102")
    length = math.hypot(*normal)
    x, y = across(normal)
    along = [value / length for value in normal]
    if along == [0.0, 0.0, 1.0]:
        return _pose(element)
    rows = [(x[k], y[k], along[k]) for k in range(3)]
    origin = element.child("origin")
    where = pose(origin.vector("xyz"), None) if origin is not None else {}
    turned = frames.from_rpy(*origin.vector("rpy")) if origin is not None else (1.0, 0.0, 0.0, 0.0)
    quat = frames.multiply(turned, frames.from_matrix((rows[0], rows[1], rows[2])))
    return {"pose": {**where, "quat": list(quat)}}


def _pose(element: Element) -> dict[str, Any]:
    origin = element.child("origin")
    where = pose(origin.vector("xyz"), origin.vector("rpy")) if origin is not None else {}
    return {"pose": where} if where else {}


def _mesh(element: Element, kind: Element, draft: Draft) -> UrdfShapeRead | None:
    """A mesh; None for one that is not there, or is of another kind of file."""
    text, scale = kind.need("filename"), kind.vector("scale", (1.0, 1.0, 1.0))
    try:
        mesh = find_mesh(text, scale, kind, draft.files)
    except SpecError as error:
        if text.lower().endswith(MESHES) and not isinstance(error, MissingFileError):
            raise
        draft.leave_out(element, MISSING, error.problems[0], BODIES)
        return None
    draft.meshes[text] = mesh.path
    if text in draft.files.above:
        kind.set_aside("filename", CARRIED, f"found from {draft.files.above[text].name}/, above the file", INFORMATION)
    data = {"mesh": mesh.data(), **_pose(element)}
    return UrdfShapeRead(element, data, element.tag == "collision", mesh=mesh, source=kind)


def judge_meshes(shapes: list[UrdfShapeRead], draft: Draft) -> list[UrdfShapeRead]:
    """The shapes without those meshes that cannot be read; of the others it is noted whether they enclose a volume."""
    named = [shape for shape in shapes if shape.mesh is not None]
    made = read_meshes([shape.mesh for shape in named if shape.mesh is not None])
    large = [at for at, shape in enumerate(named) if shape.collides and isinstance(made[at], ManyVerticesError)]
    fewer = read_meshes([mesh for at in large if (mesh := named[at].mesh) is not None], FEWER)
    for at, result in zip(large, fewer, strict=True):
        made[at] = result
    unusable = measure_meshes(
        named, made, lambda error: EMPTY if isinstance(error, FlatMeshError) else MISSING, draft, BODIES
    )
    return [shape for shape in shapes if id(shape) not in unusable]


def _empty(element: Element, kind: Element, draft: Draft) -> None:
    said = " ".join(f'{name}="{value[:40]}"' for name, value in kind.attributes.items())
    if element.tag == "visual":
        element.lose(None, f"a {kind.tag} without volume is not drawn: {said}", APPEARANCE)
    elif not draft.repairing(EMPTY):
        draft.defect(kind, "the lengths of a shape must be above 0", EMPTY, said)
    else:
        element.lose(None, f"left out by the rule {EMPTY}: {said}")
        draft.repaired(EMPTY, element, f"a {kind.tag} without volume is left out: {said}", BODIES)
