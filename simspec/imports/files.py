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
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from simspec.errors import UNSEEN_CHARACTERS, Location, Problem, SpecError
from simspec.files import NotReadableError, read_bytes
from simspec.imports.elements import Element, parse
from simspec.language.foreign import ImportOptions

# Packages of robot files: folders that `package://NAME`, `model://NAME` and `$(find NAME)` mean.
#
# A package is known by the `<name>` in its ``package.xml``, whatever its folder is called, or by the name of its folder
# (the ``model.config`` of a model says no name that paths use). :data:`ENVIRONMENT` lists the variables that name folders.

MANIFEST: Final = "package.xml"
CONFIGURATIONS: Final = ("model.config", "manifest.xml")
"""Files of a folder of a model, the second in models of before 2013; they say which file of it is read."""
MARKS: Final = (MANIFEST, *CONFIGURATIONS)
"""Files by which a folder is known as a package."""
IGNORED: Final = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
"""Files of folders that the build tools of ROS do not look into: the copies that they install, in a workspace's ``install``."""
SHARE: Final = "share"
"""Where an installed package has its files: ``PREFIX/share/NAME``."""
SOURCES: Final = "src"
"""The folder of packages in a workspace."""
ENVIRONMENT: Final = (
    ("ROS_PACKAGE_PATH", ""),
    ("AMENT_PREFIX_PATH", SHARE),
    ("GZ_SIM_RESOURCE_PATH", ""),
    ("IGN_GAZEBO_RESOURCE_PATH", ""),
    ("GAZEBO_MODEL_PATH", ""),
    ("SDF_PATH", ""),
)
"""Variables that list folders of packages, each with the folder below that the packages are in."""
MOST_FOLDERS: Final = 20_000
"""Folders that are looked at below one folder."""
LARGEST_MANIFEST: Final = 256 * 2**10
"""Bytes of a ``package.xml``; 2 kB are usual."""
MOST_MANIFESTS: Final = 32 * 2**20
"""Bytes of all that one import reads."""
LONGEST_NAME: Final = 255
"""Characters of a name: those of a folder."""

Levels = Iterator[list[Path]]
"""Folders that may be a package, those at one distance together, the nearest first."""


class MissingFileError(SpecError):
    """A file or a package that is not there."""


def named_folders(options: ImportOptions) -> dict[str, Path]:
    """The folders of packages that are named one by one."""
    return {name: options.base / folder for name, folder in options.packages.items()}


def package_path(options: ImportOptions) -> list[Path]:
    """The folders in which packages are looked for: those of the options, then those of the environment."""
    folders = [options.base / text for text in options.package_path]
    for variable, below in ENVIRONMENT:
        folders += [Path(text) / below for text in os.environ.get(variable, "").split(os.pathsep) if text]
    return list(dict.fromkeys(folders))


@dataclass
class Packages:
    """Finds the packages of one import. ``inside``: whether a file may be read, all links resolved."""

    start: Path
    """The folder of the imported file."""
    options: ImportOptions
    inside: Callable[[Path], bool] = lambda path: True
    _found: dict[str, Path] = field(default_factory=dict)
    _manifests: dict[Path, bytes | str] = field(default_factory=dict)
    """The content of each ``package.xml``, or why it is not read, by the folder of the package."""
    _bytes: int = 0
    _below: dict[Path, _PackageTree] = field(default_factory=dict)

    @functools.cached_property
    def path(self) -> list[Path]:
        """The folders in which packages are looked for, after those about the file."""
        return package_path(self.options)

    def find(self, name: str, element: Element) -> Path:
        """The folder of a package, the nearest one. Raises MissingFileError where there is none, and SpecError where two are as
        near, or where the ``package.xml`` that would decide is damaged."""
        if not _is_name(name):
            raise element.error("not the name of a package", found=name[:80], code="I101")
        if name not in self._found:
            self._found[name] = self._find(name, element)
        return self._found[name]

    def _find(self, name: str, element: Element) -> Path:
        named = named_folders(self.options)
        if name in named:
            return _installed(named[name], name)
        damaged: dict[Path, Problem] = {}
        for levels in self._searches(name, element):
            for level in levels:
                found = self._among(name, level, damaged)
                if len(found) > 1:
                    listed = ", ".join(map(str, found[:4]))
                    hint = f"--package {name}=FOLDER chooses one"
                    raise element.error(f"two packages are called {name!r}", found=listed, hint=hint, code="I106")
                if found:
                    return found[0]
        hint = f"--package-path FOLDER (a folder that holds {name}), or --package {name}=FOLDER"
        problem = element.problem(f"the package {name!r} is not found", found=name, hint=hint, code="I106")
        if damaged:
            raise SpecError([problem, *list(damaged.values())[:4]])
        if any(tree.is_cut for tree in self._below.values()):
            problem = element.problem(
                f"{problem.message} in the first {MOST_FOLDERS:,} folders", found=name, hint=hint, code="I106"
            )
        raise MissingFileError([problem])

    def _searches(self, name: str, element: Element) -> Iterator[Levels]:
        """Each place that is searched, in their order: above the file and next to each folder above; below the package that the
        file is in, which may have models; along the path; below the project, or below the workspace that the file is in."""
        yield self._above(name)
        for folder in self._folders_above():
            if _has(folder, MANIFEST):
                yield self._tree(folder).levels()
                break
        given = len({self.options.base / text for text in self.options.package_path})
        for number, folder in enumerate(self.path):
            if number == given:
                self._demand_trust(name, element)
            yield iter([[folder]] if _has(folder, *MARKS) else [])
            yield iter([self._siblings(folder, name)])
            yield self._tree(folder).levels()
        if given == len(self.path):
            self._demand_trust(name, element)
        around = self._around()
        if around is not None:
            yield self._tree(around).levels()

    def _demand_trust(self, name: str, element: Element) -> None:
        """Raise SpecError where the folders of a project file that is not trusted come next: no package that is found later is
        taken in place of one of theirs."""
        if self.options.trusting:
            message = f"the package {name!r} is sought in folders of a project file that is not trusted"
            raise element.error(message, found=name, hint=self.options.trusting, code="I107")

    def _above(self, name: str) -> Levels:
        for folder in self._folders_above():
            if folder.name == name or _has(folder, MANIFEST):
                yield [folder]
            yield self._siblings(folder, name)

    def _siblings(self, folder: Path, name: str) -> list[Path]:
        """The packages in a folder, with the folder of this name, which may be without a mark."""
        direct = folder / name
        marked = [path for path in self._tree(folder).first() if path != direct]
        return [direct, *marked] if os.path.isdir(direct) else marked

    def _folders_above(self) -> Iterator[Path]:
        project = self.options.project.resolve() if self.options.project is not None else None
        for folder in (self.start, *self.start.parents):
            yield folder
            if folder == project:
                return

    def _around(self) -> Path | None:
        """The folder below which all packages are looked for; None: nowhere."""
        if self.options.project is not None:
            return self.options.project.resolve()
        return next((folder for folder in reversed(self.start.parents) if folder.name == SOURCES), None)

    def _tree(self, folder: Path) -> _PackageTree:
        if folder not in self._below:
            self._below[folder] = _PackageTree(folder)
        return self._below[folder]

    def _among(self, name: str, level: list[Path], damaged: dict[Path, Problem]) -> list[Path]:
        """Those of the folders that are the package: by their ``package.xml``, else by their own name. Raises SpecError where
        the ``package.xml`` of a folder of this name is damaged."""
        declared: dict[str, Path] = {}
        called: dict[str, Path] = {}
        for candidate in level:
            folder = _installed(candidate, name) if candidate.name == name else candidate
            said = self._declared(folder, name)
            if isinstance(said, Problem):
                said = replace(said, hint=f"repair it, or --package {name}=FOLDER")
                if folder.name == name:
                    raise SpecError([said])
                damaged[folder] = said
            elif said == name:
                declared.setdefault(os.path.realpath(folder), folder)
            elif folder.name == name:
                called.setdefault(os.path.realpath(folder), folder)
        return list((declared or called).values())

    def _declared(self, folder: Path, name: str) -> str | Problem | None:
        """The name in the ``package.xml`` of a folder, where that can be ``name`` or its folder is called so; None where there
        is none; a problem where the manifest is wrong."""
        if folder not in self._manifests:
            self._manifests[folder] = self._read(folder / MANIFEST)
        content = self._manifests[folder]
        if content == b"":
            return None
        if isinstance(content, bytes) and name.encode(errors="replace") not in content and folder.name != name:
            return None
        file = folder / MANIFEST
        if isinstance(content, str):
            return Problem(f"a {MANIFEST} that is not read: {content}", location=Location(str(file), 1, 1), code="I106")
        try:
            root = parse(content, str(file))
        except SpecError as error:
            return error.problems[0]
        if root.tag != "package":
            return root.problem(f"the outermost element of a {MANIFEST} is <package>", found=root.tag[:80], code="I106")
        names = root.look("name")
        if len(names) != 1:
            return root.problem(f"a {MANIFEST} has one <name>", found=str(len(names)), code="I106")
        if not _is_name(names[0].text):
            return names[0].problem("not the name of a package", found=names[0].text[:80] or "nothing", code="I106")
        return names[0].text

    def _read(self, file: Path) -> bytes | str:
        """The content of a ``package.xml``; b"" where there is none that may be read; a text: why it is not read."""
        if not os.path.exists(file) or not self.inside(Path(os.path.realpath(file))):
            return b""
        try:
            content = read_bytes(file, LARGEST_MANIFEST, links=True)
        except (NotReadableError, OSError) as error:
            return why_not(error)
        self._bytes += len(content)
        if self._bytes > MOST_MANIFESTS:
            return f"there are more than {MOST_MANIFESTS:,} bytes of such files"
        return content or "it is empty"


def why_not(error: NotReadableError | OSError) -> str:
    """Why a file cannot be read."""
    return str(error) if isinstance(error, NotReadableError) else error.strerror or str(error)


def _is_name(name: str) -> bool:
    """Whether a text can name a package: one part of a path, of characters that can be seen."""
    is_part = name not in ("", ".", "..") and not any(mark in name for mark in "/\\")
    return is_part and len(name) <= LONGEST_NAME and UNSEEN_CHARACTERS.search(name) is None


def _installed(folder: Path, name: str) -> Path:
    """The folder of a package's files, where ``folder`` is the prefix into which the package alone is installed."""
    share = folder / SHARE / name
    return share if not _has(folder, *MARKS) and _has(share, MANIFEST) else folder


def _has(folder: Path, *names: str) -> bool:
    return any(os.path.exists(folder / name) for name in names)


class _PackageTree:
    """The packages below a folder. Links are not followed, and no package is looked for within another."""

    def __init__(self, folder: Path):
        self._open: list[Path] = [folder]
        self._aside: list[Path] = []
        """Folders that build tools ignore: they are looked into last."""
        self._levels: list[list[Path]] = []
        self._count = 0
        self.is_cut = False

    def first(self) -> list[Path]:
        """The packages in the folder itself."""
        if not self._levels:
            self._advance()
        return self._levels[0]

    def levels(self) -> Levels:
        """The packages at each depth, from the first."""
        level = 0
        while level < len(self._levels) or self._open:
            if level == len(self._levels):
                self._advance()
            yield self._levels[level]
            level += 1

    def _advance(self) -> None:
        found: list[Path] = []
        following: list[Path] = []
        for place in self._open:
            inside = _entries(place)
            left = MOST_FOLDERS - self._count
            self.is_cut |= len(inside) > left
            self._count += len(inside)
            for path in inside[: max(0, left)]:
                if _has(path, *MARKS):
                    found.append(path)
                elif _has(path, *IGNORED):
                    self._aside.append(path)
                elif not path.name.startswith("."):
                    following.append(path)
            if self.is_cut:
                following, self._aside = [], []
                break
        if not following:
            following, self._aside = self._aside, []
        self._open = following
        self._levels.append(found)


def _entries(folder: Path) -> list[Path]:
    """The folders in a folder; none of what may not be looked at: it holds no package that could be read."""
    try:
        with os.scandir(folder) as entries:
            return sorted(Path(entry.path) for entry in entries if entry.is_dir(follow_symlinks=False))
    except OSError:
        return []


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
        return self._bytes(self.path.resolve(), Problem(f"{self.shown}: cannot be read", code="I106"))

    def bytes_of(self, path: Path, element: Element) -> bytes:
        """A file that :meth:`find` gave. Raises SpecError at the element that names it."""
        return self._bytes(path, element.problem(f"{path.name} cannot be read", code="I106"))

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
            raise element.error("not a file path", found=text[:80], code="I106")
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
                raise MissingFileError([element.problem(message, found=text[:200], hint=hint, code="I106")]) from None
            raise

    def _find(self, text: str, element: Element, start: Path | None) -> Path:
        target = self._target(text, element, start or self.path.parent)
        try:
            resolved = target.resolve()
            is_file = resolved.is_file()
        except (OSError, RuntimeError):  # links that lead to themselves, names that are too long
            raise MissingFileError([element.problem(NO_FILE[1], found=text[:200], code="I106")]) from None
        if not self._is_inside(resolved):
            hint = self.options.way_outside("--package-path names a folder of packages")
            raise element.error("leaves the project folder", found=text, hint=hint, code="I107")
        if not is_file and start is None and (other := self._above(text)) is not None:
            return other
        if not is_file:
            hint = f"looked for {self.options.shown(target)}"
            raise MissingFileError([element.problem(NO_FILE[0], found=text, hint=hint, code="I106")])
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
                    f"{scheme}:// is not read", found=text, allowed="package://, model://, file://, a path", code="I106"
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
        problem = element.problem("simspec loads nothing from the network", found=text[:200], hint=hint, code="I108")
        raise MissingFileError([problem])


def _of_another_system(text: str, element: Element) -> Problem:
    """A path as Windows writes it."""
    hint = "write it with / and from the folder of the file, or as package://NAME/PATH"
    return element.problem("a path of Windows", found=text[:200], hint=hint, code="I106")


def is_missing(error: SpecError) -> bool:
    """Whether :meth:`Files.find` found nothing there, where reading would be allowed."""
    return all(problem.message in NO_FILE for problem in error.problems)
