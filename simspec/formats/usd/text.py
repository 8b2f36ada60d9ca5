"""Prims as the text of a file (``.usda``): the same prims give the same bytes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from simspec.formats.kit.text import number
from simspec.formats.usd.tree import Prim, Property, Stage

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


def text(stage: Stage) -> str:
    """The file. Raises ValueError for numbers that are not finite, other than limits, or too large for their type."""
    lines = [HEAD.format(root=stage.root.name)]
    # not by recursion: a chain of bodies may be deeper than Python's stack
    waiting: list[tuple[Prim | None, int]] = [(stage.root, 0)]
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


def _begin(prim: Prim) -> Iterator[str]:
    """The lines of a prim before what is in it."""
    kind = f"{prim.type} " if prim.type else ""
    yield f"def {kind}{_quoted(prim.name)}" + (" (" if prim.schemas else "")
    if prim.schemas:
        yield f"    prepend apiSchemas = [{', '.join(map(_quoted, prim.schemas))}]"
        yield ")"
    yield "{"
    for held in prim.properties:
        if held.value is not None:
            yield f"    {_property(held)}"


def _property(held: Property) -> str:
    words = " ".join((*(("custom",) if held.custom else ()), *(("uniform",) if held.uniform else ()), held.type))
    return f"{words} {held.name} = {_value(held.type, held.value)}"


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
