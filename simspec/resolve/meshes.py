"""The meshes of a spec: all that its shapes name, read and made before any tree is resolved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from simspec.errors import Problem, SpecError
from simspec.language import trees
from simspec.language.document import Key
from simspec.language.mesh import HULL, MOST_VERTICES, PIECES, Mesh
from simspec.language.models import Body as SpecBody
from simspec.language.problems import in_order
from simspec.language.shapes import Shape as SpecShape
from simspec.language.sources import Source
from simspec.meshes.files import MeshError
from simspec.world.types import Body

if TYPE_CHECKING:
    from simspec.meshes.made import MadeMesh, MeshOptions

MOST_IN_WORLD = 500_000
"""Vertices of all shapes of one scenario, copies included: each takes 60 bytes in a world's file, and more in an engine's."""


@dataclass(frozen=True)
class MeshShape:
    """A shape that is a mesh: where it stands, its body, and what it says."""

    source: Source
    path: tuple[Key, ...]
    body: SpecBody
    shape: SpecShape
    mesh: Mesh

    @property
    def file(self) -> Path:
        """The file that it names."""
        return self.source.meshes[self.mesh.file]

    @property
    def options(self) -> MeshOptions:
        """How it takes the file."""
        return options_of(self.mesh)

    def problem(self, message: str, hint: str | None = None) -> Problem:
        """A problem or a warning of this mesh."""
        return self.source.document.problem((*self.path, "mesh", "file"), message, found=self.mesh.file, hint=hint)


def options_of(mesh: Mesh) -> MeshOptions:
    """How a mesh of the spec takes its file."""
    from simspec.meshes.made import MeshOptions

    return MeshOptions(mesh.metres(), mesh.up, mesh.scale, mesh.taken_as == PIECES, mesh.max_vertices)


Meshes: TypeAlias = "Mapping[tuple[Path, MeshOptions], MadeMesh]"
"""What was made of each file, by how it is taken."""


def mesh_shapes(source: Source) -> Iterator[MeshShape]:
    """Every shape of a spec that is a mesh, once for each place in a file."""
    seen: set[tuple[int, tuple[Key, ...]]] = set()
    for bodies in trees.every(source):
        for name, body in bodies.typed.items():
            for index, shape in enumerate(body.shapes if body is not None else ()):
                path = (*bodies.path, name, "shapes", index)
                key = (id(bodies.source), path)
                if body is not None and shape.mesh is not None and key not in seen:
                    seen.add(key)
                    yield MeshShape(bodies.source, path, body, shape, shape.mesh)


def read_meshes(source: Source) -> Meshes:
    """All meshes of a spec. Raises SpecError with every file of which no solid can be made, and every body whose mass cannot be
    computed from one."""
    shapes = list(mesh_shapes(source))
    if not shapes:
        return {}
    from simspec.meshes.load import load

    loaded = load([(shape.file, shape.options) for shape in shapes], MOST_VERTICES)
    problems: list[Problem] = []
    for shape in shapes:
        result = loaded[shape.file, shape.options]
        if isinstance(result, MeshError):
            problems.append(shape.problem(str(result)))
        elif result.enclosed is None and shape.mesh.mass_from != HULL and fills(shape.body, shape.shape):
            message = f"the mass of this mesh cannot be computed: {result.open_because}"
            hint = "mass_from: hull; or the body's mass with inertia; or a file that is closed"
            problems.append(shape.problem(message, hint))
    if problems:
        raise SpecError(in_order(problems))
    return {wanted: result for wanted, result in loaded.items() if not isinstance(result, MeshError)}


def fills(body: SpecBody, shape: SpecShape) -> bool:
    """Whether a body's mass or inertia is computed from this shape of it."""
    if any(other.density for other in body.shapes):
        return bool(shape.density)
    if body.inertia is not None or not body.mass:
        return False
    colliding = any(other.collision and other.has_volume for other in body.shapes)
    return shape.collision or not colliding


def too_many(source: Source, bodies: tuple[Body, ...]) -> list[Problem]:
    """The problem of a world whose meshes have too many vertices; none where they do not."""
    total = sum(len(shape.size) // 3 for body in bodies for shape in body.shapes if shape.kind == "mesh")
    if total <= MOST_IN_WORLD:
        return []
    first = next(mesh_shapes(source))
    message = (
        f"the meshes of this scenario have {total:,} vertices, copies included; up to {MOST_IN_WORLD:,} are supported"
    )
    return [first.problem(message, "max_vertices: 64")]
