"""Meshes of a spec: from the memory of this process, from the cache, or read and made."""

from __future__ import annotations

import functools
import hashlib
import json
import math
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simspec import numerals
from simspec.errors import Problem, SpecError
from simspec.files import NotReadableError, parse_json, read_bytes
from simspec.language.quantities import LARGEST as UnitsLARGEST
from simspec.language.shapes import FEWEST, MOST_HEIGHTS
from simspec.meshes.hulls import Enclosed, enclosed, merged, reduced
from simspec.meshes.reading import (
    INSTALL,
    NEEDS,
    MeshError,
    MeshFile,
    MeshSurface,
    not_installed,
    open_mesh,
    read_surfaces,
)
from simspec.outputs.collection import Entries
from simspec.stored import MeshEntry, read_as
from simspec.world.canonical import canonical_json, from_plain, to_plain
from simspec.world.hull import FlatError, HullSolid, Points, centred, corners, hull, mesh_size
from simspec.world.types import Pose

# The geometry that a world takes from a file of triangles: convex solids with their frames, and the solid that the surface
# encloses.

FURTHEST = 1e5
"""m from the origin of the shape's frame: vertices beyond it are in another unit."""
LARGEST = 40_000
"""Vertices of a file's hull, for any requested number: to choose 128 of these takes 5 s of processor time (measured), and more
come only of files that are scans of round things, or made to take long."""
SAME = 1e-9
"""Share by which two volumes of one solid may differ by round-off."""
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """How a file is taken. ``unit`` (m) and ``up`` None: as the file says, else ``up`` of its language, and metres."""

    unit: float | None = None
    up: str | None = None
    scale: Triple = (1.0, 1.0, 1.0)
    pieces: bool = False
    max_vertices: int | None = None


@dataclass(frozen=True, slots=True)
class ConvexSolid:
    """A convex solid: ``size`` as a world's shape has it, ``pose`` of its frame in the mesh's frame, the largest distance (m)
    from the hull of which it has only some of the vertices, and how many that has."""

    size: tuple[float, ...]
    pose: Pose
    error: float
    vertices: int


@dataclass(frozen=True, slots=True)
class MadeMesh:
    """The geometry made of a file: its ``parts``, of the volume ``hull_volume`` (m³) the hull of all; the solid that its
    surface encloses, None where ``open_because`` says why that is not closed, and of how many closed ``surfaces`` it has."""

    parts: tuple[ConvexSolid, ...]
    hull_volume: float
    enclosed: HullSolid | None
    open_because: str = ""
    surfaces: int = 1


class ManyVerticesError(MeshError):
    """A hull has more vertices than are allowed, and its options do not say how many it may have."""


class FlatMeshError(MeshError):
    """All points of a mesh are in one plane, or nearly so."""


def made(surface: MeshSurface, options: MeshOptions, most_vertices: int = LARGEST) -> MadeMesh:
    """The geometry that a world takes from ``surface``; a hull whose options allow any number of vertices may have
    ``most_vertices``. Raises MeshError where no solid can be made of it, before a hull with too many is computed."""
    signs = tuple(math.copysign(1.0, factor) for factor in options.scale)
    if min(signs) < 0.0:  # so that the mirror image of a mesh is that of its hulls and pieces, to the last bit
        x, y, z = map(abs, options.scale)
        return _in_mirror(made(surface, replace(options, scale=(x, y, z)), most_vertices), signs)
    vertices, triangles = merged(placed(surface, options), surface.triangles)
    if len(vertices) and not np.abs(vertices).max() < FURTHEST:
        raise MeshError(f"it reaches further than {FURTHEST:g} m: `unit` and `scale` say how large it is")
    try:
        outer = vertices[corners(vertices)]
        if options.max_vertices is None and not options.pieces:
            _check_number(len(outer), most_vertices)
        _check_readable(len(outer))
        volume = hull(outer).solid.volume
        closed = enclosed(vertices, triangles)
        if closed.solid is not None and closed.solid.volume > volume * (1.0 + SAME):
            closed = Enclosed(None, "it encloses more than its hull: parts of it overlap")
        groups = [outer]
        if options.pieces:
            from simspec.meshes.hulls import convex_pieces

            groups = [points[corners(points)] for points in convex_pieces(vertices, triangles)]
        parts = tuple(_convex(points, options.max_vertices) for points in groups)
    except MeshError:
        raise
    except FlatError as error:
        raise FlatMeshError(f"it has no volume: {error}") from None
    except ValueError as error:
        raise MeshError(f"no solid can be made of it: {error}") from None
    return MadeMesh(parts, volume, closed.solid, closed.why, closed.surfaces)


def bounded(mesh: MadeMesh, options: MeshOptions, most_vertices: int) -> MadeMesh:
    """``mesh``, unless a hull of it, whose options allow any number of vertices, has more than ``most_vertices``: then
    ManyVerticesError is raised."""
    if options.max_vertices is None:
        _check_number(max(part.vertices for part in mesh.parts), most_vertices)
    return mesh


def _check_number(vertices: int, most: int) -> None:
    if vertices > most:
        raise ManyVerticesError(
            f"its hull has {vertices:,} vertices, more than {most:,}; `max_vertices: 64` leaves the best"
        )


def _check_readable(vertices: int) -> None:
    if vertices > LARGEST:
        raise MeshError(f"its hull has {vertices:,} vertices, more than the {LARGEST:,} that a file's may have")


def _convex(points: Points, most: int | None) -> ConvexSolid:
    """A hull in its own frame, in which all its vertices are corners still: round-off of the rotation may put one into a
    plane, and it is then left out, since whoever computes the faces from the vertices would miss it."""
    kept, error = (points, 0.0) if most is None else reduced(points, most)
    while True:
        pose, local = centred(kept)
        chosen = corners(local)
        if len(chosen) == len(kept):
            return ConvexSolid(mesh_size(local), pose, error, len(points))
        kept = kept[chosen]


def placed(surface: MeshSurface, options: MeshOptions) -> Points:
    """The vertices in m, in the shape's axes: unit, then the axis that is up (as COLLADA defines x, y and z up), then scale."""
    unit = options.unit if options.unit is not None else surface.unit if surface.unit is not None else 1.0
    if not (math.isfinite(unit) and unit > 0.0):
        raise MeshError(f"its unit is {unit:g} m")
    x, y, z = (surface.vertices[:, k] for k in range(3))
    axes = {"x": (-y, -z, x), "y": (x, -z, y), "z": (x, y, z)}[options.up or surface.up or "z"]
    return np.stack([axis * unit * factor for axis, factor in zip(axes, options.scale, strict=True)], axis=1)


def mirrored(options: MeshOptions) -> bool:
    x, y, z = options.scale
    return x * y * z < 0.0


def _in_mirror(mesh: MadeMesh, signs: tuple[float, ...]) -> MadeMesh:
    """A mesh with some axes of its frame turned round."""
    det = math.prod(signs)

    def pose(of: Pose) -> Pose:
        (x, y, z), (w, *vector) = (np.array(signs) * of.position + 0.0).tolist(), of.quaternion
        qx, qy, qz = (det * sign * value + 0.0 for sign, value in zip(signs, vector, strict=True))
        return Pose((x, y, z), (w, qx, qy, qz))

    def part(of: ConvexSolid) -> ConvexSolid:
        return replace(of, size=mesh_size(np.array(of.size).reshape(-1, 3) * signs), pose=pose(of.pose))

    solid = mesh.enclosed
    enclosed_ = None if solid is None else replace(solid, frame=pose(solid.frame))
    return replace(mesh, parts=tuple(map(part, mesh.parts)), enclosed=enclosed_)


# A cache of geometry: a robot's meshes are read and made into hulls once, whatever its spec changes.
#
# The key of an entry is the hash of everything that could change it: the files' content, how they are taken, simspec's own code
# that takes part, and the versions of the libraries. An entry carries its key and a hash of its content: one that was damaged,
# edited or renamed is no entry.

VERSION = 1
ENTRIES = Entries("meshes", head=b'{"simspec_mesh": ', largest=64 * 2**20, bound=512 * 2**20)
"""A hull of 4,096 vertices has 250 kB, and a mesh may have many pieces."""
LIBRARIES = ("numpy", "scipy", "trimesh", "pycollada", "coacd")


@functools.cache
def _maker() -> str:
    """The hash of the code that makes entries, and of the versions that it stands on."""
    package = Path(__file__).resolve().parents[1]
    files = [*(package / "meshes").glob("*.py"), *(package / "world" / name for name in ("hull.py", "frames.py"))]
    digest = hashlib.sha256(json.dumps([sys.version, *map(_version, LIBRARIES)]).encode())
    for path in sorted(files):
        content = path.read_bytes()
        digest.update(f"{path.name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return ""


def key(file: MeshFile, options: MeshOptions) -> str:
    """The name of the entry of a file that is taken so."""
    return hashlib.sha256(canonical_json([VERSION, _maker(), file.digest(), to_plain(options)]).encode()).hexdigest()


def read(name: str) -> MadeMesh | None:
    """An entry; None when there is none, or it is not what was kept (it is then made anew)."""
    content = ENTRIES.read(name)
    if content is None:
        return None
    try:
        entry = read_as(MeshEntry, content, name)
        if (entry.simspec_mesh, entry.key) != (VERSION, name) or entry.sha256 != _digest(entry.made):
            return None
        made: MadeMesh = from_plain(MadeMesh, parse_json(entry.made))
    except (SpecError, ValueError, KeyError, TypeError):
        return None
    return made


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def write(name: str, made: MadeMesh) -> bool:
    """Keep an entry; False when the folder cannot be written, which costs time only."""
    text = canonical_json(made)
    entry = {"simspec_mesh": VERSION, "key": name, "sha256": _digest(text), "made": text}
    return ENTRIES.write(name, json.dumps(entry, allow_nan=False))


MeshRequest = tuple[Path, MeshOptions]
"""A file, and how it is taken."""
REMEMBERED = 1000
"""Meshes that a process remembers: a sweep resolves the same robot once for each case."""

_remembered: dict[str, MadeMesh] = {}


def load(wanted: Iterable[MeshRequest], most_vertices: int) -> Mapping[MeshRequest, MadeMesh | MeshError]:
    """The geometry of each file, or why there is none. ``most_vertices``: of a hull whose options allow any. Raises SpecError,
    once for all files, where packages that read meshes are not installed."""
    results: dict[MeshRequest, MadeMesh | MeshError] = {}
    names: dict[MeshRequest, str] = {}
    files: dict[Path, MeshFile] = {}
    for item in dict.fromkeys(wanted):
        path, options = item
        try:
            if path not in files:
                files[path] = open_mesh(path)
        except MeshError as error:
            results[item] = error
            continue
        names[item] = name = key(files[path], options)
        known = _remembered.get(name) or read(name)
        if known is not None:
            results[item] = _bounded(_remember(name, known), options, most_vertices)
    missing = [item for item in names if item not in results]
    unread = list(dict.fromkeys(path for path, _ in missing))
    if unread and (packages := not_installed()):
        raise SpecError([Problem(NEEDS, found=f"no {' and no '.join(packages)}", hint=INSTALL, code="C110")])
    surfaces = dict(zip(unread, read_surfaces([files[path] for path in unread]), strict=True))
    for item in missing:
        path, options = item
        surface = surfaces[path]
        if isinstance(surface, MeshError):
            results[item] = surface
            continue
        try:
            mesh = made(surface, options, most_vertices)
        except MeshError as error:
            results[item] = error
            continue
        results[item] = _bounded(_remember(names[item], mesh), options, most_vertices)
        write(names[item], mesh)
    return results


def _bounded(mesh: MadeMesh, options: MeshOptions, most_vertices: int) -> MadeMesh | MeshError:
    """A mesh, wherever it comes from, or that it has more vertices than are allowed."""
    try:
        return bounded(mesh, options, most_vertices)
    except ManyVerticesError as error:
        return error


def _remember(name: str, mesh: MadeMesh) -> MadeMesh:
    while len(_remembered) >= REMEMBERED:
        del _remembered[next(iter(_remembered))]
    _remembered[name] = mesh
    return mesh


# Files of heights: grey PNG pictures, and numbers as text. Both bounded, neither trusted.
#
# The PNG is decoded here, by zlib and numpy: of the format's many forms this is the one that holds heights, and nothing of it
# runs outside of Python (W3C, Portable Network Graphics, third edition: chunks in 5, filters in 9).

LARGEST_GRID_FILE = 16 * 2**20
"""Bytes of one file: the most heights, as text of 60 characters each."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY = 0
"""PNG's number of pictures without colours and opacity."""

Array = NDArray[np.float64]


def read_grid(path: Path) -> Array:
    """The numbers (rows, columns) of a file as they stand in it, the first row first: the shades of a picture, or what a text
    says. Raises MeshError."""
    try:
        content = read_bytes(path, LARGEST_GRID_FILE, links=True)
    except NotReadableError as error:
        raise MeshError(f"{path.name} cannot be read: {error}") from None
    except OSError as error:
        raise MeshError(f"{path.name} cannot be read: {error.strerror}") from None
    return _png(content) if path.suffix.lower() == ".png" else _text(content)


def _demand(rows: int, columns: int) -> None:
    if rows < FEWEST or columns < FEWEST:
        raise MeshError(f"{rows} rows and {columns} columns, where ground has at least {FEWEST} of each")
    if rows * columns > MOST_HEIGHTS:
        raise MeshError(f"{rows} × {columns} heights, more than the {MOST_HEIGHTS:,} that are read")


# --- text ---------------------------------------------------------------------------------------------------------


def _text(content: bytes) -> Array:
    try:
        lines = content.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise MeshError(f"not ASCII at byte {error.start}") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = line.split(",") if "," in line else numerals.parts_of(line)
        rows.append([_number(word.strip(numerals.SPACE), number) for word in words])
        if len(words) != len(rows[0]):
            raise MeshError(f"{len(words)} numbers in line {number}, where the first row has {len(rows[0])}")
        if len(rows) * len(words) > MOST_HEIGHTS:
            raise MeshError(f"more than the {MOST_HEIGHTS:,} heights that are read")
    _demand(len(rows), len(rows[0]) if rows else 0)
    return np.array(rows)


def _number(word: str, line: int) -> float:
    try:
        value = numerals.number(word)
    except numerals.NumeralError as error:
        raise MeshError(f"{word[:40]!r} in line {line} is no usable number{error.suffix}") from None
    if abs(value) > UnitsLARGEST:
        raise MeshError(f"{word[:40]!r} in line {line} is no usable number")
    return value


# --- pictures -----------------------------------------------------------------------------------------------------


def _png(content: bytes) -> Array:
    if not content.startswith(SIGNATURE):
        raise MeshError("no PNG: it does not begin as one")
    header, packed = b"", []
    for name, data in _chunks(content):
        if name == b"IHDR":
            header = header or data
        elif name == b"IDAT":
            packed.append(data)
    if len(header) != 13:
        raise MeshError("damaged: it has no header")
    columns, rows = (int.from_bytes(header[start : start + 4], "big") for start in (0, 4))
    depth, colours, *methods = header[8:]
    if colours != GREY or depth not in (8, 16):
        raise MeshError(f"a picture with {depth} bits and of kind {colours}, where heights are grey with 8 or 16 bits")
    if any(methods):
        raise MeshError("interlaced, or packed in an unknown way, which is not read")
    _demand(rows, columns)
    wide = columns * depth // 8
    lines = _unpacked(b"".join(packed), rows * (1 + wide)).reshape(rows, 1 + wide)
    shades = _unfiltered(lines[:, 0], lines[:, 1:], depth // 8)
    return shades.reshape(rows, wide).view(">u2" if depth == 16 else "u1").astype(np.float64)


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = len(SIGNATURE)
    while True:
        size, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        data, check = content[at + 8 : at + 8 + size], content[at + 8 + size : at + 12 + size]
        if len(check) != 4:
            raise MeshError("damaged: it ends too early")
        if zlib.crc32(name + data) != int.from_bytes(check, "big"):
            raise MeshError("damaged: a checksum is wrong")
        if name == b"IEND":
            return
        yield name, data
        at += 12 + size


def _unpacked(packed: bytes, size: int) -> NDArray[np.uint8]:
    """Exactly ``size`` bytes; no more are unpacked, whatever the file would become."""
    unpacking = zlib.decompressobj()
    try:
        data = unpacking.decompress(packed, size + 1)
    except zlib.error as error:
        raise MeshError(f"damaged: {error}") from None
    if len(data) != size:
        raise MeshError("damaged: its pixels are not as many as it says")
    return np.frombuffer(data, np.uint8)


def _unfiltered(kinds: NDArray[np.uint8], lines: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """The bytes of each line from what is left of them when a guess by its neighbours is taken away; ``step``: bytes of a
    pixel."""
    made = np.zeros(lines.shape, np.uint8)
    above = np.zeros(lines.shape[1], np.uint8)
    for row, (kind, line) in enumerate(zip(kinds.tolist(), lines, strict=True)):
        if kind == 0:
            made[row] = line
        elif kind == 1:
            made[row] = np.cumsum(line.reshape(-1, step), axis=0, dtype=np.uint8).ravel()
        elif kind == 2:
            made[row] = line + above
        elif kind in (3, 4):
            made[row] = _guessed(kind, line.tolist(), above.tolist(), step)
        else:
            raise MeshError(f"damaged: line {row + 1} is filtered in the unknown way {kind}")
        above = made[row]
    return made


def _guessed(kind: int, line: list[int], above: list[int], step: int) -> list[int]:
    """A line by the filters Average (3) and Paeth (4)."""
    done: list[int] = []
    for index, value in enumerate(line):
        left = done[index - step] if index >= step else 0
        up = above[index]
        if kind == 3:
            guess = (left + up) // 2
        else:
            corner = above[index - step] if index >= step else 0
            far = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
            guess = left if far[0] <= far[1] and far[0] <= far[2] else up if far[1] <= far[2] else corner
        done.append((value + guess) & 255)
    return done
