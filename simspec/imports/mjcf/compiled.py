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
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from simspec.errors import Problem, SpecError
from simspec.files import NotReadableError, parse_json
from simspec.imports.child import ChildError, Policy, run
from simspec.imports.elements import APPEARANCE, HARDNESS_HINT, HOW_HARD, INFORMATION, PHYSICS, Element
from simspec.imports.mjcf.assembly import MjcfAssembly
from simspec.language.foreign import LossSeverity
from simspec.plugins import Plugins

# They are found in the compiled numbers: a value of a class of defaults counts like an attribute, and one without effect is no
# loss.

_LISTED: Final = "a distance at which contact is listed, without a force: nothing is felt of it"
_AT_CENTRE: Final = (
    "of a free body the language has it at the centre of mass, and the file at another point, the origin of its frame"
)


class MjcfFeature(NamedTuple):
    """``attributes``: where files say it, as ``tag/attribute``; ``*`` for an element itself."""

    attributes: str
    severity: LossSeverity
    reason: str
    hint: str = ""


FEATURES: Final = {
    "body.mocap": MjcfFeature("body/mocap", INFORMATION, "a body that a program moves: here it stands where it is"),
    "body.mocap_start": MjcfFeature(
        "body/pos body/quat",
        INFORMATION,
        "a body that a program moves begins where the loop that holds it is closed: joints of the other body begin at their "
        "limits, since the reference is beyond them",
    ),
    "body.gravcomp": MjcfFeature(
        "body/gravcomp joint/actuatorgravcomp",
        PHYSICS,
        "actuators with a largest effort take the weight away: in the language it is away, whatever they do",
    ),
    "joint.start": MjcfFeature(
        "joint/range joint/ref",
        INFORMATION,
        "the reference position is beyond the limits: a run begins at the nearest limit",
        "position: of the joint, in the spec, or positions: where the model is placed",
    ),
    "joint.margin": MjcfFeature(
        "joint/margin",
        INFORMATION,
        "the distance at which a limit begins to act is not in the language: limits are hard",
    ),
    "joint.effort_range": MjcfFeature(
        "joint/actuatorfrcrange joint/actuatorfrclimited", PHYSICS, "limits of effort are symmetric in the language"
    ),
    "joint.free_damping": MjcfFeature("joint/damping freejoint/*", PHYSICS, _AT_CENTRE),
    "joint.free_spring": MjcfFeature("joint/stiffness freejoint/*", PHYSICS, "free bodies have no springs"),
    "joint.dry_friction": MjcfFeature("joint/frictionloss", PHYSICS, "only hinges and slides have dry friction"),
    "joint.armature": MjcfFeature("joint/armature freejoint/*", PHYSICS, _AT_CENTRE),
    "joint.ball_limit": MjcfFeature("joint/range joint/limited", PHYSICS, "a ball whose largest angle is 0 is fixed"),
    "joint.polynomial": MjcfFeature(
        "joint/stiffness joint/damping", PHYSICS, "springs and dampers are linear in the language"
    ),
    "joint.plastic": MjcfFeature("joint/springyield", PHYSICS, "springs that yield are not in the language"),
    "geom.kind": MjcfFeature(
        "geom/type geom/mesh geom/hfield",
        PHYSICS,
        "a collision shape of a kind that the language does not have yet; a height field that may move, or is too large",
    ),
    "geom.appearance": MjcfFeature(
        "geom/type geom/mesh geom/hfield", APPEARANCE, "a visual shape of a kind that the language does not have yet"
    ),
    "geom.hull": MjcfFeature(
        "geom/mesh",
        PHYSICS,
        "a hull of more vertices than the language has: it is the hull of those that change it most",
    ),
    "geom.drawn_hull": MjcfFeature("geom/mesh", APPEARANCE, "a drawn mesh of more vertices than the language has"),
    "option.timestep": MjcfFeature(
        "option/timestep",
        INFORMATION,
        "dampers and springs are explicit in time in the spec, and would diverge at the file's timestep: it has a shorter one",
        "physics: {damping: implicit} allows the file's; less stiffness or more armature a longer one",
    ),
    "geom.margin": MjcfFeature(
        "geom/margin geom/gap", PHYSICS, "a gap beyond the margin: in the language no margin is negative"
    ),
    "pair.margin": MjcfFeature(
        "pair/margin pair/gap", PHYSICS, "a gap beyond the margin: in the language no margin is negative"
    ),
    "geom.gap": MjcfFeature("geom/gap", INFORMATION, _LISTED),
    "pair.gap": MjcfFeature("pair/gap", INFORMATION, _LISTED),
    "geom.fluid": MjcfFeature(
        "geom/fluidshape geom/fluidcoef",
        PHYSICS,
        "forces of a fluid on single shapes, with added mass and lift: the language has those on boxes of the bodies' inertia",
    ),
    "geom.adhesion": MjcfFeature("geom/adhesion pair/adhesion", PHYSICS, "adhesion is not in the language"),
    "contact.softness": MjcfFeature(
        "geom/solref geom/solimp geom/solmix pair/solref pair/solimp pair/solreffriction",
        INFORMATION,
        HOW_HARD,
        HARDNESS_HINT,
    ),
    "contact.pair": MjcfFeature(
        "pair/*", PHYSICS, "the file lets two shapes touch whose bodies are joined rigidly; the language does not"
    ),
    "contact.uneven": MjcfFeature(
        "pair/*", PHYSICS, "friction of a pair is the same in every direction in the language"
    ),
    "contact.materials": MjcfFeature(
        "geom/friction geom/condim geom/priority geom/contype geom/conaffinity",
        PHYSICS,
        "more kinds of surfaces than a spec may have materials",
    ),
    "contact.scenario": MjcfFeature(
        "option/cone geom/condim geom/priority",
        INFORMATION,
        "how different surfaces combine, and the friction cone, are said by the scenario that places a model",
        "contact: {combine: max} in the scenario",
    ),
    "contact.override": MjcfFeature(
        "option/o_margin option/o_solref option/o_solimp option/o_friction flag/override",
        PHYSICS,
        "one law for all contacts, instead of their own",
    ),
    "option.fluid": MjcfFeature(
        "option/density option/viscosity option/wind",
        PHYSICS,
        "of bodies that are welded, one of them without inertia of its own, the fluid acts on the box of all together",
    ),
    "equality": MjcfFeature(
        "equality/*",
        PHYSICS,
        "the language has joints that follow one other linearly, and loops that the reference configuration closes",
    ),
    "equality.softness": MjcfFeature(
        "equality/solref equality/solimp", INFORMATION, "how hard constraints are: those of the spec are rigid"
    ),
    "equality.inactive": MjcfFeature("equality/*", INFORMATION, "a constraint that is switched off is left out"),
    "tendon": MjcfFeature(
        "tendon/*",
        PHYSICS,
        "the language has springs, dampers and limits along sums of joint positions; not along ways through space, nor "
        "friction, inertia, springs with a slack range and limits that the sum begins beyond",
    ),
    "tendon.passive": MjcfFeature("tendon/*", INFORMATION, "a tendon that exerts no force by itself"),
    "actuator": MjcfFeature(
        "actuator/*",
        INFORMATION,
        "an actuator of no single hinge or slide, with a state, or with limits of its force that are not symmetric",
        "control: {robot: {joints: [JOINT], kp: KP, kd: KD, effort_limit: LIMIT}}",
    ),
    "actuator.inertia": MjcfFeature("actuator/*", PHYSICS, "inertia and damping of actuators are not carried"),
    "key": MjcfFeature(
        "key/*",
        INFORMATION,
        "a named state is carried where the file has one tree; joints beyond a limit are at the limit",
        "positions: where the model is placed",
    ),
    "key.driven": MjcfFeature(
        "key/time key/ctrl key/act key/mpos key/mquat",
        INFORMATION,
        "states of actuators, inputs of those that a spec has not, and what a program moves are no part of a named state",
    ),
    "plugin": MjcfFeature("plugin/*", PHYSICS, "plugins are programs of unknown effect"),
}
"""Every feature. An attribute of one that the model does not have is carried: it says what holds anyway."""


@dataclass
class MjcfFeatures:
    """Those that a model has, each with the elements that have it."""

    having: dict[str, list[Element]] = field(default_factory=dict)

    carried: list[Element] = field(default_factory=list)
    """Elements of sections (constraints) that the spec says."""
    states: set[str] = field(default_factory=set)
    """Names of the keys that the spec has as states."""
    commanded: set[str] = field(default_factory=set)
    """Names of those of them whose inputs are commands of the spec's."""
    actuators: set[int] = field(default_factory=set)
    """Numbers of the actuators that the spec has."""
    framed: set[int] = field(default_factory=set)
    """The ``id`` of the elements of sites that the spec has as frames."""
    hints: dict[tuple[str, int], str] = field(default_factory=dict)
    """Ways out for single elements, by the feature and the ``id`` of the element."""
    _known: set[tuple[str, int]] = field(default_factory=set)
    """The entries of :attr:`having`, by the ``id`` of the element: they are looked up for each attribute of each element."""

    def add(self, name: str, element: Element, hint: str = "") -> None:
        """Say that an element has a feature; ``hint``: the way out for this one."""
        if hint:
            self.hints[name, id(element)] = hint
        if name not in FEATURES:
            raise KeyError(name)
        elements = self.having.setdefault(name, [])
        if not self.has(name, element):
            self._known.add((name, id(element)))
            elements.append(element)

    def carry(self, element: Element) -> None:
        """Say that an element of a section is carried, but for what its features say of attributes."""
        self.carried.append(element)

    def has(self, name: str, element: Element) -> bool:
        """Whether an element has a feature."""
        return (name, id(element)) in self._known


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
    """A program that compiles MJCF; see the entry point for its requests and answers. It has two functions without
    parameters: ``prepare`` imports what it needs and limits itself, ``main`` answers; in between the kernel confines it."""

    PROGRAM: ClassVar[Path]
    EXTRA: ClassVar[str]

    @classmethod
    def version(cls) -> str | None:
        """The installed version; None where it is not installed."""


@dataclass(frozen=True)
class CompiledElement:
    """An element of the compiled model: its name (empty: none) and the element of the file that it comes from."""

    name: str
    element: Element


@dataclass(frozen=True)
class CompiledMesh:
    """A mesh: its file (None: it has none), what is done to the file's vertices v, ``scale (R(turn)ᵀ (v − origin))``, the
    number of faces, of vertices of its hull (at most), and the extent along its own axes (m)."""

    path: Path | None
    scale: tuple[float, ...]
    origin: tuple[float, ...]
    turn: tuple[float, ...]
    faces: int
    hull: int
    extent: tuple[float, ...]


def _mesh_file(mesh: Mapping[str, Any], assembly: MjcfAssembly) -> CompiledMesh:
    scale, origin, turn, extent = (tuple(mesh[word]) for word in ("scale", "refpos", "refquat", "extent"))
    path = assembly.mesh_files.get(mesh["file"])
    return CompiledMesh(path, scale, origin, turn, mesh["faces"], mesh["hull"], extent)


class CompiledMjcf:
    """The compiled model: ``self["body_pos"]`` is an array as the compiler calls it; ``parts`` by kind and number."""

    def __init__(self, answer: Mapping[str, Any], assembly: MjcfAssembly):
        model = answer["model"]
        self.version = str(answer["version"])
        self.major = int(self.version.partition(".")[0])
        self.numbers: dict[str, int] = model["numbers"]
        self.options: dict[str, Any] = model["options"]
        self._arrays: dict[str, NDArray[Any]] = {name: np.asarray(value) for name, value in model["arrays"].items()}
        self.root = assembly.root
        self.parts: dict[str, dict[int, CompiledElement]] = {}
        for kind, rows in model["elements"].items():
            parts = self.parts.setdefault(kind, {})
            for name, line, number in rows:
                parts[number] = CompiledElement(name, assembly.lines.get(line, assembly.root))
        self.meshes: dict[int, CompiledMesh] = {
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

    def part(self, kind: str, number: int) -> CompiledElement:
        """An element by its number; where the compiler made it by itself, nameless and of the outermost element."""
        return self.parts[kind].get(number) or CompiledElement("", self.root)

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
def compilers() -> Plugins[Compiler]:
    """The compilers that are offered."""

    def check(name: str, loaded: Any) -> Compiler:
        if not isinstance(loaded, Compiler):
            raise TypeError(f"{name} is no compiler: it needs PROGRAM, EXTRA and version")
        return loaded

    return Plugins(GROUP, check)


def _compiler(root: Element) -> Compiler:
    extras = []
    for compiler in compilers().values():
        if compiler.version() is not None:
            chosen: Compiler = compiler
            return chosen
        extras.append(compiler.EXTRA)
    hint = f"pip install 'simspec-physics[{extras[0]}]'" if extras else None
    raise root.error("MJCF is imported by way of its own compiler, which is not installed", hint=hint, code="I109")


def compile_model(assembly: MjcfAssembly, states: Random | None = None) -> CompiledMjcf:
    """The compiled model; with ``states``, also its dynamics in some. Raises SpecError where the compiler refuses it, is not
    installed, or takes more time or memory than is allowed."""
    root = assembly.root
    compiler = _compiler(root)
    requested: dict[str, Any] = {"files": [[name, len(content)] for name, content in assembly.texts.items()]}
    if states is not None:
        requested["random"] = states
    head = json.dumps(requested).encode()
    message = b"".join((struct.pack("<Q", len(head)), head, *assembly.texts.values()))
    try:
        answered = run(compiler.PROGRAM, (str(SECONDS), str(MEMORY)), message, PATIENCE, POLICY)
        answer = parse_json(answered)
    except (ChildError, NotReadableError) as error:
        raise root.error(f"the compiler of this model gave no answer: {error}", code="I109") from None
    if "error" in answer:
        raise SpecError([_refused(str(answer["error"]), assembly)])
    return CompiledMjcf(answer, assembly)


_LINE = re.compile(r",?\s*\bline (\d+)(, column \d+)?")


def _refused(error: str, assembly: MjcfAssembly) -> Problem:
    """The compiler's message, at the element that it means; its line numbers are not the file's."""
    element = assembly.root
    match = _LINE.search(error)
    if match:
        element = assembly.lines.get(int(match[1]), element)
    text = " ".join(_LINE.sub("", error).split())
    for name, path in assembly.named.items():
        text = text.replace(name, path.name)
    return element.problem(f"the compiler of this model refuses it: {text[:500]}", code="I109")
