"""``simspec.toml``, the project file: which engines a project takes by default, in which interpreters, and where packages lie.

It is found upward from the working folder, up to the root of the repository (the folder with ``.git``) or of the file system.
Paths in it are relative to it. The command line comes before the file, and the file before the defaults. Only the command line
reads it: functions called from Python receive their engines and interpreters.

A project file comes with a repository, from anybody. The programs and folders that it names are used once the user has trusted
the file with this content (``outputs/trust.py``): only then are its interpreters started, and files in its folders read.
"""

from __future__ import annotations

import difflib
import functools
import json
import os
import re
import reprlib
import shlex
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from simspec.engines.kit.registry import loaders, parse
from simspec.errors import Location, Problem, SpecError
from simspec.outputs.files import read_bytes, refuse

PROJECT_FILE = "simspec.toml"
REPOSITORY = ".git"
"""Entries of the root of a repository: no project file is sought above it."""
LARGEST = 64_000
"""Bytes of a project file."""
LONGEST_LINE = 2000
"""Characters of a line: the reader of TOML takes the square of the number of keys that dots join."""
MOST_ENGINES = 32
"""Engines with options: each interpreter is a process while versions are queried."""
KEYS: Mapping[str, str] = {
    "engines": "Options of engines by label: NAME, or NAME@VERSION in quotes",
    "default-engines": "Engines of every command that is given neither --engine nor --all-engines: NAME, or NAME@VERSION",
    "package-paths": "Folders in which packages (package://NAME/...) are sought, relative to this file",
    "allowed-folders": "Folders outside the project whose files specs and robot files may use, relative to this file",
}
FOLDERS = ("package-paths", "allowed-folders")
ENGINE_KEYS: Mapping[str, str] = {"python": "Python interpreter that has this engine; a path, relative to this file"}
TITLE = "simspec: a project file"
_HEADER = re.compile(r"\s*\[\[?([^\[\]]*)\]")
_ENTRY = re.compile(r"""\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")
_KEY = re.compile(r"""[A-Za-z0-9_-]+|"[^"]*"|'[^']*'""")
_SYNTAX = re.compile(r" \(at line (\d+), column (\d+)\)$")


class NotTrustedError(SpecError):
    """A command needs what a project file names that the user has not trusted."""


class Interpreters(Mapping[str, str]):
    """Interpreters of engines, by label, as a command may use them.

    ``not_trusted``: labels whose interpreter an untrusted project file names. To look one up raises NotTrustedError, so that it
    is neither started nor replaced in silence by another interpreter. ``not_queried``: labels that have an interpreter which
    this command does not start; they are contained, and have no value.
    """

    def __init__(
        self,
        paths: Mapping[str, str],
        not_trusted: Mapping[str, NotTrustedError] | None = None,
        not_queried: Mapping[str, str] | None = None,
    ):
        self._paths = dict(paths)
        self.not_trusted, self.not_queried = dict(not_trusted or {}), dict(not_queried or {})

    def __getitem__(self, label: str) -> str:
        if label in self.not_trusted:
            raise self.not_trusted[label]
        return self._paths[label]

    def __contains__(self, label: object) -> bool:
        return label in self._paths or label in self.not_trusted or label in self.not_queried

    def __iter__(self) -> Iterator[str]:
        return iter((*self._paths, *self.not_trusted))

    def __len__(self) -> int:
        return len(self._paths) + len(self.not_trusted)

    def __bool__(self) -> bool:
        return bool(self._paths or self.not_trusted or self.not_queried)

    def with_named(self, named: Mapping[str, str]) -> Interpreters:
        """The same with interpreters of the command line, which come first: they are the user's word."""
        return Interpreters(
            {**self._paths, **named},
            {label: error for label, error in self.not_trusted.items() if label not in named},
            {label: why for label, why in self.not_queried.items() if label not in named},
        )


@dataclass(frozen=True)
class Project:
    """A project file. ``file``: None where there is none; ``interpreters``: by engine's label; ``default_engines``: empty where
    the file names none; ``package_paths``, ``allowed_folders``: folders; ``not_trusted``: why the user does not trust the file,
    None where the user does, or where it names nothing that needs it."""

    file: Path | None = None
    interpreters: Mapping[str, str] = field(default_factory=dict)
    default_engines: tuple[str, ...] = ()
    package_paths: tuple[Path, ...] = ()
    allowed_folders: tuple[Path, ...] = ()
    not_trusted: str | None = None

    def known_interpreters(self) -> Interpreters:
        """Those of the file, and of other labels the environments that simspec made (``engines/kit/environments.py``), for
        commands that start engines."""
        from simspec.engines.kit.environments import environments

        if self.not_trusted is None:
            return Interpreters({**environments(), **self.interpreters})
        return Interpreters(environments(), dict.fromkeys(self.interpreters, self.refusal("interpreters")))

    def listed_interpreters(self) -> Interpreters:
        """The same for commands that list, plan or show: none of the file is started, whether it is trusted or not."""
        from simspec.engines.kit.environments import environments

        made = {label: python for label, python in environments().items() if label not in self.interpreters}
        return Interpreters(made, not_queried={label: self.why_not_queried(label) for label in self.interpreters})

    def why_not_queried(self, label: str) -> str:
        """Why a list says no version of a label that the file has an interpreter for."""
        if self.not_trusted is None:
            return f"not queried; simspec engines doctor {label} starts it"
        return f"not queried: {self.not_trusted}; {self.trusting}"

    @property
    def trusting(self) -> str:
        """The command that trusts the file."""
        return trusting(self.file or Path(PROJECT_FILE))

    def refusal(self, what: str) -> NotTrustedError:
        """The error of a command that needs ``what`` the file names."""
        message = f"{self.file}: {self.not_trusted}: its {what} are not used"
        return NotTrustedError([Problem(message, hint=f"read it, then {self.trusting}", code="C113")])


def trusting(file: Path) -> str:
    """The command that trusts a project file."""
    return f"simspec trust {shlex.quote(str(file))}"


def find_project(start: Path) -> Path | None:
    """The project file that is in force in the folder ``start``; None where there is none."""
    for folder in (start, *start.parents):
        if os.path.lexists(folder / PROJECT_FILE):
            return folder / PROJECT_FILE
        if os.path.lexists(folder / REPOSITORY):
            return None
    return None


def load_project(start: Path | None = None) -> Project:
    """The project of the folder ``start`` (None: the working folder). Raises SpecError, with the place of every problem."""
    folder = Path.cwd() if start is None else start.absolute()
    file = find_project(folder)
    if file is None:
        return Project()
    _demand_owner(file, folder)
    return read_project(file)


def _demand_owner(file: Path, start: Path) -> None:
    """Raise SpecError where a file above the working folder belongs to another user: it names programs that are started."""
    owner = os.lstat(file).st_uid
    if owner not in {os.geteuid(), 0, os.stat(start).st_uid}:
        message = f"{file}: belongs to another user, and is not used"
        raise SpecError(
            [Problem(message, hint=f"a {PROJECT_FILE} or {REPOSITORY} of your own, nearer, comes first", code="C113")]
        )


def read_project(file: Path) -> Project:
    """Read one project file. Its trust is that of the bytes that are read. Raises SpecError, with the place of
    every problem."""
    return parse_project(file, read_bytes(file, LARGEST))


def parse_project(file: Path, content: bytes) -> Project:
    """The same, of a file's content."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise refuse(file, f"not UTF-8 at byte {error.start}") from None
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST_LINE:
            message = f"a line of {len(line):,} characters, more than the {LONGEST_LINE:,} that are read"
            raise SpecError([Problem(message, location=Location(str(file), number, 1), code="C112")])
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SpecError([_syntax(file, str(error) if isinstance(error, ValueError) else "nested too deeply")]) from None
    project = _ProjectReader(file, data, _lines(text)).project()
    if not (project.interpreters or project.package_paths or project.allowed_folders):
        return project
    from simspec.outputs import trust

    return replace(project, not_trusted=trust.why_not(file, content))


def _syntax(file: Path, message: str) -> Problem:
    place = _SYNTAX.search(message)
    location = Location(str(file), int(place[1]), int(place[2])) if place else None
    return Problem(
        f"{'' if place else f'{file}: '}not TOML: {_SYNTAX.sub('', message)}", location=location, code="C112"
    )


def _lines(text: str) -> dict[tuple[str, ...], int]:
    """The line (from 1) of every key and table that begins a line; lines of multi-line texts are not keys."""
    lines: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    quote = ""
    for number, line in enumerate(text.splitlines(), 1):
        inside = bool(quote)
        for mark in re.findall(r'"""|\'\'\'', line):
            quote = "" if quote == mark else quote or mark
        if inside:
            continue
        if header := _HEADER.match(line):
            table = _path(header[1])
            lines.setdefault(table, number)
        elif entry := _ENTRY.match(line):
            lines.setdefault((*table, *_path(entry[1])), number)
    return lines


def _path(text: str) -> tuple[str, ...]:
    return tuple(key.strip("\"'") for key in _KEY.findall(text))


class _ProjectReader:
    """Checks the data of one file; collects every problem."""

    def __init__(self, file: Path, data: Mapping[str, Any], lines: Mapping[tuple[str, ...], int]):
        self._file, self._data, self._lines = file, data, lines
        self._problems: list[Problem] = []

    def project(self) -> Project:
        self._known((), self._data, KEYS)
        project = Project(
            self._file,
            dict(self._interpreters()),
            tuple(self._texts("default-engines", self._check_label)),
            tuple(self._file.parent / text for text in self._texts("package-paths", self._check_folder)),
            tuple(self._file.parent / text for text in self._texts("allowed-folders", self._check_folder)),
        )
        if self._problems:
            raise SpecError(self._problems)
        return project

    def _problem(
        self,
        path: tuple[str, ...],
        message: str,
        *,
        found: str | None = None,
        allowed: str | None = None,
        hint: str | None = None,
        code: str,
    ) -> None:
        line = next((self._lines[path[:end]] for end in range(len(path), 0, -1) if path[:end] in self._lines), 1)
        place = Location(str(self._file), line, 1)
        self._problems.append(Problem(message, ".".join(path), place, found, allowed, hint, code=code))

    def _known(self, path: tuple[str, ...], table: Mapping[str, Any], keys: Mapping[str, str]) -> None:
        for key in table:
            if key not in keys:
                near = difflib.get_close_matches(key, keys, 1)
                hint = f"did you mean {near[0]}?" if near else None
                self._problem((*path, key), f"unknown key {key!r}", allowed=", ".join(keys), hint=hint, code="C114")

    def _interpreters(self) -> Iterator[tuple[str, str]]:
        tables = self._data.get("engines", {})
        if not isinstance(tables, Mapping):
            hint = "[engines.NAME] with python = ...; a list of engines is default-engines = [...]"
            self._problem(("engines",), "expected tables by engine", found=_shown(tables), hint=hint, code="C114")
            return
        if len(tables) > MOST_ENGINES:
            self._problem(
                ("engines",), f"{len(tables):,} engines, more than the {MOST_ENGINES} that are read", code="C114"
            )
            return
        for label, table in tables.items():
            path = ("engines", label)
            if not isinstance(table, Mapping):
                self._problem(
                    path, "expected a table", found=_shown(table), hint=f"[engines.{_quoted(label)}]", code="C114"
                )
                continue
            self._check_label(path, label)
            self._known(path, table, ENGINE_KEYS)
            python = table.get("python")
            if isinstance(python, str) and python and "\0" not in python:
                yield label, str(self._file.parent / python)
            elif "python" in table:
                self._problem(
                    (*path, "python"), "expected the path of an interpreter", found=_shown(python), code="C114"
                )
            else:
                self._problem(path, "no option", hint="python = ... names an interpreter", code="C114")

    def _texts(self, key: str, check: Callable[[tuple[str, ...], str], None]) -> Iterator[str]:
        texts = self._data.get(key, [])
        if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
            self._problem((key,), "expected a list of strings", found=_shown(texts), code="C114")
            return
        if key in self._data and not texts:
            self._problem((key,), "an empty list", hint="remove it, or list at least one", code="C114")
        for text in dict.fromkeys(texts):
            check((key,), text)
            yield text

    def _check_label(self, path: tuple[str, ...], label: str) -> None:
        try:
            identity = parse(label)
        except SpecError:
            self._problem(
                path, f"{label!r} is not an engine's label", allowed="NAME, or NAME@VERSION in quotes", code="C114"
            )
            return
        if identity.python is not None:
            name = _quoted(identity.label)
            self._problem(
                path, f"{label!r} contains an interpreter", hint=f"[engines.{name}] with python = ...", code="C114"
            )
        elif identity.name not in (known := list(loaders())):
            near = difflib.get_close_matches(identity.name, known, 1)
            hint = f"did you mean {near[0]}?" if near else None
            self._problem(path, f"unknown engine {identity.name!r}", allowed=", ".join(known), hint=hint, code="C114")

    def _check_folder(self, path: tuple[str, ...], text: str) -> None:
        if "\0" in text or not text or not (self._file.parent / text).is_dir():
            self._problem(path, "not a folder", found=_shown(text), hint="paths are relative to this file", code="C114")


def _shown(value: Any) -> str:
    return reprlib.repr(value)  # nested tables of any depth


def _quoted(label: str) -> str:
    return label if re.fullmatch(r"[A-Za-z0-9_-]+", label) else json.dumps(label, ensure_ascii=False)


@functools.cache
def schema_text() -> str:
    """The JSON Schema of the file, for editors."""
    texts = {"type": "array", "minItems": 1, "items": {"type": "string", "minLength": 1}}
    options = {name: {"type": "string", "minLength": 1, "description": text} for name, text in ENGINE_KEYS.items()}
    table = {"type": "object", "properties": options, "required": list(options), "additionalProperties": False}
    schema = {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": TITLE,
        "type": "object",
        "additionalProperties": False,
        "properties": {
            "engines": {
                "description": KEYS["engines"],
                "type": "object",
                "maxProperties": MOST_ENGINES,
                "additionalProperties": table,
            },
            **{key: {"description": KEYS[key], **texts} for key in ("default-engines", *FOLDERS)},
        },
    }
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def is_schema(content: bytes) -> bool:
    """Whether a file is that schema, of whatever version: by its title, as JSON."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("title") == TITLE
