"""Height fields of a compiled model as shapes of the language."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.imports.mjcf.bodies import Bodies, numbers
from simspec.meshes.files import MeshError
from simspec.meshes.grids import read_grid

MOST_ROWS: Final = 2**16
"""Heights that are written into a spec; of more, a picture that says the same is named."""
SAME: Final = 1e-6
"""Share of the range by which a picture may be off: the compiler has single precision."""


def height_field(bodies: Bodies, number: int) -> dict[str, Any] | None:
    """The shape of a geom; None for what the language does not have: one on a body that may move, and one of more heights than
    are read."""
    model = bodies.model
    data, shares = int(model["geom_dataid"][number]), model.get("hfield_data")
    if shares is None or not _still(bodies, int(model["geom_bodyid"][number])):
        return None
    rows, columns = int(model["hfield_nrow"][data]), int(model["hfield_ncol"][data])
    half_x, half_y, top, base = model["hfield_size"][data].tolist()
    first = int(model["hfield_adr"][data])
    grid = shares[first : first + rows * columns].reshape(rows, columns)[::-1]  # as on a map: the greatest y first
    said = {"size": numbers([2.0 * half_x, 2.0 * half_y]), "heights": [0.0, float(top)], "base": float(base)}
    path = model.field_files.get(data)
    if path is not None and _says(path, grid):
        text = os.path.relpath(path, bodies.folder).replace(os.sep, "/")
        bodies.files[text] = path
        return {"heightfield": {"file": text, **said}}
    if rows * columns > MOST_ROWS:
        return None
    if not grid.any():  # all at the lowest, as in the compiled model
        said["heights"] = [0.0, 0.0]
    return {"heightfield": {"rows": [numbers(row) for row in grid], **said}}


def _still(bodies: Bodies, body: int) -> bool:
    """Whether a body is fixed to the world, and none above it is moved as it is told."""
    if int(bodies.model["body_weldid"][body]) != 0:
        return False
    while body:
        if int(bodies.model["body_mocapid"][body]) >= 0:
            return False
        body = int(bodies.model["body_parentid"][body])
    return True


def _says(path: Path, grid: NDArray[Any]) -> bool:
    """Whether a file is a picture that the language reads, with these shares of its range."""
    if path.suffix.lower() != ".png":
        return False
    try:
        shades = read_grid(path)
    except MeshError:
        return False
    span = shades.max() - shades.min()
    return shades.shape == grid.shape and bool(np.abs((shades - shades.min()) / (span or 1.0) - grid).max() <= SAME)
