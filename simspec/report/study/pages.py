"""Pages of Markdown with marked places that are filled from published studies.

    <!-- study NAME: SWEEP TABLE -->                 a table
    <!-- study NAME: SWEEP TABLE said -->            what it says, in sentences
    <!-- study NAME: SWEEP TABLE ROW COLUMN -->      one cell; ROW: the first cells of the row, with " | " between them
    <!-- study NAME: measured -->                    where and when it was measured, and what is wrong

Each ends with ``<!-- end of study -->``. Words are separated by spaces; those with spaces stand in double quotes.
"""

from __future__ import annotations

import dataclasses
import re
import shlex
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from simspec.errors import Problem, SpecError, visible
from simspec.experiments.store import Store
from simspec.outputs.files import read_bytes, read_gzip
from simspec.outputs.targets import STUDY, read_marker
from simspec.proof.certificate import Certificate
from simspec.report.page.document import Section, section
from simspec.report.page.packing import PackedNumbers
from simspec.report.studies import StoredStudy, study_of
from simspec.report.study.runs import Done, Record, StudyTable, milliseconds
from simspec.report.study.sentences import charts, verdict
from simspec.report.table import BAD, DIM, GOOD, WARNING, Table, TableCell, escaped, markdown
from simspec.runner.run import Run
from simspec.stored import StoredTableShown, StudyTables, read_as
from simspec.world.canonical import sha256

BEGIN = re.compile(r"<!-- study ([\w.-]+): (.*?) -->")
END = "<!-- end of study -->"
MEASURED, SAID = "measured", "said"
OLDER = "**These figures are older than the code: models of this sweep have changed since they were measured.**"
OLDER_CELL = " (older than the code)"
NOT_MEASURED = "Not measured yet."
NOT_SMALL = "Not part of the small study, which these figures are of."
BETWEEN = " | "
TONES = (GOOD, WARNING, BAD, DIM)


@dataclass(frozen=True)
class PageMark:
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


def marks(text: str, page: str) -> list[PageMark]:
    """The marked places of a page. Raises SpecError, with every problem, for marks that are not understood."""
    found: list[PageMark] = []
    problems: list[Problem] = []
    after = 0
    for begin in BEGIN.finditer(text):
        line = text.count("\n", 0, begin.start()) + 1
        end = text.find(END, begin.end())
        following = BEGIN.search(text, begin.end())
        if end < 0 or (following is not None and following.start() < end):
            problems.append(
                Problem(f"{page}:{line}: a marked place has no end", found=begin.group(), hint=END, code="R110")
            )
            continue
        try:
            words = tuple(shlex.split(begin.group(2)))
        except ValueError as error:
            problems.append(Problem(f"{page}:{line}: {error}", found=begin.group(), code="R110"))
            continue
        if (words != (MEASURED,) and len(words) not in (2, 3, 4)) or (len(words) == 3 and words[2] != SAID):
            allowed = f"{MEASURED}; SWEEP TABLE; SWEEP TABLE {SAID}; SWEEP TABLE ROW COLUMN"
            problems.append(
                Problem(f"{page}:{line}: not a place of a study", found=begin.group(), allowed=allowed, code="R110")
            )
            continue
        found.append(PageMark(begin.group(1), words, line, text[begin.end() : end]))
        after = end + len(END)
    if END in text[after:] or (text.count(END) != len(found) and not problems):
        problems.append(Problem(f"{page}: {END} without a beginning", code="R110"))
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
            problems += [
                Problem(f"{page}:{mark.line}: {problem.message}", allowed=problem.allowed, code=problem.code)
                for problem in error.problems
            ]
    if problems:
        raise SpecError(problems)
    return "".join([*parts, text[position:]])


def _content(mark: PageMark, tables: StudyTables | None, older: bool) -> str:
    if tables is None:
        return NOT_MEASURED if len(mark.words) == 4 else _block(NOT_MEASURED)
    if mark.sweep is None:
        lines = [f"- {escaped(measured.what)}: {escaped(measured.value)}" for measured in tables.measured]
        lines += [f"- {escaped(line)}" for number, line in enumerate(tables.said) if number in tables.bad]
        return _block(
            "\n".join([*lines, f"- sweep by sweep: [study.md](studies/{mark.study}/study.md#how-it-was-done)"])
        )
    inline = len(mark.words) == 4
    if mark.sweep not in tables.sweeps:
        if tables.small:
            return NOT_SMALL if inline else _block(NOT_SMALL)
        raise SpecError(
            [Problem(f"{mark.study} has no sweep {mark.sweep!r}", allowed=", ".join(tables.sweeps), code="R110")]
        )
    shown = _table(mark, tables)
    if inline:
        return _cell(mark, shown) + (OLDER_CELL if older else "")
    text = (
        "\n".join(f"- {escaped(line)}" for line in shown.said)
        if mark.words[2:] == (SAID,)
        else markdown(stored_table(shown))
    )
    return _block(f"{OLDER}\n\n{text}" if older else text)


def _block(text: str) -> str:
    return f"\n{text.strip()}\n"


def _table(mark: PageMark, tables: StudyTables) -> StoredTableShown:
    sweep = tables.sweeps[mark.words[0]]
    shown = next((shown for shown in sweep if shown.name == mark.words[1]), None)
    if shown is None:
        message = f"the sweep {mark.words[0]} of {mark.study} has no table {mark.words[1]!r}"
        raise SpecError([Problem(message, allowed=", ".join(shown.name for shown in sweep), code="R110")])
    return shown


def _cell(mark: PageMark, shown: StoredTableShown) -> str:
    """One cell, by the first cells of its row and the head of its column."""
    row_words, column = mark.words[2].split(BETWEEN), mark.words[3]
    heads = [cell.text for cell in shown.head]
    rows = [row for row in shown.rows if [cell.text for cell in row[: len(row_words)]] == row_words]
    if heads.count(column) != 1 or len(rows) != 1:
        firsts = "; ".join(row[0].text for row in shown.rows)
        message = f"the table {shown.name} has not one cell for row {mark.words[2]!r}, column {column!r}"
        raise SpecError([Problem(message, allowed=f"rows {firsts}; columns {'; '.join(heads)}", code="R110")])
    return escaped(rows[0][heads.index(column)].text)


def stored_table(stored: StoredTableShown, said: bool = False) -> Table:
    """A stored table; ``said``: with its sentences."""
    table = Table(
        visible(stored.title), *(visible(cell.text, lines=True) for cell in stored.head), note=visible(stored.note)
    )
    for column, head in zip(table.columns, stored.head, strict=True):
        column.right = "right" in head.classes.split()
    for row in stored.rows:
        tones = (next((word for word in cell.classes.split() if word in TONES), "") for cell in row)
        table.add(*(TableCell(visible(cell.text, lines=True), tone) for cell, tone in zip(row, tones, strict=True)))
    table.said = tuple(map(visible, stored.said)) if said else ()
    return table


# Playback: of each engine the first run of the plan, where the store has it.

PLAYBACK = "playback"
TOLERANCE = 1e-3
"""m, of the differences that the page names: that of ``simspec run``."""


def playback_tables(done: Done) -> list[StudyTable]:
    """``playback``: which runs are played back on the page of the study."""
    made = StudyTable(done, PLAYBACK, "Runs that are played back", "engine", "timestep", "run", right=(1,))
    chosen: dict[str, None] = {}
    for cell, row in done.runs(whole=True):
        if cell.engine in chosen:
            continue
        chosen[cell.engine] = None
        made.add(cell.engine, milliseconds(row.timestep), f"{row.key[:16]}…")
        certificate = done.outcome.index.certificates.get(cell.key)
        made.records.append(
            {"engine": cell.engine, "timestep": row.timestep, "run": row.key, "certificate": certificate}
        )
    return [made]


def playbacks(tables: StudyTables, store: Store, packed: PackedNumbers) -> list[Section]:
    """The parts of the page that play runs back, with their plots over time, expectations and differences.

    Raises SpecError, which names the file, where a run is damaged; a run that is not in the store is left out, and named.
    """
    made = []
    for sweep, showns in tables.sweeps.items():
        for shown in showns:
            if (
                shown.name == PLAYBACK
                and (part := playback(tables.study, sweep, shown.records, store, packed)) is not None
            ):
                made.append(part)
    return made


def playback(study: str, sweep: str, records: Sequence[Record], store: Store, packed: PackedNumbers) -> Section | None:
    """The runs of some records (``run``, ``engine``, ``certificate``) as a part of a page; None where the store has none."""
    runs: dict[str, Run] = {}
    notes: list[str] = []
    certificates: list[Certificate] = []
    for record in records:
        key, engine, proof = (record.get(name) for name in ("run", "engine", "certificate"))
        if not isinstance(key, str) or not isinstance(engine, str) or not isinstance(proof, str | None):
            raise SpecError([Problem(f"{study}: {sweep} does not name the runs that are played back", code="R110")])
        if not store.has(key):
            notes.append(f"{engine}: the run is not in the store {store.shown}: it is not played back")
            continue
        runs[engine] = store.load(key)
        text = store.certificate_text(proof) if proof else None
        if text is not None:
            certificates.append(Certificate.from_json(text, f"the certificate {proof}"))
    if not runs:
        return None
    world = next(iter(runs.values())).world
    others = [engine for engine, run in runs.items() if _motion(run) != _motion(next(iter(runs.values())))]
    if others:
        notes.append(f"{', '.join(others)}: of another world: not played back")
        runs = {engine: run for engine, run in runs.items() if engine not in others}
    certificate = None
    if certificates:
        engines = {name: proof for certificate in certificates for name, proof in certificate.engines.items()}
        certificate = dataclasses.replace(certificates[0], engines=engines)
    stored = StoredStudy(study_of(runs, {}, certificate, TOLERANCE), Path(), tuple(notes))
    made = section(stored, packed)
    title = f"{sweep}: one run of each engine at {milliseconds(world.physics.timestep)}"
    return dataclasses.replace(made, name=visible(title), details=())


def _motion(run: Run) -> str:
    """The hash of the world of a run without the options of engines: runs with the same hash can be overlaid."""
    return sha256(dataclasses.replace(run.world, name="", expectations=(), engines=()))


# A study as a section of a page, read back from ``study.json``.

TABLES_FILE = "study.json"
PUBLISHED_FILE = "study.json.gz"
"""The same in the folder of a published study, which is committed."""
SCHEMA = 2
LARGEST = 64 * 2**20
"""Bytes of ``study.json``."""


def study_tables(folder: Path) -> StudyTables | None:
    """The tables that ``simspec study`` wrote into a folder; None where it wrote nothing there. Raises SpecError where it is
    damaged."""
    return None if (text := tables_text(folder)) is None else parsed_tables(*text)


def tables_text(folder: Path) -> tuple[Path, bytes] | None:
    """The file of a study's tables in ``folder``, published or not, and its text; None and errors as :func:`study_tables`."""
    marker = read_marker(folder) if folder.is_dir() else None
    if marker is None or marker.kind != STUDY:
        return None
    for name, read in ((TABLES_FILE, read_bytes), (PUBLISHED_FILE, read_gzip)):
        if marker.owns(name):
            path = folder / name
            try:
                return path, read(path, LARGEST, folder)
            except FileNotFoundError:
                raise SpecError(
                    [Problem(f"{path} is missing", hint="simspec study STUDY writes it", code="R110")]
                ) from None
    return None


def parsed_tables(path: Path, content: bytes) -> StudyTables:
    """The tables in the text of a file, which errors name. Raises SpecError where it is damaged or of another schema."""
    tables = read_as(StudyTables, content, str(path))
    if tables.schema_ != SCHEMA:
        hint = "simspec study STUDY writes it anew"
        raise SpecError(
            [Problem(f"{path}: schema {tables.schema_}, this simspec reads {SCHEMA}", hint=hint, code="R104")]
        )
    return tables


def study_section(tables: StudyTables) -> Section:
    """A study as a part of a page: its verdict, its plots, its tables with their sentences, and how it was done. Raises
    SpecError where its figures are damaged."""
    notes = ["The small study: fewer timesteps, seeds and repetitions." if tables.small else ""]
    notes.append(f"Figures from elsewhere: {tables.figures}" if tables.figures else "")
    return Section(
        name=visible(tables.study),
        description=visible(tables.description),
        verdict=tuple(verdict(tables)),
        notes=tuple(visible(note) for note in notes if note),
        certificate=(),
        certificate_notes=(),
        results=tuple(stored_table(shown, said=True) for sweep in tables.sweeps.values() for shown in sweep),
        details=(),
        provenance=_provenance(tables),
        scene=None,
        caption="",
        charts=tuple(charts(tables)),
    )


def study_parts(tables: StudyTables, store: Store | None) -> Callable[[PackedNumbers], list[Section]]:
    """A function that makes the parts of a study's page: the study, then the runs that are played back where ``store`` has
    them."""

    def parts(packed: PackedNumbers) -> list[Section]:
        return [study_section(tables), *(playbacks(tables, store, packed) if store is not None else ())]

    return parts


def _provenance(tables: StudyTables) -> Table:
    rows = [(measured.what, measured.value) for measured in tables.measured] + [
        ("how it was done", line) for line in tables.said
    ]
    return Table("Provenance", "", "", rows=rows, note="Each run is in the study's store, with where it came from.")
