"""The tables of ``simspec study`` as parts of a page: read back from ``study.json``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from simspec.errors import Problem, SpecError, visible
from simspec.experiments.store import Store
from simspec.outputs.marker import STUDY, read_marker
from simspec.outputs.reading import read_bytes
from simspec.report.page.packing import Packed
from simspec.report.page.section import Section
from simspec.report.page.sheets import Cell, Sheet
from simspec.report.study.charts import charts
from simspec.report.study.pages import stored_sheet
from simspec.report.study.playback import playbacks
from simspec.report.study.verdict import verdict
from simspec.stored import StudyTables, read_as

TABLES_FILE = "study.json"
SCHEMA = 2
LARGEST = 64 * 2**20
"""Bytes of ``study.json``."""


def study_tables(folder: Path) -> StudyTables | None:
    """What ``simspec study`` wrote into a folder; None where it wrote nothing there. Raises SpecError where it is damaged."""
    path = folder / TABLES_FILE
    marker = read_marker(folder) if folder.is_dir() else None
    if marker is None or marker.kind != STUDY or not marker.owns(TABLES_FILE):
        return None
    try:
        content = read_bytes(path, LARGEST, folder)
    except FileNotFoundError:
        raise SpecError([Problem(f"{path} is missing", hint="simspec study STUDY writes it")]) from None
    tables = read_as(StudyTables, content, str(path))
    if tables.schema_ != SCHEMA:
        hint = "simspec study STUDY writes it anew"
        raise SpecError([Problem(f"{path}: schema {tables.schema_}, this simspec reads {SCHEMA}", hint=hint)])
    return tables


def study_section(tables: StudyTables) -> Section:
    """A study as a part of a page: what matters of it, its plots, its tables with what they say, and how it was done. Raises
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
        results=tuple(stored_sheet(one, said=True) for own in tables.sweeps.values() for one in own),
        details=(),
        provenance=_provenance(tables),
        scene=None,
        caption="",
        charts=tuple(charts(tables)),
    )


def study_parts(tables: StudyTables, store: Store | None) -> Callable[[Packed], list[Section]]:
    """What makes the parts of a study's page: the study, then the runs that are played back where ``store`` has them."""

    def parts(packed: Packed) -> list[Section]:
        return [study_section(tables), *(playbacks(tables, store, packed) if store is not None else ())]

    return parts


def _provenance(tables: StudyTables) -> Sheet:
    rows = [(one.what, one.value) for one in tables.measured] + [("how it was done", line) for line in tables.said]
    cells = tuple((Cell(visible(what)), Cell(visible(value), "wrap")) for what, value in rows)
    note = "Each run is in the study's store, with where it came from."
    return Sheet("Provenance", (Cell(""), Cell("")), cells, note)
