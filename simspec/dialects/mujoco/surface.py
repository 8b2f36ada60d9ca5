"""The meaning of MJCF's contact numbers: from friction, condim, solref and solimp back to a surface of the world.

For the independent reader of files and for the engine's read-back; it shares nothing with what writes these numbers. Every
contact of MuJoCo obeys a₁ + d (b v + k r) = (1 − d) a₀ (its documentation, "Computation": a₀ the acceleration without the
contact, a₁ with it, d the impedance); a spring-damper is an impedance near zero, a rigid contact one near one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from simspec.formats.mjcf.reading import MjcfDocument, MjcfItem
from simspec.world.types import Hardness, Surface

MUJOCO_DEFAULT = ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0))
"""MuJoCo's own solref and solimp."""
SOFT = 1e-3
"""Impedances below this leave a₀ to the other forces, up to a thousandth: springs. MuJoCo allows 1e-4 to 0.9999."""
ROUND_OFF = 1e-12
"""How far the error reduction, a quotient by the timestep's square, may be from the common law's."""


@dataclass(frozen=True, slots=True)
class CommonLaw:
    """The inputs that identify the common law of a contact: the timestep, and the settings that give it its numbers."""

    timestep: float
    error_reduction: float
    solimps: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, timestep: float, settings: Mapping[str, Any]) -> CommonLaw:
        """From a sidecar's settings; the two impedances are the rigid one, and native friction's with its soft first touch."""
        high, cushion = float(settings["contact_impedance"]), float(settings["friction_cushion"])
        rigid = (high, high, 0.001, 0.5, 2.0)
        soft = () if settings["friction"] == "coulomb" else ((0.01, high, cushion, 0.5, 2.0),)
        return cls(timestep, float(settings["contact_error_reduction"]), (rigid, *soft))


def surface(
    condim: int,
    friction: Sequence[float],
    solref: Sequence[float],
    solimp: Sequence[float],
    common: CommonLaw,
    inverse_mass: float = 1.0,
) -> Surface:
    """The surface that one geom or one explicit pair holds.

    ``friction``: sliding, torsional, rolling.
    ``inverse_mass`` (1/kg): of an explicit pair the sum of both bodies'; a geom holds what it would be at 1 kg.
    """
    hardness = _hardness(solref, solimp, common, inverse_mass)
    return Surface(
        float(friction[0]) if condim >= 3 else 0.0,
        float(friction[1]) if condim >= 4 else 0.0,
        float(friction[2]) if condim >= 6 else 0.0,
        _restitution(float(solref[1]), common.timestep) if hardness.kind == "common" else 0.0,
        hardness,
    )


def _restitution(damping: float, timestep: float) -> float:
    """The damping of the common law's reference, per step, is one plus the restitution: the shortest number of which it is."""
    restitution = 0.0 - damping * timestep - 1.0
    # at timesteps of 13 ms and others the product rounds to 1 - 1e-16
    shortest = round(restitution, 14) + 0.0
    return shortest if 0.0 - (1.0 + shortest) / timestep == damping else restitution


def _hardness(solref: Sequence[float], solimp: Sequence[float], common: CommonLaw, inverse_mass: float) -> Hardness:
    stiffness, damping = (float(value) for value in solref)
    if (tuple(solref), tuple(solimp)) == MUJOCO_DEFAULT:
        return Hardness("native")
    constant = solimp[0] == solimp[1]
    if constant and stiffness > 0.0 and solimp[0] <= SOFT:
        return Hardness("time-constant", time_constant=stiffness, damping_ratio=damping)
    taken_back = 0.0 - stiffness * common.timestep * common.timestep
    if tuple(solimp) in common.solimps and abs(taken_back - common.error_reduction) <= ROUND_OFF:
        return Hardness("common")
    # a spring-damper by what holds a load: its depth is (1 − d) a₀ / k
    yielding = inverse_mass * (1.0 - solimp[0])
    if not yielding:
        return Hardness("stiffness")
    return Hardness("stiffness", stiffness=0.0 - stiffness / yielding, damping=0.0 - damping / yielding)


# From meshes and height fields of an MJCF document back to those of a world; shares no code with what writes them.

IN_MESH: Final = {"name", "file", "inertia"}
"""The attributes of a mesh. Others would scale, move or cut it."""
MESH_FOLDERS: Final = {"meshdir", "assetdir", "strippath"}
"""Attributes of the compiler that change which file a name means."""
IN_FIELD: Final = {"name", "nrow", "ncol", "size", "elevation"}
"""The attributes of a height field."""
MOST_POINTS: Final = 1_000_000
"""Points of one height field that are read."""


Sizes = dict[str, tuple[float, ...]]
"""Sizes of shapes by the names of what they are."""


def read_assets(document: MjcfDocument) -> tuple[Sizes, Sizes]:
    """The meshes and the height fields of a document. Raises ValueError for what is not read."""
    if document.section("asset") and (moved := MESH_FOLDERS & document.compiler.stated.keys()):
        raise document.compiler.refused(f"{min(moved)} is not read")
    meshes, fields, files = Sizes(), Sizes(), set[str]()
    for item in document.section("asset"):
        if item.tag == "hfield":
            name, size = _height_field(item)
            if fields.setdefault(name, size) is not size:
                raise item.refused("a second height field of its name")
            continue
        if item.tag != "mesh" or item.values.keys() != IN_MESH or item.element.children:
            raise item.refused(f"is not read, but for meshes that have {', '.join(sorted(IN_MESH))} and nothing else")
        name, file = item.text("name"), item.text("file")
        if name in meshes or file not in document.meshes:
            raise item.refused(f"a second mesh of its name, or without its file {file[:60]!r}")
        if item.text("inertia") != "convex":
            raise item.refused("inertia should be convex")
        meshes[name] = document.meshes[file]
        files.add(file)
    if unused := document.meshes.keys() - files:
        raise ValueError(f"{document.file}: no mesh has the files {sorted(unused)}")
    return meshes, fields


def _height_field(item: MjcfItem) -> tuple[str, tuple[float, ...]]:
    """The name and the size (``world/shapes.py``) of a height field. Raises ValueError where its elevations are not what
    every reader leaves as it is: shares from 0 to 1, or 0 throughout."""
    if item.values.keys() != IN_FIELD or item.element.children:
        raise item.refused(f"is not read, but with {', '.join(sorted(IN_FIELD))} and nothing else")
    rows, columns = (item.number(name) for name in ("nrow", "ncol"))
    if not all(2.0 <= count <= MOST_POINTS and count == int(count) for count in (rows, columns)):
        raise item.refused(f"{rows:g} rows and {columns:g} columns")
    if rows * columns > MOST_POINTS:
        raise item.refused(f"{rows:g} × {columns:g} points, more than the {MOST_POINTS:,} that are read")
    half_x, half_y, top, base = item.numbers("size", 4)
    shares = item.numbers("elevation", int(rows * columns))
    if min(shares) != 0.0 or max(shares) not in (0.0, 1.0):
        raise item.refused(f"its elevations are from {min(shares):g} to {max(shares):g}, should be from 0 to 1")
    wide = int(columns)
    northward = [shares[wide * row : wide * (row + 1)] for row in reversed(range(int(rows)))]
    heights = (top * share for row in northward for share in row)
    return item.text("name"), (rows, columns, 2.0 * half_x, 2.0 * half_y, base, *heights)
