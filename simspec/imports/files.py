"""Files that a foreign file names: found by its own kinds of paths, and only where the user allows to read.

Allowed are the project folder of the file, and the folders of packages that the user names or that are installed. Every part of
a path is resolved first, links included, so that none leads out.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from simspec.errors import UNSEEN_CHARACTERS, Problem, SpecError
from simspec.imports.elements import Element
from simspec.language.foreign import ImportOptions
from simspec.reading import NotReadableError, read_bytes

LARGEST_FILE: Final = 256 * 2**20
"""Bytes of one file that another names; a mesh of the largest that is read (200,000 faces as text) has 40 million."""
LONGEST_PATH: Final = 1000
"""Characters of a path in a file."""
PACKAGE: Final = re.compile(r"(package|model):///?([^/\\]+)/?(.*)", re.DOTALL)
FIND: Final = re.compile(r"\$\(find\s+([^)\s]+)\)/?(.*)", re.DOTALL)
SCHEME: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://(.*)", re.DOTALL)
MARKS: Final = ("package.xml", "model.config")
"""Files by which a folder is known as a package."""
NO_FILE: Final = ("no such file", "this path does not exist")
"""What :meth:`Files.find` says of a file that is not there."""
MOST_ABOVE: Final = 4
"""Folders above a file that are looked into."""
MOST_FOLDERS: Final = 20_000
"""Folders that are looked at for one package."""


class MissingFileError(SpecError):
    """A file or a package that is not there."""


@dataclass
class Files:
    """What one import reads: the file itself first. ``read`` remembers the SHA-256 of all that was read."""

    path: Path
    shown: str
    options: ImportOptions
    read: dict[Path, str] = field(default_factory=dict)
    looks_above: bool = False
    """Whether relative paths that lead nowhere are looked for in the folders above the file: what a program makes is written
    somewhere, and its paths start there."""
    above: dict[str, Path] = field(default_factory=dict)
    """What was found so: the folder, by the path."""

    @functools.cached_property
    def roots(self) -> tuple[Path, ...]:
        """Folders whose files may be read; empty: any."""
        if self.options.project is None:
            return ()
        named = [*self._named().values(), *self._folders(), *map(Path, self.options.allowed)]
        # unlike Path.resolve, realpath has an answer for links that lead to themselves: there is nothing below them
        return tuple(Path(os.path.realpath(folder)) for folder in dict.fromkeys((self.options.project, *named)))

    def content(self) -> bytes:
        """The file itself. Raises SpecError where it cannot be read."""
        return self._bytes(self.path.resolve(), Problem(f"{self.shown}: cannot be read"))

    def bytes_of(self, path: Path, element: Element) -> bytes:
        """A file that :meth:`find` gave. Raises SpecError at the element that names it."""
        return self._bytes(path, element.problem(f"{path.name} cannot be read"))

    def _bytes(self, path: Path, problem: Problem) -> bytes:
        why = ""
        try:
            content = read_bytes(path, LARGEST_FILE, links=True)
        except NotReadableError as error:
            why = str(error)
        except OSError as error:
            why = error.strerror or str(error)
        if why:
            message = f"{problem.message}: {why}"
            raise SpecError(
                [Problem(message, problem.path, problem.location, problem.found, problem.allowed, problem.hint)]
            )
        self.read[path] = hashlib.sha256(content).hexdigest()
        return content

    def find(self, text: str, element: Element, beside: Path | None = None) -> Path:
        """The file that a path in a file means: ``package://``, ``model://``, ``$(find)/``, ``file://``, or relative to
        ``beside`` (the folder of the file). Raises SpecError at ``element`` for what does not exist or may not be read."""
        if len(text) > LONGEST_PATH or UNSEEN_CHARACTERS.search(text) or not text.strip():
            raise element.error("not a file path", found=text[:80])
        target = self._target(text, element, beside or self.path.parent)
        try:
            resolved = target.resolve()
            is_file = resolved.is_file()
        except (OSError, RuntimeError):  # links that lead to themselves, names that are too long
            raise MissingFileError([element.problem(NO_FILE[1], found=text[:200])]) from None
        if self.roots and not any(resolved.is_relative_to(root) for root in self.roots):
            hint = self.options.way_outside("--package-path names a folder of packages")
            raise element.error("leaves the project folder", found=text, hint=hint)
        if not is_file and beside is None and (other := self._above(text)) is not None:
            return other
        if not is_file:
            raise MissingFileError([element.problem(NO_FILE[0], found=text, hint=f"looked for {_short(target)}")])
        return resolved

    def _above(self, text: str) -> Path | None:
        """The file of a relative path in the nearest folder above the file, none of them outside :attr:`roots`."""
        if not self.looks_above or any(pattern.fullmatch(text) for pattern in (FIND, PACKAGE, SCHEME)):
            return None
        for folder in list(self.path.resolve().parent.parents)[:MOST_ABOVE]:
            if self.roots and not any(folder.is_relative_to(root) for root in self.roots):
                return None
            found = Path(os.path.realpath(folder / text))
            inside = not self.roots or any(found.is_relative_to(root) for root in self.roots)
            if inside and found.is_file() and not Path(text).is_absolute():
                self.above[text] = folder
                return found
        return None

    def _target(self, text: str, element: Element, beside: Path) -> Path:
        if match := FIND.fullmatch(text) or PACKAGE.fullmatch(text):
            *_, name, rest = match.groups()
            if not rest.strip("/") and (beside / name).is_file():
                return beside / name  # package://wheel.obj: a file without a package, as some write it
            return self.package(name, element) / rest.lstrip("/")
        if match := SCHEME.fullmatch(text):
            scheme, rest = match.groups()
            if scheme.lower() != "file":
                raise element.error(
                    f"{scheme}:// is not read", found=text, allowed="package://, model://, file://, a path"
                )
            return beside / rest
        return beside / text

    # --- packages ---------------------------------------------------------------------------------------------

    def package(self, name: str, element: Element) -> Path:
        """The folder of a package. Raises SpecError where none is found."""
        if name in (".", "..") or "/" in name or "\\" in name:
            raise element.error("not the name of a package", found=name[:80])
        named = self._named()
        if name in named:
            return named[name]
        for candidate in itertools.chain(self._above_and_beside(name), self._in(self._given_folders(), name)):
            if candidate.is_dir():
                return candidate
        if self.options.trusting:  # the folders of the project file come before those of the environment
            message = f"the package {name!r} is sought in folders of a project file that is not trusted"
            raise element.error(message, found=name, hint=self.options.trusting)
        for candidate in self._in(self._installed_folders(), name):
            if candidate.is_dir():
                return candidate
        hint = f"--package-path FOLDER (a folder that holds {name}), or --package {name}=FOLDER"
        raise MissingFileError([element.problem(f"the package {name!r} is not found", found=name, hint=hint)])

    def _named(self) -> dict[str, Path]:
        return {name: self.options.base / folder for name, folder in self.options.packages.items()}

    def _folders(self) -> Iterator[Path]:
        """Folders of packages that the user or the environment names."""
        yield from self._given_folders()
        yield from self._installed_folders()

    def _given_folders(self) -> Iterator[Path]:
        for text in self.options.package_path:
            yield self.options.base / text

    def _installed_folders(self) -> Iterator[Path]:
        for text in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
            if text:
                yield Path(text)
        for text in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if text:
                yield Path(text) / "share"

    def _above_and_beside(self, name: str) -> Iterator[Path]:
        """Folders that a package of this name may be: above the file and beside those."""
        project = self.options.project.resolve() if self.options.project is not None else None
        for folder in self.path.resolve().parents:
            if folder.name == name:
                yield folder
            yield folder / name
            if folder == project:
                break

    def _in(self, folders: Iterable[Path], name: str) -> Iterator[Path]:
        """Folders that a package of this name may be in folders of packages."""
        for folder in folders:
            if folder.name == name and any((folder / mark).exists() for mark in MARKS):
                yield folder
            yield folder / name
            yield from _below(folder, name)


def is_missing(error: SpecError) -> bool:
    """Whether :meth:`Files.find` found nothing there, where reading would be allowed."""
    return all(problem.message in NO_FILE for problem in error.problems)


def _below(folder: Path, name: str) -> Iterator[Path]:
    """Packages of a name deeper in a folder, the nearest first; a package has no packages in it."""
    waiting, seen = [folder], 0
    while waiting and seen < MOST_FOLDERS:
        following: list[Path] = []
        for place in waiting:
            seen += 1
            try:
                inside = sorted(entry.path for entry in os.scandir(place) if entry.is_dir(follow_symlinks=False))
            except OSError:
                continue  # what may not be looked at holds no package that could be read
            for path in map(Path, inside):
                is_package = any((path / mark).exists() for mark in MARKS)
                if path.name == name and is_package:
                    yield path
                if not is_package and not path.name.startswith("."):
                    following.append(path)
        waiting = following


def _short(path: Path) -> str:
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
