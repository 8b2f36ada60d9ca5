"""Convex hulls for what collides by ODE: a class of geoms whose points of contact with everything else are found here, in C.

``hulls.c`` is the class, as ODE receives it; ``overlap.c`` how deep two shapes are in each other, ``manifold.c`` where they
touch. An engine compiles these sources into its own part in C, or loads them as one.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.errors import EngineError

FOLDER = Path(__file__).parent
SOURCES = tuple(FOLDER / name for name in ("hulls.c", "overlap.c", "manifold.c"))
HEADERS = (FOLDER / "simspec_hulls.h",)
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")

Pointer, Numbers = ctypes.c_void_p, ctypes.POINTER(ctypes.c_double)
FUNCTIONS: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "hull_is": (ctypes.c_int, (Pointer,)),
    "hull_vertices": (ctypes.c_int, (Pointer, Numbers)),
    "hull_instead": (Pointer, (Pointer, Pointer, Numbers, ctypes.c_int)),
    "hull_gone": (None, (Pointer,)),
    "hulls_doubted": (ctypes.c_long, ()),
}
"""The functions that are called from Python: result and arguments."""
DOUBTED = "{} overlaps of hulls may be reported too deep by more than 1e-8 m"


def vertices_of(library: Any, geom: Any) -> tuple[float, ...]:
    """The vertices (flat, m) that a hull's geom has."""
    actual = (ctypes.c_double * (3 * library.hull_vertices(geom, None)))()
    library.hull_vertices(geom, actual)
    return tuple(actual)


def check_solid(engine: str, name: str, size: tuple[float, ...]) -> None:
    """Raises EngineError where vertices have no solid between them, of which overlaps have no depth."""
    corners = np.array(size).reshape(-1, 3)
    if np.linalg.matrix_rank(corners - corners.mean(axis=0)) < corners.shape[1]:
        raise EngineError(engine, f"does not support the size of the mesh {name!r}, whose corners are in one plane")
