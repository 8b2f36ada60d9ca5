"""Defects to plant into compiled files, to see whether the proof notices: the names, and the tools to edit files with.

Each format has a module ``<format>_defects`` with a table DEFECTS: for every name of ``NAMES`` a function from files to
files with that one defect in them, or a sentence saying why files of this format cannot have it. The worlds they are planted
into are those of ``proof/selftest_worlds.py``.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable, Mapping
from typing import Any, Final
from xml.etree import ElementTree

from simspec.dialects.kit.sidecar import SIDECAR, sidecar_text
from simspec.formats.kit.contract import tensor
from simspec.formats.kit.text import number, numbers
from simspec.world import frames

Files = Mapping[str, str]
Plant = Callable[[Files], dict[str, str]]

MARGINS = ("margin", "margin of a pair", "margin dropped", "margin of two materials")
"""Those of contact margins."""
BELTS = ("surface velocity", "surface velocity, sign", "surface velocity dropped", "surface velocity, angular")
"""Those of surfaces that move."""
FRAMES = ("frame, position", "frame, orientation", "frame on another body", "frame dropped")
"""Those of named frames."""
GROUND = (
    *("height field, a height", "height field, length", "height field, base", "height field, mirrored"),
    "height field missing",
)
"""Those of height fields."""
NAMES: Mapping[str, str] = {
    "mass": "model",
    "centre of mass": "model",
    "inertia, diagonal": "model",
    "inertia, sign of a product": "model",
    "body dropped": "model",
    "joint type": "model",
    "axis": "model",
    "axis reversed": "model",
    "joint origin, position": "model",
    "joint origin, orientation": "model",
    "position limit": "model",
    "position limit dropped": "model",
    "velocity limit": "model",
    "effort limit": "model",
    "damping": "model",
    "spring stiffness": "model",
    "spring rest": "model",
    "dry friction": "dry friction",
    "armature": "armature",
    "ball damping": "ball joint",
    "ball armature": "ball armature",
    "ball spring": "ball joint",
    "ball limit": "ball limit",
    "ball limit dropped": "ball limit",
    "gravity scale": "lifted",
    "gravity scale dropped": "lifted",
    "free damping": "lifted",
    "free damping, of rotation": "lifted",
    "free armature": "free armature",
    "fluid, density": "immersed",
    "fluid, viscosity": "immersed",
    "fluid, velocity reversed": "immersed",
    "fluid, a box": "immersed",
    "fluid, axes of a box": "immersed",
    "fluid dropped": "immersed",
    "initial position": "model",
    "initial velocity": "model",
    "shape type": "model",
    "shape size": "model",
    "shape position": "model",
    "shape orientation": "model",
    "shape not solid": "model",
    "mesh, a vertex": "meshes",
    "mesh, scale": "meshes",
    "mesh, mirrored": "meshes",
    "mesh of another shape": "meshes",
    "mesh missing": "meshes",
    "mesh, margin": "meshes",
    "meshes in another order": "meshes",
    **dict.fromkeys(GROUND, "ground"),
    **dict.fromkeys(MARGINS, "margins"),
    **dict.fromkeys(BELTS, "belts"),
    "friction": "model",
    "restitution": "bouncing",
    "pair value": "surfaces",
    "cone": "surfaces",
    "hardness": "surfaces",
    "copy filter": "surfaces",
    "passing pair": "surfaces",
    "torsional friction": "rolling",
    "rolling friction": "rolling",
    "excluded pair dropped": "model",
    "excluded pair too many": "model",
    "collision group": "model",
    "excluded pair of a mechanism dropped": "model",
    "excluded pair of a mechanism too many": "model",
    "group filter dropped": "model",
    "coupling, ratio": "held",
    "coupling, offset": "held",
    "coupling, sign": "held",
    "coupling, leader": "held",
    "held point": "held",
    "weld, orientation": "held",
    "constraint dropped": "held",
    "sum, coefficient": "sums",
    "sum, stiffness": "sums",
    "sum, rest": "sums",
    "sum, damping": "sums",
    "sum dropped": "sums",
    "sum, dry friction": "sum friction",
    "sum, limit": "sum limits",
    "sum, limits dropped": "sum limits",
    **dict.fromkeys(FRAMES, "frames"),
    "gravity": "model",
    "timestep": "model",
}
"""The name of each defect, and the world it is planted into.

In the world "surfaces": *pair value* the friction of ice with rubber, halved; *cone* another than the world's; *hardness*
contact ten times as soft; *copy filter* copies of two shapes, or an explicit pair, that act where another pair of materials
should; *passing pair* ghost and ice touch. In "rolling": the number of the pair, halved.
"""

STEP = 1e-3
"""How far a planted length, angle or share is off: a slip of the pen, a million times the proof's tolerance."""


def xml(path: str, change: Callable[[ElementTree.Element], None]) -> Plant:
    """A defect made by changing the XML tree of one file."""

    def plant(files: Files) -> dict[str, str]:
        root = ElementTree.fromstring(files[path])
        before = ElementTree.tostring(root)
        change(root)
        after = ElementTree.tostring(root, encoding="unicode")
        if after.encode() == before:
            raise ValueError(f"the defect changed nothing in {path}")
        return {**files, path: '<?xml version="1.0" encoding="utf-8"?>\n' + after + "\n"}

    return plant


def sidecar(change: Callable[[dict[str, Any]], None]) -> Plant:
    """A defect made by changing the sidecar."""

    def plant(files: Files) -> dict[str, str]:
        content = json.loads(files[SIDECAR])
        change(content)
        text = sidecar_text(content)
        if text == files[SIDECAR]:
            raise ValueError("the defect changed nothing in the sidecar")
        return {**files, SIDECAR: text}

    return plant


def _constraint(name: str, change: Callable[[dict[str, Any]], None]) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        change(next(entry for entry in content["constraints"] if entry["name"] == name))

    return sidecar(edit)


def _changed(name: str, key: str, change: Callable[[Any], Any]) -> Plant:
    return _constraint(name, lambda entry: entry.update({key: change(entry[key])}))


def _dropped(name: str) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        content["constraints"] = [entry for entry in content["constraints"] if entry["name"] != name]

    return sidecar(edit)


def _turned(entry: dict[str, Any]) -> None:
    turn = frames.from_axis_angle((1.0, 0.0, 0.0), STEP)
    entry["pose"]["quaternion"] = list(frames.multiply(tuple(entry["pose"]["quaternion"]), turn))


CONSTRAINTS: Mapping[str, Plant] = {
    "coupling, ratio": _changed("mirror", "ratio", lambda ratio: ratio * (1.0 + STEP)),
    "coupling, offset": _changed("mirror", "offset", lambda offset: offset + STEP),
    "coupling, sign": _changed("mirror", "ratio", lambda ratio: -ratio),
    "coupling, leader": _changed("mirror", "leader", lambda _: "crank_joint"),
    "held point": _changed("pin", "first_point", lambda point: [point[0] + STEP, *point[1:]]),
    "weld, orientation": _constraint("glue", _turned),
    "constraint dropped": _dropped("glue"),
}
"""For dialects whose sidecar has the constraints."""


def _sum(change: Callable[[dict[str, Any]], None]) -> Plant:
    return sidecar(lambda content: change(content["sums"][0]))


def _first_longer(entry: dict[str, Any]) -> None:
    entry["joints"][0][1] += STEP


SUMS: Mapping[str, Plant] = {
    "sum, coefficient": _sum(_first_longer),
    "sum, stiffness": _sum(lambda entry: entry.update(stiffness=entry["stiffness"] * (1.0 + STEP))),
    "sum, rest": _sum(lambda entry: entry.update(rest=entry["rest"] + STEP)),
    "sum, damping": _sum(lambda entry: entry.update(damping=entry["damping"] * (1.0 + STEP))),
    "sum dropped": sidecar(lambda content: content.update(sums=[])),
    "sum, dry friction": _sum(lambda entry: entry.update(dry_friction=entry["dry_friction"] * (1.0 + STEP))),
    "sum, limit": _sum(lambda entry: entry["position_limits"].__setitem__(1, entry["position_limits"][1] + STEP)),
    "sum, limits dropped": _sum(lambda entry: entry.update(position_limits=None)),
}
"""For dialects whose sidecar has the sums of joint positions."""


def _scale(content: dict[str, Any]) -> None:
    content["passive"]["gravity_scales"][0]["scale"] += STEP


def _no_scale(content: dict[str, Any]) -> None:
    del content["passive"]["gravity_scales"][1]


def _free_damping(key: str) -> Plant:
    def edit(content: dict[str, Any]) -> None:
        content["passive"]["free_damping"][0][key] *= 1.0 + STEP

    return sidecar(edit)


def _around(change: Callable[[dict[str, Any]], None]) -> Plant:
    return sidecar(lambda content: change(content["passive"]["around"]))


PASSIVE: Mapping[str, Plant] = {
    "gravity scale": sidecar(_scale),
    "gravity scale dropped": sidecar(_no_scale),
    "free damping": _free_damping("linear"),
    "free damping, of rotation": _free_damping("angular"),
    "fluid, density": _around(lambda around: around["fluid"].update(density=around["fluid"]["density"] * (1.0 + STEP))),
    "fluid, viscosity": _around(
        lambda around: around["fluid"].update(viscosity=around["fluid"]["viscosity"] * (1.0 + STEP))
    ),
    "fluid, velocity reversed": _around(
        lambda around: around["fluid"].update(velocity=[-value for value in around["fluid"]["velocity"]])
    ),
    "fluid, a box": _around(lambda around: around["boxes"][1]["box"].update(edges=around["boxes"][0]["box"]["edges"])),
    "fluid, axes of a box": _around(lambda around: around["boxes"][0]["box"].update(quaternion=[1.0, 0.0, 0.0, 0.0])),
    "fluid dropped": sidecar(lambda content: content.pop("passive")),
}
"""For dialects whose sidecar has what acts on bodies at all times."""


def element_at(root: ElementTree.Element, path: str) -> ElementTree.Element:
    """The one element at ``path``. Raises LookupError when there is none."""
    found = root.find(path)
    if found is None:
        raise LookupError(f"no element {path}")
    return found


def floats(text: str | None) -> list[float]:
    """The numbers of an attribute or a text."""
    return [float(part) for part in (text or "").split()]


def nudged(text: str | None, index: int = 0, by: float = STEP) -> str:
    """The same numbers with one of them moved by ``by``."""
    values = floats(text)
    values[index] += by
    return numbers(values)


def scaled(text: str | None, index: int = 0, by: float = 1.0 + STEP) -> str:
    """The same numbers with one of them scaled."""
    values = floats(text)
    values[index] *= by
    return numbers(values)


def turned_axis(text: str | None) -> str:
    """A unit axis turned a little about x (about y where it is x itself)."""
    axis = tuple(floats(text))
    about = (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0)
    return numbers(frames.rotate(frames.from_axis_angle(about, STEP), axis))  # type: ignore[arg-type]


def flipped_product(moments: tuple[float, ...], turn: tuple[float, ...]) -> tuple[float, ...]:
    """The tensor (xx, yy, zz, xy, xz, yz) of principal moments and axes, with the sign of Ixy flipped."""
    xx, yy, zz, xy, xz, yz = tensor(moments, turn)  # type: ignore[arg-type]
    return (xx, yy, zz, -xy, xz, yz)


def text_of(value: float) -> str:
    """One number as formats print it."""
    return number(value)


# Defects of meshes, for every dialect whose files name OBJ files: faults of the file, and of the references to it.
#
# They are planted into the world "meshes" (``proof/selftest_worlds.py``), whose last body has two shapes of different hulls.

SUFFIX: Final = ".obj"

Rows = list[list[str]]
"""The lines of a file, by their words."""


def _meshes(files: Files) -> list[str]:
    """The names of the mesh files. Raises LookupError where there are not two."""
    names = sorted(name for name in files if name.endswith(SUFFIX))
    if len(names) < 2:
        raise LookupError(f"{len(names)} mesh files, not two or more")
    return names


def edited(change: Callable[[Rows], None]) -> Plant:
    """A defect in the lines of the first mesh file."""

    def plant(files: Files) -> dict[str, str]:
        name = _meshes(files)[0]
        rows = [line.split() for line in files[name].splitlines() if not line.startswith("#")]
        change(rows)
        return {**files, name: "".join(" ".join(row) + "\n" for row in rows)}

    return plant


def _moved(rows: Rows) -> None:
    vertex = next(row for row in rows if row[0] == "v")
    vertex[1] = str(float(vertex[1]) + STEP)


def _times(x: float, y: float, z: float) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in rows:
            if row[0] == "v":
                row[1:] = numbers(float(word) * by for word, by in zip(row[1:], (x, y, z), strict=True)).split()
            elif row[0] == "f" and x * y * z < 0.0:  # seen from outside again
                row[1:] = row[:0:-1]

    return change


def _exchanged(files: Files) -> dict[str, str]:
    first, second, *_ = _meshes(files)
    return {**files, first: files[second], second: files[first]}


def _without(files: Files) -> dict[str, str]:
    missing = _meshes(files)[0]
    return {name: text for name, text in files.items() if name != missing}


def reordered(file: str, name: str) -> Plant:
    """Two shapes of a body exchange their meshes: the last two that follow each other and differ. ``name``: a pattern of what
    names a mesh in ``file``, with the name as its group."""

    def plant(files: Files) -> dict[str, str]:
        text = files[file]
        match_, other = [
            pair for pair in itertools.pairwise(re.finditer(name, text)) if pair[0].group(1) != pair[1].group(1)
        ][-1]
        (a, b), (c, d) = match_.span(1), other.span(1)
        return {**files, file: text[:a] + other.group(1) + text[b:c] + match_.group(1) + text[d:]}

    return plant


FILES: Final[Mapping[str, Plant]] = {
    "mesh, a vertex": edited(_moved),
    "mesh, scale": edited(_times(1.0 + STEP, 1.0 + STEP, 1.0 + STEP)),
    "mesh, mirrored": edited(_times(-1.0, 1.0, 1.0)),
    "mesh of another shape": _exchanged,
    "mesh missing": _without,
}
"""The defects of the files themselves."""
