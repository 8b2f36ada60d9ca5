"""The files of a spec: the file itself, and the model files that it uses, each read and validated once."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

from pydantic import ValidationError

from simspec.errors import UNSEEN_CHARACTERS, Problem, SpecError
from simspec.language.document import Details, Document, Key, dotted, event_count, mapping, read
from simspec.language.foreign import Import, Imported, ImportOptions, import_file, is_foreign, suffixes
from simspec.language.instances import ModelPlacement, instance, placement_of
from simspec.language.models import File
from simspec.language.packages import PACKAGE, Package, PackagedFile, is_packaged, is_robot, packaged, shown_path
from simspec.language.problems import of_validation
from simspec.language.quantities import Number
from simspec.language.shapes import GRID_SUFFIXES as GRIDS
from simspec.language.shapes import MESH_SUFFIXES as MESHES
from simspec.language.shapes import named_files
from simspec.language.strict import show
from simspec.language.words import LONGEST_TEXT

DEEPEST_USE = 8
"""Files that use files that use files: a chain longer than this is refused."""
NAMEABLE = (".yaml", ".yml", ".csv", ".npz")
"""Files that a spec may mean."""
MOST_EXPANDED = 1_000_000
"""Keys and values of all files, once for each different way in which they are used: some ten seconds of reading."""
PROJECT_MARKS = (".git", "pyproject.toml")
PACKAGE_MARKS = ("package.xml", "model.config")
"""Marks of a package of robot files, which is a project where it is in none."""


@dataclass
class Source:
    """One file: its document, its model (None when it has errors), and the files that it uses, by the text of ``use``."""

    document: Document
    folder: Path
    file: File | None = None
    uses: dict[str, Source] = field(default_factory=dict)
    table: Path | None = None
    """The file of `trajectory.file`, found and allowed."""
    meshes: dict[str, Path] = field(default_factory=dict)
    """The files of shapes (`mesh.file`, `heightfield.file`), found and allowed, by the texts that name them."""
    imported: Imported | None = None
    """The result of the importer of a file of another language; None for a spec."""
    package: Package | None = None
    """The installed package that the file is in; None for a file that a path names."""
    path: Path | None = None
    """The file; None for a document made in Python."""
    placement: ModelPlacement | None = None
    """The placement that made the document what it is; None for a file that stands alone."""
    written: Document | None = None
    """The document as the file says it; None where :attr:`document` is."""
    packaged: dict[Path, Package] = field(default_factory=dict)
    """Files of packages that this file names itself (meshes, tables), with their packages."""

    @property
    def content(self) -> File:
        """The model of a file without errors; only such a spec is resolved. Raises ValueError for another."""
        if self.file is None:
            raise ValueError(f"{self.document.file} has errors, so it is not resolved")
        return self.file

    def all(self) -> Iterator[Source]:
        """This source and every other below it, each once."""
        seen: dict[int, Source] = {}
        waiting = [self]
        while waiting:
            source = waiting.pop()
            if id(source) not in seen:
                seen[id(source)] = source
                waiting.extend(source.uses.values())
        return iter(seen.values())


def project_folder(path: Path) -> Path:
    """The folder that ``use`` must not leave: the nearest one above with a mark of a project, else of a package, else the
    file's own."""
    folder = path.resolve().parent
    for marks in (PROJECT_MARKS, PACKAGE_MARKS):
        for candidate in (folder, *folder.parents):
            if any((candidate / mark).exists() for mark in marks):
                return candidate
    return folder


def validate(document: Document) -> tuple[File | None, list[Problem]]:
    """The document's model, or its problems."""
    if not isinstance(document.data, dict):
        found = "an empty file" if document.data is None else show(document.data)
        hint = "a spec starts with simspec: 1"
        return None, [document.problem((), "a spec is a mapping (key: value)", found=found, hint=hint, code="S104")]
    try:
        return File.model_validate(document.data), []
    except ValidationError as error:
        return None, list(of_validation(error, document))


def uses(data: Any) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Every placement that has a ``use``, with its path."""
    data = mapping(data)
    placements: dict[tuple[str, ...], Any] = {("model",): data.get("model")}
    placements |= {("models", name): placed for name, placed in mapping(data.get("models")).items()}
    for path, placed in placements.items():
        if isinstance(mapping(placed).get("use"), str):
            yield path, placed


def use_key(placed: Mapping[str, Any]) -> str:
    """The key of :attr:`Source.uses` of a placement that has a ``use``: its text, what it says to an importer, and what it
    makes of the model."""
    text: str = placed["use"]
    said = {word: placed[word] for word in ("import", "with", "mirror", "joint") if placed.get(word) is not None}
    return text if not said else f"{text} {json.dumps(said, sort_keys=True, default=str)}"


def parameters_of(source: Source) -> dict[str, dict[str, Number]]:
    """The parameters of the files of placed models, by the placement's name: which numbers they may be."""
    found: dict[str, dict[str, Number]] = {}
    for path, placed in uses(source.document.data):
        used = source.uses.get(use_key(placed))
        if used is not None and used.file is not None and used.file.model is not None and path[0] == "models":
            declared = used.file.model.parameters
            found[path[1]] = {name: Number(parameter.dimension) for name, parameter in declared.items()}
    return found


def of_package(options: ImportOptions, found: PackagedFile) -> ImportOptions:
    """The options for the importer of a file of a package: only the package's folder may be read, and the package's arguments
    come after those of ``options``."""
    arguments = {**found.arguments, **options.arguments}
    return replace(options, project=found.package.root, package=found.package, arguments=arguments)


def _installed_name(path: Path) -> str | None:
    """The name of a file in a folder of installed packages."""
    parts = path.parts
    at = next((index for index, part in enumerate(parts) if part in ("site-packages", "dist-packages")), None)
    return f"{PACKAGE}{'/'.join(parts[at + 1 :])}" if at is not None and len(parts) > at + 2 else None


def _noted(source: Source, found: Path | PackagedFile) -> Path:
    """The path of a file that ``source`` names; that it is of a package is remembered for the record of what was read."""
    if isinstance(found, Path):
        return found
    source.packaged[found.path] = found.package
    return found.path


class SourceCollector:
    """Reads the files that a file uses, and theirs; collects every problem."""

    def __init__(self, project: Path | None, options: ImportOptions | None = None):
        self.project = project
        """The folder that must not be left; None: any file may be used."""
        self.options = options or ImportOptions()
        """The options for importers, unless a placement gives them."""
        self.problems: list[Problem] = []
        self._read: dict[tuple[Path, str, str], Source | None] = {}
        self._opened: dict[tuple[Path, str], tuple[Document, Imported | None] | None] = {}
        self._expanded = 0

    def again(self) -> SourceCollector:
        """A collector for the same spec with other values: it does not read again the files that this one has read."""
        other = SourceCollector(self.project, self.options)
        other._read = {key: source for key, source in self._read.items() if source is not None}
        other._opened = {key: opened for key, opened in self._opened.items() if opened is not None}
        return other

    def collect(self, source: Source, chain: tuple[Path, ...]) -> None:
        """Read what ``source`` uses; ``chain`` holds the files that led here, this one last."""
        for path, placed in uses(source.document.data):
            key = use_key(placed)
            if key in source.uses:
                continue
            used = self._find(source, path, placed, chain)
            if used is not None:
                source.uses[key] = used
        table = source.document.at("trajectory", "file")
        if isinstance(table, str) and (found := self._place(source, ("trajectory", "file"), table)) is not None:
            source.table = _noted(source, found)
        if source.imported is not None:
            source.meshes.update(source.imported.files)
        missing: set[str] = set()
        for at, text in named_files(source.document.data):
            if text in source.meshes or text in missing:
                continue
            found = self._place(source, at, text)
            if found is None:
                missing.add(text)
            else:
                source.meshes[text] = _noted(source, found)

    def _problem(self, source: Source, path: tuple[Key, ...], message: str, **more: Unpack[Details]) -> None:
        self.problems.append(source.document.problem(path, message, **more))

    def _packaged(self, source: Source, path: tuple[Key, ...], text: str) -> PackagedFile | None:
        """The file of a package that a text names, or the robot of that name."""
        try:
            return packaged(text, suffixes())
        except SpecError as error:
            here = source.document.locate(path)
            self.problems.extend(replace(problem, location=here, path=dotted(path)) for problem in error.problems)
            return None

    def _place(self, source: Source, path: tuple[Key, ...], text: str) -> Path | PackagedFile | None:
        """The file that a path of a spec means, where it may be read."""
        if len(text) > LONGEST_TEXT or UNSEEN_CHARACTERS.search(text):
            return None  # reported where it is read
        if not text.strip():
            self._problem(source, path, "not a file path", found=show(text), code="S305")
            return None
        if is_packaged(text):
            return self._packaged(source, path, text)
        project = self.project
        if project is not None and source.package is not None:
            project = source.package.root
        try:
            target = (source.folder / text).resolve()
            is_file = target.is_file()
        except (OSError, RuntimeError):  # links that lead to themselves, names that are too long
            self._problem(source, path, "this path does not exist", found=show(text), code="S305")
            return None
        if not is_file and path[-1] == "use" and is_robot(text):
            return self._packaged(source, path, text)
        if project is not None and not target.is_relative_to(project) and not self.options.allows(target):
            allowed = f"files in {shown_path(project)}"
            hint = self.options.way_outside()
            if (name := _installed_name(target)) is not None:
                hint = f"{name} names this file of an installed package"
            if source.package is not None:
                allowed, hint = f"files of {source.package.name}", "--allow-outside allows it"
            self._problem(
                source, path, "leaves the project folder", found=text, allowed=allowed, hint=hint, code="S306"
            )
            return None
        if not is_file:
            self._problem(source, path, "no such file", found=text, hint=_near_file(target), code="S305")
            return None
        package = source.package
        return PackagedFile(target, package) if package is not None and target.is_relative_to(package.root) else target

    def _find(
        self, source: Source, place: tuple[str, ...], placed: Mapping[str, Any], chain: tuple[Path, ...]
    ) -> Source | None:
        path, text = (*place, "use"), placed["use"]
        found = self._place(source, path, text)
        if found is None:
            return None
        target = found if isinstance(found, Path) else found.path
        if target in chain:
            loop = " -> ".join(file.name for file in (*chain[chain.index(target) :], target))
            self._problem(source, path, f"circular use of files: {loop}", found=text, code="S307")
            return None
        if len(chain) >= DEEPEST_USE:
            self._problem(
                source, path, f"more than {DEEPEST_USE} files use one another in a chain", found=text, code="S307"
            )
            return None
        said = placed.get("import")
        if said is not None and not is_foreign(target.name):
            hint = "remove it: this file is a spec"
            self._problem(
                source, (*place, "import"), "`import` is only for files of other languages", hint=hint, code="S307"
            )
            return None
        given = ImportOptions() if said is None else _options(said, source.folder, self.project)
        if given is None:
            return None  # reported where it is read
        options = given.together(self.options)
        if isinstance(found, PackagedFile):
            options = of_package(options, found)
        placement = placement_of(source.document, place, placed, source.placement)
        key = (target, options.key(), placement.key())
        if key not in self._read:
            self._read[key] = None
            where = (*place, "use" if said is None else "import")
            self._read[key] = self._load(target, chain, options, placement, where)
        used = self._read[key]
        if used is not None and isinstance(used.document.data, Mapping) and "model" not in used.document.data:
            hint = "a model file has `model: {bodies: ...}`"
            if used.imported is not None:
                hint = "a file of several trees is a scenario: `simspec import` writes it as a spec"
            self._problem(source, path, "this file contains no model", found=text, hint=hint, code="S307")
            return None
        return used

    def _load(
        self,
        target: Path,
        chain: tuple[Path, ...],
        options: ImportOptions,
        placement: ModelPlacement,
        where: tuple[str, ...],
    ) -> Source | None:
        """A file that a placement uses; ``where``: the place of what is wrong, but not with the file."""
        key = (target, options.key())
        if key not in self._opened:
            self._opened[key] = self._open(target, options, placement.document, where)
        opened = self._opened[key]
        if opened is None:
            return None
        written, imported = opened
        before, self._expanded = self._expanded, self._expanded + event_count(written.data)
        if self._expanded > MOST_EXPANDED:
            if before <= MOST_EXPANDED:
                message = "model files that are used in too many different ways: too many keys and values in all"
                found, allowed = f"{self._expanded:,}", f"up to {MOST_EXPANDED:,}"
                problem = placement.document.problem(placement.path, message, found=found, allowed=allowed, code="S109")
                self.problems.append(problem)
            return None
        document, wrong = instance(written, placement)
        file, problems = validate(document)
        self.problems.extend((*document.problems, *wrong, *problems))
        source = Source(document, target.parent, file, imported=imported, package=options.package, path=target)
        source.placement, source.written = placement, written
        self.collect(source, (*chain, target))
        return source

    def _open(
        self, target: Path, options: ImportOptions, user: Document, where: tuple[str, ...]
    ) -> tuple[Document, Imported | None] | None:
        """The document of a file that ``user`` uses, and what its importer made of it; None where it cannot be read."""
        try:
            if self.project is None or options.package is None:
                options = replace(options, project=self.project)
            return open_document(target, options.shown(target), options)
        except SpecError as error:
            here, path = user.locate(where), dotted(where)
            self.problems.extend(
                problem if problem.location is not None else replace(problem, location=here, path=problem.path or path)
                for problem in error.problems
            )
            return None


def open_document(path: Path, shown: str, options: ImportOptions) -> tuple[Document, Imported | None]:
    """The document of a spec, or of a file of another language with what its importer made of it. Raises SpecError."""
    if not is_foreign(path.name):
        return read(path, shown), None
    imported = import_file(path, shown, options)
    return imported.document(shown), imported


def _options(said: Any, folder: Path, project: Path | None) -> ImportOptions | None:
    """The options for an importer that a placement gives; None where it has errors."""
    try:
        return (said if isinstance(said, Import) else Import.model_validate(said)).options(folder, project)
    except ValidationError:
        return None


def _near_file(target: Path) -> str | None:
    from simspec.language.strict import near

    try:
        ends = (*NAMEABLE, *MESHES, *GRIDS, *suffixes())
        names = sorted(entry.name for entry in os.scandir(target.parent) if entry.name.lower().endswith(ends))
    except OSError:
        return None
    return near(target.name, names)
