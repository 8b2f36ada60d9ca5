"""Around every command: what simspec raises on purpose is printed, with its exit code."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable
from typing import Any

import typer

from simspec.arguments import NUMBERS
from simspec.ending import exit_if_signalled
from simspec.errors import EngineError, Problem, SimspecError, SpecError
from simspec.numerals import NumeralError, whole


def command(function: Callable[..., int | None]) -> Callable[..., None]:
    """A command whose return value is the exit code, and whose simspec errors are printed, never traced back."""

    @functools.wraps(function)
    def guarded(*args: Any, **keywords: Any) -> None:
        try:
            code = function(*args, **keywords)
        except SimspecError as error:
            code = report_error(error, keywords.get("as_json", False))
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("simspec"):
                raise
            missing = EngineError(error.name, "not installed: pip install 'simspec[all]'")
            code = report_error(missing, keywords.get("as_json", False))
        except OSError as error:
            if error.filename is None:  # not of a file: of what is said itself
                raise
            problem = Problem(f"{error.filename}: {error.strerror or error}")
            code = report_error(SpecError([problem]), keywords.get("as_json", False))
        if code:
            raise typer.Exit(code)

    return guarded


def report_error(error: SimspecError, as_json: bool) -> int:
    exit_if_signalled()
    if as_json:
        from simspec.report.plain import error_data, text

        sys.stdout.write(text(error_data(error)))
    else:
        from simspec.report.terminal import show_error

        show_error(error)
    return error.exit_code


def wrong_words(arguments: list[str]) -> Problem | None:
    """The first problem of the words of a command line that no command could use, whatever it is."""
    return _empty(arguments) or _not_text(arguments) or _not_numbers(arguments)


def _empty(arguments: list[str]) -> Problem | None:
    """What is wrong with arguments of which one is empty: as a path it would be the current folder, and no name is empty."""
    for index, word in enumerate(arguments):
        if not word or (word.startswith("--") and word.endswith("=")):
            before = f" after {arguments[index - 1]}" if index and not word else ""
            return Problem(
                f"an argument of the command line is empty: the word {index + 1}{before}",
                found=" ".join(map(repr, arguments)),
                hint="is a variable of the shell empty? write . for the current folder",
            )
    return None


def _not_text(arguments: list[str]) -> Problem | None:
    """What is wrong with arguments, or a current folder, that are not UTF-8: no spec, certificate or engine can name them."""
    words = [(f"the word {index + 1} of the command line", word) for index, word in enumerate(arguments)]
    with contextlib.suppress(FileNotFoundError):  # a folder that was removed; said where a file is asked for in it
        words.append(("the path of the current folder", os.getcwd()))
    for what, word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            return Problem(f"{what} is not UTF-8 text", found=repr(word), hint="rename the file or the folder")
    return None


def _not_numbers(words: list[str]) -> Problem | None:
    """What is wrong with an option that takes a number, where Python would read one in its word and simspec reads none."""
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, equals, value = word.partition("=")
        kind = NUMBERS.get(option)
        if kind is None:
            continue
        text = value if equals else following
        try:
            kind(text)
        except NumeralError as error:
            what = "a whole number" if kind is whole else "a finite number"
            return Problem(f"{option} should be {what}: {error}", found=repr(text))
    return None
