"""What a file means: the model that every engine is held against, and where the file says each of its values."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines
from simspec.errors import Location, Problem, SimspecError, SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.imports.draft import FROM_SHAPES
from simspec.imports.elements import Element, parse
from simspec.imports.packages import Packages
from simspec.language.foreign import Imported, ImportOptions, Repair, importers
from simspec.language.load import Spec, load
from simspec.language.sources import project_folder
from simspec.world.types import Body, Vector3, World

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
        for engine in engines().values()
        for language, reads in engine.FOREIGN.items()
        if name.endswith(reads.suffixes)
    }
    if not fitting:
        allowed = " ".join(sorted({end for engine in engines().values() for end in suffixes_of(engine)}))
        raise SpecError([Problem(f"{path}: no engine reads such files", allowed=allowed)])
    root = parse(content, str(path)).tag
    for language, reads in fitting.items():
        if reads.root == root:
            return language
    allowed = ", ".join(f"<{reads.root}>" for reads in fitting.values())
    raise SpecError([Problem(f"{path}: the outermost element is <{root[:60]}>", allowed=allowed)])


def suffixes_of(engine: type[Engine]) -> set[str]:
    """Ends of names of the files that an engine reads."""
    return {end for reads in engine.FOREIGN.values() for end in reads.suffixes}


def content_of(path: Path) -> bytes:
    """The bytes of a file. Raises SpecError where it cannot be read."""
    try:
        return read_bytes(path, LARGEST, links=True)
    except NotReadableError as error:
        raise SpecError([Problem(f"{path}: cannot be read: {error}")]) from None
    except OSError as error:
        raise SpecError([Problem(f"{path}: cannot be read: {error.strerror or error}")]) from None


def meaning_of(path: Path, options: ImportOptions, allow_outside: bool = False) -> Meaning:
    """What a file means, by its importer; where that refuses the file, by the importer with all its repairs, whose values then
    count for nothing; else no bodies. Raises SpecError for what is no such file."""
    content = content_of(path)
    language = language_of(path, content)
    bare = Meaning(path, language, packages=packages_of(content, path, options))
    importer = importers().get(language)
    if importer is None:
        why = importers().broken().get(language)
        return dataclasses.replace(bare, defects=(Problem(why),) if why else ())
    try:
        return _read(bare, options, allow_outside)
    except SpecError as error:
        bare = dataclasses.replace(bare, defects=error.problems)
    told = getattr(importer, "rules", None)  # an importer may have none
    rules = tuple(told()) if told is not None else ()
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
        source = "the file, as simspec imports it with every repair; what was repaired is not compared"
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
    """What reports call a file: as it was given, or its name in its package."""
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
