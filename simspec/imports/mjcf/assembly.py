"""The files of one MJCF model put together as texts for its compiler: includes in place, every named file read and given a name
of its own, so that the compiler opens none; each element begins on a line of its own, by which it is found again.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence, Sized
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final
from xml.sax.saxutils import quoteattr

from simspec import numerals
from simspec.imports.elements import DEEPEST, MOST_BODIES, SPLIT, Element, parse
from simspec.imports.files import Files, MissingFileError
from simspec.language.foreign import Account

ROOT: Final = "mujoco"
"""The name of the outermost element."""
MOST_ELEMENTS: Final = 60_000
"""Elements of a model with all replicates; one body of 100,000 takes the compiler minutes."""
MOST_COPIES: Final = 10**9
"""The number of copies that stands for larger ones: more than is allowed of anything. Products of numbers of thousands
of digits would take minutes."""
MOST_CELLS: Final = 10_000_000
"""Cells of a height field."""
MOST_FILES: Final = 2000
"""Files of one model."""
MOST_BYTES: Final = 512 * 2**20
"""Bytes of all files of one model."""
LEFT_OUT: Final = frozenset(
    ("sensor", "visual", "statistic", "custom", "size", "texture", "layer", "skin", "light", "camera")
)
"""Elements that no body follows from; they are accounted for, and not compiled."""
FOLDERS: Final = {"mesh": "meshdir", "hfield": "meshdir"}
"""Which folder of ``compiler`` the files of an element are in; none: that of the main file."""
REFUSED: Final = {"flexcomp": "deformable bodies are not supported", "flex": "deformable bodies are not supported"}
"""Elements that make bodies which the spec's language does not have."""


@dataclass
class _Folders:
    """The folders of files that ``compiler`` states."""

    meshdir: str = ""
    strippath: bool = False


@dataclass
class MjcfAssembly:
    """A model as its compiler gets it."""

    root: Element
    texts: dict[str, bytes] = field(default_factory=dict)
    """All files by the names that the texts have for them, the main one first."""
    lines: dict[int, Element] = field(default_factory=dict)
    """Elements by their line; lines of different texts are different."""
    named: dict[str, Path] = field(default_factory=dict)
    """Files by those names."""
    included: dict[int, Element] = field(default_factory=dict)
    """The outermost element of each included file, by the ``id`` of the element that includes it."""
    models: list[Element] = field(default_factory=list)
    """The outermost elements of models that are attached."""
    mesh_files: dict[str, Path] = field(default_factory=dict)
    """Files of meshes, by the names of the texts."""

    def accounts(self) -> list[Account]:
        """Those of all files, the main one first."""
        return [account for root in (self.root, *self.included.values(), *self.models) for account in root.accounts()]

    def below(self, element: Element) -> Iterator[Element]:
        """The children of an element, includes in place."""
        for child in element.look():
            if id(child) in self.included:
                yield from self.below(self.included[id(child)])
            else:
                yield child

    def everything(self) -> Iterator[Element]:
        """Every element but includes, of all files, each before what is in it."""
        return self.inside(self.root, *self.models)

    def inside(self, *roots: Element) -> Iterator[Element]:
        """The same of some elements, these among them."""
        waiting = [*reversed(roots)]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(list(self.below(element))))


def assemble(files: Files) -> MjcfAssembly:
    """Read a model and all files that it names. Raises SpecError at the element that names one which may not be read, and
    for what is too much."""
    root = parse(files.content(), files.shown)
    if root.tag != ROOT:
        raise root.error(f"an MJCF file begins with <{ROOT}>", found=f"<{root.tag[:80]}>", code="I101")
    builder = _ModelBuilder(files, MjcfAssembly(root))
    builder.model(root, files.path.resolve(), "main.xml")
    return builder.made


class _ModelBuilder:
    def __init__(self, files: Files, made: MjcfAssembly):
        self.files, self.made = files, made
        self._given: dict[Path, str] = {}
        self._model_names: dict[Path, str] = {}
        self._chain: list[Path] = []
        self._homes: dict[int, Path] = {}
        """The folder of each included file, by the ``id`` of its outermost element."""
        self._line = 1
        self._elements = self._bodies = 0
        self._bytes = 0

    def model(self, root: Element, path: Path, name: str) -> None:
        """Put a model, and those that it attaches, into ``texts``."""
        self._chain.append(path)
        self.made.texts[name] = b""  # the main text is the first
        self._include(root, path, [path])
        folders = self._folders(root)
        # attached models first: their lines are before this one's
        for element in self.made.inside(root):
            if element.tag == "model" and element.has("file"):
                self._attached(element, path)
        begin = self._line
        lines: list[str] = []
        self._emit(root, lines, 1, 1, folders, path)
        self.made.texts[name] = ("\n" * (begin - 1) + "\n".join(lines) + "\n").encode()
        self._chain.pop()

    def _emit(self, element: Element, lines: list[str], depth: int, copies: int, folders: _Folders, path: Path) -> None:
        """The lines of an element; ``copies``: how often replicates around it make it."""
        if depth > DEEPEST:
            raise element.error(f"more than {DEEPEST} elements within each other", code="I105")
        if element.tag in REFUSED:
            raise element.error(f"<{element.tag}>: {REFUSED[element.tag]}", hint="remove it", code="I104")
        if element.tag == "replicate":
            copies = min(copies * _count(element, "count"), MOST_COPIES)
        made = copies * (_cells(element) if element.tag == "composite" else 1)
        self._elements += made
        if self._elements > MOST_ELEMENTS:
            raise element.error(
                "too many elements, replicates counted", allowed=f"{MOST_ELEMENTS:,}", hint=SPLIT, code="I105"
            )
        self._bodies += made if element.tag in ("body", "composite") else 0
        if self._bodies > MOST_BODIES:
            raise element.error(
                "too many bodies, replicates counted", allowed=f"{MOST_BODIES:,}", hint=SPLIT, code="I105"
            )
        self.made.lines[self._line] = element
        attributes = self._attributes(element, folders, path)
        begin = " ".join((element.tag, *(f"{name}={quoteattr(value)}" for name, value in attributes.items())))
        inside = [child for child in self.made.below(element) if child.tag not in LEFT_OUT]
        self._line += 1
        if not inside:
            lines.append(f"<{begin}/>")
            return
        lines.append(f"<{begin}>")
        for child in inside:
            self._emit(child, lines, depth + 1, copies, folders, path)
        self._line += 1
        lines.append(f"</{element.tag}>")

    def _attributes(self, element: Element, folders: _Folders, path: Path) -> dict[str, str]:
        attributes = {
            name: " ".join(numerals.parts_of(value))
            for name, value in element.attributes.items()
            if not name.startswith("{")
        }
        if element.tag == "compiler":
            for name in ("meshdir", "texturedir", "assetdir", "strippath"):
                attributes.pop(name, None)
        if element.tag == "material":
            attributes.pop("texture", None)
        if element.tag == "hfield" and _count(element, "nrow") * _count(element, "ncol") > MOST_CELLS:
            raise element.error("too large a height field", allowed=f"{MOST_CELLS:,} cells", code="I105")
        if element.tag == "model" and "file" in attributes:
            attributes["file"] = self._model_names[self.files.find(attributes["file"], element, path.parent)]
        elif element.tag in FOLDERS and "file" in attributes:
            text = _in_folder(attributes["file"], getattr(folders, FOLDERS[element.tag]), folders.strippath)
            attributes.setdefault("name", PurePosixPath(attributes["file"].replace("\\", "/")).stem)
            attributes["file"] = self._file(text, element, path.parent)
        return attributes

    def _file(self, text: str, element: Element, folder: Path) -> str:
        """The name in the texts of a file, which is read. One that an included file names, and that is not where the model has
        its files, is in the folder of the included file."""
        places = [(text, folder)]
        if (home := self._home(element)) is not None:
            places.append((element.attributes["file"].strip().replace("\\", "/"), home))
        found = self._first(places, element)
        if found not in self._given:
            _demand_few(self._given, element)
            content = self.files.bytes_of(found, element)
            self._bytes += len(content)
            if self._bytes > MOST_BYTES:
                raise element.error(
                    "the files of this model are too large", allowed=f"{MOST_BYTES:,} bytes together", code="I105"
                )
            suffix = found.suffix.lower()
            name = f"file{len(self._given)}{suffix if suffix.isascii() and suffix != '.xml' else ''}"
            self._given[found] = name
            self.made.texts[name] = content
            self.made.named[name] = found
        if element.tag == "mesh":
            self.made.mesh_files[self._given[found]] = found
        return self._given[found]

    def _home(self, element: Element) -> Path | None:
        around = element
        while around.parent is not None:
            around = around.parent
        return self._homes.get(id(around))

    def _include(self, root: Element, main: Path, seen: list[Path]) -> None:
        """Read what is included, and what that includes; each path once, as the compiler has it."""
        waiting = [(root, main.parent, 1)]
        while waiting:
            element, home, depth = waiting.pop()
            for child in element.look():
                if child.tag != "include":
                    waiting.append((child, home, depth))
                    continue
                if depth > DEEPEST:
                    raise child.error(f"more than {DEEPEST} files that include each other in a chain", code="I105")
                name, path = self._relative_file(child.take().need("file"), child, (main.parent, home))
                if name in seen:
                    hint = "the compiler of this language reads each file once"
                    raise child.error(
                        "this file is included already, or is the file itself", path.name, hint=hint, code="I101"
                    )
                _demand_few(seen, child)
                seen.append(name)
                inside = parse(self.files.bytes_of(path, child), _shown(self.files, path))
                self.made.included[id(child)] = inside
                self._homes[id(inside)] = name.parent
                waiting.append((inside, name.parent, depth + 1))

    def _relative_file(self, text: str, element: Element, folders: Sequence[Path]) -> tuple[Path, Path]:
        """A file whose path starts from the first of the folders where there is one: the path without links followed, by which
        the compiler knows a file, and the file. Raises MissingFileError."""
        found = self._first([(text, folder) for folder in dict.fromkeys(folders)], element)
        names = (Path(os.path.normpath(folder / text)) for folder in folders)
        return next((name for name in names if os.path.realpath(name) == str(found)), found), found

    def _first(self, places: Sequence[tuple[str, Path]], element: Element) -> Path:
        """The first of some files that is there: paths, each with the folder that it starts from. Raises the error of the
        first."""
        missing: list[MissingFileError] = []
        for text, folder in places:
            try:
                return self.files.find(text, element, folder)
            except MissingFileError as error:
                missing.append(error)
        raise missing[0]

    def _attached(self, element: Element, path: Path) -> None:
        found = self.files.find(element.attributes["file"], element, path.parent)
        if found in self._chain:
            raise element.error("this model attaches itself", found=found.name, code="I101")
        if found in self._model_names:
            return
        _demand_few(self._model_names, element)
        if len(self._chain) > DEEPEST:
            raise element.error(f"more than {DEEPEST} models within each other", code="I105")
        root = parse(self.files.bytes_of(found, element), _shown(self.files, found))
        if root.tag != ROOT:
            raise element.error("only models in MJCF can be attached", found=found.name, code="I101")
        self._model_names[found] = name = f"model{len(self._model_names)}.xml"
        self.made.models.append(root)
        self.model(root, found, name)

    def _folders(self, root: Element) -> _Folders:
        folders = _Folders()
        for element in self.made.inside(root):
            if element.tag != "compiler":
                continue
            for name in ("assetdir", "meshdir"):
                if element.has(name):
                    folders.meshdir = element.attributes[name].strip()
            if element.has("strippath"):
                folders.strippath = element.attributes["strippath"].strip() == "true"
        return folders


def _demand_few(read: Sized, element: Element) -> None:
    if len(read) >= MOST_FILES:
        raise element.error("too many files", allowed=f"{MOST_FILES:,}", code="I105")


def _shown(files: Files, path: Path) -> str:
    """How messages call a file: relative to the main one as that is called."""
    try:
        inside = path.relative_to(files.path.resolve().parent)
        return files.options.shown(path) if files.options.package else str(Path(files.shown).parent / inside)
    except ValueError:
        return files.options.shown(path)


def _in_folder(text: str, folder: str, strip: bool) -> str:
    text = text.strip().replace("\\", "/")
    if strip:
        text = PurePosixPath(text).name
    if not folder or text.startswith("/") or "://" in text:
        return text
    return f"{folder.rstrip('/')}/{text}"


def _copies(text: str) -> int:
    """A number of copies, at least 1 and at most MOST_COPIES. Raises NumeralError."""
    if numerals.WHOLE.fullmatch(text) and len(text) > numerals.MOST_DIGITS:
        return 1 if text.startswith("-") else MOST_COPIES
    return min(max(1, numerals.whole(text)), MOST_COPIES)


def _count(element: Element, name: str) -> int:
    """A whole number of an attribute, at least 1."""
    text = element.attributes.get(name, "1")
    try:
        return _copies(numerals.parts_of(text)[0])
    except (numerals.NumeralError, IndexError):
        raise element.error(
            f"{name} of <{element.tag}> should be a whole number", found=text[:80], code="I101"
        ) from None


def _cells(element: Element) -> int:
    product = 1
    for text in numerals.parts_of(element.attributes.get("count", "1")):
        try:
            product = min(product * _copies(text), MOST_COPIES)
        except numerals.NumeralError:
            raise element.error(
                f"count of <{element.tag}> should be whole numbers", found=text[:80], code="I101"
            ) from None
    return product
