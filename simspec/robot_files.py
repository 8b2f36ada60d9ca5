"""How robot files of other languages are read: the options of the command line, declared once for every command that takes such
files, by themselves or as what a spec uses."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, get_type_hints

import typer

from simspec.errors import Problem, SpecError

if TYPE_CHECKING:
    from simspec.language.foreign import ImportOptions
    from simspec.language.load import Spec


@dataclass(frozen=True)
class RobotFiles:
    """What the command line says of robot files, in its own words."""

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

    def options(self, *more_folders: str) -> ImportOptions:
        """The same as importers take it; ``more_folders``: further folders of packages. Raises SpecError for words of another
        form."""
        from simspec.language.foreign import ImportOptions

        here = Path.cwd()
        packages = {name: str(here / folder) for name, folder in pairs(self.package, "--package", "NAME=DIR").items()}
        return ImportOptions(
            packages,
            tuple(str(here / folder) for folder in (*self.package_path, *more_folders, *self.project_paths)),
            pairs(self.arg, "--arg", "NAME=VALUE"),
            tuple(self.repair),
            base=here,
            self_collision=self.self_collision,
            allowed=tuple(self.allowed_folders),
            trusting=self.trusting,
        )

    def check_effect(self, *specs: Spec) -> None:
        """Raise SpecError where something is said of robot files, and no spec has one. Where packages are may be said of
        any."""
        said = {"--repair": self.repair, "--arg": self.arg, "--no-self-collision": not self.self_collision}
        options = [option for option, value in said.items() if value]
        if options and not any(source.imported is not None for spec in specs for source in spec.source.all()):
            names = " and ".join(spec.name for spec in specs) or "what has no spec"
            hint = "leave it out: there is no file of another language"
            raise SpecError([Problem(f"{option} is without effect on {names}", hint=hint) for option in options])


def pairs(words: Sequence[str], option: str, form: str) -> dict[str, str]:
    """Values by name of ``NAME=VALUE``. Raises SpecError for other words, and for a name that is there twice."""
    said: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not name or not equals or name in said:
            why = "given twice" if name in said else f"expected {form}"
            raise SpecError([Problem(f"{option}: {why}", found=word)])
        said[name] = value
    return said


NO_WORDS: Final = RobotFiles()
"""Where nothing is said."""
OPTIONS: Final = {
    "repair": (
        Annotated[
            list[str] | None,
            typer.Option(
                "--repair",
                metavar="RULE",
                help="Repair defects of robot files of this kind; all: of every kind. Repeatable.",
            ),
        ],
        None,
    ),
    "package": (
        Annotated[
            list[str] | None,
            typer.Option("--package", metavar="NAME=DIR", help="Folder of a package of robot files. Repeatable."),
        ],
        None,
    ),
    "package_path": (
        Annotated[
            list[str] | None,
            typer.Option("--package-path", metavar="DIR", help="Folder in which packages are looked for. Repeatable."),
        ],
        None,
    ),
    "arg": (
        Annotated[
            list[str] | None,
            typer.Option("--arg", metavar="NAME=VALUE", help="Argument of a xacro file. Repeatable."),
        ],
        None,
    ),
    "self_collision": (
        Annotated[
            bool,
            typer.Option(
                "--self-collision/--no-self-collision", help="Whether bodies of one robot file may touch each other."
            ),
        ],
        True,
    ),
}
"""The options by fields of :class:`RobotFiles`, each with its declaration and what it is unless it is said."""
PLACE: Final = "robot_files"
"""The argument of a command that takes all of them."""


def project_folders() -> dict[str, Any]:
    """What the project file says of folders, by fields of :class:`RobotFiles`."""
    from simspec.project import load_project

    project = load_project()
    paths, allowed = tuple(map(str, project.package_paths)), tuple(map(str, project.allowed_folders))
    if project.not_trusted is None or not (paths or allowed):
        return {"project_paths": paths, "allowed_folders": allowed}
    return {"trusting": project.trusting}


def project_options() -> ImportOptions:
    """How robot files are read where the command line says nothing of them: by the project file."""
    return RobotFiles(**project_folders()).options()


def reads_robot_files(function: Callable[..., int]) -> Callable[..., int]:
    """A command with these options in its command line; it gets them together, as its argument ``robot_files``."""

    @functools.wraps(function)
    def reading(**words: Any) -> int:
        said: dict[str, Any] = {name: words.pop(name) for name in OPTIONS}
        spoken: dict[str, Any] = {name: () if value is None else value for name, value in said.items()}
        return function(**words, **{PLACE: RobotFiles(**spoken, **project_folders())})

    hints = get_type_hints(function, include_extras=True)
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name != PLACE:
            parameters.append(parameter.replace(annotation=hints[parameter.name]))
            continue
        for name, (declaration, default) in OPTIONS.items():
            parameters.append(parameter.replace(name=name, annotation=declaration, default=default))
    reading.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what the command line is made from
    reading.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return reading
