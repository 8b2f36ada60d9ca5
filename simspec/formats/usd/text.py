"""Prims as the text of a file (``.usda``), as a binary file or a package: the same prims give the same bytes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from simspec.errors import Problem, SpecError
from simspec.files import scratch_folder
from simspec.formats.kit.text import number


@dataclass(frozen=True, slots=True)
class UsdProperty:
    """An attribute or a relationship: its type (``double3``, ``rel``), its name, its value. Numbers of the types of single
    precision are rounded when they are written; a value of None is not written."""

    type: str
    name: str
    value: Any
    uniform: bool = False
    custom: bool = False


@dataclass(slots=True)
class UsdPrim:
    """A prim: its name, its type ("" for none), the schemas that are applied to it, its properties, and what is in it."""

    name: str
    type: str = ""
    schemas: list[str] = field(default_factory=list)
    properties: list[UsdProperty] = field(default_factory=list)
    children: list[UsdPrim] = field(default_factory=list)

    def apply(self, *schemas: str) -> None:
        """Apply schemas, each once."""
        self.schemas += [schema for schema in schemas if schema not in self.schemas]

    def say(self, type: str, name: str, value: Any) -> None:
        """Give an attribute of a schema a value."""
        self.properties.append(UsdProperty(type, name, value))

    def uniform(self, name: str, value: str) -> None:
        """Give a word that does not change in time."""
        self.properties.append(UsdProperty("token", name, value, uniform=True))

    def relate(self, name: str, targets: list[str]) -> None:
        """Give a relationship its targets."""
        self.properties.append(UsdProperty("rel", name, targets))

    def custom(self, type: str, name: str, value: Any) -> None:
        """Say in an attribute of simspec's own what the schemas' attributes say in single precision, or not at all."""
        self.properties.append(UsdProperty(type, f"simspec:{name}", value, custom=True))


@dataclass(frozen=True, slots=True)
class UsdStage:
    """A whole file: its one outermost prim, and the name of the world."""

    name: str
    root: UsdPrim


SINGLE: Final = frozenset(("float", "float2", "float3", "vector3f", "point3f", "color3f", "quatf"))
"""Types whose numbers have single precision."""
HEAD: Final = """#usda 1.0
(
    defaultPrim = "{root}"
    kilogramsPerUnit = 1
    metersPerUnit = 1
    upAxis = "Z"
)
"""


def text(stage: UsdStage) -> str:
    """The file. Raises ValueError for numbers that are not finite, other than limits, or too large for their type."""
    lines = [HEAD.format(root=stage.root.name)]
    # not by recursion: a chain of bodies may be deeper than Python's stack
    waiting: list[tuple[UsdPrim | None, int]] = [(stage.root, 0)]
    while waiting:
        prim, depth = waiting.pop()
        space = "    " * depth
        if prim is None:
            lines.append(f"{space}}}")
            continue
        lines += [f"{space}{line}" for line in _begin(prim)]
        waiting.append((None, depth))
        waiting.extend((child, depth + 1) for child in reversed(prim.children))
    return "\n".join(lines) + "\n"


def _begin(prim: UsdPrim) -> Iterator[str]:
    """The lines of a prim before what is in it."""
    kind = f"{prim.type} " if prim.type else ""
    yield f"def {kind}{_quoted(prim.name)}" + (" (" if prim.schemas else "")
    if prim.schemas:
        yield f"    prepend apiSchemas = [{', '.join(map(_quoted, prim.schemas))}]"
        yield ")"
    yield "{"
    for item in prim.properties:
        if item.value is not None:
            yield f"    {_property(item)}"


def _property(item: UsdProperty) -> str:
    words = " ".join((*(("custom",) if item.custom else ()), *(("uniform",) if item.uniform else ()), item.type))
    return f"{words} {item.name} = {_value(item.type, item.value)}"


def _value(kind: str, value: Any) -> str:
    if kind == "rel":
        targets = [f"<{target}>" for target in value]
        return targets[0] if len(targets) == 1 else f"[{', '.join(targets)}]"
    if kind.endswith("[]"):
        return f"[{', '.join(_value(kind[:-2], item) for item in value)}]"
    if kind == "bool":
        return "true" if value else "false"
    if kind == "int":
        return str(value)
    if kind in ("token", "string"):
        return _quoted(value)
    write = _single if kind in SINGLE else _double
    if isinstance(value, Sequence):
        return f"({', '.join([write(item) for item in value])})"
    return write(value)


def _double(value: float) -> str:
    return number(value)


def _single(value: float) -> str:
    """The shortest text of the nearest number of single precision; infinity stands for no limit."""
    if math.isinf(value):
        return "inf" if value > 0.0 else "-inf"
    with np.errstate(over="ignore"):
        rounded = np.float32(value)
    if not np.isfinite(rounded):
        raise ValueError(f"{value} cannot be written in single precision")
    short = str(rounded + np.float32(0.0))
    return short[:-2] if short.endswith(".0") else short


def _quoted(words: str) -> str:
    escaped = words.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


# --- binary files and packages; usd-core writes them ---

TEXT: Final = ".usda"
BINARY: Final = ".usdc"
PACKAGE: Final = ".usdz"
INSIDE: Final = "world.usdc"
"""The file in a package. Meshes are prims of it, so that nothing else is in the package and no path leads out of it."""


def encoded(text: str, suffix: str) -> bytes:
    """The bytes of a file of this kind. Raises SpecError where usd-core is not installed."""
    if suffix == TEXT:
        return text.encode()
    try:
        from pxr import Sdf
    except ImportError:
        hint = f"pip install 'simspec-physics[usd]'; {TEXT} needs nothing"
        raise SpecError(
            [Problem(f"{suffix} is written by usd-core, which is not installed", hint=hint, code="C110")]
        ) from None
    layer = Sdf.Layer.CreateAnonymous(TEXT)
    with scratch_folder("usd") as folder:
        inside = folder / INSIDE
        if not (layer.ImportFromString(text) and layer.Export(str(inside))):
            raise ValueError("usd-core does not take the text that simspec wrote")
        if suffix == BINARY:
            return inside.read_bytes()
        package = folder / f"package{PACKAGE}"
        with Sdf.ZipFileWriter.CreateNew(str(package)) as writer:
            writer.AddFile(str(inside), INSIDE)
        return package.read_bytes()
