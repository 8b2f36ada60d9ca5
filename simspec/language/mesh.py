"""Shapes from files of triangles: their convex hulls, and the mass of what their surfaces enclose."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, create_model

from simspec.language.document import Key
from simspec.language.hint import NOT_YET
from simspec.language.quantities import Number, Vector, Whole
from simspec.language.reader import Reader
from simspec.language.strict import ABSENT, Fault, Maybe, Strict, fault, show
from simspec.language.units import parse
from simspec.language.words import FileName, Word

SUFFIXES = (".obj", ".stl", ".dae", ".glb", ".gltf", ".ply", ".msh")
"""Ends of names of files that are read, in small letters."""
UNITS = ("m", "dm", "cm", "mm", "um", "in", "ft")
"""Units that a file's lengths may be in."""
FEWEST_VERTICES, MOST_VERTICES = 4, 20_000
"""Vertices of a hull. Engines' times grow with them: bodies of 1,800 run a hundred times slower in some than bodies of 128."""
FROM_FILES = ("mesh", "heightfield")
"""Kinds of shapes that may name a file."""
HULL, PIECES = "hull", "pieces"
SURFACE = "surface"


@dataclass(frozen=True)
class Scale(Reader):
    """A factor, or one for each axis; a negative one mirrors."""

    def read(self, value: Any) -> tuple[float, float, float]:
        number = Number("number")
        if isinstance(value, (list, tuple)) or hasattr(value, "tolist"):
            x, y, z = Vector(number).read(value)
        else:
            x = y = z = number.read(value)
        if 0.0 in (x, y, z):
            raise fault("a factor of 0 leaves no volume", show(value), "numbers other than 0")
        return (x, y, z)

    def describe(self) -> str:
        return "a number, or 3 of them"

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [Number("number").schema(), Vector(Number("number")).schema()]}


@dataclass(frozen=True)
class Taken(Word):
    """What a mesh is taken as."""

    def read(self, value: Any) -> str:
        if value == SURFACE:
            hint = "hull; pieces for what is not convex; a height field or boxes for ground"
            raise fault(f"contact with a surface of triangles is {NOT_YET}", SURFACE, ", ".join(self.words), hint)
        return super().read(value)


class _File(Strict):
    file: Annotated[str, FileName()] = Field(
        ..., description="Path of the file (OBJ, STL, DAE, glTF, GLB, PLY, MSH), relative to this file"
    )
    unit: Maybe[Annotated[str, Word(UNITS)]] = Field(
        ABSENT, description="Unit of the file's lengths; default: as a DAE file says it, else m"
    )
    up: Maybe[Annotated[str, Word(("x", "y", "z"))]] = Field(
        ABSENT,
        description="The file's axis that becomes z; default: as a DAE file says it, y of glTF and GLB, z of all others",
    )
    scale: Annotated[tuple[float, float, float], Scale()] = Field(
        (1.0, 1.0, 1.0), description="Factors along the axes after `up`; negative ones mirror"
    )


_AS: dict[str, Any] = {  # `as` is no name that a class body may have
    "as": (
        Annotated[str, Taken((HULL, PIECES))],
        Field(
            HULL, description="`hull`: its convex hull; `pieces`: several convex ones that together are nearly the same"
        ),
    ),
}
_FileAs: type[_File] = create_model("_FileAs", __base__=_File, **_AS)


class Mesh(_FileAs):
    """A solid from a file of triangles: their convex hull, or several convex pieces."""

    max_vertices: Maybe[Annotated[int, Whole(FEWEST_VERTICES, MOST_VERTICES)]] = Field(
        ABSENT, description="The most vertices of the hull, or of each piece; default: all that it has"
    )
    mass_from: Annotated[str, Word((SURFACE, HULL))] = Field(
        SURFACE,
        description="What `density`, or the body's `mass` without `inertia`, fills: the closed `surface`, or the `hull`",
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        text = data.get("file")
        if isinstance(text, str) and text.strip() and not text.lower().endswith(SUFFIXES):
            yield Fault(("file",), "not a file of triangles that is read", show(text), " ".join(SUFFIXES))

    @property
    def taken_as(self) -> str:
        """``hull`` or ``pieces``."""
        value: str = getattr(self, "as")
        return value

    def metres(self) -> float | None:
        """The length of the file's unit (m), where the spec says it."""
        return None if self.unit is None else parse(f"1 {self.unit}", "length")


def named_files(data: Any) -> Iterator[tuple[tuple[Key, ...], str]]:
    """The files that the shapes of a plain spec name, with the paths of the texts."""
    if not isinstance(data, Mapping):
        return
    trees: list[tuple[tuple[Key, ...], Any]] = [(("bodies",), data.get("bodies"))]
    model, models = data.get("model"), data.get("models")
    if isinstance(model, Mapping):
        trees.append((("model", "bodies"), model.get("bodies")))
    for name, placed in models.items() if isinstance(models, Mapping) else ():
        if isinstance(placed, Mapping):
            trees.append((("models", name, "bodies"), placed.get("bodies")))
    for path, bodies in trees:
        for name, body in bodies.items() if isinstance(bodies, Mapping) else ():
            shapes = body.get("shapes") if isinstance(body, Mapping) else None
            for index, shape in enumerate(shapes if isinstance(shapes, (list, tuple)) else ()):
                for kind in FROM_FILES:
                    said = shape.get(kind) if isinstance(shape, Mapping) else None
                    text = said.get("file") if isinstance(said, Mapping) else None
                    if isinstance(text, str):
                        yield (*path, name, "shapes", index, kind, "file"), text
