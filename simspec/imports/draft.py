"""The spec that an importer makes: its data with places, problems and repairs, its materials, masses and meshes.

Problems of a file are collected and raised together.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final, TypeVar

from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import APPEARANCE, Element
from simspec.imports.files import Files
from simspec.language.document import Path_, dotted
from simspec.language.foreign import Account, Imported, ImportOptions, Repair, RequestedRepairs
from simspec.language.quantities import Number
from simspec.language.shapes import MESH_SUFFIXES as SUFFIXES
from simspec.language.shapes import MOST_VERTICES
from simspec.language.strict import Faults, required
from simspec.language.words import clean_name
from simspec.meshes.load import MadeMesh, MeshOptions, load
from simspec.meshes.reading import MeshError
from simspec.outputs.collection import Entries
from simspec.outputs.writing import write_file
from simspec.world import frames
from simspec.world.shapes import SHAPES

WHOLE: Final = 1e15
"""Whole numbers below this are written without a point, and read back as the same double."""
TURN: Final = 2.0 * math.pi
"""rad; the language requires a unit on larger angles, since degrees may be meant. A foreign file states its unit."""


class Problems(list[Problem]):
    """Problems that are raised together."""

    @contextlib.contextmanager
    def collecting(self) -> Iterator[None]:
        """Within it, a SpecError ends what is being read there, and its problems are kept."""
        try:
            yield
        except SpecError as error:
            self.extend(error.problems)

    def demand_none(self) -> None:
        """Raise SpecError with all problems, where there are any."""
        if self:
            raise SpecError(self)


@dataclass
class Draft:
    """A spec in the making. ``rules``: the importer's rules of repair, with what they do; ``with_value``: those that take a
    value."""

    files: Files
    options: ImportOptions
    rules: Mapping[str, str] = field(default_factory=dict)
    with_value: Sequence[str] = ()
    places: dict[Path_, Location] = field(default_factory=dict)
    problems: Problems = field(default_factory=Problems)
    repairs: list[Repair] = field(default_factory=list)
    comments: dict[str, str] = field(default_factory=dict)
    suspicious: list[Problem] = field(default_factory=list)
    """Values that are allowed, and that look like a slip."""
    meshes: dict[str, Any] = field(default_factory=dict)
    """Files that the data names, by the text that names them."""
    made: set[str] = field(default_factory=set)
    """Those of them that the source has within itself."""

    def collecting(self) -> contextlib.AbstractContextManager[None]:
        """Within it, a SpecError ends what is being read there, and its problems are kept."""
        return self.problems.collecting()

    def place(self, path: Path_, element: Element) -> None:
        """The value at a path of the data comes from an element."""
        self.places[path] = element.location

    def way_out(self, rule: str) -> str:
        """The hint of a defect that a rule repairs."""
        return f"simspec import --repair {rule}: {self.rules[rule]}"

    def defect(
        self, element: Element, message: str, rule: str = "", found: str | None = None, hint: str | None = None
    ) -> None:
        """Report a defect of the source, which ``rule`` would repair."""
        self.problems.append(element.problem(message, found, hint=self.way_out(rule) if rule else hint, code="I110"))

    def suspect(self, element: Element, message: str, rule: str, found: str) -> None:
        """Report a value that is allowed and looks like a slip, which ``rule`` would repair."""
        self.suspicious.append(element.problem(message, found, hint=self.way_out(rule), code="W112"))

    def mend(
        self, rule: str, element: Element, message: str, repair: str, path: Path_, found: str | None = None
    ) -> bool:
        """Report a defect, or record its repair where the rule is requested: ``repair`` says what changes, ``path`` where this
        is seen in the data. Whether the rule is requested."""
        if self.repairing(rule):
            self.repaired(rule, element, repair, path)
        else:
            self.defect(element, message, rule, found)
        return self.repairing(rule)

    def leave_out(self, element: Element, rule: str, why: Problem, path: Path_ = ()) -> None:
        """Leave a mesh out that cannot be used: one that is only drawn, or by the rule. Raises SpecError for another."""
        found = f": {why.found}" if why.found else ""
        if element.tag == "visual":
            element.lose(None, f"{why.message}{found}", APPEARANCE, why.hint or "")
        elif self.repairing(rule):
            element.lose(None, f"left out by the rule {rule}: {why.message}{found}")
            self.repaired(rule, element, f"a mesh is left out: {why.message}{found}", path)
        else:
            raise SpecError([replace(why, hint="; ".join(filter(None, [why.hint, self.way_out(rule)])))])

    def repairing(self, rule: str) -> bool:
        """Whether a rule is requested, by its name or by `all`."""
        return rule in self.options.repairs

    def repaired(self, rule: str, element: Element, what: str, path: Path_) -> None:
        """A rule was applied; ``what`` says what it changed, ``path`` where this is seen in the data."""
        self.repairs.append(Repair(rule, element.location, what, dotted(path)))

    def take_back(self, path: Path_) -> None:
        """Remove the repairs of what is at a path, or in it: another rule has replaced it, so that they have no effect."""
        place = dotted(path)
        self.repairs = [
            repair for repair in self.repairs if repair.path != place and not repair.path.startswith(f"{place}.")
        ]

    def note(self, path: Path_, sentence: str) -> None:
        """A sentence that stands above a value in the written spec, after those that are there already."""
        key = dotted(path)
        self.comments[key] = f"{self.comments[key]}; {sentence}" if key in self.comments else sentence

    def imported(self, data: dict[str, Any], accounts: list[Account]) -> Imported:
        """The import of ``data``."""
        files = self.meshes, frozenset(self.made), self.files.read
        return Imported(data, self.places, accounts, self.repairs, *files, self.comments, self.suspicious)

    def finish(self) -> None:
        """Raise SpecError with all problems, in the order of the file; a rule that does not exist is one."""
        self.problems += self.options.repairs.problems(self.files.shown, self.rules, self.with_value)
        if self.problems:
            here = self.files.shown

            def order(problem: Problem) -> tuple[bool, int, int]:
                place = problem.location or Location(here, 0, 0)
                return (place.file != here, place.line, place.column)

            raise SpecError(sorted(self.problems, key=order))


def follow(joint: str, leader: str, ratio: float, offset: float, turns: bool = False) -> dict[str, Any]:
    """The words of a joint that follows another; ``turns``: its position is an angle, whose unit is said."""
    words: dict[str, Any] = {"joint": joint, "leader": leader}
    if ratio != 1.0:
        words["ratio"] = plain(ratio)
    if offset:
        words["offset"] = angle(offset) if turns else plain(offset)
    return {"follow": words}


MOVING_PLANE: Final = "a plane is only drawn where it is fixed to the world"


def not_drawn(visual: Element, why: Problem) -> None:
    """Say of a visual that something in it is wrong: nothing but its appearance is lost."""
    found = f": {why.found}" if why.found else ""
    visual.forget()
    visual.lose(None, f"{why.message}{found}", APPEARANCE, why.hint or "")


def plain(value: float) -> float:
    """The same number; a whole one as an int, and no negative zero. Those that are none (twice the half size of 1e308) are left
    to the language, which refuses them at their place."""
    return int(value) if abs(value) < WHOLE and value == math.floor(value) else value


def tidy(value: Any, path: Path_ = (), infinite: list[Path_] | None = None) -> Any:
    """Data with whole numbers as ints; ``infinite`` gets the paths of numbers that are not finite."""
    if isinstance(value, dict):
        return {key: tidy(item, (*path, key), infinite) for key, item in value.items()}
    if isinstance(value, list):
        return [tidy(item, (*path, index), infinite) for index, item in enumerate(value)]
    if not isinstance(value, float):
        return value
    if infinite is not None and not math.isfinite(value):
        infinite.append(path)
        return value
    return plain(value)


def numbers(values: Sequence[float]) -> list[float]:
    """Several such numbers."""
    return [plain(value) for value in values]


def angle(value: float) -> float | str:
    """An angle in rad; one of more than a turn says its unit."""
    return f"{plain(value)!r} rad" if abs(value) > TURN else plain(value)


def tensor_words(six: Sequence[float]) -> dict[str, Any]:
    """An inertia (xx, yy, zz, xy, xz, yz) as ``inertia.tensor``, without products of zero."""
    words = {name: plain(value) for name, value in zip(MOMENTS, six, strict=True) if value or name[0] == name[1]}
    return {"tensor": words}


def pose(xyz: Sequence[float] | None, rpy: Sequence[float] | None) -> dict[str, Any]:
    """A pose with only what is not zero; empty for the same frame."""
    said: dict[str, Any] = {}
    if xyz is not None and any(xyz):
        said["xyz"] = numbers(xyz)
    if rpy is not None and any(rpy):
        said["rpy"] = [angle(value) for value in rpy]
    return said


CONTACT_OF_LINK: Final[Mapping[str, str]] = {
    "lateral_friction": "friction",
    "spinning_friction": "torsional_friction",
    "rolling_friction": "rolling_friction",
    "restitution": "restitution",
}
"""Words of a ``contact`` of a link, which one reader of robot files has."""


@dataclass(frozen=True, slots=True)
class LinkSurface:
    """A surface of a file, as a material of the language."""

    friction: float = 1.0
    restitution: float = 0.0
    restitution_threshold: float = 0.0
    torsional_friction: float = 0.0
    rolling_friction: float = 0.0

    def data(self) -> dict[str, Any]:
        """The material, with only what is not zero; it has a friction."""
        return {word: value for word, value in asdict(self).items() if value or word == "friction"}


@dataclass
class Materials:
    """Names of surfaces; equal ones are one material."""

    names: dict[LinkSurface, str] = field(default_factory=dict)

    def name(self, surface: LinkSurface) -> str:
        """The material of a surface."""
        if surface not in self.names:
            self.names[surface] = f"surface-{len(self.names) + 1}"
        return self.names[surface]

    def data(self) -> dict[str, Any]:
        """Materials by name; a single one is called ``surface``."""
        if len(self.names) == 1:
            return {"surface": next(iter(self.names)).data()}
        return {name: surface.data() for surface, name in self.names.items()}


MOMENTS: Final = ("xx", "yy", "zz", "xy", "xz", "yz")
Six = tuple[float, float, float, float, float, float]
"""A symmetric tensor: xx, yy, zz, xy, xz, yz."""

RULE: Final = "triangle-inequality"
NOT_POSITIVE: Final = "not-positive"
"""The rule of repair of moments that are not above 0."""
MEANING: Final = "a tensor that no body has becomes the nearest one that a body can have"
FROM_SHAPES: Final = "masses-from-shapes"
DENSITY: Final = 1000.0
"""kg/m³ of :data:`FROM_SHAPES` unless a value is given with it: that of water."""
OF_SHAPES: Final = (
    "a moving body without mass, or with a mass below 0, has that of its shapes of 1000 kg/m³, or of another density: "
    "`masses-from-shapes=7850 kg/m^3`"
)

OF_SHAPES_OR_BALL: Final = "moments that are not above 0 follow from the mass and the shapes, or are those of a ball"


def ball(mass: float) -> tuple[float, str]:
    """The moment of inertia (kg m²) of a ball of a mass (kg) and of :data:`DENSITY`, which stands for moments that are missing;
    and the repair in words."""
    radius: float = (3.0 * mass / (4.0 * math.pi * DENSITY)) ** (1.0 / 3.0)
    moment = 0.4 * mass * radius * radius
    return moment, f"the moments are those of a ball of {mass:g} kg and {DENSITY:g} kg/m³: {moment:.6g} kg m²"


def even(mass: float) -> str:
    """The repair of moments that follow from the shapes and the mass (kg), in words."""
    return f"the centre of mass and the moments follow from the shapes, of even density, of {mass:g} kg"


def solids_of(shapes: Iterable[S]) -> list[S]:
    """Those of the shapes of a link that are filled: those that collide, or where none of these has a volume, those that are
    seen."""
    filled = [shape for shape in shapes if shape.volume > 0.0]
    return [shape for shape in filled if shape.collides] or filled


def given(name: str, before: float, solids: Sequence[LinkShape], density: float) -> str:
    """The repair by :data:`FROM_SHAPES`: the mass (kg) of the body ``name``, before and by shapes of ``density`` (kg/m³)."""
    counted = f"{len(solids)} {'collision' if solids[0].collides else 'visual'} shape{'s' if len(solids) > 1 else ''}"
    aside = [] if solids[0].collides else ["no collision shape has a volume"]
    if hulls := sum(shape.is_open for shape in solids):
        aside.append(f"{hulls} {'mesh is' if hulls == 1 else 'meshes are'} not closed: the hull is filled")
    kilograms = density * math.fsum(shape.volume for shape in solids)
    became = f"{before:g} kg became " if before else ""
    why = f" ({'; '.join(aside)})" if aside else ""
    return f"{name}: {became}{kilograms:.6g} kg, of {counted} of {density:g} kg/m³{why}"


def density_of(requested: RequestedRepairs, shown: str) -> tuple[float, list[Problem]]:
    """kg/m³ of the rule :data:`FROM_SHAPES`, and the problems of the value that is given with it. ``shown``: how messages call
    the file."""
    text = requested.value(FROM_SHAPES)
    if text is None:
        return DENSITY, []
    try:
        return Number("density", 0.0, above=True).read(text), []
    except Faults as error:
        form = f"{FROM_SHAPES}=1000, {FROM_SHAPES}=7850 kg/m^3"
        message = f"{shown}: the density of {FROM_SHAPES}: "
        return DENSITY, [
            Problem(message + fault.message, found=text[:80], allowed=form, code="S201") for fault in error.faults
        ]


def nearest(tensor: Sequence[float], share: float | None = None) -> Six:
    """The tensor nearest to a positive one (by the sum of squares) that obeys the triangle inequality. It has the same
    principal axes: the excess of the largest moment is shared by all three (``share``: of each, where it is known)."""
    import numpy as np

    xx, yy, zz, xy, xz, yz = tensor
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    excess = max(0.0, (moments[2] - moments[0] - moments[1]) / 3.0) if share is None else share
    moved = moments + excess * np.array([1.0, 1.0, -1.0])
    full = (axes * moved) @ axes.T
    return frames.vector6(float(full[index]) for index in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def shown(moments: Sequence[float]) -> str:
    """Moments in a message."""
    return ", ".join(f"{value:.6g}" for value in moments)


def became(before: Sequence[float], after: Sequence[float]) -> str:
    """The repair in words, by the principal moments."""
    return f"the principal moments {shown(before)} kg m² became {shown(after)} kg m²"


COLLADA: Final = ".dae"

FEWER: Final = 128
"""Vertices that a hull keeps of which a file has more than a spec may have: they leave 0.1 to 0.3 mm of
parts of 0.1 m, and take 2 to 4 s of computing once (measured); engines are fast with so few."""

BEGINNING: Final = b"# Made by simspec import"
ENTRIES: Final = Entries("stages", head=BEGINNING, largest=256 * 2**20, bound=512 * 2**20)
"""Where the user's cache has the meshes that files have within themselves, by the hash of their content."""


@dataclass(frozen=True)
class NamedMesh:
    """A mesh of a robot file: the text that names it, the file, and the factors along the axes."""

    text: str
    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def data(self) -> dict[str, Any]:
        """The word ``mesh`` of a shape."""
        data: dict[str, Any] = {"file": self.text}
        if self.up is not None:
            data["up"] = self.up
        x, y, z = self.scale
        if not x == y == z:
            data["scale"] = [plain(value) for value in self.scale]
        elif x != 1.0:
            data["scale"] = plain(x)
        return data

    @property
    def up(self) -> str | None:
        """The word ``up``: robots are drawn with the axes that a COLLADA file has, whatever it says is up."""
        return "z" if self.path.suffix.lower() == COLLADA else None


def find_mesh(
    text: str, scale: tuple[float, float, float], element: Element, files: Files, start: Path | None = None
) -> NamedMesh:
    """The mesh that a text in a file means; ``start``: the folder that its path starts from, where that is another than the
    imported file's. Raises MissingFileError where there is no such file, SpecError for one that may
    not be read, is of no language of meshes, or has no volume."""
    if not text.lower().endswith(SUFFIXES):
        raise element.error("not a file of triangles that is read", text[:200], " ".join(SUFFIXES), code="I106")
    if 0.0 in scale:
        raise element.error(
            "a factor of 0 leaves no volume", " ".join(map(str, scale)), "numbers other than 0", code="I102"
        )
    return NamedMesh(text, files.find(text, element, start), scale)


SIZES: Final[Mapping[str, str]] = {"box": "size", "ellipsoid": "radii"}
"""The word of the sizes of shapes whose sizes are one list."""
SIZED: Final = ("box", "sphere", "cylinder", "capsule", "ellipsoid")
"""Kinds of shapes that have a size in the spec."""


def shape_data(kind: str, size: Sequence[float]) -> dict[str, Any]:
    """The word of a shape, with its sizes (m) in the order of ``SHAPES``."""
    values = numbers(size)
    return {kind: {SIZES[kind]: values} if kind in SIZES else dict(zip(SHAPES[kind].sizes, values, strict=True))}


@dataclass
class LinkShape:
    """A shape of a link: ``data`` are its words; ``source``: the element that names its mesh, where it is another."""

    element: Element
    data: dict[str, Any]
    collides: bool
    name: str = ""
    mesh: NamedMesh | None = None
    source: Element | None = None
    is_open: bool = False
    """Whether the mesh encloses no volume."""
    volume: float = 0.0
    """m³ that is filled where the mass follows from the shape: the enclosed volume of a closed mesh, that of the hull of an
    open one."""

    def fill(self) -> None:
        """Let the mass follow from the shape: of a mesh that is not closed, only the hull has a volume."""
        if self.is_open:
            self.data["mesh"] = {**self.data["mesh"], "mass_from": "hull"}

    def measured(self, mesh: MadeMesh) -> None:
        """Remember the volume of the shape's mesh."""
        self.is_open = mesh.enclosed is None
        self.volume = mesh.hull_volume if mesh.enclosed is None else abs(mesh.enclosed.volume)


S = TypeVar("S", bound=LinkShape)


def measure_meshes(
    shapes: Iterable[S],
    made: Iterable[MadeMesh | MeshError],
    rule: Callable[[MeshError], str],
    draft: Draft,
    path: Path_,
) -> set[int]:
    """Give shapes the volumes of their meshes; those that cannot be read are left out by the ``rule`` for the error, or are
    problems. The ``id`` of each of these."""
    unusable = set()
    for shape, result in zip(shapes, made, strict=True):
        if not isinstance(result, MeshError):
            shape.measured(result)
            continue
        unusable.add(id(shape))
        with draft.collecting():
            why = (shape.source or shape.element).problem(str(result), required(shape.mesh).text, code="I106")
            draft.leave_out(shape.element, rule(result), why, path)
    return unusable


def read_meshes(meshes: Sequence[NamedMesh], most: int | None = None) -> list[MadeMesh | MeshError]:
    """The mesh of each, or the reason why there is none; it is remembered for the spec that names them. ``most``: vertices that
    are kept of hulls that have more."""
    wanted = [(mesh.path, MeshOptions(up=mesh.up, scale=mesh.scale, max_vertices=most)) for mesh in meshes]
    made = load(wanted, MOST_VERTICES)
    return [made[entry] for entry in wanted]


def kept_vertices(mesh: MadeMesh) -> int | None:
    """The word `max_vertices` of a mesh that is reduced; None for one that is whole."""
    return FEWER if any(part.vertices > MOST_VERTICES for part in mesh.parts) else None


def made_file(obj: bytes, called: str) -> tuple[str, Path]:
    """A mesh that a file has within itself, as a file of the cache (else of the folder of temporary files): how a spec calls
    it, and the file. ``obj`` begins with :data:`BEGINNING`. Raises SpecError where it cannot be written."""
    place = ENTRIES.folder()
    folder = place if place is not None else Path(tempfile.gettempdir()) / f"simspec-{os.getuid()}" / ENTRIES.name
    digest = hashlib.sha256(obj).hexdigest()
    path = folder / f"{digest[:32]}.obj"
    try:
        write_file(path, obj.decode(), lambda content: content.startswith(BEGINNING), lasting=False)
    except (OSError, SpecError) as error:
        raise SpecError(
            [Problem(f"a mesh of this file cannot be written to {path.parent}: {error}", code="C106")]
        ) from None
    return f"meshes/{clean_name(called)[:60]}_{digest[:8]}.obj", path
