"""The tables of ``simspec study`` as parts of a page: read back from ``study.json``."""

from __future__ import annotations

from pathlib import Path

from simspec.errors import Problem, SpecError, visible
from simspec.outputs.marker import STUDY, read_marker
from simspec.outputs.reading import read_bytes
from simspec.report.page.section import Section
from simspec.report.page.sheets import Sheet
from simspec.report.page.words import BAD, GOOD, Sentence
from simspec.report.study.pages import stored_sheet
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
    """A study as a part of a page: how it was done, then its tables. There is no playback: its runs are in a store."""
    said = tuple(
        Sentence(BAD if number in tables.bad else GOOD, visible(line)) for number, line in enumerate(tables.said)
    )
    notes = [tables.description, "The small study." if tables.small else ""]
    notes.append(f"Figures from elsewhere: {tables.figures}" if tables.figures else "")
    return Section(
        name=visible(tables.study),
        verdict=said,
        notes=tuple(visible(note) for note in notes if note),
        certificate=(),
        certificate_notes=(),
        results=tuple(stored_sheet(one) for own in tables.sweeps.values() for one in own),
        details=(),
        provenance=Sheet(
            "Provenance", (), (), "Each run is in the study's store, with where it came from: simspec study"
        ),
        scene=None,
        caption="",
    )
