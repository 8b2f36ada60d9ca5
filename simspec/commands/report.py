"""``simspec report``: one HTML file about stored studies and runs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.experiments.store import Store
from simspec.outputs.marker import RUN, STUDY
from simspec.outputs.targets import demand, file_problem
from simspec.outputs.writing import change_file, write_file
from simspec.report.page.document import Part, is_page, page
from simspec.report.plain import PAGE_FILE, text
from simspec.report.screen import say
from simspec.report.stored_study import load_study
from simspec.report.study.page_section import study_parts, study_tables
from simspec.runner.store import is_run

SWEEP_FOLDER = "sweep"
"""Where ``simspec study`` has its store, in the folder of its results."""


def report(folders: Sequence[Path], out: Path | None, as_json: bool) -> int:
    """Write the page of the studies and runs in ``folders``, to ``out`` or into the one folder there is."""
    path = write_page(folders, out)
    if as_json:
        sys.stdout.write(text({"file": path, "folders": list(folders), "bytes": path.stat().st_size}))
    else:
        say(f"written: {path}")
    return EXIT_OK


def write_page(folders: Sequence[Path], out: Path | None) -> Path:
    """Write the page of some studies and runs where it belongs; where it was. A page that is as it should be is left alone.

    Raises SpecError when one of them is damaged, or the target may not be written.
    """
    if out is None and len(folders) != 1:
        message = "a report of several folders needs a file of its own"
        raise SpecError([Problem(message, hint="use -o FILE")])
    if out is not None:
        demand([file_problem(out, is_page)])
    studies: list[Part] = []
    for folder in folders:
        tables = study_tables(folder)
        studies.append(load_study(folder) if tables is None else study_parts(tables, _store(folder)))
    content = page(studies).encode()
    if out is not None:
        return write_file(out, content, is_page)
    (folder,) = folders
    kind = RUN if is_run(folder) else STUDY
    change_file(folder, kind, PAGE_FILE, lambda before: None if before == content else content)
    return folder / PAGE_FILE


def _store(folder: Path) -> Store | None:
    """The store of a study's runs, where it is in its folder."""
    place = folder / SWEEP_FOLDER
    return Store.open(place) if place.is_dir() else None
