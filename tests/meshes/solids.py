"""Triangles with known solids, and files of them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import trimesh

_CORNERS = "013 032 467 475 045 051 237 276 026 064 157 173"
BOX_FACES = np.array([[int(corner) for corner in face] for face in _CORNERS.split()])


def box(x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    """A cuboid with a corner at the origin."""
    corners = np.array([[a, b, c] for a in (0.0, x) for b in (0.0, y) for c in (0.0, z)])
    return corners, BOX_FACES


def l_profile() -> tuple[np.ndarray, np.ndarray]:
    """An L of 2 x 2 x 1 without its corner of 1 x 1 x 1: of volume 3 in a hull of 3.5, with the centre (5/6, 5/6, 1/2)."""
    outline = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)]
    points = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in outline])
    cap = [(0, 1, 3), (1, 2, 3), (0, 3, 5), (3, 4, 5)]
    sides = [face for i in range(6) for face in ((i, (i + 1) % 6, i + 6), ((i + 1) % 6, (i + 1) % 6 + 6, i + 6))]
    return points, np.array([*((a, c, b) for a, b, c in cap), *((a + 6, b + 6, c + 6) for a, b, c in cap), *sides])


def stl(points: np.ndarray, faces: np.ndarray) -> bytes:
    """A binary STL."""
    rows = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["corners"] = points[faces]
    return b"\0" * 80 + struct.pack("<I", len(faces)) + rows.tobytes()


def obj(points: np.ndarray, faces: np.ndarray) -> str:
    """An OBJ, with all digits."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist())]) + "\n"


def write_all(folder: Path, points: np.ndarray, faces: np.ndarray) -> dict[str, Path]:
    """The same triangles in every language that is read, by another program's writers."""
    mesh = trimesh.Trimesh(points, faces, process=False)
    names = {"stl": "m.stl", "obj": "m.obj", "ply": "m.ply", "glb": "m.glb", "gltf": "m.gltf", "dae": "m.dae"}
    for kind, name in names.items():
        mesh.export(folder / name, file_type=kind)
    mesh.export(folder / "ascii.stl", file_type="stl_ascii")
    return {**{kind: folder / name for kind, name in names.items()}, "ascii": folder / "ascii.stl"}
