"""Options of commands: each is declared once, for the command line and for Python.

A command is a class of options (``scenario_options.py``, ``experiment_options.py``). The command line is made from its fields,
and the function that does the work receives one object of it. The project file gives what neither says. Only light modules are
imported here.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, TypeVar, dataclass_transform, get_type_hints

from typer import Argument, Option

from simspec import numerals
from simspec.errors import EXIT_OK, EngineError, Problem, SpecError

if TYPE_CHECKING:
    from simspec.language.foreign import ImportOptions
    from simspec.language.load import Spec
    from simspec.project import Interpreters
    from simspec.selection import Selection

NUMBERS: Mapping[str, Callable[[str], float]] = {
    **dict.fromkeys(("--tolerance", "--fail-on-diff", "--deadline", "--speed"), numerals.number),
    **dict.fromkeys(("--jobs", "--windows", "--timed-runs", "--fps", "--port"), numerals.whole),
}
"""Options that take numbers, and the function that checks their text before the command line is parsed."""
SpecName = Annotated[str, Argument(metavar="SPEC", help="A YAML file, or the name of a library scenario.")]
SpecNames = Annotated[list[str], Argument(metavar="SPEC...", help="YAML files, or library scenarios.")]
Tolerance = Annotated[float, Option(metavar="METRE", min=0.0, help="Tolerance of positions (m) and angles (rad).")]
NoVerify = Annotated[bool, Option("--no-verify", help="Skip the proof that the engines have the same model.")]
StoreFolder = Annotated[
    Path | None, Option(metavar="DIR", help="Where runs are stored (default runs/NAME/sweep); may be shared.")
]
DryRun = Annotated[bool, Option("--dry-run", help="Print the plan and its cost; run and write nothing.")]
Wait = Annotated[bool, Option("--wait", help="Wait while another sweep writes to the store.")]
CheckFolder = Annotated[bool, Option("--check", help="Write nothing; exit with 1 if the folder is not current.")]
PageFile = Annotated[
    Path | None, Option("--out", "-o", metavar="FILE", help="Output file (default FOLDER/report.html).")
]
EngineNames = Annotated[list[str] | None, Argument(metavar="[NAME]...", help="Engines.")]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options that several commands share. A command line has those that its class names; in the others, defaults hold."""

    NAME: ClassVar[str]
    BODY: ClassVar[str]
    """Module and name of the function that does the work; it is imported when the command is called."""
    TAKES: ClassVar[tuple[str, ...]]
    """Fields that the command line has, in the order of its help."""

    engine: Annotated[
        list[str] | None,
        Option(
            "--engine", "-e", metavar="NAME", help="An engine. NAME@VERSION=PYTHON: in another interpreter. Repeatable."
        ),
    ] = None
    sets: Annotated[
        list[str] | None,
        Option("--set", metavar="PATH=VALUE", help="Override a value: --set physics.timestep=2ms. Repeatable."),
    ] = None
    accept: Annotated[
        list[str] | None,
        Option(
            "--accept",
            metavar="FEATURE",
            help="Let engines have this feature approximately or from outside; all: every feature that needs it. Repeatable.",
        ),
    ] = None
    repair: Annotated[
        list[str] | None,
        Option(
            "--repair",
            metavar="RULE",
            help="Repair defects of robot files of this kind; all: of every kind. Repeatable.",
        ),
    ] = None
    package: Annotated[
        list[str] | None,
        Option("--package", metavar="NAME=DIR", help="Folder of a package of robot files. Repeatable."),
    ] = None
    package_path: Annotated[
        list[str] | None,
        Option("--package-path", metavar="DIR", help="Folder in which packages are looked for. Repeatable."),
    ] = None
    arg: Annotated[
        list[str] | None, Option("--arg", metavar="NAME=VALUE", help="Argument of a xacro file. Repeatable.")
    ] = None
    self_collision: Annotated[
        bool,
        Option("--self-collision/--no-self-collision", help="Whether bodies of one robot file may touch each other."),
    ] = True
    allow_outside: Annotated[
        bool, Option("--allow-outside", help="Allow `use:` to read files outside the project folder.")
    ] = False
    strict: Annotated[bool, Option("--strict", help="Treat warnings as errors (exit code 2).")] = False
    python: Annotated[
        list[str] | None,
        Option("--python", metavar="ENGINE=PATH", help="Run an engine in another Python interpreter. Repeatable."),
    ] = None
    deadline: Annotated[float, Option(metavar="SECONDS", min=0.1, help="Deadline of one engine process.")] = 600.0
    junit: Annotated[
        Path | None, Option("--junit", metavar="FILE", help="Also write a test report that CI systems read (XML).")
    ] = None
    annotations: Annotated[
        bool, Option("--annotations", help="Also print what failed as annotations of the spec's lines (GitHub).")
    ] = False
    summary: Annotated[Path | None, Option("--summary", metavar="FILE", help="Also write a summary as Markdown.")] = (
        None
    )
    github: Annotated[bool, Option("--github", help="In GitHub Actions: --annotations, and a summary of the job.")] = (
        False
    )
    as_json: Annotated[bool, Option("--json", help="Print one JSON object instead of tables.")] = False

    @cached_property
    def robot_files(self) -> RobotFileOptions:
        """How robot files are read: by these options, then by the project file. Raises SpecError."""
        given: dict[str, Any] = {
            name: () if (value := getattr(self, name)) is None else value for name in ROBOT_OPTIONS
        }
        return RobotFileOptions(**given, **_project_folders())

    @cached_property
    def chosen(self) -> list[str]:
        """The engines that ``--engine`` names, else the default engines of the project file; empty where there are none."""
        from simspec.project import load_project

        return self.engine or list(load_project().default_engines)

    def interpreters(self, starts: bool = True) -> Interpreters:
        """As :func:`interpreters`."""
        return interpreters(self.python, self.engine, starts=starts)


Kind = TypeVar("Kind", bound=Options)
COMMANDS: Final[dict[str, type[Options]]] = {}
"""Every command by its name."""
ROBOT_OPTIONS: Final = ("repair", "package", "package_path", "arg", "self_collision")
"""Options of commands that read robot files, alone or as what a spec uses: ``ROBOTS`` in the list of a command."""


@dataclass_transform(kw_only_default=True, frozen_default=True)
def command(name: str, body: str, takes: str) -> Callable[[type[Kind]], type[Kind]]:
    """Make a class the command ``name``: its docstring is the help, ``takes`` lists its options in the order of the help.
    ``body``: module and name of the function that does the work, below ``simspec.commands``."""

    def made(kind: type[Kind]) -> type[Kind]:
        kind = dataclass(frozen=True, kw_only=True, repr=False, eq=False)(kind)
        kind.NAME, kind.BODY = name, f"simspec.commands.{body}"
        kind.TAKES = tuple(takes.replace("ROBOTS", " ".join(ROBOT_OPTIONS)).split())
        COMMANDS[name] = kind
        return kind

    return made


def function_of(kind: type[Options]) -> Callable[..., int]:
    """The function of a command with one parameter for each option, as Typer takes it."""
    hints = get_type_hints(kind, include_extras=True)
    defaults = {
        entry.name: inspect.Parameter.empty if entry.default is MISSING else entry.default for entry in fields(kind)
    }

    def called(**given: Any) -> int:
        if getattr(given.get("context"), "invoked_subcommand", None) is not None:
            return EXIT_OK  # a command of the group is called next
        module, _, name = kind.BODY.partition(":")
        return int(getattr(import_module(module), name)(kind(**given)))

    parameters = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=defaults[name], annotation=hints[name])
        for name in kind.TAKES
    ]
    called.__name__, called.__doc__ = kind.NAME, kind.__doc__
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # read by Typer
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called


# --- robot files ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RobotFileOptions:
    """How robot files of other languages are read, in the words of the command line and of the project file."""

    repair: Sequence[str] = ()
    """Rules of repair that may be applied."""
    package: Sequence[str] = ()
    """``NAME=DIR``: the folder of a package."""
    package_path: Sequence[str] = ()
    """Folders in which packages are looked for."""
    project_paths: Sequence[str] = ()
    """Folders in which they are looked for after these: ``package-paths`` of the project file."""
    allowed_folders: Sequence[str] = ()
    """``allowed-folders`` of the project file: their files may be used from outside of them."""
    trusting: str = field(default="", compare=False)
    """The command that trusts the project file, where it names folders of these kinds and is not trusted: they are not used."""
    arg: Sequence[str] = ()
    """``NAME=VALUE``: an argument of a xacro file."""
    self_collision: bool = True
    """Whether bodies of one file's model may touch each other."""

    def options(self) -> ImportOptions:
        """The options of importers. Raises SpecError for words of another form."""
        from simspec.language.foreign import ImportOptions

        here = Path.cwd()
        packages = {name: str(here / folder) for name, folder in _pairs(self.package, "--package", "NAME=DIR").items()}
        return ImportOptions(
            packages,
            tuple(str(here / folder) for folder in (*self.package_path, *self.project_paths)),
            _pairs(self.arg, "--arg", "NAME=VALUE"),
            tuple(self.repair),
            base=here,
            self_collision=self.self_collision,
            allowed=tuple(self.allowed_folders),
            trusting=self.trusting,
        )

    def check_effect(self, *specs: Spec) -> None:
        """Raise SpecError where an option of robot files has no effect, since no spec has a robot file. The folders of packages
        may always be given."""
        given = {"--repair": self.repair, "--arg": self.arg, "--no-self-collision": not self.self_collision}
        options = [option for option, value in given.items() if value]
        if options and not any(source.imported is not None for spec in specs for source in spec.source.all()):
            names = " and ".join(spec.name for spec in specs) or "runs without a spec"
            hint = "leave it out: there is no file of another language"
            raise SpecError(
                [Problem(f"{option} is without effect on {names}", hint=hint, code="C109") for option in options]
            )


def _pairs(words: Sequence[str], option: str, form: str) -> dict[str, str]:
    """Values by name of ``NAME=VALUE``. Raises SpecError for other words, and for a name that is given twice."""
    values: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not name or not equals or name in values:
            why = "given twice" if name in values else f"expected {form}"
            raise SpecError([Problem(f"{option}: {why}", found=word, code="C103")])
        values[name] = value
    return values


def _project_folders() -> dict[str, Any]:
    """The folders of the project file, by fields of :class:`RobotFileOptions`."""
    from simspec.project import load_project

    project = load_project()
    paths, allowed = tuple(map(str, project.package_paths)), tuple(map(str, project.allowed_folders))
    if project.not_trusted is None or not (paths or allowed):
        return {"project_paths": paths, "allowed_folders": allowed}
    return {"trusting": project.trusting}


# --- engines ----------------------------------------------------------------------------------------------------------------


def interpreters(
    words: list[str] | None, engine_words: list[str] | None = None, *, starts: bool = True
) -> Interpreters:
    """The interpreters that ``--python`` and ``--engine`` name, and for other engines those of the project file and the
    environments that simspec made, by the engine's label. ``starts``: whether the command starts engines; one that lists, plans
    or shows starts no interpreter of a project file."""
    from simspec.engines.kit.registry import find_engine, parse
    from simspec.project import load_project

    typed: dict[str, str] = {}
    for word in words or ():
        engine = parse(word)
        if engine.python is None:
            raise SpecError(
                [Problem(f"--python {word}: no interpreter given", allowed="ENGINE=/path/to/python", code="C103")]
            )
        find_engine(engine.name)
        typed[engine.label] = engine.python
    for engine in map(parse, engine_words or ()):
        if engine.python is not None and typed.setdefault(engine.label, engine.python) != engine.python:
            message = f"{engine.label} is given two interpreters"
            raise SpecError([Problem(message, found=f"{typed[engine.label]} and {engine.python}", code="C103")])
    project = load_project()
    return (project.known_interpreters() if starts else project.listed_interpreters()).with_named(typed)


def demand_trusted(labels: Iterable[str], pythons: Mapping[str, str]) -> None:
    """Raise NotTrustedError where an engine's interpreter is one of a project file that is not trusted: before anything is
    started or written."""
    for label in labels:
        pythons.get(label)


def engine_names(words: list[str], audits: bool = False) -> list[str]:
    """The labels of the engines that are named. Raises EngineError, and SpecError for the name of a format or, unless
    ``audits``, of an engine that only loads robot files."""
    from simspec.engines.kit.registry import auditors, find_engine, parse

    labels: dict[str, None] = {}
    for word in words:
        engine = parse(word)
        try:
            find_engine(engine.name)
        except EngineError as error:
            from simspec.formats.kit.contract import formats

            if engine.name in formats():
                hint = f"--engine ENGINE; plain files: simspec compile SPEC --format {engine.name}"
                raise SpecError(
                    [Problem(f"{engine.name!r} is a format, not an engine", hint=hint, code="E111")]
                ) from error
            raise
        if not audits and engine.name in auditors():
            message = f"{engine.name} loads robot files for an audit; simspec runs no world in it"
            hint = f"simspec audit FILE --engine {engine.label}"
            raise SpecError([Problem(message, hint=hint, code="E107")])
        labels[engine.label] = None
    return list(labels)


def names_alone(words: list[str]) -> list[str]:
    """The names without versions: files are of an engine, whatever its version."""
    from simspec.engines.kit.registry import engine_name

    return list(dict.fromkeys(map(engine_name, engine_names(words))))


def engines_at_work(
    words: list[str] | None,
    pythons: Mapping[str, str],
    demand: bool = True,
    files_alone: bool = False,
    audits: bool = False,
) -> Selection:
    """The engines that have to run: those that are named, else every installed one (``audits``: also those that only load
    robot files). Raises EngineError for a named engine that is not installed (unless ``demand`` is false, or ``files_alone`` is
    true and only its files are ever proven), SpecError when no engine is, NotTrustedError for one whose interpreter a project
    file names that is not trusted."""
    from simspec import selection
    from simspec.engines.kit.registry import find_engine

    if words:
        names = engine_names(words, audits)
        demand_trusted(names, pythons)
        if demand:
            demand_installed([name for name in names if not (files_alone and find_engine(name).FILES_ALONE)], pythons)
        return selection.named(names, pythons)
    found = selection.available(pythons, audits)
    demand_trusted(found.engines, pythons)
    if not found.engines:
        raise SpecError(
            [
                Problem(
                    "no engine is installed",
                    hint="pip install 'simspec-physics[all]', or use --engine NAME",
                    code="E201",
                )
            ]
        )
    return found


def demand_installed(names: list[str], pythons: Mapping[str, str]) -> None:
    """Raise EngineError for the first engine that is neither installed nor found in an interpreter of its own."""
    from simspec.comparison.study import missing_engines

    for name, why in missing_engines(names, pythons).items():
        raise EngineError(name, why)


def print_json(value: Any) -> None:
    """Print the answer of a command as one JSON object."""
    from simspec.report.screen import text

    sys.stdout.write(text(value))
