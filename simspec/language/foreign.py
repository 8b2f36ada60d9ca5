"""Robot files of other languages: importers, their results, and how a result becomes a document of this language.

Importers are offered by entry points (:data:`GROUP`); none is imported here. An importer accounts for everything in a
file: each element and attribute is carried, carried without effect, or lost.
"""

from __future__ import annotations

import functools
import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Protocol, runtime_checkable

from pydantic import Field

from simspec.errors import Location, Problem, SpecError
from simspec.files import NotReadableError, open_regular
from simspec.language.beginning import LimitStart, begin_within
from simspec.language.document import Document, Key, Mark, Path_
from simspec.language.packages import Package, shown_path
from simspec.language.shapes import NameOf
from simspec.language.strict import Strict
from simspec.language.words import FileName, Flag, Text, Texts
from simspec.plugins import Plugins

if TYPE_CHECKING:
    from simspec.language.sources import Source


GROUP = "simspec.importers"
"""The entry points of importers, by the name of their language."""


class Fate(StrEnum):
    """The fate of an element or attribute of a foreign file."""

    CARRIED = "carried"
    """The spec says the same."""
    UNUSED = "carried but unused"
    """The spec says the same, and no engine acts on it (a rating, a colour)."""
    LOST = "lost"
    """The spec does not say it."""


class LossSeverity(StrEnum):
    """The effect of a loss."""

    PHYSICS = "physics"
    APPEARANCE = "appearance"
    INFORMATION = "information"


@dataclass(frozen=True, slots=True)
class Account:
    """The fate of an element or attribute: ``what`` is its path in the file (``joint[elbow]/mimic/@multiplier``),
    ``reason`` and ``hint`` (the way out) say why it is not carried."""

    location: Location
    what: str
    fate: Fate
    severity: LossSeverity = LossSeverity.PHYSICS
    reason: str = ""
    hint: str = ""


@dataclass(frozen=True, slots=True)
class Repair:
    """A defect of the source that a rule repaired, since that rule was requested."""

    rule: str
    location: Location
    what: str
    """The repaired value and the new one, in a sentence."""
    path: str = ""
    """The dotted path in the spec where the repair is seen; its comment is written there."""


ALL: Final = "all"
"""In place of a rule of repair: every rule that the file needs."""


@dataclass(frozen=True, slots=True)
class RequestedRepairs:
    """The rules of repair that a user requests, as ``RULE``, ``RULE=VALUE`` or :data:`ALL`. ``rule in requested`` is true of a
    rule that is named, and of every rule where all are requested."""

    words: tuple[str, ...] = ()

    def __contains__(self, rule: object) -> bool:
        return ALL in self.words or self.is_named(rule)

    def is_named(self, rule: object) -> bool:
        """Whether the rule itself is named: some rules need that, since what they change may be intended."""
        return any(_rule_of(word) == rule for word in self.words)

    def value(self, rule: str) -> str | None:
        """The value that is given with a rule; None where there is none."""
        values = [word.partition("=")[2].strip() for word in self.words if "=" in word and _rule_of(word) == rule]
        return values[0] if values else None

    def problems(self, shown: str, rules: Iterable[str], with_value: Iterable[str] = ()) -> list[Problem]:
        """The problems of the words: rules that the importer of the file ``shown`` does not have, values of rules that take
        none, two values of one rule. ``with_value``: the rules that take a value."""
        rules, with_value = tuple(rules), tuple(with_value)
        found, values = list[Problem](), dict[str, str]()
        for word in self.words:
            rule, equals, value = _rule_of(word), "=" in word, word.partition("=")[2].strip()
            if rule not in rules and word != ALL:
                allowed = ", ".join((*rules, ALL)) if rules else f"none for this language, or {ALL}"
                found.append(
                    Problem(f"{shown}: no rule of repair is called {rule[:80]!r}", allowed=allowed, code="I117")
                )
            elif equals and rule not in with_value:
                found.append(
                    Problem(f"{shown}: the rule {rule} takes no value", found=word[:80], allowed=rule, code="I117")
                )
            elif equals and values.setdefault(rule, value) != value:
                found.append(
                    Problem(
                        f"{shown}: the rule {rule} is given two values", found=f"{values[rule]}, {value}", code="I117"
                    )
                )
        return found


def _rule_of(word: str) -> str:
    return word.partition("=")[0].strip()


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """The options of an import; ``project`` is the folder that no file may be outside of (None: any), except in the folders of
    ``packages``."""

    packages: Mapping[str, str] = field(default_factory=dict)
    """Folders of packages by name, relative to the file that says so, or absolute."""
    package_path: tuple[str, ...] = ()
    """Folders in which packages are looked for, each by the name of its folder."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Arguments of a file that is a program (xacro)."""
    repair: tuple[str, ...] = ()
    """Rules of repair that may be applied, in the words of :class:`RequestedRepairs`."""
    project: Path | None = None
    base: Path = Path()
    """The folder that relative ``packages`` start from."""
    self_collision: bool = True
    """Whether bodies of the file's model may touch each other; False is said by the spec (``contact.self_collision``)."""
    package: Package | None = None
    """The package that the file is in; files of it have its name in messages. Then ``project`` is the package's folder."""

    def shown(self, path: Path) -> str:
        """The name of a file in messages."""
        return shown_path(path, self.package)

    allowed: tuple[str, ...] = ()
    """Absolute folders whose files may be used although they are outside of ``project``."""
    trusting: str = ""
    """The command by which the user would trust the project file, where it names folders and is not trusted: those folders are
    neither in ``package_path`` nor in ``allowed``, and what would need them is refused with this command."""

    def allows(self, file: Path) -> bool:
        """Whether a resolved path is in one of the ``allowed`` folders."""
        return any(file.is_relative_to(os.path.realpath(folder)) for folder in self.allowed)

    def way_outside(self, more: str = "") -> str:
        """The hint of an error about a file outside of the project folder; ``more``: a further way."""
        ways = [f"{self.trusting} lets the folders of the project file be used"] if self.trusting else []
        return "; ".join([*ways, "--allow-outside allows it", *filter(None, [more])])

    def together(self, more: ImportOptions) -> ImportOptions:
        """The options of a placement together with those of all files (``more``; its folders are absolute): rules of
        both, the placement's folders first, the arguments of all files and the values of their rules before its own."""
        valued = {_rule_of(word) for word in more.repair if "=" in word}
        return replace(
            self,
            packages={**more.packages, **self.packages},
            package_path=(*self.package_path, *more.package_path),
            arguments={**self.arguments, **more.arguments},
            repair=tuple(
                dict.fromkeys((*(word for word in self.repair if _rule_of(word) not in valued), *more.repair))
            ),
            self_collision=self.self_collision and more.self_collision,
            allowed=more.allowed,
            trusting=more.trusting,
        )

    @property
    def repairs(self) -> RequestedRepairs:
        """The rules of repair that are requested."""
        return RequestedRepairs(self.repair)

    def key(self) -> str:
        """The same text for the same options."""
        return json.dumps(asdict(self), sort_keys=True, default=str)


@dataclass
class Imported:
    """The result of an importer."""

    data: dict[str, Any]
    """A spec as plain data in SI units: a model file where the source has one tree, else a scenario."""
    places: dict[Path_, Location]
    """Where values of ``data`` come from, by their path; a value without a place has that of the nearest path around it."""
    accounts: list[Account]
    """Every element and attribute of the source, in the order of the file."""
    repairs: list[Repair] = field(default_factory=list)
    files: dict[str, Path] = field(default_factory=dict)
    """Files that ``data`` names (meshes), by the text that names them: found and allowed."""
    made: frozenset[str] = frozenset()
    """Those of ``files`` that the source has within itself: they were written to the cache, so that a spec needs copies."""
    read: dict[Path, str] = field(default_factory=dict)
    """SHA-256 of every file that was read, by its path."""
    comments: dict[str, str] = field(default_factory=dict)
    """A sentence to be written above a value, by its dotted path."""
    suspicious: list[Problem] = field(default_factory=list)
    """Warnings: values that are allowed and look like slips of the file, such as lengths in millimetres."""

    starts: list[LimitStart] = field(default_factory=list)
    """Joints that begin at a limit, since the position of the file, or 0 where it has none, is beyond it."""

    def losses(self) -> list[Account]:
        """The accounts of elements that are not carried."""
        return [account for account in self.accounts if account.fate is Fate.LOST]

    def document(self, file: str) -> Document:
        """The same as a document, whose places are those of the source."""
        marks = {path: Mark(place.line, place.column, file=place.file) for path, place in self.places.items()}
        return Document(file, self.data, _mark(self.data, (), marks, Mark(1, 1)))


def _mark(value: Any, path: Path_, marks: Mapping[Path_, Mark], around: Mark) -> Mark:
    """The mark of a value and of all that is in it; ``around``: that of what it is in, for what has none of its own."""
    place = marks.get(path, around)
    mark = Mark(place.line, place.column, file=place.file)
    items: dict[Key, Any] = {}
    if isinstance(value, dict):
        items = value
    elif isinstance(value, list):
        items = dict(enumerate(value))
    else:
        return mark
    mark.items = {key: _mark(item, (*path, key), marks, mark) for key, item in items.items()}
    if isinstance(value, dict):
        mark.keys = {str(key): (below.line, below.column) for key, below in mark.items.items()}
    return mark


@runtime_checkable
class Importer(Protocol):
    """Reads files of one language. Importers have no state."""

    NAME: str
    """The language, as messages call it."""
    SUFFIXES: tuple[str, ...]
    """Ends of names of its files, in small letters, with the dot."""

    def recognises(self, content: bytes) -> bool:
        """Whether a file that begins so is of this language; for those that share a suffix."""

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """A file as a spec. ``shown``: its name in messages. Raises SpecError with every problem and its place: defects of the
        source that no rule of ``options.repair`` repairs are problems."""


def _check(name: str, loaded: Any) -> Importer:
    importer = loaded()
    if not isinstance(importer, Importer):
        raise TypeError(f"{name} is no importer: it needs NAME, SUFFIXES, recognises and read")
    return importer


@functools.cache
def importers() -> Plugins[Importer]:
    """All importers that are installed, by name."""
    return Plugins(GROUP, _check)


@functools.cache
def _suffixes() -> dict[str, tuple[str, ...]]:
    """The suffixes of every importer; none is imported."""
    return {name: importers().stated(name, "SUFFIXES") for name in importers()}


@functools.cache
def suffixes() -> tuple[str, ...]:
    """Ends of names of all files that can be imported."""
    return tuple(sorted({suffix for ends in _suffixes().values() for suffix in ends}))


def is_foreign(name: str) -> bool:
    """Whether a file of this name is of another language than simspec's."""
    return name.lower().endswith(suffixes())


def import_file(path: Path, shown: str, options: ImportOptions) -> Imported:
    """A foreign file as a spec, by the importer that its name and beginning ask for. Raises SpecError with every problem."""
    fitting = [importers()[name] for name, ends in _suffixes().items() if path.name.lower().endswith(ends)]
    if len(fitting) > 1:
        beginning = _beginning(path)
        fitting = [importer for importer in fitting if importer.recognises(beginning)] or fitting[:1]
    if len(fitting) != 1:
        known = ", ".join(f"{importer.NAME} ({' '.join(importer.SUFFIXES)})" for importer in importers().values())
        raise SpecError(
            [Problem(f"{shown}: not a file of a language that simspec imports", allowed=known, code="I114")]
        )
    imported: Imported = fitting[0].read(path, shown, options)
    imported.starts += begin_within(imported.data, imported.comments)
    if not options.self_collision:
        _without_self_collision(imported, shown)
    return imported


def _without_self_collision(imported: Imported, shown: str) -> None:
    """Let the bodies of an imported model pass through each other. Raises SpecError for a file that is not one model."""
    if "model" not in imported.data:
        hint = "contact: groups or exclude, in the spec that simspec import writes"
        raise SpecError(
            [Problem(f"{shown}: self_collision is of one model, and the file has several", hint=hint, code="I112")]
        )
    imported.data.setdefault("contact", {})["self_collision"] = False
    imported.comments["contact.self_collision"] = "the file does not say so: an option of the import"


_HEAD = 16 * 2**20
"""Bytes by which the language of a file is found: elements particular to a language may come late."""


def _beginning(path: Path) -> bytes:
    try:
        with os.fdopen(open_regular(path, 2**40, links=True), "rb") as stream:
            return stream.read(_HEAD)
    except NotReadableError as error:
        raise SpecError([Problem(f"{path}: cannot be read: {error}", code="C104")]) from None
    except OSError as error:
        raise SpecError([Problem(f"{path}: cannot be read: {error.strerror}", code="C104")]) from None


class Import(Strict):
    """The options for the importer of a file of another language."""

    packages: dict[NameOf, Annotated[str, FileName()]] = Field(
        {}, description="Folders of the packages that the file names, by package name, relative to this file"
    )
    package_path: list[Annotated[str, FileName()]] = Field(
        [], description="Folders to search for packages, relative to this file"
    )
    arguments: dict[NameOf, Annotated[str, Text()]] = Field(
        {}, description="Arguments of a file that is a program (xacro), by name"
    )
    repair: Annotated[list[str], Texts()] = Field(
        [],
        description="Rules for the repair of defects of the file, `RULE` or `RULE=VALUE`; `all`: every rule "
        "that the file needs",
    )
    self_collision: Annotated[bool, Flag()] = Field(
        True, description="false: the bodies of the model that the file describes do not touch each other"
    )

    def options(self, folder: Path, project: Path | None) -> ImportOptions:
        """The same as importers take it; ``folder``: that of the file which says so."""
        return ImportOptions(
            self.packages,
            tuple(self.package_path),
            self.arguments,
            tuple(self.repair),
            project,
            folder,
            self.self_collision,
        )


# The losses and repairs of an import as text: counted, grouped, and as warnings.

_IN_BRACKETS: Final = re.compile(r"\[[^\]]*\]")
ORDER: Final = (LossSeverity.PHYSICS, LossSeverity.APPEARANCE, LossSeverity.INFORMATION)


@dataclass(frozen=True, slots=True)
class AccountGroup:
    """Accounts that say the same of the same kind of thing; the first of them stands for all."""

    first: Account
    count: int


def kind_of(account: Account) -> str:
    """The subject of an account, without names: ``joint/mimic/@multiplier``."""
    return _IN_BRACKETS.sub("", account.what)


def grouped(accounts: Iterable[Account]) -> list[AccountGroup]:
    """Losses by kind and reason, those that change physics first, each kind in the order of the file."""
    groups: dict[tuple[Any, ...], list[Account]] = {}
    for account in accounts:
        key = (kind_of(account), account.severity, account.reason)
        groups.setdefault(key, []).append(account)
    rows = [AccountGroup(members[0], len(members)) for members in groups.values()]
    return sorted(rows, key=lambda group: ORDER.index(group.first.severity))


def counts(imported: Imported) -> dict[str, int]:
    """How many elements and attributes have which fate, and how many of the lost ones change physics."""
    fates = Counter(account.fate for account in imported.accounts)
    physics = sum(account.severity is LossSeverity.PHYSICS for account in imported.losses())
    return {
        "carried": fates[Fate.CARRIED],
        "carried_but_unused": fates[Fate.UNUSED],
        "lost": fates[Fate.LOST],
        "lost_of_physics": physics,
    }


def of_physics(imported: Imported) -> list[Account]:
    """The losses that change physics."""
    return [account for account in imported.losses() if account.severity is LossSeverity.PHYSICS]


def problems(accounts: Sequence[Account]) -> Iterator[Problem]:
    """Losses as problems, of each kind the first with the number of the others."""
    for group in grouped(accounts):
        account, more = group.first, group.count - 1
        counted = f" (and {more} more)" if more else ""
        message = f"the import loses {kind_of(account)}{counted}: {account.reason}"
        yield Problem(message, account.what, account.location, hint=account.hint or None, code="W119")


def repaired(sources: Iterable[Source]) -> list[Repair]:
    """The repairs of all files of other languages among ``sources``, each once."""
    return list(
        dict.fromkeys(repair for source in sources if source.imported is not None for repair in source.imported.repairs)
    )


def repairs_data(repairs: Iterable[Repair]) -> list[dict[str, Any]]:
    """Repairs as plain data: the rule, the place, what was changed, and where the spec has it."""
    return [
        {
            "rule": repair.rule,
            "file": repair.location.file,
            "line": repair.location.line,
            "what": repair.what,
            "path": repair.path,
        }
        for repair in repairs
    ]
