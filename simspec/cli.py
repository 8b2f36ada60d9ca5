"""The command line, made from the options of the commands; the modules that do the work are imported when called."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from simspec.commands import experiment_options, scenario_options  # noqa: F401  # they declare the commands
from simspec.commands.help_format import COMMAND_GROUPS, HelpCommand, HelpGroup
from simspec.commands.options import COMMANDS, NUMBERS, function_of
from simspec.errors import EXIT_OK, EngineError, Problem, SimspecError, SpecError
from simspec.numerals import NumeralError, whole
from simspec.processes import exit_if_signalled, in_order

HELP_NAMES = {"help_option_names": ["--help", "-h"]}


def guarded(function: Callable[..., int | None]) -> Callable[..., None]:
    """A command that exits with the function's return value. Errors of simspec are printed, without a traceback."""

    @functools.wraps(function)
    def called(*args: Any, **keywords: Any) -> None:
        try:
            code = function(*args, **keywords)
        except SimspecError as error:
            code = report_error(error, keywords.get("as_json", False))
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("simspec"):
                raise
            missing = EngineError(error.name, "not installed: pip install 'simspec-physics[all]'")
            code = report_error(missing, keywords.get("as_json", False))
        except OSError as error:
            if error.filename is None:  # not about a file: standard output is closed
                raise
            problem = Problem(f"{error.filename}: {error.strerror or error}", code="C104")
            code = report_error(SpecError([problem]), keywords.get("as_json", False))
        if code:
            raise typer.Exit(code)

    return called


def report_error(error: SimspecError, as_json: bool) -> int:
    """Print an error; its exit code."""
    exit_if_signalled()
    if as_json:
        from simspec.report.screen import error_data, text

        sys.stdout.write(text(error_data(error)))
    else:
        from simspec.report.problems import show_error

        show_error(error)
    return error.exit_code


def simspec_command() -> None:
    """Run one physics scenario in several engines, with proof that all simulate the same model.

    \b
    Start here:
      simspec new pendulum                     write a spec, pendulum.yaml
      simspec run pendulum.yaml --all-engines  compile, verify, run, compare
      simspec view runs/pendulum               see it: verdict, playback, plots
      simspec list                             the scenarios of the library
      simspec engines                          the engines, and what they support

    \b
    Exit codes: 0 success; 1 an expectation, a proof or a comparison failed; 2
    error in the spec or the command line; 3 an engine failed or is not installed.
    """


def registered(word: str | None = None) -> typer.Typer:
    """The command line with every command, or with the command or group ``word`` alone where there is one: building a command
    takes as long as parsing its options."""
    app = typer.Typer(
        name="simspec",
        cls=HelpGroup,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={**HELP_NAMES, "max_content_width": 110},
    )
    app.callback()(simspec_command)
    names = " ".join(COMMAND_GROUPS.values()).split()
    for name in [word] if word in names else names:
        if name == "engines":
            engines = typer.Typer(rich_markup_mode=None, context_settings=HELP_NAMES)
            engines.callback(invoke_without_command=True)(guarded(function_of(COMMANDS["engines"])))
            for part in ("show", "doctor", "install"):
                engines.command(part, cls=HelpCommand)(guarded(function_of(COMMANDS[f"engines {part}"])))
            app.add_typer(engines, name="engines")
        else:
            app.command(name, cls=HelpCommand)(guarded(function_of(COMMANDS[name])))
    return app


def __getattr__(name: str) -> typer.Typer:
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = app = registered()
    return app


def help_text() -> str:
    """The text of ``simspec --help``, 80 columns wide whatever the terminal is."""
    group = typer.main.get_command(registered())
    settings = {**group.context_settings, "terminal_width": 80, "max_content_width": 80}
    context = group.context_class(group, info_name="simspec", **settings)
    return group.get_help(context) + "\n"


def main(arguments: list[str]) -> int:
    """Run one command line; the exit code."""
    return in_order(lambda: _main(arguments))


def _main(arguments: list[str]) -> int:
    if arguments == ["--write-help"]:
        from simspec.outputs.writing import write_file

        write_file(Path(__file__).with_name("help.txt"), help_text(), lambda old: b"simspec" in old[:100])
        return EXIT_OK
    if arguments == ["--version"]:
        from simspec.plugins import simspec_version

        print(f"simspec {simspec_version()}")
        return EXIT_OK
    if arguments[:1] == ["help"] and len(arguments) > 1 and " ".join(arguments[1:]) in COMMANDS:
        arguments = [*arguments[1:], "--help"]
    problem = _empty(arguments) or _not_text(arguments) or _not_numbers(arguments)
    if problem is not None:
        return report_error(SpecError([problem]), "--json" in arguments)
    registered(next(iter(arguments), None))(
        arguments, prog_name="simspec"
    )  # ends with SystemExit, whose code is the command's
    return EXIT_OK


# --- words that no command can use ------------------------------------------------------------------------------------------


def _empty(arguments: list[str]) -> Problem | None:
    """The problem of an empty argument: as a path it would be the current folder, and no name is empty."""
    for index, word in enumerate(arguments):
        if not word or (word.startswith("--") and word.endswith("=")):
            before = f" after {arguments[index - 1]}" if index and not word else ""
            return Problem(
                f"an argument of the command line is empty: the word {index + 1}{before}",
                found=" ".join(map(repr, arguments)),
                hint="is a variable of the shell empty? write . for the current folder",
                code="C103",
            )
    return None


def _not_text(arguments: list[str]) -> Problem | None:
    """The problem of an argument, or of a current folder, that is not UTF-8: no spec, certificate or engine can name it."""
    words = [(f"the word {index + 1} of the command line", word) for index, word in enumerate(arguments)]
    with contextlib.suppress(FileNotFoundError):  # the folder was removed: reported where a file in it is read
        words.append(("the path of the current folder", os.getcwd()))
    for name, word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            return Problem(
                f"{name} is not UTF-8 text", found=repr(word), hint="rename the file or the folder", code="C116"
            )
    return None


def _not_numbers(words: list[str]) -> Problem | None:
    """The problem of a numeric option whose text Python would read as a number, and simspec does not."""
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, equals, value = word.partition("=")
        kind = NUMBERS.get(option)
        if kind is None:
            continue
        text = value if equals else following
        try:
            kind(text)
        except NumeralError as error:
            number = "a whole number" if kind is whole else "a finite number"
            return Problem(f"{option} should be {number}: {error}", found=repr(text), code="C103")
    return None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
