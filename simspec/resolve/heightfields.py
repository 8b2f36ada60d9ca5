"""The height fields of a spec: their files, read before any tree is resolved, and their heights as the world has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simspec.errors import Problem, SpecError
from simspec.language import trees
from simspec.language.document import Key
from simspec.language.heightfield import MOST_HEIGHTS, Heightfield
from simspec.language.problems import in_order
from simspec.language.sources import Source
from simspec.language.strict import required
from simspec.meshes.files import MeshError
from simspec.world.shapes import HEIGHTFIELD_HEAD, heightfield_size
from simspec.world.types import Body, Pose

Array = NDArray[np.float64]
Grids = Mapping[Path, Array]
"""The numbers (rows, columns) of each file, as they stand in it."""


def field_shapes(source: Source) -> Iterator[tuple[Source, tuple[Key, ...], Heightfield]]:
    """Every shape of a spec that is a height field, with its file and its place there, once for each place."""
    seen: set[tuple[int, tuple[Key, ...]]] = set()
    for bodies in trees.every(source):
        for name, body in bodies.typed.items():
            for index, shape in enumerate(body.shapes if body is not None else ()):
                path = (*bodies.path, name, "shapes", index, "heightfield")
                key = (id(bodies.source), path)
                if shape.heightfield is not None and key not in seen:
                    seen.add(key)
                    yield bodies.source, path, shape.heightfield


def read_grids(source: Source) -> Grids:
    """The files of all height fields of a spec. Raises SpecError with every one that cannot be read."""
    grids: dict[Path, Array] = {}
    problems: list[Problem] = []
    for own, path, field in field_shapes(source):
        if field.file is None or own.meshes[field.file] in grids:
            continue
        from simspec.meshes.grids import read_grid

        try:
            grids[own.meshes[field.file]] = read_grid(own.meshes[field.file])
        except MeshError as error:
            problems.append(own.document.problem((*path, "file"), str(error), found=field.file))
    if problems:
        raise SpecError(in_order(problems))
    return grids


def placed_field(field: Heightfield, source: Source, grids: Grids) -> tuple[tuple[float, ...], Pose]:
    """The size of a height field in the world, and its frame there in the shape's frame of the spec: the world has the lowest
    height at zero, and the first row at the least y."""
    numbers = np.array(field.rows) if field.file is None else grids[source.meshes[field.file]]
    heights = numbers[::-1]
    if field.heights is not None:
        (low, high), least = field.heights, heights.min()
        span = heights.max() - least
        heights = low + (heights - least) * ((high - low) / span if span else 0.0)
    lowest = float(heights.min())
    x, y = required(field.size)
    return heightfield_size(x, y, field.base, heights - lowest), Pose((0.0, 0.0, lowest))


def too_many_heights(source: Source, bodies: tuple[Body, ...]) -> list[Problem]:
    """The problem of a world whose height fields have too many heights; none where they do not."""
    sizes = [shape.size for body in bodies for shape in body.shapes if shape.kind == "heightfield"]
    total = sum(len(size) - HEIGHTFIELD_HEAD for size in sizes)
    if total <= MOST_HEIGHTS:
        return []
    own, path, _ = next(field_shapes(source))
    message = (
        f"the height fields of this scenario have {total:,} heights, copies included; up to {MOST_HEIGHTS:,} are read"
    )
    return [own.document.problem(path, message, hint="fewer rows and columns, or fewer copies")]
