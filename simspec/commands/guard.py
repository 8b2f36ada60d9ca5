"""Around every command: what simspec raises on purpose is printed, with its exit code."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

import typer

from simspec.ending import end_if_told
from simspec.errors import EngineError, Problem, SimspecError, SpecError


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
    end_if_told()
    if as_json:
        from simspec.report.plain import error_data, text

        sys.stdout.write(text(error_data(error)))
    else:
        from simspec.report.terminal import show_error

        show_error(error)
    return error.exit_code
