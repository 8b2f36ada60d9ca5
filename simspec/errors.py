"""Problems found in what a user wrote, and the exceptions that carry them.

A :class:`Problem` says where, what was found, what is allowed and the way out; an exception carries all
problems of one step at once, so that a user repairs a file in one go.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

EXIT_OK = 0
EXIT_FAILED = 1
"""An expectation, a proof or a diff failed."""
EXIT_WRONG = 2
"""The spec or the command is wrong."""
EXIT_ENGINE = 3
"""An engine failed or is missing."""


MOST_TEXT = 400
"""Characters of a text of somebody else's that a message quotes."""


def clipped(text: str, most: int = MOST_TEXT) -> str:
    """``text``, or its beginning and its length where it is longer than ``most`` characters."""
    return text if len(text) <= most else f"{text[:most]}… ({len(text):,} characters)"


@dataclass(frozen=True, slots=True)
class Location:
    """A place in a file; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong.

    ``path`` is the dotted path in the spec (``bodies.ball.mass``), ``found`` and ``allowed`` say what was
    there and what may be, ``hint`` is the way out (the nearest valid word, the key to write instead).
    """

    message: str
    path: str = ""
    location: Location | None = None
    found: str | None = None
    allowed: str | None = None
    hint: str | None = None

    def __str__(self) -> str:
        place = f"{self.location}: " if self.location else ""
        where = f"{self.path}: " if self.path else ""
        parts = [f"{place}{where}{self.message}"]
        if self.found is not None:
            parts.append(f"  found:   {self.found}")
        if self.allowed is not None:
            parts.append(f"  allowed: {self.allowed}")
        if self.hint is not None:
            parts.append(f"  hint:    {self.hint}")
        return "\n".join(parts)


class SimspecError(Exception):
    """Base of every error that simspec raises on purpose; ``exit_code`` is what the command line ends with."""

    exit_code = EXIT_FAILED


class SpecError(SimspecError):
    """The spec (or the command) is wrong. ``problems`` holds every problem found, in file order."""

    exit_code = EXIT_WRONG

    def __init__(self, problems: Iterable[Problem]):
        self.problems = tuple(problems)
        if not self.problems:
            raise ValueError("a SpecError needs at least one problem")
        super().__init__("\n".join(str(problem) for problem in self.problems))


class UnsupportedError(SpecError):
    """A format or an engine cannot say something that the spec says, and the spec did not accept that."""


class EngineError(SimspecError):
    """An engine is missing, crashed, hung, or refused what it was given. ``engine`` names it."""

    exit_code = EXIT_ENGINE

    def __init__(self, engine: str, message: str):
        self.engine = engine
        super().__init__(f"{engine}: {message}")
