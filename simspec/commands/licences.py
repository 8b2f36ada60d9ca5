"""Consent to licence terms of engines, ``Engine.LICENCES``: the user gives it before anything is downloaded or made."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Sequence

from simspec.engines.kit.contract import Engine
from simspec.errors import Problem, SpecError
from simspec.report.screen import say

OPTION = "--accept-licence"


def check_accepted(names: Sequence[str], requested: Iterable[type[Engine]], yes: bool) -> None:
    """Raise SpecError where ``--accept-licence`` has no effect: for an engine that is not requested or has no licence terms,
    and without ``--yes``."""
    engines = {engine.NAME: engine for engine in requested}
    licensed = [name for name, engine in engines.items() if engine.LICENCES]
    problems = []
    for name in names:
        if name not in licensed:
            why = "has no licence terms to accept" if name in engines else "is not among the engines to install"
            message = f"{OPTION} {name} is without effect: {name} {why}"
            hint = None if licensed else "leave it out"
            problems.append(Problem(message, allowed=", ".join(licensed) or None, hint=hint, code="C109"))
    if names and not problems and not yes:
        problems.append(Problem(f"{OPTION} is without effect: nothing is installed without --yes", code="C109"))
    if problems:
        raise SpecError(problems)


class Consent:
    """The engines whose licence terms the user has accepted in this command. It is stored nowhere: an environment that is whole
    is not installed again."""

    def __init__(self, accepted: Iterable[str] = ()):
        self._accepted = set(accepted)
        self._reasons: dict[str, str] = {}

    def prompt(self, engine: type[Engine], silent: bool) -> None:
        """Let the user accept the terms of ``engine``, which have been printed, by typing its name. There is no prompt where
        they are accepted already or the answer is known, without a terminal, and if ``silent``."""
        if engine.NAME in self._accepted or engine.NAME in self._reasons:
            return
        if silent:
            self._reasons[engine.NAME] = "--json does not prompt"
        elif not _on_terminal():
            self._reasons[engine.NAME] = "there is no terminal for the prompt"
        else:
            say(f"{engine.NAME}: to accept these terms and install, type {engine.NAME}; anything else leaves it out")
            if _answer() == engine.NAME:
                self._accepted.add(engine.NAME)
            else:
                self._reasons[engine.NAME] = f"the answer was not {engine.NAME}"

    def refusal(self, engine: type[Engine], label: str) -> str | None:
        """Why ``engine``, requested as ``label``, may not be installed, with the command that accepts its terms; None where it
        may be."""
        if not engine.LICENCES or engine.NAME in self._accepted:
            return None
        names = ", ".join(terms.name for terms in engine.LICENCES)
        why = f" ({self._reasons[engine.NAME]})" if engine.NAME in self._reasons else ""
        way = shlex.join(["simspec", "engines", "install", label, "--yes", OPTION, engine.NAME])
        return f"licence not accepted: {names}{why}; {way}"


def terms_lines(engine: type[Engine]) -> list[str]:
    """The licence terms of an engine, one line each."""
    return [
        f"{engine.NAME}: licence terms of {terms.covers}: {terms.name}, {', '.join(terms.addresses)}"
        for terms in engine.LICENCES
    ]


def _on_terminal() -> bool:
    """Whether the user sees what is printed and can answer."""
    return all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stdout))


def _answer() -> str:
    """A line of the terminal; empty at its end."""
    return sys.stdin.buffer.readline().decode(errors="replace").strip()
