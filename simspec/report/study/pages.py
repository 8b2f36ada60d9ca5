"""Pages of Markdown with marked places that are filled from published studies.

    <!-- study NAME: SWEEP TABLE -->                 a table
    <!-- study NAME: SWEEP TABLE said -->            what it says, in sentences
    <!-- study NAME: SWEEP TABLE ROW COLUMN -->      one cell; ROW: the first cells of the row, with " | " between them
    <!-- study NAME: measured -->                    where and when it was measured, and what is wrong

Each ends with ``<!-- end of study -->``. Words are separated by spaces; those with spaces stand in double quotes.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Collection
from dataclasses import dataclass

from simspec.errors import Problem, SpecError, visible
from simspec.report.page.sheets import Cell, Sheet
from simspec.report.study.markdown import escaped, markdown
from simspec.stored import StoredTableShown, StudyTables

BEGIN = re.compile(r"<!-- study ([\w.-]+): (.*?) -->")
END = "<!-- end of study -->"
MEASURED, SAID = "measured", "said"
OLDER = "**These figures are older than the code: models of this sweep have changed since they were measured.**"
OLDER_CELL = " (older than the code)"
NOT_MEASURED = "Not measured yet."
NOT_SMALL = "Not part of the small study, which these figures are of."
BETWEEN = " | "


@dataclass(frozen=True)
class Mark:
    """A marked place of a page: the study, what is wanted of it, and what stands there. ``line``: of its beginning, from 1."""

    study: str
    words: tuple[str, ...]
    line: int
    content: str

    @property
    def sweep(self) -> str | None:
        """The sweep whose figures stand there; None where it is the study as a whole."""
        return None if self.words == (MEASURED,) else self.words[0]

    @property
    def says_older(self) -> bool:
        """Whether it says that its figures are older than the code."""
        return OLDER in self.content or self.content.endswith(OLDER_CELL)

    @property
    def says_unmeasured(self) -> bool:
        """Whether it says that the study was not measured yet."""
        return self.content.strip() == NOT_MEASURED


def marks(text: str, page: str) -> list[Mark]:
    """The marked places of a page. Raises SpecError, with every problem, for marks that are not understood."""
    found: list[Mark] = []
    problems: list[Problem] = []
    after = 0
    for begin in BEGIN.finditer(text):
        line = text.count("\n", 0, begin.start()) + 1
        end = text.find(END, begin.end())
        following = BEGIN.search(text, begin.end())
        if end < 0 or (following is not None and following.start() < end):
            problems.append(Problem(f"{page}:{line}: a marked place has no end", found=begin.group(), hint=END))
            continue
        try:
            words = tuple(shlex.split(begin.group(2)))
        except ValueError as error:
            problems.append(Problem(f"{page}:{line}: {error}", found=begin.group()))
            continue
        if (words != (MEASURED,) and len(words) not in (2, 3, 4)) or (len(words) == 3 and words[2] != SAID):
            allowed = f"{MEASURED}; SWEEP TABLE; SWEEP TABLE {SAID}; SWEEP TABLE ROW COLUMN"
            problems.append(Problem(f"{page}:{line}: not a place of a study", found=begin.group(), allowed=allowed))
            continue
        found.append(Mark(begin.group(1), words, line, text[begin.end() : end]))
        after = end + len(END)
    if END in text[after:] or (text.count(END) != len(found) and not problems):
        problems.append(Problem(f"{page}: {END} without a beginning"))
    if problems:
        raise SpecError(problems)
    return found


def filled(text: str, page: str, study: Callable[[str], StudyTables | None], older: Collection[tuple[str, str]]) -> str:
    """A page with its marked places made anew. ``study``: its tables by name, None for one that was not measured yet.
    ``older``: studies and sweeps that the page is to say are older than the code.

    Raises SpecError, with every problem, for places that are not understood or that the study does not have.
    """
    problems: list[Problem] = []
    parts: list[str] = []
    position = 0
    places = iter(marks(text, page))
    for begin in BEGIN.finditer(text):
        mark = next(places)
        parts.append(text[position : begin.end()])
        position = text.index(END, begin.end())
        try:
            parts.append(_content(mark, study(mark.study), (mark.study, mark.sweep) in older))
        except SpecError as error:
            problems += [Problem(f"{page}:{mark.line}: {one.message}", allowed=one.allowed) for one in error.problems]
    if problems:
        raise SpecError(problems)
    return "".join([*parts, text[position:]])


def _content(mark: Mark, tables: StudyTables | None, older: bool) -> str:
    if tables is None:
        return NOT_MEASURED if len(mark.words) == 4 else _block(NOT_MEASURED)
    if mark.sweep is None:
        lines = [f"- {escaped(one.what)}: {escaped(one.value)}" for one in tables.measured]
        lines += [f"- {escaped(line)}" for number, line in enumerate(tables.said) if number in tables.bad]
        return _block(
            "\n".join([*lines, f"- sweep by sweep: [study.md](studies/{mark.study}/study.md#how-it-was-done)"])
        )
    inline = len(mark.words) == 4
    if mark.sweep not in tables.sweeps:
        if tables.small:
            return NOT_SMALL if inline else _block(NOT_SMALL)
        raise SpecError([Problem(f"{mark.study} has no sweep {mark.sweep!r}", allowed=", ".join(tables.sweeps))])
    shown = _table(mark, tables)
    if inline:
        return _cell(mark, shown) + (OLDER_CELL if older else "")
    text = "\n".join(f"- {escaped(line)}" for line in shown.said) if mark.words[2:] == (SAID,) else _markdown(shown)
    return _block(f"{OLDER}\n\n{text}" if older else text)


def _block(text: str) -> str:
    return f"\n{text.strip()}\n"


def _table(mark: Mark, tables: StudyTables) -> StoredTableShown:
    own = tables.sweeps[mark.words[0]]
    shown = next((one for one in own if one.name == mark.words[1]), None)
    if shown is None:
        message = f"the sweep {mark.words[0]} of {mark.study} has no table {mark.words[1]!r}"
        raise SpecError([Problem(message, allowed=", ".join(one.name for one in own))])
    return shown


def _markdown(shown: StoredTableShown) -> str:
    return markdown(stored_sheet(shown))


def _cell(mark: Mark, shown: StoredTableShown) -> str:
    """One cell, by the first cells of its row and the head of its column."""
    row_words, column = mark.words[2].split(BETWEEN), mark.words[3]
    heads = [one.text for one in shown.head]
    rows = [row for row in shown.rows if [one.text for one in row[: len(row_words)]] == row_words]
    if heads.count(column) != 1 or len(rows) != 1:
        firsts = "; ".join(row[0].text for row in shown.rows)
        message = f"the table {shown.name} has not one cell for row {mark.words[2]!r}, column {column!r}"
        raise SpecError([Problem(message, allowed=f"rows {firsts}; columns {'; '.join(heads)}")])
    return escaped(rows[0][heads.index(column)].text)


def stored_sheet(stored: StoredTableShown, said: bool = False) -> Sheet:
    """A stored table as a table of a page; ``said``: with its sentences."""
    head = tuple(Cell(visible(one.text, lines=True), one.classes) for one in stored.head)
    rows = tuple(tuple(Cell(visible(one.text, lines=True), one.classes) for one in row) for row in stored.rows)
    sentences = tuple(map(visible, stored.said)) if said else ()
    return Sheet(visible(stored.title), head, rows, visible(stored.note), sentences)
