"""The meaning of a file: the model that every engine is compared with, and where the file states each of its values."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import loaders
from simspec.errors import Location, Problem, SimspecError, SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.imports.draft import FROM_SHAPES
from simspec.imports.elements import Element, parse
from simspec.imports.files import Packages
from simspec.language.foreign import Imported, ImportOptions, Repair, importers
from simspec.language.load import Spec, load
from simspec.language.sources import project_folder
from simspec.world import frames
from simspec.world.kinematics import joint_displacement
from simspec.world.types import Body, Inertial, Pose, Shape, Vector3, World

# Bodies of a file and of an engine, made comparable: matched by name, placed in the world, folded where an engine
# merges them.

WORLD: Final = "world"
"""The name of what cannot move."""
Floats = NDArray[np.float64]


def parents_first(bodies: Sequence[Body]) -> list[Body]:
    """Bodies, each after its parent: engines keep orders of their own. Raises ValueError where a parent is missing, or
    bodies are parents of each other."""
    children: dict[str | None, list[Body]] = {}
    for body in bodies:
        children.setdefault(body.joint.parent, []).append(body)
    ordered: list[Body] = []
    waiting = list(reversed(children.get(None, [])))
    while waiting:
        body = waiting.pop()
        ordered.append(body)
        waiting.extend(reversed(children.get(body.name, [])))
    if len(ordered) != len(bodies):
        left = sorted({body.name for body in bodies} - {body.name for body in ordered})
        raise ValueError(f"bodies without a way to the world: {', '.join(left[:5])}")
    return ordered


def zero_poses(bodies: Sequence[Body]) -> dict[str, Pose]:
    """The pose of every body's frame in the world with all joints at zero; free roots where they start."""
    placed: dict[str, Pose] = {}
    for body in parents_first(bodies):
        joint = body.joint
        start = joint.origin if joint.parent is None else frames.compose(placed[joint.parent], joint.origin)
        if joint.kind == "free" and joint.position:
            start = frames.compose(start, joint_displacement(body, joint.position))
        placed[body.name] = start
    return placed


def groups_of(bodies: Sequence[Body]) -> dict[str, str]:
    """For every body the topmost one that it is rigidly joined to; ``WORLD`` where that cannot move."""
    group: dict[str, str] = {}
    for body in parents_first(bodies):
        joint = body.joint
        if joint.kind != "fixed":
            group[body.name] = body.name
        else:
            group[body.name] = WORLD if joint.parent is None else group[joint.parent]
    return group


def key_of(name: str) -> str:
    """A name without what importers and engines change in it."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def tail_of(name: str) -> str:
    """The name of a body without that of its model."""
    return key_of(re.split(r"/|::", name)[-1])


def _unique(key: Callable[[str], str], bodies: Sequence[Body]) -> dict[str, Body | None]:
    """Bodies by a key of their names; None where several have it."""
    found: dict[str, Body | None] = {}
    for body in bodies:
        name = key(body.name)
        found[name] = None if name in found else body
    return found


@dataclass(frozen=True)
class Matched:
    """Bodies of a file and those of an engine.

    partners  the engine's body for each of the file's, by name, where it has one
    carrier   for each of the file's bodies the one of them whose engine body has it: itself, or one that it is fixed to;
              ``WORLD`` for one that became a part of the world; None where it is nowhere
    extra     the engine's bodies that stand for none of the file's
    """

    partners: dict[str, Body]
    carrier: dict[str, str | None]
    extra: tuple[Body, ...]


def match(bodies: Sequence[Body], actual: Sequence[Body]) -> Matched:
    """Match by name: exactly, else without marks and case, else without the name of the model before it, where only one body of
    each side is called so; where no name fits, the only root of one with that of the other."""
    partner_of: dict[str, Body] = {}
    taken: set[str] = set()
    for key in (str, key_of, tail_of):
        left = _unique(key, [body for body in bodies if body.name not in partner_of])
        free = _unique(key, [body for body in actual if body.name not in taken])
        for name, body in left.items():
            partner = free.get(name)
            if body is not None and partner is not None:
                partner_of[body.name] = partner
                taken.add(partner.name)
    roots = [body for body in bodies if body.joint.parent is None]
    actual_roots = [body for body in actual if body.joint.parent is None]
    if not partner_of and len(roots) == len(actual_roots) == 1 and actual_roots[0].name != WORLD:
        partner_of[roots[0].name] = actual_roots[0]  # one is named after its model
        taken.add(actual_roots[0].name)
    carrier: dict[str, str | None] = {}
    for body in bodies:
        if body.name in partner_of:
            carrier[body.name] = body.name
        elif body.joint.parent is None:
            carrier[body.name] = WORLD  # whether a root is fixed is often left open
        else:
            carrier[body.name] = carrier[body.joint.parent] if body.joint.kind == "fixed" else None
    return Matched(partner_of, carrier, tuple(body for body in actual if body.name not in taken))


def folded(parts: Sequence[Body], at: dict[str, Pose], onto: str) -> tuple[Inertial, tuple[Shape, ...]]:
    """The mass properties and shapes of several bodies as one, in the frame of ``onto``."""
    inverse = frames.inverse(at[onto])
    shapes: list[Shape] = []
    lumps: list[tuple[float, Vector3, Floats]] = []
    for body in parts:
        place = frames.compose(inverse, at[body.name])
        inertial = body.inertial
        centre = frames.add(place.position, frames.rotate(place.quaternion, inertial.centre_of_mass))
        lumps.append((inertial.mass, centre, full(frames.rotate_inertia(place.quaternion, inertial.inertia))))
        shapes += [dataclasses.replace(shape, pose=frames.compose(place, shape.pose)) for shape in body.shapes]
    mass = sum(lump[0] for lump in lumps)
    if len(lumps) == 1 or not mass:
        return Inertial(mass, lumps[0][1], six(sum((lump[2] for lump in lumps), np.zeros((3, 3))))), tuple(shapes)
    middle = np.sum([lump[0] * np.array(lump[1]) for lump in lumps], axis=0) / mass
    tensor = np.zeros((3, 3))
    for value, centre, moment in lumps:
        arm = np.array(centre) - middle
        tensor += moment + value * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    x, y, z = middle.tolist()
    return Inertial(mass, (x, y, z), six(tensor)), tuple(shapes)


def full(inertia: Sequence[float]) -> Floats:
    """A tensor (3, 3) from (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six(tensor: Floats) -> tuple[float, float, float, float, float, float]:
    """The same back."""
    t = tensor.tolist()
    return (t[0][0], t[1][1], t[2][2], t[0][1], t[0][2], t[1][2])


LARGEST: Final = 64 * 2**20
"""Bytes of a file that is audited."""
PACKAGE: Final = re.compile(rb"(?:package|model)://([^/\\\"'<>\s]+)")
FIND: Final = re.compile(rb"\$\(find\s+([^)\s]+)\)")


@dataclass(frozen=True)
class Meaning:
    """A file as simspec reads it. ``bodies`` are empty where simspec does not read it at all; ``source`` says in words
    where they come from. ``unsure``: paths of values that were repaired, which are no values of the file. ``world``: None where
    there are such; ``read``: the world also then."""

    path: Path
    language: str
    source: str = ""
    bodies: tuple[Body, ...] = ()
    gravity: Vector3 | None = None
    world: World | None = None
    read: World | None = None
    spec: Spec | None = None
    imported: Imported | None = None
    defects: tuple[Problem, ...] = ()
    unsure: frozenset[str] = frozenset()
    packages: Mapping[str, str] = field(default_factory=dict)

    @property
    def locate(self) -> Callable[[str], Location | None]:
        """Places in the file, by dotted paths of the world."""
        return self.spec.locate if self.spec is not None else lambda path: None


def language_of(path: Path, content: bytes) -> str:
    """The language of a file, by the engines that read it: the end of its name, and its outermost element. Raises
    SpecError for a file of none, and for what is damaged or hostile: no engine is given such a file."""
    name = path.name.lower()
    fitting = {
        language: reads
        for engine in loaders().values()
        for language, reads in engine.FOREIGN.items()
        if name.endswith(reads.suffixes)
    }
    if not fitting:
        allowed = " ".join(sorted({end for engine in loaders().values() for end in suffixes_of(engine)}))
        raise SpecError([Problem(f"{path}: no engine reads such files", allowed=allowed, code="I114")])
    root = parse(content, str(path)).tag
    for language, reads in fitting.items():
        if reads.root == root:
            return language
    allowed = ", ".join(f"<{reads.root}>" for reads in fitting.values())
    raise SpecError([Problem(f"{path}: the outermost element is <{root[:60]}>", allowed=allowed, code="I114")])


def suffixes_of(engine: type[Engine]) -> set[str]:
    """Ends of names of the files that an engine reads."""
    return {end for reads in engine.FOREIGN.values() for end in reads.suffixes}


def content_of(path: Path) -> bytes:
    """The bytes of a file. Raises SpecError where it cannot be read."""
    try:
        return read_bytes(path, LARGEST, links=True)
    except NotReadableError as error:
        raise SpecError([Problem(f"{path}: cannot be read: {error}", code="C104")]) from None
    except OSError as error:
        raise SpecError([Problem(f"{path}: cannot be read: {error.strerror or error}", code="C104")]) from None


def meaning_of(path: Path, options: ImportOptions, allow_outside: bool = False) -> Meaning:
    """The meaning of a file, by its importer; where that refuses the file, by the importer with all its repairs, whose values
    then count for nothing; else no bodies. Raises SpecError for what is no such file."""
    content = content_of(path)
    language = language_of(path, content)
    bare = Meaning(path, language, packages=packages_of(content, path, options))
    importer = importers().get(language)
    if importer is None:
        why = importers().broken().get(language)
        return dataclasses.replace(bare, defects=(Problem(why, code="I101"),) if why else ())
    try:
        return _read(bare, options, allow_outside)
    except SpecError as error:
        bare = dataclasses.replace(bare, defects=error.problems)
    given = getattr(importer, "rules", None)  # an importer may have none
    rules = tuple(given()) if given is not None else ()
    if rules:
        try:
            return _read(bare, dataclasses.replace(options, repair=rules), allow_outside)
        except SimspecError:
            return bare
    return bare


def _read(bare: Meaning, options: ImportOptions, allow_outside: bool) -> Meaning:
    spec = load(bare.path, options=options, allow_outside=allow_outside)
    world = spec.resolve()
    imported = spec.source.imported
    repairs = imported.repairs if imported is not None else []
    source = "the file, as simspec imports it"
    if bare.defects:
        source = "the file, as simspec imports it with every repair; repaired values are not compared"
    said = imported is not None and any(path[:2] == ("physics", "gravity") for path in imported.places)
    return dataclasses.replace(
        bare,
        source=source,
        bodies=world.bodies,
        gravity=world.physics.gravity if said else None,
        world=world if not bare.defects else None,
        read=world,
        spec=spec,
        imported=imported,
        unsure=frozenset(path for repair in repairs if bare.defects for path in _changed(repair)),
    )


def _changed(repair: Repair) -> list[str]:
    """The paths, from the body on, of what a repair changed."""
    path = repair.path.rpartition("bodies.")[2]
    body = path.rpartition(".")[0]
    # masses are seen at the shapes that they follow from
    more = [f"{body}.{word}" for word in ("mass", "centre_of_mass", "inertia")] if repair.rule == FROM_SHAPES else []
    return [path, *more]


def packages_of(content: bytes, path: Path, options: ImportOptions) -> dict[str, str]:
    """The folders of the packages that a file names, found as the importers find them."""
    names = {name.decode(errors="replace") for pattern in (PACKAGE, FIND) for name in pattern.findall(content)}
    packages = Packages(
        path.resolve().parent, dataclasses.replace(options, project=options.project or project_folder(path))
    )
    found: dict[str, str] = {}
    asking = Element("robot", {}, Location(str(path), 1, 1), "", None)
    for name in sorted(names):
        with contextlib.suppress(SpecError):  # the importer reports it where the file names it
            found[name] = str(packages.find(name, asking).resolve())
    return found


def file_name(path: Path, options: ImportOptions) -> str:
    """How reports call a file: as it was given, or its name in its package."""
    return str(path) if options.package is None else options.shown(path)


def plain_text(value: Any) -> str:
    """A value of a file as a table shows it."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, (tuple, list)):
        return " ".join(plain_text(item) for item in value)
    return str(value)
