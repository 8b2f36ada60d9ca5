"""Problems found in what a user wrote, and the exceptions that carry them.

A :class:`Problem` says where, what was found, what is allowed and the way out; an exception carries all
problems of one step at once, so that a user repairs a file in one go.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

EXIT_OK = 0
EXIT_FAILED = 1
"""An expectation, a proof or a diff failed."""
EXIT_WRONG = 2
"""The spec or the command is wrong."""
EXIT_ENGINE = 3
"""An engine failed or is missing."""


MOST_TEXT = 400
"""Characters of foreign text that a message quotes."""
MOST_WORDS = 1500
"""Characters of a field of a problem in simspec's own words; the longest lists all words of a table of the language."""
MOST_PROBLEMS = 50
"""Problems that an error lists; it counts the others."""


def clipped(text: str, most: int = MOST_TEXT) -> str:
    """``text``, or its beginning and its length where it is longer than ``most`` characters."""
    return text if len(text) <= most else f"{text[:most]}… ({len(text):,} characters)"


def more_places(paths: Sequence[object]) -> str:
    """ " (and 3 more places)" after a message that names the first of ``paths``; "" where there is one."""
    more = len(paths) - 1
    return f" (and {more} more place{'s' if more > 1 else ''})" if more else ""


def visible(text: str, lines: bool = False) -> str:
    """``text`` with everything escaped that is not seen, or that does more than be seen: control characters (with ``lines``,
    all but the ends of lines), other ends of lines, marks that change the direction of writing, and halves of characters."""
    return UNSEEN_CHARACTERS.sub(lambda found: _escaped(found.group(), lines), text)


UNSEEN_CHARACTERS = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff]"
)


def _escaped(character: str, lines: bool) -> str:
    if lines and character == "\n":
        return character
    return character.encode("unicode_escape", "surrogatepass").decode("ascii")


@dataclass(frozen=True, slots=True)
class Location:
    """A place in a file; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{_words(self.file)}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong.

    ``path`` is the dotted path in the spec (``bodies.ball.mass``), ``found`` and ``allowed`` say what was
    there and what may be, ``hint`` is the way out (the nearest valid word, the key to write instead). ``code`` is that of its
    class (:mod:`simspec.codes`), whose page ``simspec help CODE`` prints.
    """

    message: str
    path: str = ""
    location: Location | None = None
    found: str | None = None
    allowed: str | None = None
    hint: str | None = None
    code: str = field(default="", kw_only=True)

    def __str__(self) -> str:
        place = f"{self.location}: " if self.location else ""
        where = f"{visible(clipped(self.path))}: " if self.path else ""
        parts = [f"{place}{where}{_words(self.message)}"]
        if self.found is not None:
            parts.append(f"  found:   {visible(clipped(self.found))}")
        if self.allowed is not None:
            parts.append(f"  allowed: {_words(self.allowed)}")
        if self.hint is not None:
            parts.append(f"  hint:    {_words(self.hint)}")
        return "\n".join(parts)


def _words(text: str) -> str:
    return visible(clipped(text, MOST_WORDS))


@dataclass(frozen=True, slots=True)
class EngineRefusal(Problem):
    """A problem of a single engine: a feature that it does not support, or not unless it is accepted.

    ``feature`` is the name that the support matrix has for it, empty where the problem is of none; ``option`` is where the spec
    accepts it by name (``accept``, ``outside``), empty where nothing that is accepted helps.
    """

    engine: str = ""
    feature: str = ""
    option: str = ""


class SimspecError(Exception):
    """Base of every error that simspec raises on purpose; ``exit_code`` is what the command line ends with."""

    exit_code = EXIT_FAILED
    code = ""
    """That of the class of the error (:mod:`simspec.codes`), where no problem of it says one."""


class SpecError(SimspecError):
    """The spec (or the command) is wrong. ``problems`` holds every problem found, in file order."""

    exit_code = EXIT_WRONG

    def __init__(self, problems: Iterable[Problem]):
        self.problems = tuple(problems)
        if not self.problems:
            raise ValueError("a SpecError needs at least one problem")
        super().__init__("\n".join([*map(str, self.problems[:MOST_PROBLEMS]), *self.more]))

    @property
    def more(self) -> tuple[str, ...]:
        """A line that counts the problems that are not listed, where there are such."""
        left = len(self.problems) - MOST_PROBLEMS
        return (f"and {left:,} more problem{'s' if left > 1 else ''}",) if left > 0 else ()


class UnsupportedError(SpecError):
    """A format or an engine cannot say something that the spec says, and the spec did not accept that.

    ``brief``: lines that stand in the terminal for those problems that are of single engines; empty: each is printed in full.
    ``ending``: the last lines, the ways out of all problems together; ``ways_out``: the same as data.
    """

    brief: tuple[str, ...] = ()
    ending: tuple[str, ...] = ()
    ways_out: Mapping[str, Any] | None = None


def code_of_failure(message: str) -> str:
    """The code of a failure of an engine, by its message: all that is known of a failed run, and of an error of a process."""
    missing = ("not installed", "is installed, and importing", "is version")
    late = "no result within its deadline"
    return "E201" if message.startswith(missing) else "E203" if message.startswith(late) else "E202"


class EngineError(SimspecError):
    """An engine is missing, crashed, hung, or refused what it was given. ``engine`` names it; ``operation`` is the number of
    the operation that its process was at when it ended without a result, where that is known. ``refused``: the engine
    itself said so, and lives."""

    exit_code = EXIT_ENGINE

    def __init__(self, engine: str, message: str, operation: int | None = None, refused: bool = False):
        self.code = code_of_failure(message)
        self.engine = engine
        self.operation = operation
        self.refused = refused
        # a margin distinguishes the lines of an engine from simspec's
        first, *rest = visible(message, lines=True).split("\n")
        super().__init__("\n  | ".join([f"{visible(clipped(engine))}: {first}", *rest]))


def not_importable(engine: str, module: str, error: ImportError) -> EngineError:
    """The error of an engine whose Python ``module`` cannot be imported: it is not installed, or it is, and importing it fails
    for another reason (a library that does not load, a locale)."""
    if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == module:
        return EngineError(engine, f"not installed: pip install 'simspec-physics[{engine}]' ({error})")
    return EngineError(engine, f"is installed, and importing {module} fails: {error}")


# Results for reading, where a whole report is too much: small tables in HTML for notebooks, lengths with a prefix.


def html_table(title: str, head: Sequence[str], rows: Iterable[Sequence[object]], note: str = "") -> str:
    """A table with a caption, and a note below it. Names come from untrusted specs: nothing in them is markup."""
    heads = "".join(f"<th>{_text(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{_text(entry)}</td>" for entry in row) + "</tr>" for row in rows)
    above = f"<thead><tr>{heads}</tr></thead>" if head else ""
    below = f"<p>{_text(note)}</p>" if note else ""
    return f"<table><caption>{_text(title)}</caption>{above}<tbody>{body}</tbody></table>{below}"


def _text(value: object) -> str:
    return escape(visible(str(value)))


def length(value: float | None) -> str:
    """A length (m) with the prefix that suits it, e.g. ``3.2 mm``."""
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞"
    for factor, unit in ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm")):
        if abs(value) >= factor:
            return f"{value / factor:.3g} {unit}"
    return f"{value:.1e} m" if value else "0"
