"""Files of installed Python packages, and robots of the package ``robot_descriptions``, by names that are the same on every
machine.

``package://NAME/PATH`` is a file of the installed Python package NAME. ``robot_descriptions://ROBOT`` is the robot file that
the module ROBOT of ``robot_descriptions`` describes, in its cache; ``robot_descriptions://ROBOT/PATH`` is another file of the
same repository.

No code of a package is executed and nothing is fetched: packages are located by the finders of the import system and by their
installed metadata, modules of ``robot_descriptions`` are parsed. Only the folder of the package may be read.
"""

from __future__ import annotations

import ast
import difflib
import functools
import hashlib
import importlib.machinery
import importlib.metadata
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final

from simspec.errors import UNSEEN_CHARACTERS, Problem, SpecError
from simspec.files import NotReadableError, read_text

PACKAGE: Final = "package://"
ROBOTS: Final = "robot_descriptions"
ROBOT: Final = f"{ROBOTS}://"
DESCRIPTION: Final = re.compile(r"[a-z0-9_]+_description")
"""Names of modules of the package robot_descriptions."""
FORMS: Final = f"{PACKAGE}NAME/PATH, {ROBOT}NAME"
LONGEST_PATH: Final = 1000
LARGEST_MODULE: Final = 1_000_000
"""Bytes of a module of robot_descriptions; the largest, its list of repositories, has 30 thousand."""
MOST_FILES: Final = 20_000
"""Files of a package that are looked at for a suggestion."""
_NAME: Final = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,98}[A-Za-z0-9])?|_[A-Za-z0-9_]{0,98}")
_PATH_WORD: Final = re.compile(r"[A-Z]+_PATH")
_FOLDER_WORDS: Final = ("PACKAGE_PATH", "REPOSITORY_PATH")
_HASH: Final = re.compile(r"[0-9a-f]{40}")
_REVISION: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


@dataclass(frozen=True)
class Package:
    """A folder that belongs to an installed package, or a cached repository of robot_descriptions."""

    name: str
    """The name that files of the folder have on every machine, without the path: ``package://NAME``."""
    root: Path
    """The folder, links resolved: no file outside it may be read."""
    version: str = ""
    """The version of the distribution, or the commit of the repository; empty where neither is known."""

    def named(self, path: Path) -> str | None:
        """The name of a file in the folder that is the same on every machine; None for a file that is not in it."""
        try:
            return f"{self.name}/{path.relative_to(self.root).as_posix()}"
        except ValueError:
            return None


@dataclass(frozen=True)
class PackagedFile:
    """A file of a package. ``arguments``: those that robot_descriptions gives a file that is a program (xacro)."""

    path: Path
    package: Package
    arguments: Mapping[str, str] = field(default_factory=dict)

    @property
    def shown(self) -> str:
        """The name of the file in messages and provenance."""
        return self.package.named(self.path) or str(self.path)


class NotCachedError(SpecError):
    """A robot of robot_descriptions that exists and is not in the cache at the commit that is required."""


def is_packaged(text: str) -> bool:
    """Whether a text names a file of a package by one of the two schemes."""
    return text.startswith((PACKAGE, ROBOT))


def is_robot(text: str) -> bool:
    """Whether a text that names no file may be the name of a robot of robot_descriptions."""
    return len(text) <= 100 and DESCRIPTION.fullmatch(text) is not None


def shown_path(path: Path, package: Package | None = None) -> str:
    """A path as messages show it: by the name of the package that it is in, else relative to the working folder where it is
    below it."""
    if package is not None and (named := package.named(path)) is not None:
        return named
    try:
        return str(path.relative_to(Path.cwd().resolve()))
    except ValueError:
        return str(path)


def packaged(text: str, suffixes: Sequence[str]) -> PackagedFile:
    """The file that a text with a scheme names, or the bare name of a robot (:func:`is_robot`). ``suffixes``: ends of names of
    robot files.

    Raises SpecError, without a location, for a package that is not installed or has no folder (a single module, an archive) and
    for a path that leads out of it or to no file; NotCachedError for a robot that has to be fetched.
    """
    if len(text) > LONGEST_PATH or UNSEEN_CHARACTERS.search(text):
        raise _error("not the name of a file of a package", text[:80], allowed=FORMS)
    if text.startswith(PACKAGE):
        name, _, rest = text.removeprefix(PACKAGE).partition("/")
        return _of_package(name, _inside(rest, text), text)
    name, slash, rest = text.removeprefix(ROBOT).partition("/")
    robot = _described(name, suffixes)
    if not slash:
        return robot
    return PackagedFile(_file(robot.package, _inside(rest, text), text), robot.package)


def digests(files: Mapping[Path, Package], known: Mapping[Path, str]) -> dict[str, dict[str, Any]]:
    """The record of files that were read from packages, by the package's name: its version (or commit) and the SHA-256 of each
    file by its path in the package. ``known``: digests by path, of what was hashed when it was read."""
    record: dict[str, dict[str, Any]] = {}
    for path, package in sorted(files.items()):
        entry = record.setdefault(package.name, {"version": package.version, "files": {}})
        digest = known.get(path)
        if digest is None:
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
        entry["files"][path.relative_to(package.root).as_posix()] = digest
    return record


def _error(message: str, found: str, allowed: str | None = None, hint: str | None = None) -> SpecError:
    return SpecError([Problem(message, found=found, allowed=allowed, hint=hint, code="I115")])


def _inside(rest: str, text: str) -> PurePosixPath:
    """The path within a package. Raises SpecError where it is none."""
    parts = rest.split("/")
    if "\\" in rest or any(part in ("", ".", "..") for part in parts):
        why = "names no file of the package" if not rest else "not a path within a package"
        raise _error(why, text[:200], allowed=FORMS)
    return PurePosixPath(*parts)


def _file(package: Package, inside: PurePosixPath, text: str) -> Path:
    """A file in the folder of a package, links resolved. Raises SpecError."""
    try:
        path = Path(os.path.realpath(package.root / inside))
        is_file = path.is_file()
    except OSError:  # names that are too long
        raise _error("no such file in the package", text[:200]) from None
    if not path.is_relative_to(package.root):
        raise _error(f"leaves the package {package.name}", text[:200], allowed="files in the package's folder")
    if not is_file:
        raise _error("no such file in the package", text[:200], hint=_near_file(package, inside))
    return path


def _near_file(package: Package, inside: PurePosixPath) -> str | None:
    """A hint that names files of the package with a similar path, or of the same name."""
    found: list[str] = []
    seen = 0
    for folder, below, names in os.walk(package.root):
        below.sort()
        seen += len(names)
        if seen > MOST_FILES:
            break
        here = Path(folder).relative_to(package.root)
        found += [(here / name).as_posix() for name in names if name.lower().endswith(inside.suffix.lower())]
    same = sorted(path for path in found if PurePosixPath(path).name == inside.name)[:3]
    similar = same or difflib.get_close_matches(str(inside), sorted(found)[:3000], 1, 0.5)
    return f"did you mean {' or '.join(f'{package.name}/{path}' for path in similar)}?" if similar else None


# --- installed packages ---


def _of_package(name: str, inside: PurePosixPath, text: str) -> PackagedFile:
    if not _NAME.fullmatch(name):
        raise _error("not the name of a package", text[:200], allowed=FORMS)
    error: SpecError | None = None
    for package in _packages(name, tuple(sys.path), Path.cwd()):
        try:
            return PackagedFile(_file(package, inside, text), package)
        except SpecError as refused:
            error = error or refused
    raise error or _error(f"no folder of the package {name!r}", text[:200])


@functools.lru_cache(maxsize=64)
def _packages(name: str, places: tuple[str, ...], working_folder: Path) -> tuple[Package, ...]:
    """The folders of a package, each once for all files that are named in it. They depend on ``places`` and
    ``working_folder``. Raises SpecError."""
    folders = package_folders(name)
    version = _version(name)
    return tuple(Package(f"{PACKAGE}{name}", folder, version) for folder in folders)


def package_folders(name: str) -> list[Path]:
    """The folders of an installed package, links resolved: those of the Python package of this name (a namespace package has
    several), then folders ``share/NAME`` that the distribution of this name lists, then its other Python packages. Raises
    SpecError where there is none."""
    folders, why = _importable(name)
    distribution = _distribution(name)
    if distribution is not None:
        folders += _shared(name, distribution)
        folders = folders or _top_folders(distribution)
    folders = [Path(os.path.realpath(folder)) for folder in folders]
    folders = [folder for folder in dict.fromkeys(folders) if folder.is_dir()]
    if not folders:
        hint = "packages that a robot file names itself are found by --package NAME=DIR and --package-path DIR"
        raise _error(why or f"the package {name!r} is not installed", name, hint=None if why else hint)
    return folders


def _importable(name: str) -> tuple[list[Path], str]:
    """The folders of a Python package, found without importing it; or why it has none."""
    if not name.isidentifier():
        return [], ""
    here = Path.cwd()
    # folders of the working folder are files that a path names, whatever way Python was started
    places = [place for place in sys.path if place and Path(place) != here]
    for finder in list(sys.meta_path):
        find = getattr(finder, "find_spec", None)
        if find is None:
            continue
        spec = find(name, places) if finder is importlib.machinery.PathFinder else find(name, None)
        if spec is None:
            continue
        if spec.submodule_search_locations is None:
            return [], f"{name!r} is a single module, which has no folder of files"
        # a namespace package that is found in sys.path itself looks there again, in the working folder too
        found = [Path(place) for place in list(spec.submodule_search_locations)]
        folders = [place for place in found if place.is_dir() and place.parent != here]
        return folders, "" if folders else f"the package {name!r} is in an archive, and has no folder of files"
    return [], ""


def _distribution(name: str) -> importlib.metadata.Distribution | None:
    try:
        return importlib.metadata.distribution(name)
    except (importlib.metadata.PackageNotFoundError, ValueError):
        return None


def _version(name: str) -> str:
    """The version of the distribution that a package is from; empty where none says that it has it."""
    distribution = _distribution(name)
    if distribution is None:
        owners = importlib.metadata.packages_distributions().get(name, [])
        distribution = _distribution(sorted(owners)[0]) if owners else None
    return str(distribution.version) if distribution is not None else ""


def _shared(name: str, distribution: importlib.metadata.Distribution) -> list[Path]:
    """Folders ``share/NAME`` among the files that a distribution lists, below its folder or the interpreter's."""
    found: dict[Path, None] = {}
    allowed = [Path(os.path.realpath(place)) for place in (str(distribution.locate_file("")), sys.prefix)]
    for file in distribution.files or ():
        parts = file.parts
        for at, part in enumerate(parts[:-2]):
            if part == "share" and (
                re.sub(r"[-_.]+", "-", parts[at + 1]).lower() == re.sub(r"[-_.]+", "-", name).lower()
            ):
                folder = Path(os.path.realpath(str(distribution.locate_file(PurePosixPath(*parts[: at + 2])))))
                if any(folder.is_relative_to(place) for place in allowed):
                    found[folder] = None
                break
    return list(found)


def _top_folders(distribution: importlib.metadata.Distribution) -> list[Path]:
    """Python packages of a distribution that is called otherwise: the top folders of the files that it lists."""
    names = dict.fromkeys(file.parts[0] for file in distribution.files or () if len(file.parts) > 1)
    return [
        Path(str(distribution.locate_file(name))) for name in names if name.isidentifier() and name != "__pycache__"
    ]


# --- robot_descriptions ---


def _described(name: str, suffixes: Sequence[str]) -> PackagedFile:
    """The file of a robot in the cache of robot_descriptions. Raises SpecError."""
    if not is_robot(name):
        raise _error("not the name of a robot of robot_descriptions", name[:80], allowed="panda_description, ...")
    try:
        library = package_folders(ROBOTS)[0]
    except SpecError:
        hint = f"pip install {ROBOTS}"
        raise _error(f"{name}: no such file, and {ROBOTS} is not installed", name, hint=hint) from None
    module = library / f"{name}.py"
    if not module.is_file():
        known = sorted(path.stem for path in library.glob("*_description.py"))
        near = difflib.get_close_matches(name, known, 1, 0.6)
        suggestion = f"did you mean {near[0]!r}?" if near else None
        raise _error(f"{name}: {ROBOTS} has no such robot", name, hint=suggestion)
    said = _Module(library, name)
    root, commit = said.repository()
    words = [word for word in sorted(said.values) if _PATH_WORD.fullmatch(word) and word not in _FOLDER_WORDS]
    paths = [value for word in words if isinstance(value := said.values[word], str)]
    fitting = [path for path in paths if path.lower().endswith(tuple(suffixes))]
    if not fitting:
        found = ", ".join(os.path.relpath(path, root) for path in paths) or "no file"
        raise _error(f"{name}: in no language that simspec imports", found)
    package = Package(f"{ROBOT}{name}", Path(os.path.realpath(root)), commit)
    inside = PurePosixPath(os.path.relpath(fitting[0], root))
    arguments = said.values.get("XACRO_ARGS") if fitting[0].lower().endswith(".xacro") else None
    given = arguments if isinstance(arguments, dict) else {}
    return PackagedFile(_file(package, inside, f"{ROBOT}{name}"), package, given)


class _Module:
    """A module of robot_descriptions, parsed: texts joined to paths (``values``, by name), and their repository."""

    def __init__(self, library: Path, name: str):
        self.values: dict[str, str | dict[str, str]] = {}
        self._library, self._name = library, name
        self._clones: dict[str, None] = {}
        for target, value in _assignments(_parsed(library / f"{name}.py", name)):
            if (read := self._value(value)) is not None:
                self.values[target] = read

    def repository(self) -> tuple[Path, str]:
        """The folder of the robot's repository in the cache, and its commit. Raises SpecError, NotCachedError."""
        if len(self._clones) != 1:
            raise _error(f"{self._name}: this version of {ROBOTS} describes it in a form that is not read", self._name)
        key = next(iter(self._clones))
        folder, wanted = self._clone(key)
        commit = _head(folder)
        if commit is None or (_HASH.fullmatch(wanted) and commit != wanted):
            state = "is not in the cache" if commit is None else f"is in the cache at commit {commit[:12]}"
            message = f"{self._name}: {state} of {ROBOTS}" if commit is None else f"{self._name}: {state}"
            hint = f"simspec import {self._name} fetches it"
            raise NotCachedError(
                [Problem(message, found=self._name, allowed=f"commit {wanted}", hint=hint, code="I115")]
            )
        return folder, commit

    def _clone(self, key: str) -> tuple[Path, str]:
        """The folder of a repository in the cache, and the commit that is required, as robot_descriptions defines them."""
        entry = _repositories(self._library).get(key)
        if entry is None or not _inner(entry.get("cache_path", "")) or not entry.get("commit"):
            raise _error(f"{self._name}: {ROBOTS} has no repository {key!r}", self._name)
        cache = Path(os.path.expanduser(os.environ.get("ROBOT_DESCRIPTIONS_CACHE", f"~/.cache/{ROBOTS}")))
        place, commit = entry["cache_path"], entry["commit"]
        if other := os.environ.get("ROBOT_DESCRIPTION_COMMIT"):
            if not _REVISION.fullmatch(other):
                raise _error("ROBOT_DESCRIPTION_COMMIT is not a commit", other[:80])
            place, commit = f"{place}-{other}/{place}", other
        return cache / place, commit

    def _value(self, node: ast.expr | None) -> str | dict[str, str] | None:
        """A text, or a mapping of texts; None for another expression."""
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else None
        if isinstance(node, ast.Name):
            return self.values.get(node.id)
        if isinstance(node, ast.Dict):
            pairs = [(self._value(key), self._value(value)) for key, value in zip(node.keys, node.values, strict=True)]
            texts = {key: value for key, value in pairs if isinstance(key, str) and isinstance(value, str)}
            return texts if len(texts) == len(pairs) else None
        if not isinstance(node, ast.Call):
            return None
        called = ast.unparse(node.func)
        values = [self._value(argument) for argument in node.args]
        texts_alone = [value for value in values if isinstance(value, str)]
        if len(texts_alone) != len(values) or not values:
            return None
        if called.lstrip("_") == "clone_to_cache":
            self._clones[texts_alone[0]] = None
            return str(self._clone(texts_alone[0])[0])
        if called.lstrip("_") in ("path.join", "os.path.join"):
            return os.path.join(*texts_alone)
        return None


def _inner(path: str) -> bool:
    return bool(path) and not os.path.isabs(path) and ".." not in path.split("/")


def _parsed(path: Path, name: str) -> ast.Module:
    try:
        return ast.parse(read_text(path, LARGEST_MODULE))
    except (NotReadableError, OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        raise _error(f"{name}: this version of {ROBOTS} cannot be read", name) from None


def _assignments(tree: ast.Module) -> Iterator[tuple[str, ast.expr | None]]:
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            yield node.targets[0].id, node.value
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id, node.value


@functools.lru_cache(maxsize=4)
def _repositories(library: Path) -> dict[str, dict[str, str]]:
    """The texts that robot_descriptions says of each repository, by its name: ``commit``, ``cache_path``."""
    found: dict[str, dict[str, str]] = {}
    for target, value in _assignments(_parsed(library / "_repositories.py", ROBOTS)):
        if target != "REPOSITORIES" or not isinstance(value, ast.Dict):
            continue
        for key, entry in zip(value.keys, value.values, strict=True):
            if isinstance(key, ast.Constant) and isinstance(entry, ast.Call):
                said = {word.arg: word.value for word in entry.keywords if word.arg is not None}
                found[str(key.value)] = {
                    word: constant.value
                    for word, constant in said.items()
                    if isinstance(constant, ast.Constant) and isinstance(constant.value, str)
                }
    return found


def _head(folder: Path) -> str | None:
    """The commit that is checked out in a clone; None where the folder is none."""
    git = folder / ".git"
    try:
        head = read_text(git / "HEAD", 1000).strip()
        if head.startswith("ref: ") and _inner(head[5:]):
            head = read_text(git / head[5:], 1000).strip()
    except (NotReadableError, OSError):
        return None
    return head if _HASH.fullmatch(head) else None
