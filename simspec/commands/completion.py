"""Shell completion: ``simspec completion``, and the words that may follow on a command line.

At each press of the tab key the shell's script (``templates/completion``) starts simspec with the variable
``_SIMSPEC_COMPLETE`` and the words so far. The answer is made from the options of the commands, entry points and names of
files: no engine and no importer is loaded. Each line has a kind, a text and a description, separated by tabs: a ``word``, a
``start`` of a word that goes on, ``files`` with suffixes, or ``folders``; the shell itself completes paths.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, EnumType
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

from typer.models import OptionInfo

from simspec.commands import experiment_options  # noqa: F401  # it declares commands
from simspec.commands.options import COMMANDS, print_json
from simspec.commands.scenario_options import CompletionOptions
from simspec.errors import EXIT_OK
from simspec.plugins import SIMSPEC

SPECS: Final = (".yaml", ".yml")
LARGEST_PROJECT: Final = 100_000
"""Bytes of a project file that is read for the labels in it."""


@dataclass(frozen=True, slots=True)
class Suggestion:
    """One line of the answer."""

    kind: str
    text: str = ""
    description: str = ""

    def line(self) -> str:
        """The line that the shell's script reads; tabs and line ends within a part are spaces."""
        parts = (self.kind, self.text, self.description)
        return "\t".join(" ".join(part.split()) for part in parts).rstrip("\t") + "\n"


@dataclass(frozen=True, slots=True)
class CommandParameter:
    """An option or an argument of a command: its field, its words on the command line (none of an argument), its type."""

    field: str
    words: tuple[str, ...]
    kind: Any
    metavar: str
    description: str

    @property
    def flag(self) -> bool:
        """Whether it is an option without a value."""
        return self.kind is bool

    @property
    def repeatable(self) -> bool:
        """Whether it may be given more than once."""
        return any(
            part is list or getattr(part, "__origin__", None) is list for part in (self.kind, *get_args(self.kind))
        )


def completion(options: CompletionOptions) -> int:
    """Print the script of a shell."""
    from simspec.files import resource_folder

    shell = options.shell.value
    script = (resource_folder("templates") / "completion" / f"simspec.{shell}").read_text(encoding="utf-8")
    if options.as_json:
        print_json({"shell": shell, "script": script})
    else:
        sys.stdout.write(script)
    return EXIT_OK


def answer(words: Sequence[str], shell: str) -> int:
    """Print the words that may follow; nothing where that fails, since the text would end on the line that is being typed."""
    with contextlib.suppress(Exception):
        sys.stdout.write(answer_text(words, shell))
    return EXIT_OK


def answer_text(words: Sequence[str], shell: str) -> str:
    """The lines for a shell's script: the candidates for the last of ``words`` that begin like it."""
    kept = ""
    if shell == "bash":
        words, kept = _words_of_line(*words)
    lines = []
    for entry in candidates(words):
        if entry.kind in ("word", "start"):
            if not entry.text.startswith(words[-1]):
                continue
            entry = Suggestion(entry.kind, entry.text.removeprefix(kept), entry.description)
        lines.append(entry.line())
    return "".join(dict.fromkeys(lines))


def _words_of_line(line: str, current: str) -> tuple[list[str], str]:
    """The words after the program of a line that ends at the cursor; and the beginning of the last one that bash does not
    replace: bash ends words at ``=``, ``:`` and ``@``, too, and replaces ``current``, what stands after it."""
    words = line.split()
    for quote in ("", '"', "'"):
        with contextlib.suppress(ValueError):
            words = shlex.split(line + quote)
            break
    if line[-1:].isspace() and not quote:
        words.append("")
    return words[1:], words[-1].removesuffix("" if current in ("=", ":", "@") else current)


# --- commands and options ---------------------------------------------------------------------------------------------------


def candidates(words: Sequence[str]) -> Iterator[Suggestion]:
    """The candidates for the last of ``words``, whatever its beginning is."""
    *before, current = words
    if not before:
        yield from _commands()
        return
    command, *typed = before
    if command in COMMANDS and typed and f"{command} {typed[0]}" in COMMANDS:
        command, *typed = f"{command} {typed[0]}", *typed[1:]
    if command not in COMMANDS:
        return
    parameters = parameters_of(command)
    options = {word: parameter for parameter in parameters for word in parameter.words}
    arguments = [parameter for parameter in parameters if not parameter.words]
    value_of, used, count = _typed(typed, options)
    name, equals, _ = current.partition("=")
    if value_of is not None:
        yield from values(value_of, command)
    elif equals and name in options:
        for entry in values(options[name], command):
            text = f"{name}={entry.text}" if entry.kind in ("word", "start") else entry.text
            yield Suggestion(entry.kind, text, entry.description)
    elif current.startswith("-"):
        for parameter in parameters:
            if parameter not in used or parameter.repeatable:
                yield from (Suggestion("word", word, parameter.description) for word in parameter.words)
        yield Suggestion("word", "--help", "Print the help of the command.")
    else:
        if not typed:
            parts = (name.removeprefix(f"{command} ") for name in COMMANDS if name.startswith(f"{command} "))
            yield from (Suggestion("word", part, summary(f"{command} {part}")) for part in parts)
        if arguments and (count < len(arguments) or arguments[-1].repeatable):
            yield from values(arguments[min(count, len(arguments) - 1)], command)


def _commands() -> Iterator[Suggestion]:
    for name in COMMANDS:
        if " " not in name:
            yield Suggestion("word", name, summary(name))
    yield Suggestion("word", "--help", "Print the commands.")
    yield Suggestion("word", "--version", "Print the version.")


def summary(command: str) -> str:
    """The first sentence of a command's help."""
    return (COMMANDS[command].__doc__ or "").partition("\n")[0].partition(". ")[0].rstrip(".")


def parameters_of(command: str) -> list[CommandParameter]:
    """The options and arguments of a command, in the order of its help."""
    kind = COMMANDS[command]
    hints = get_type_hints(kind, include_extras=True)
    found = []
    for name in kind.TAKES:
        shape, *extras = get_args(hints[name]) or (hints[name],)
        for extra in extras:
            words: tuple[str, ...] = ()
            if isinstance(extra, OptionInfo):
                # Typer takes the first declaration for a default value until the function is registered
                first = (extra.default,) if isinstance(extra.default, str) else ()
                given = (*first, *(extra.param_decls or ())) or (f"--{name.replace('_', '-')}",)
                words = tuple(word for part in given for word in part.split("/") if word.startswith("-"))
            description = (extra.help or "").partition(". ")[0].rstrip(".")
            found.append(CommandParameter(name, words, shape, extra.metavar or "", description))
    return found


def _typed(
    words: Sequence[str], options: Mapping[str, CommandParameter]
) -> tuple[CommandParameter | None, list[CommandParameter], int]:
    """Of the words after the command: the option whose value is next, the options used, and the number of arguments."""
    value_of: CommandParameter | None = None
    used, count = [], 0
    for word in words:
        if value_of is not None:
            value_of = None
            continue
        name, equals, _ = word.partition("=")
        if name in options:
            used.append(options[name])
            value_of = None if equals or options[name].flag else options[name]
        elif not word.startswith("-"):
            count += 1
    return value_of, used, count


# --- values -----------------------------------------------------------------------------------------------------------------


def values(parameter: CommandParameter, command: str) -> Iterator[Suggestion]:
    """The values that a parameter may have: by its field, else by its type."""
    source = VALUES.get(f"{command}.{parameter.field}") or VALUES.get(parameter.field)
    kinds = (
        parameter.kind,
        *get_args(parameter.kind),
        *(part for kind in get_args(parameter.kind) for part in get_args(kind)),
    )
    if source is not None:
        yield from source()
    elif enums := [kind for kind in kinds if isinstance(kind, EnumType)]:
        members: Iterable[Enum] = enums[0]
        yield from (Suggestion("word", str(member.value)) for member in members)
    elif Path in kinds:
        yield Suggestion("folders" if parameter.metavar.startswith(("DIR", "FOLDER")) else "files")


def engine_names() -> Iterator[Suggestion]:
    """The names of engines; and the labels of versions that simspec has environments of, or the project file names."""
    names = _known_engines()
    yield from (Suggestion("word", name) for name in names)
    for label, where in _labels():
        if label.partition("@")[0] in names and "@" in label:
            yield Suggestion("word", label, where)


def _known_engines() -> list[str]:
    return [*_plugins("simspec.engines"), *_plugins("simspec.auditors")]


def _labels() -> Iterator[tuple[str, str]]:
    from simspec.outputs.files import data_folder
    from simspec.project import PROJECT_FILE, find_project

    folder = data_folder("engines")
    if folder is not None and folder.is_dir():
        yield from ((name, "environment of simspec") for name in sorted(os.listdir(folder)))
    file = find_project(Path.cwd())
    if file is not None and file.is_file() and file.stat().st_size <= LARGEST_PROJECT:
        tables = tomllib.loads(file.read_text(encoding="utf-8")).get("engines", {})
        yield from ((str(label), PROJECT_FILE) for label in tables)


def _interpreters() -> Iterator[Suggestion]:
    yield from (Suggestion("start", f"{entry.text}=") for entry in engine_names())


def _plugins(group: str) -> dict[str, str]:
    """The names of plug-ins with their modules; none is imported."""
    return {point.name: point.module for point in sorted(entry_points(group=group), key=lambda point: point.name)}


def _formats() -> Iterator[Suggestion]:
    yield from (Suggestion("word", name) for name in _plugins("simspec.formats"))


def _specs() -> Iterator[Suggestion]:
    """Scenarios of the library, spec files, and robot files."""
    from simspec.files import library

    yield from (Suggestion("word", name, "scenario of the library") for name in library())
    yield Suggestion("files", " ".join((*SPECS, *_robot_suffixes())))


def _robots() -> Iterator[Suggestion]:
    yield Suggestion("files", " ".join(_robot_suffixes()))


def _robot_suffixes() -> tuple[str, ...]:
    """The suffixes that simspec's importers state in their packages; importers of other distributions are not imported."""
    modules = [module for module in _plugins("simspec.importers").values() if module.partition(".")[0] == SIMSPEC]
    packages = [importlib.import_module(module.rpartition(".")[0]) for module in modules]
    return tuple(dict.fromkeys(suffix for package in packages for suffix in getattr(package, "SUFFIXES", ())))


def _studies() -> Iterator[Suggestion]:
    from simspec.files import resource_folder

    for file in sorted((resource_folder("specs") / "studies").glob("*.yaml")):
        yield Suggestion("word", file.stem, "study of the library")
    yield Suggestion("files", " ".join(SPECS))


def _runs_or_specs() -> Iterator[Suggestion]:
    yield from _specs()
    yield Suggestion("folders")


def _pages() -> Iterator[Suggestion]:
    """Codes of errors and warnings with their titles, and features."""
    from simspec.codes import CODES
    from simspec.support.features import MEANING

    for texts in (CODES, MEANING):
        yield from (Suggestion("word", str(word), str(text)) for word, text in texts.items())


def _features() -> Iterator[Suggestion]:
    from simspec.support.features import Feature

    yield Suggestion("word", "all", "every feature that needs it")
    yield from (Suggestion("word", feature.value) for feature in Feature)


VALUES: Final[Mapping[str, Callable[[], Iterator[Suggestion]]]] = {
    **dict.fromkeys(("engine", "without", "shown", "names"), engine_names),
    **dict.fromkeys(("spec", "specs"), _specs),
    **dict.fromkeys(("a", "b"), _runs_or_specs),
    **dict.fromkeys(("import.file", "audit.files"), _robots),
    "robot": _robots,
    "accepted": lambda: iter([Suggestion("word", name) for name in _known_engines()]),
    "python": _interpreters,
    "format_name": _formats,
    "accept": _features,
    "repair": lambda: iter([Suggestion("word", "all", "defects of every kind")]),
    "study": _studies,
    "help.words": _pages,
    "view.seen": _runs_or_specs,
    "fmt.files": lambda: iter([Suggestion("files", " ".join(SPECS))]),
    "pages": lambda: iter([Suggestion("files", ".md")]),
    "trust.file": lambda: iter([Suggestion("files", "simspec.toml")]),
    "baseline": lambda: iter([Suggestion("files", ".json")]),
    "package_path": lambda: iter([Suggestion("folders")]),
}
"""Values by field, or by command and field; for those of other fields the type says what they are."""
