"""The compiled model of an MJCF file, as plain numbers: made in a process of its own, by a compiler that an entry point offers.

Nothing of the physics is read from the XML: angles, frames, classes, inertias from shapes, and what a compiler bounds or
balances are all in these numbers. The XML is read for places, and for what is not carried.
"""

from __future__ import annotations

import functools
import json
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from simspec.errors import Problem, SpecError
from simspec.imports.child import ChildError, Policy, run
from simspec.imports.elements import Element
from simspec.imports.mjcf.assembly import Assembly
from simspec.plugins import Offered, offered
from simspec.reading import NotReadableError, parse_json

GROUP: Final = "simspec.mjcf_compilers"
"""The entry points of compilers."""
SECONDS: Final = 8
"""CPU time of the compiler; 95 % of the models of the measured corpora take under 1 s."""
PATIENCE: Final = 60.0
"""s by the clock, on a busy machine."""
POLICY: Final = Policy("data")
"""It gets all files by its input."""
MEMORY: Final = 900 * 2**20
"""Bytes of the compiler's process."""

FREE, BALL, SLIDE, HINGE = 0, 1, 2, 3
"""Types of joints."""


@runtime_checkable
class Compiler(Protocol):
    """A program that compiles MJCF; see the entry point's own for what it is told and answers. It has two functions without
    parameters: ``prepare`` imports what it needs and limits itself, ``main`` answers; in between the kernel confines it."""

    PROGRAM: ClassVar[Path]
    EXTRA: ClassVar[str]

    @classmethod
    def version(cls) -> str | None:
        """The installed version; None where it is not installed."""


@dataclass(frozen=True)
class Part:
    """An element of the compiled model: its name (empty: none) and the element of the file that it comes from."""

    name: str
    element: Element


@dataclass(frozen=True)
class MeshFile:
    """A mesh: its file (None: it has none), what is done to the file's vertices v, ``scale (R(turn)ᵀ (v − origin))``, the
    number of faces, of vertices of its hull (at most), and the extent along its own axes (m)."""

    path: Path | None
    scale: tuple[float, ...]
    origin: tuple[float, ...]
    turn: tuple[float, ...]
    faces: int
    hull: int
    extent: tuple[float, ...]


def _mesh_file(mesh: Mapping[str, Any], assembly: Assembly) -> MeshFile:
    scale, origin, turn, extent = (tuple(mesh[word]) for word in ("scale", "refpos", "refquat", "extent"))
    path = assembly.mesh_files.get(mesh["file"])
    return MeshFile(path, scale, origin, turn, mesh["faces"], mesh["hull"], extent)


class Compiled:
    """The compiled model: ``self["body_pos"]`` is an array as the compiler calls it; ``parts`` by kind and number."""

    def __init__(self, answer: Mapping[str, Any], assembly: Assembly):
        model = answer["model"]
        self.version = str(answer["version"])
        self.major = int(self.version.partition(".")[0])
        self.numbers: dict[str, int] = model["numbers"]
        self.options: dict[str, Any] = model["options"]
        self._arrays: dict[str, NDArray[Any]] = {name: np.asarray(value) for name, value in model["arrays"].items()}
        self.root = assembly.root
        self.parts: dict[str, dict[int, Part]] = {}
        for kind, rows in model["elements"].items():
            parts = self.parts.setdefault(kind, {})
            for name, line, number in rows:
                parts[number] = Part(name, assembly.lines.get(line, assembly.root))
        self.meshes: dict[int, MeshFile] = {
            int(number): _mesh_file(mesh, assembly) for number, mesh in model["meshes"].items()
        }
        self.field_files: dict[int, Path] = {
            int(number): assembly.named[name] for number, name in model["hfields"].items() if name in assembly.named
        }
        """The files of height fields, by number."""
        self.stable_step: float | None = model["stable_step"]
        """s; the longest at which explicit dampers and springs do not diverge, None where there are none."""
        self.dynamics: list[dict[str, Any]] = answer.get("dynamics", [])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    def get(self, name: str) -> NDArray[Any] | None:
        """An array that some versions do not have."""
        return self._arrays.get(name)

    def part(self, kind: str, number: int) -> Part:
        """An element by its number; where the compiler made it by itself, nameless and of the outermost element."""
        return self.parts[kind].get(number) or Part("", self.root)

    def disabled(self, *names: str) -> bool:
        """Whether one of these flags is switched off."""
        return any(name in self.options["disabled"] for name in names)

    def enabled(self, name: str) -> bool:
        """Whether one of the flags is switched on that are off by default."""
        return name in self.options["enabled"]

    @property
    def has_fluid(self) -> bool:
        """Whether a fluid acts on bodies: without springs and dampers no passive force does (measured)."""
        present = self.options["density"] or self.options["viscosity"]
        return bool(present) and not (self.disabled("spring") and self.disabled("damper"))

    def joints_of(self, body: int) -> range:
        """The numbers of a body's joints."""
        first = int(self["body_jntadr"][body])
        return range(first, first + int(self["body_jntnum"][body]))


Random = tuple[int, int, float]
"""How many random states, the seed of their generator, and the spread of positions about the reference (rad, m)."""


@functools.cache
def compilers() -> Offered:
    """The compilers that are offered."""

    def check(name: str, loaded: Any) -> Compiler:
        if not isinstance(loaded, Compiler):
            raise TypeError(f"{name} is no compiler: it needs PROGRAM, EXTRA and version")
        return loaded

    return offered(GROUP, check)


def _compiler(root: Element) -> Compiler:
    extras = []
    for compiler in compilers().good.values():
        if compiler.version() is not None:
            chosen: Compiler = compiler
            return chosen
        extras.append(compiler.EXTRA)
    hint = f"pip install 'simspec[{extras[0]}]'" if extras else None
    raise root.error("MJCF is imported by way of its own compiler, which is not installed", hint=hint)


def compile_model(assembly: Assembly, states: Random | None = None) -> Compiled:
    """The compiled model; with ``states``, also its dynamics in some. Raises SpecError where the compiler refuses it, is not
    installed, or takes more time or memory than is allowed."""
    root = assembly.root
    compiler = _compiler(root)
    asked: dict[str, Any] = {"files": [[name, len(content)] for name, content in assembly.texts.items()]}
    if states is not None:
        asked["random"] = states
    head = json.dumps(asked).encode()
    told = b"".join((struct.pack("<Q", len(head)), head, *assembly.texts.values()))
    try:
        answered = run(compiler.PROGRAM, (str(SECONDS), str(MEMORY)), told, PATIENCE, POLICY)
        answer = parse_json(answered)
    except (ChildError, NotReadableError) as error:
        raise root.error(f"the compiler of this model gave no answer: {error}") from None
    if "error" in answer:
        raise SpecError([_refused(str(answer["error"]), assembly)])
    return Compiled(answer, assembly)


_LINE = re.compile(r",?\s*\bline (\d+)(, column \d+)?")


def _refused(error: str, assembly: Assembly) -> Problem:
    """What the compiler says, at the element that it means; its own lines are not the file's."""
    element = assembly.root
    match = _LINE.search(error)
    if match:
        element = assembly.lines.get(int(match[1]), element)
    text = " ".join(_LINE.sub("", error).split())
    for name, path in assembly.named.items():
        text = text.replace(name, path.name)
    return element.problem(f"the compiler of this model refuses it: {text[:500]}")
