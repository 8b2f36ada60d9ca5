"""The surfaces of meshes as a page draws them: read in the confined process, simplified, kept in a cache."""

from __future__ import annotations

import base64
import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from simspec.errors import SpecError
from simspec.meshes.hulls import merged
from simspec.meshes.load import FURTHEST, MeshOptions, mirrored, placed
from simspec.meshes.reading import MeshError, MeshFile, MeshSurface, open_mesh, read_surfaces
from simspec.meshes.simplify import simplified
from simspec.outputs.collection import Entries
from simspec.stored import DrawnEntry, read_as
from simspec.world.appearance import DrawnMesh, DrawnSurface, Rgba
from simspec.world.canonical import canonical_json
from simspec.world.types import World

MOST_TRIANGLES = 5_000
"""Of one file."""
MOST_IN_PAGE = 100_000
"""Of all files of a world: a page that draws them has 1 MB more."""
FEWEST_TRIANGLES = 200
"""Of one file, however many a world has."""
MOST_COLOURS = 32
"""Of one file; further ones have none."""
VERSION = 1
ENTRIES = Entries("drawn", head=b'{"simspec_drawn": ', largest=4 * 2**20, bound=256 * 2**20)

Wanted = tuple[str, float | None, str | None, tuple[float, float, float]]
"""The file and how it is taken: its surface follows from these alone."""
_remembered: dict[str, DrawnSurface] = {}


def drawn_meshes(world: World) -> list[DrawnMesh]:
    """The meshes that a world's shapes are drawn by, in the order of the shapes."""
    return [
        shape.drawn for body in world.bodies for shape in body.shapes if shape.drawn is not None and shape.drawn.first
    ]


def wanted(mesh: DrawnMesh) -> Wanted:
    """The file of a mesh and how it is taken: its surface follows from these alone."""
    return mesh.file, mesh.unit, mesh.up, mesh.scale


def surfaces(world: World) -> dict[Wanted, DrawnSurface]:
    """The surfaces of the meshes that a world's shapes are drawn by; none for files that cannot be read any more."""
    known: dict[Wanted, DrawnSurface] = {}
    missing: list[Wanted] = []
    for mesh in drawn_meshes(world):
        if mesh.surface is not None:
            known[wanted(mesh)] = mesh.surface
        else:
            missing.append(wanted(mesh))
    missing = list(dict.fromkeys(missing))
    if not missing:
        return known
    most = int(np.clip(MOST_IN_PAGE // (len(missing) + len(known)), FEWEST_TRIANGLES, MOST_TRIANGLES))
    return {**known, **_made(missing, most)}


def _made(missing: Iterable[Wanted], most: int) -> dict[Wanted, DrawnSurface]:
    results: dict[Wanted, DrawnSurface] = {}
    unread: dict[Wanted, tuple[MeshFile, str]] = {}
    for item in missing:
        try:
            file = open_mesh(Path(item[0]), colours=True)
        except MeshError:
            continue
        key = _key(file, item, most)
        known = _remembered.get(key) or _read(key)
        if known is None:
            unread[item] = file, key
        else:
            results[item] = _remembered[key] = known
    files = {file.path: file for file, _ in unread.values()}
    read = dict(zip(files, read_surfaces(list(files.values())), strict=True)) if files else {}
    for item, (file, key) in unread.items():
        surface = read[file.path]
        made = None if isinstance(surface, MeshError) else drawn_surface(surface, MeshOptions(*item[1:]), most)
        if made is not None:
            results[item] = _remembered[key] = made
            _write(key, made)
    return results


def drawn_surface(surface: MeshSurface, options: MeshOptions, most: int) -> DrawnSurface | None:
    """At most ``most`` triangles that look like ``surface``; None where nothing can be drawn of it. Triangles of one colour are
    simplified together."""
    try:
        points = placed(surface, options)
    except MeshError:
        return None
    triangles = surface.triangles[:, ::-1] if mirrored(options) else surface.triangles
    vertices, corners, colours = [], [], []
    count = 0
    for colour, part in _parts(surface, triangles):
        local, faces = merged(points, part)
        if not len(faces) or not np.abs(local).max() < FURTHEST:
            continue
        share = max(8, most * len(part) // len(triangles))
        local, faces, _ = simplified(local, faces, share)
        if not len(faces):
            continue
        local, faces = merged(local, faces)
        vertices.append(local)
        corners.append(faces + count)
        colours.append((colour, len(faces)))
        count += len(local)
    if not corners or count > 2**16:
        return None
    return DrawnSurface(
        np.concatenate(vertices).astype("<f4").tobytes(),
        np.concatenate(corners).astype("<u2").tobytes(),
        tuple(colours),
        len(triangles),
    )


def _parts(surface: MeshSurface, triangles: np.ndarray) -> list[tuple[Rgba | None, np.ndarray]]:
    """The triangles of each colour."""
    groups: dict[Rgba | None, list[np.ndarray]] = {}
    first = 0
    for colour, count in surface.colours or ((None, len(triangles)),):
        known = colour if colour in groups or len(groups) < MOST_COLOURS else None
        groups.setdefault(known, []).append(triangles[first : first + count])
        first += count
    ordered = sorted(groups.items(), key=lambda item: item[0] or ())
    return [(colour, np.concatenate(parts)) for colour, parts in ordered]


# A cache of surfaces. The key of an entry is the hash of everything that could change it.


@functools.cache
def _maker() -> str:
    """The hash of the code that makes surfaces."""
    digest = hashlib.sha256()
    for name in ("drawn.py", "simplify.py", "load.py", "hulls.py", "reading.py", "child.py"):
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()


def _key(file: MeshFile, item: Wanted, most: int) -> str:
    plain = [VERSION, _maker(), file.digest(), *item[1:], most]
    return hashlib.sha256(canonical_json(plain).encode()).hexdigest()


def _read(key: str) -> DrawnSurface | None:
    content = ENTRIES.read(key)
    if content is None:
        return None
    try:
        entry = read_as(DrawnEntry, content, key)
        if (entry.simspec_drawn, entry.key) != (VERSION, key) or entry.sha256 != _digest(entry.made):
            return None
        return surface_of(json.loads(entry.made))
    except (SpecError, ValueError, KeyError, TypeError):
        return None


def _write(key: str, surface: DrawnSurface) -> None:
    text = json.dumps(plain_surface(surface))
    entry = {"simspec_drawn": VERSION, "key": key, "sha256": _digest(text), "made": text}
    ENTRIES.write(key, json.dumps(entry))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def plain_surface(surface: DrawnSurface) -> dict[str, Any]:
    """A surface as JSON has it."""
    return {
        "vertices": base64.b64encode(surface.vertices).decode(),
        "triangles": base64.b64encode(surface.triangles).decode(),
        "colours": [[colour and list(colour), count] for colour, count in surface.colours],
        "faces": surface.faces,
    }


def surface_of(plain: Any) -> DrawnSurface:
    """The inverse of :func:`plain_surface`. Raises ValueError, KeyError or TypeError for anything else."""
    vertices = np.frombuffer(base64.b64decode(plain["vertices"], validate=True), "<f4")
    triangles = np.frombuffer(base64.b64decode(plain["triangles"], validate=True), "<u2")
    colours = tuple((None if colour is None else _rgba(*colour), int(count)) for colour, count in plain["colours"])
    if len(vertices) % 3 or len(triangles) % 3 or not np.isfinite(vertices).all():
        raise ValueError("no triangles")
    if not len(triangles) or int(triangles.max()) >= len(vertices) // 3:
        raise ValueError("a triangle has a vertex that does not exist")
    if sum(count for _, count in colours) != len(triangles) // 3 or any(count < 1 for _, count in colours):
        raise ValueError("not each triangle has its colour")
    return DrawnSurface(vertices.tobytes(), triangles.tobytes(), colours, int(plain["faces"]))


def _rgba(red: float, green: float, blue: float, opacity: float) -> Rgba:
    if not all(0.0 <= value <= 1.0 for value in (red, green, blue, opacity)):
        raise ValueError("a colour is four numbers between 0 and 1")
    return float(red), float(green), float(blue), float(opacity)
