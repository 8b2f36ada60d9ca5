"""Meshes as PyBullet is given them, and the hulls that it makes of them.

PyBullet makes of an OBJ file a compound of hulls, in which it sets a margin only where the file is the one shape of a link and
unmoved; of an STL file it makes one hull, which takes it everywhere (measured). So the files of meshes are given to it as STL,
whose single precision is 1e-7 of an extent, where its own hulls keep 1e-4 of it. Facts marked *measured*: pybullet 3.2.7.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from simspec.contact import ContactPlan, contact_plan
from simspec.dialects.pybullet.sidecar import faces_meet, margins_of
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.refinements import BLUNT, blunted
from simspec.engines.kit.settings import resolve_settings
from simspec.engines.pybullet.bullet_file import Block
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.formats.kit.mesh_reading import SUFFIX, field_of_triangles, read_triangles
from simspec.formats.kit.text import FIELDS
from simspec.outputs.files import files_below
from simspec.outputs.writing import Artifacts
from simspec.support.declarations import Level, Refinement, unsupported_if
from simspec.world.contact_pairs import meeting_kinds
from simspec.world.hull import SLACK_OF_HALVES, HullError, margin_excess
from simspec.world.types import Shape, World

STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""One triangle of a binary file."""
HEADER = 80
"""Bytes before the number of triangles."""
MESH = re.compile(r'(<mesh filename=")([^"]*)"')
KEPT = 2e-4
"""Share of its extent by which PyBullet's hull may differ from the points that it was made of: it computes with whole numbers,
10216 to half an extent (measured: up to 1e-4)."""

AT_ONCE = 65_536
"""Products of a direction and a point that are looked at together: all 56,064 × 32,384 of one hand are 14 GB."""

Points = NDArray[np.float64]


@contextmanager
def with_stl(folder: Path) -> Iterator[Path]:
    """A folder of the robots of ``folder`` whose meshes are STL files; the folder itself where there are no meshes.

    Raises EngineError where a mesh is missing or is no convex hull.
    """
    try:
        names = [name for name in files_below(folder) if name.endswith(SUFFIX) and not _is_field(name)]
        if not names:
            yield folder
            return
        files: dict[str, str | bytes] = {_stl(name): stl_of(*read_triangles(folder, name)) for name in names}
        for name in files_below(folder):
            if _is_field(name):
                files[name] = (folder / name).read_text(encoding="utf-8")
            if name.endswith(".urdf"):
                files[name] = MESH.sub(_renamed, (folder / name).read_text(encoding="utf-8"))
        with scratch_folder("stl") as place:
            Artifacts(files).write(place / "files")
            yield place / "files"
    except ValueError as error:
        raise EngineError("pybullet", str(error)) from error


def uses_faces(folder: Path, base_margin: float) -> bool:
    """Whether the meshes that touch, in the robots of ``folder``, are all on bases, and these have no margin: only then does
    PyBullet look at faces where they are (see ``dialects/pybullet/sidecar.py``)."""
    margins = set()
    for name in files_below(folder):
        if name.endswith(".urdf"):
            text = (folder / name).read_bytes()
            try:
                root = ElementTree.fromstring(text)
            except ElementTree.ParseError as error:
                raise EngineError("pybullet", f"{name} is not XML: {error}") from error
            for number, link in enumerate(root.iter("link")):
                if any(
                    each.find("geometry/mesh") is not None for each in link.iter("collision") if not each.get("concave")
                ):
                    margins.add(base_margin if number == 0 else None)
    return margins == {0.0}


def _is_field(name: str) -> bool:
    """Whether a file is the surface of a height field, which PyBullet takes as the triangles that it is."""
    return name.startswith(f"{FIELDS}/")


def _stl(name: str) -> str:
    return f"{name.removesuffix(SUFFIX)}.stl"


def _renamed(found: re.Match[str]) -> str:
    name = found.group(2)
    return f'{found.group(1)}{_stl(name)}"' if name.endswith(SUFFIX) and not _is_field(name) else found.group(0)


def stl_of(vertices: Points, faces: NDArray[np.int64]) -> bytes:
    """A closed surface as a binary STL file."""
    rows = np.zeros(len(faces), STL)
    rows["corners"] = vertices[faces]
    first, second, third = (rows["corners"][:, corner].astype(float) for corner in range(3))
    rows["normal"] = np.cross(second - first, third - first)
    return b"convex hull".ljust(HEADER) + len(faces).to_bytes(4, "little") + rows.tobytes()


@dataclass(frozen=True, slots=True)
class StoredMesh:
    """A mesh that PyBullet holds: the size of a hull, or of a ``field``, and the margin (m) that Bullet keeps around it."""

    size: tuple[float, ...]
    margin: float
    field: bool = False


class Hulls:
    """The convex hulls, and the height fields, in a dump of PyBullet's memory, by the address of the shape that they are part
    of."""

    def __init__(self, blocks: Iterable[Block]):
        self._at = {block.address: block for block in blocks}

    def of(self, address: int) -> list[StoredMesh]:
        """The meshes of a shape, or of all parts of a compound one, in their order."""
        block = self._at.get(address)
        if block is None:
            return []
        names = block.rows.dtype.names or ()
        row = block.rows[0]
        if "m_childShapePtr" in names:
            parts = self._at.get(int(row["m_childShapePtr"]))
            children = () if parts is None else parts.rows
            return [hull for part in children for hull in self.of(int(part["m_childShape"]))]
        if "m_meshInterface" in names:
            return [StoredMesh(self._field(row), float(row["m_collisionMargin"]), True)]
        if "m_unscaledPointsDoublePtr" not in names:
            return []
        scale = _floats(row["m_convexInternalShapeData"]["m_localScaling"])
        points = next(
            (self._at[int(row[name])] for name in POINTERS if int(row[name]) in self._at),
            None,
        )
        if points is None:
            raise EngineError("pybullet", "holds a hull without points")
        margin = float(row["m_convexInternalShapeData"]["m_collisionMargin"])
        vertices = points.rows["m_floats"][:, :3].astype(float) * scale
        return [StoredMesh(tuple(vertices.ravel().tolist()), margin)]

    def _field(self, row: np.void) -> tuple[float, ...]:
        """The height field that the triangles of a shape are the boundary of."""
        interface = row["m_meshInterface"]
        parts = self._at.get(int(interface["m_meshPartsPtr"]))
        if parts is None or len(parts.rows) != 1 or _floats(interface["m_scaling"]).tolist() != [1.0, 1.0, 1.0]:
            raise EngineError("pybullet", "holds a mesh of triangles in several parts, or scaled")
        part = parts.rows[0]
        points, indices = (self._at.get(int(part[name])) for name in ("m_vertices3d", "m_indices32"))
        if points is None or indices is None:
            raise EngineError("pybullet", "holds a mesh without triangles")
        try:
            return field_of_triangles(
                points.rows["m_floats"][:, :3][indices.rows["m_value"]].astype(float).reshape(-1, 3, 3)
            )
        except (ValueError, IndexError) as error:
            raise EngineError("pybullet", f"holds triangles that are no height field: {error}") from error


POINTERS = ("m_unscaledPointsDoublePtr", "m_unscaledPointsFloatPtr")


def _floats(vector: np.void) -> NDArray[np.float64]:
    return np.array(vector["m_floats"][:3], dtype=float)


def alike(first: Sequence[float], second: Sequence[float]) -> bool:
    """Whether the hulls of two sets of points (flat) are the same, within what PyBullet keeps of one."""
    points, others = (np.array(flat, dtype=float).reshape(-1, 3) for flat in (first, second))
    if not len(points) or not len(others):
        return False
    kept = KEPT * max(np.ptp(these, axis=0).max() for these in (points, others))
    if any((np.abs(end(points, axis=0) - end(others, axis=0)) > kept).any() for end in (np.min, np.max)):
        return False
    step = max(1, AT_ONCE // max(len(points), len(others)))
    for toward in (these[start : start + step] for these in (points, others) for start in range(0, len(these), step)):
        reach, other_reach = ((toward @ these.T).max(axis=1) for these in (points, others))
        if (np.abs(reach - other_reach) > kept * np.linalg.norm(toward, axis=1)).any():
            return False
    return True


class Alike:
    """Which hulls of a read-back are the same: those that PyBullet names one file for, and those whose points say so, each two
    looked at once. Sizes are compared by identity, and kept as long as this is."""

    def __init__(self) -> None:
        self._file: dict[int, tuple[Sequence[float], object]] = {}
        self._known: dict[tuple[int, int], bool] = {}

    def of_file(self, size: tuple[float, ...], file: object) -> tuple[float, ...]:
        """``size``, known to be of a file with its scale."""
        self._file[id(size)] = (size, file)
        return size

    def __call__(self, size: Sequence[float], other: Sequence[float]) -> bool:
        first, second = (self._file.setdefault(id(points), (points, None)) for points in (size, other))
        if first[1] is not None and first[1] == second[1]:
            return True
        key = (id(size), id(other))
        if key not in self._known:
            self._known[key] = alike(size, other)
        return self._known[key]


# Effects of PyBullet's margin of 1 mm on the shapes of links that are no bases (see ``dialects/pybullet/sidecar.py``).

HALVES: Final[Mapping[str, Callable[[Sequence[float]], float]]] = {
    "box": lambda size: min(size) / 2.0,
    "cylinder": lambda size: min(size[0], size[1] / 2.0),
}
"""The least half (m) of the kinds that have the margin within them, by their size."""
ROUND = ("sphere", "ellipsoid")
"""Kinds of shapes that touch a hull in one point."""
LANDING = Refinement(
    Level.APPROXIMATE,
    "PyBullet adds one contact point in each step to a hull of a link other than the base, so that a hull that lands on a face "
    "tumbles; see docs/engines/pybullet.md",
    short="a hull that lands on a face is stopped at one point first, and tumbles",
)
THICK = {
    kind: Refinement(
        Level.APPROXIMATE,
        "PyBullet keeps a margin of 1 mm on links other than the base, so that boxes, cylinders and meshes are at least 2 mm "
        "thick there",
        short=f"a {kind} thinner than 2 mm, on a link other than the base, is 2 mm thick in contact",
    )
    for kind in ("mesh", *HALVES)
}
"""By the kind of shape."""
DULL = {
    "cylinder": Refinement(
        Level.APPROXIMATE,
        f"PyBullet's contact is up to {1e3 * BLUNT:g} mm inside the curved side of cylinders of 1 to 30 mm length",
        short="contact is slightly inside the curved side of a short cylinder",
    ),
    "mesh": Refinement(
        Level.APPROXIMATE,
        f"PyBullet's contact is up to {1e3 * BLUNT:g} mm inside the faces of hulls with edges shorter than 1 cm",
        short="contact is slightly inside the faces of a hull with short edges",
    ),
}
"""By the kind of shape."""


def meshes_supported(engine: type[Engine], world: World) -> Refinement | None:
    """Not supported where copies of a mesh are within two margins; approximate where hardly anything of one is within the
    margin, or where one on a link with that margin may land on a face, an edge or another mesh."""
    try:
        found = _outside(engine, world, "mesh")
    except ValueError as error:
        return unsupported_if(str(error))
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    lands = any("mesh" in pair and not set(pair) & set(ROUND) for pair in meeting_kinds(world))
    landing = LANDING if lands and not faces_meet(world, plan, _base_margin(engine, world)) else None
    return _together(landing, _blunt("mesh", world), _thick("mesh", found) if found else None)


def thick_enough(engine: type[Engine], kind: str, world: World) -> Refinement | None:
    """Approximate where boxes or cylinders are thinner than the margin that PyBullet keeps within them, and where cylinders
    are so short that their sides are felt inside."""
    found = _outside(engine, world, kind)
    return _together(_blunt(kind, world), _thick(kind, found) if found else None)


def thicker(engine: type[Engine], world: World) -> dict[str, float]:
    """By name the shapes whose faces PyBullet holds elsewhere than they are, and how far (m) outside or inside they are."""
    blunt = dict.fromkeys((shape.name for kind in DULL for shape in blunted(kind, world)), BLUNT)
    thick = {name: size for kind in ("mesh", *HALVES) for name, size in _outside(engine, world, kind).items()}
    return {name: max(blunt.get(name, 0.0), thick.get(name, 0.0)) for name in (blunt | thick)}


def _blunt(kind: str, world: World) -> Refinement | None:
    """Approximate where shapes of a kind are felt inside of where they are."""
    found = list(blunted(kind, world))
    if not found:
        return None
    dull = DULL[kind]
    return Refinement(Level.APPROXIMATE, f"{dull.how} ({found[0].name!r})", short=dull.short)


def _together(*parts: Refinement | None) -> Refinement | None:
    """One of several approximations, or all of them in the order given."""
    found = [part for part in parts if part is not None]
    if len(found) < 2:
        return found[0] if found else None
    how = "; ".join(part.how for part in found if part.how)
    return Refinement(Level.APPROXIMATE, how, short="; ".join(part.short for part in found if part.short))


def _base_margin(engine: type[Engine], world: World) -> float:
    return float(str(resolve_settings(engine, world)["collision_margin"]))


def _outside(engine: type[Engine], world: World, kind: str) -> dict[str, float]:
    """Of shapes of one kind. Raises ValueError for a mesh with an unknown margin."""
    plan, base_margin = contact_plan(world, engine.RULES, engine.LAYERS), _base_margin(engine, world)
    found: dict[str, float] = {}
    for body in world.bodies:
        margins: dict[Shape, set[float]] = {}
        for shape, margin in margins_of(kind, body, plan, base_margin):
            margins.setdefault(shape, set()).add(margin)
        for shape, of_shape in margins.items():
            short = _short(shape, of_shape)
            if short > (SLACK_OF_HALVES if kind in HALVES else 0.0):
                found[shape.name] = short
    return found


def _short(shape: Shape, margins: set[float]) -> float:
    if shape.kind in HALVES:
        return max(margins) - HALVES[shape.kind](shape.size)
    if len(margins) > 1:
        raise ValueError(f"copies of the mesh {shape.name!r} are on links with and without PyBullet's margin")
    try:
        return margin_excess(shape.size, max(margins))
    except HullError as error:
        raise ValueError(f"PyBullet keeps {max(margins):g} m around the mesh {shape.name!r}: {error}") from error


def _thick(kind: str, found: Mapping[str, float]) -> Refinement:
    name = max(found, key=lambda name: found[name])
    thick = THICK[kind]
    how = f"{thick.how}: faces of {name!r} are {1e3 * found[name]:.2g} mm too far outside, the most of any {kind}"
    return Refinement(Level.APPROXIMATE, how, short=thick.short)


# Limits of PyBullet's contact with height fields, world by world.

HOW: Final = (
    "simspec writes a closed surface of triangles, in single precision. PyBullet collides with its inner edges, which "
    "brake and deflect sliding bodies; see docs/engines/pybullet.md"
)


def ground_supported(world: World, plan: ContactPlan, base_margin: float) -> Refinement | None:
    """Not supported where PyBullet would keep a margin around a height field: on other links than bases, and in copies."""
    for body in world.bodies:
        margins = [margin for _, margin in margins_of("heightfield", body, plan, base_margin)]
        if any(margins):
            shape = next(shape.name for shape in body.shapes if shape.kind == "heightfield")
            return unsupported_if(
                f"PyBullet keeps {max(margins):g} m around the height field {shape!r}. Use a massless root body with "
                f"one material, "
                "and collision_margin 0"
            )
    return None
