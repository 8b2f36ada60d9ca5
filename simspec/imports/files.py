"""Files that a foreign file names: found by its own kinds of paths, and only where the user allows to read.

Allowed are the project folder of the file, and the folders of packages that the user names or that are installed. Every part of
a path is resolved first, links included, so that none leads out.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from simspec.errors import UNSEEN_CHARACTERS, Problem, SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.imports.elements import Element
from simspec.imports.packages import MissingFileError, Packages, named_folders, package_path, why_not
from simspec.language.foreign import ImportOptions

LARGEST_FILE: Final = 256 * 2**20
"""Bytes of one file that another names; a mesh of the largest that is read (200,000 faces as text) has 40 million."""
LONGEST_PATH: Final = 1000
"""Characters of a path in a file."""
PACKAGE: Final = re.compile(r"(package|model):///?([^/\\]+)/?(.*)", re.DOTALL)
FIND: Final = re.compile(r"\$\(find\s+([^)\s]+)\)/?(.*)", re.DOTALL)
SCHEME: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://(.*)", re.DOTALL)
NETWORK: Final = ("http", "https", "ftp")
"""Schemes of what would be loaded from the network."""
LIBRARY: Final = re.compile(
    r"https?://[^/]*fuel[^/]*/1\.0/[^/]+/models/([^/]+)(?:/(?:\d+|tip))?(?:/files)?/?(.*)", re.DOTALL | re.IGNORECASE
)
"""A model of the public library of models (Fuel), and a file of it."""
DRIVE: Final = re.compile(r"(?:file:/*)?[A-Za-z]:[/\\]", re.IGNORECASE)
"""How a path of Windows begins."""
PLACEHOLDER: Final = re.compile(r"@[A-Za-z_]\w*@|\$\{[^}]*\}|\{\{.*?\}\}|\$\((?!find\s)[^)]*\)")
"""A text that a build, or another program, replaces."""
NO_FILE: Final = ("no such file", "this path does not exist")
"""What :meth:`Files.find` says of a file that is not there."""
MOST_ABOVE: Final = 4
"""Folders above a file that are looked into."""


@dataclass
class Files:
    """The files that one import reads, the file itself first. ``read`` remembers the SHA-256 of all that was read."""

    path: Path
    shown: str
    options: ImportOptions
    read: dict[Path, str] = field(default_factory=dict)
    looks_above: bool = False
    """Whether relative paths that lead nowhere are looked for in the folders above the file: the output of a program is written
    somewhere, and its paths start there."""
    above: dict[str, Path] = field(default_factory=dict)
    """Files that were found so: the folder, by the path."""

    @functools.cached_property
    def roots(self) -> tuple[Path, ...]:
        """Folders whose files may be read; empty: any."""
        if self.options.project is None:
            return ()
        named = [*named_folders(self.options).values(), *package_path(self.options), *map(Path, self.options.allowed)]
        # unlike Path.resolve, realpath has an answer for links that lead to themselves: there is nothing below them
        return tuple(Path(os.path.realpath(folder)) for folder in dict.fromkeys((self.options.project, *named)))

    def content(self) -> bytes:
        """The file itself. Raises SpecError where it cannot be read."""
        return self._bytes(self.path.resolve(), Problem(f"{self.shown}: cannot be read"))

    def bytes_of(self, path: Path, element: Element) -> bytes:
        """A file that :meth:`find` gave. Raises SpecError at the element that names it."""
        return self._bytes(path, element.problem(f"{path.name} cannot be read"))

    def _bytes(self, path: Path, problem: Problem) -> bytes:
        try:
            content = read_bytes(path, LARGEST_FILE, links=True)
        except (NotReadableError, OSError) as error:
            raise SpecError([replace(problem, message=f"{problem.message}: {why_not(error)}")]) from None
        self.read[path] = hashlib.sha256(content).hexdigest()
        return content

    @functools.cached_property
    def packages(self) -> Packages:
        """The packages that paths name."""
        return Packages(self.path.resolve().parent, self.options, self._is_inside)

    def _is_inside(self, path: Path) -> bool:
        return not self.roots or any(path.is_relative_to(root) for root in self.roots)

    def find(self, text: str, element: Element, start: Path | None = None) -> Path:
        """The file that a path in a file means: ``package://``, ``model://``, ``$(find)/``, ``file://``, or relative to
        ``start`` (the folder of the file); ``%20`` is a space where there is no file of that very name. Raises SpecError at
        ``element`` for what does not exist or may not be read."""
        if len(text) > LONGEST_PATH or UNSEEN_CHARACTERS.search(text) or not text.strip():
            raise element.error("not a file path", found=text[:80])
        if DRIVE.match(text):
            raise MissingFileError([_of_another_system(text, element)])
        try:
            return self._find(text, element, start)
        except MissingFileError:
            plain = unquote(text)
            if plain != text and not UNSEEN_CHARACTERS.search(plain):
                with contextlib.suppress(MissingFileError):
                    return self._find(plain, element, start)
            if "\\" in text:
                raise MissingFileError([_of_another_system(text, element)]) from None
            if PLACEHOLDER.search(text):
                message, hint = (
                    "a path with a placeholder that a build replaces",
                    "import the file that the build makes of this one",
                )
                raise MissingFileError([element.problem(message, found=text[:200], hint=hint)]) from None
            raise

    def _find(self, text: str, element: Element, start: Path | None) -> Path:
        target = self._target(text, element, start or self.path.parent)
        try:
            resolved = target.resolve()
            is_file = resolved.is_file()
        except (OSError, RuntimeError):  # links that lead to themselves, names that are too long
            raise MissingFileError([element.problem(NO_FILE[1], found=text[:200])]) from None
        if not self._is_inside(resolved):
            hint = self.options.way_outside("--package-path names a folder of packages")
            raise element.error("leaves the project folder", found=text, hint=hint)
        if not is_file and start is None and (other := self._above(text)) is not None:
            return other
        if not is_file:
            hint = f"looked for {self.options.shown(target)}"
            raise MissingFileError([element.problem(NO_FILE[0], found=text, hint=hint)])
        return resolved

    def _above(self, text: str) -> Path | None:
        """The file of a relative path in the nearest folder above the file, none of them outside :attr:`roots`."""
        if not self.looks_above or any(pattern.fullmatch(text) for pattern in (FIND, PACKAGE, SCHEME)):
            return None
        for folder in list(self.path.resolve().parent.parents)[:MOST_ABOVE]:
            if not self._is_inside(folder):
                return None
            found = Path(os.path.realpath(folder / text))
            if self._is_inside(found) and found.is_file() and not Path(text).is_absolute():
                self.above[text] = folder
                return found
        return None

    def _target(self, text: str, element: Element, start: Path) -> Path:
        if match := FIND.fullmatch(text) or PACKAGE.fullmatch(text):
            *_, name, rest = match.groups()
            if not rest.strip("/") and (start / name).is_file():
                return start / name  # package://wheel.obj: a file without a package, as some write it
            return self.packages.find(name, element) / rest.lstrip("/")
        if match := SCHEME.fullmatch(text):
            scheme, rest = match.groups()
            if scheme.lower() in NETWORK:
                return self._downloaded(text, element)
            if scheme.lower() != "file":
                raise element.error(
                    f"{scheme}:// is not read", found=text, allowed="package://, model://, file://, a path"
                )
            inner = rest.lstrip("/")
            if FIND.fullmatch(inner) or PACKAGE.fullmatch(inner):
                return self._target(inner, element, start)
            return start / (rest.removeprefix("localhost") if rest.startswith("localhost/") else rest)
        return start / text

    def _downloaded(self, text: str, element: Element) -> Path:
        """The file of a model of the public library that the user has as a package. Raises MissingFileError for another."""
        match = LIBRARY.fullmatch(text)
        hint = "save the file, and name it by its path"
        if match is not None:
            name, rest = unquote(match[1]), match[2]
            hint = f"download the model {name!r} (gz fuel download -u URL), and say --package {name!r}=FOLDER"
            with contextlib.suppress(MissingFileError):
                target = self.packages.find(name, element) / rest
                if os.path.isfile(target):
                    return target
        problem = element.problem("simspec loads nothing from the network", found=text[:200], hint=hint)
        raise MissingFileError([problem])


def _of_another_system(text: str, element: Element) -> Problem:
    """A path as Windows writes it."""
    hint = "write it with / and from the folder of the file, or as package://NAME/PATH"
    return element.problem("a path of Windows", found=text[:200], hint=hint)


def is_missing(error: SpecError) -> bool:
    """Whether :meth:`Files.find` found nothing there, where reading would be allowed."""
    return all(problem.message in NO_FILE for problem in error.problems)
