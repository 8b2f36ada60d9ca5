"""``simspec pages``: fill pages of Markdown from published studies, or see whether they are current."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from simspec.commands.experiment_options import PagesOptions
from simspec.commands.options import print_json
from simspec.commands.study import absent_engines, find_study, plan_of
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.experiments.after_sweep import older_sweeps, read_models, sweep_models
from simspec.language.load import load_study_file
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import LARGEST_MARKER
from simspec.outputs.writing import write_file
from simspec.project import Interpreters
from simspec.report.screen import say
from simspec.report.study.pages import PUBLISHED_FILE, PageMark, filled, marks, parsed_tables, tables_text
from simspec.stored import StudyTables

STUDIES = "studies"
"""The folder of published studies, next to a page."""


def pages(options: PagesOptions) -> int:
    """Fill the pages, or see whether they are current, and whether their figures are of the models of today."""
    check, older = options.check, options.older
    texts = {path: _text(path) for path in options.pages}
    found = {path: marks(text, str(path)) for path, text in texts.items()}
    folders = {path.parent / STUDIES / mark.study for path, local in found.items() for mark in local}
    absent = _absent(found, older)
    kept = {folder: None if folder in absent else _published(folder) for folder in sorted(folders)}
    pythons = options.interpreters(starts=False)
    why = {folder: {} if folder in absent else _older(options, folder, pythons) for folder in kept}
    problems: list[str] = []
    written: list[Path] = []
    for path, text in texts.items():
        alongside = path.parent / STUDIES
        stale = {(mark.study, mark.sweep or "") for mark in found[path] if mark.sweep in why[alongside / mark.study]}
        said = {(mark.study, mark.sweep or "") for mark in found[path] if mark.says_older}
        given = stale if older else stale & said
        for study, sweep in sorted(stale - given):
            problems.append(
                f"{path}: figures of {study}, sweep {sweep}, are older than the code: {why[alongside / study][sweep]}"
            )
        wanted = filled(text, str(path), _tables_in(alongside, kept), given)
        if wanted != text and check:
            problems.append(f"{path} is not what the study's results give; simspec pages {path} writes it")
        elif wanted != text:
            write_file(path, wanted, text.encode().__eq__)
            written.append(path)
    if options.as_json:
        plain = {folder.as_posix(): local for folder, local in why.items()}
        print_json({"pages": list(texts), "written": written, "problems": problems, "older": plain})
        return EXIT_FAILED if problems else EXIT_OK
    for line in problems:
        say(line, error=True)
    if any("older than the code" in line for line in problems):
        say(
            "simspec study STUDY --publish DIR measures them anew; simspec pages --older makes the pages say so",
            error=True,
        )
    for path in () if check else texts:
        say(f"{path}: {'written' if path in written else 'already current'}")
    return EXIT_FAILED if problems else EXIT_OK


def _tables_in(path: Path, kept: dict[Path, StudyTables | None]) -> Callable[[str], StudyTables | None]:
    return lambda study: kept[path / study]


def _absent(found: Mapping[Path, Sequence[PageMark]], older: bool) -> set[Path]:
    """The folders of studies that are not there, where all pages that name them say so, or are to say so."""
    said: dict[Path, bool] = {}
    for path, local in found.items():
        for mark in local:
            folder = path.parent / STUDIES / mark.study
            if not folder.exists():
                said[folder] = said.get(folder, True) and (older or mark.says_unmeasured)
    return {folder for folder, all_say_so in said.items() if all_say_so}


def _text(path: Path) -> str:
    try:
        return read_bytes(path, LARGEST_MARKER).decode("utf-8")
    except (FileNotFoundError, NotADirectoryError):
        raise SpecError([Problem(f"{path}: no such page", code="C104")]) from None
    except UnicodeDecodeError:
        raise SpecError([Problem(f"{path} is not text in UTF-8", code="C116")]) from None


def _published(folder: Path) -> StudyTables:
    """The tables of a published study. Raises SpecError where there are none, or not those of its models."""
    models = read_models(folder)
    stored = tables_text(folder)
    if stored is None or hashlib.sha256(stored[1]).hexdigest() != models.study_sha256:
        message = f"{folder / PUBLISHED_FILE}: was edited or is damaged: it is not the one that was published"
        raise SpecError(
            [Problem(message, hint=f"simspec study {models.source} --publish {folder} writes it anew", code="R104")]
        )
    return parsed_tables(*stored)


def _older(options: PagesOptions, folder: Path, pythons: Interpreters) -> dict[str, str]:
    """By sweep, why the figures of a published study are older than the code."""
    kept = read_models(folder)
    source = load_study_file(
        find_study(kept.source), allow_outside=options.allow_outside, options=options.robot_files.options()
    )
    sweeps = source.sweeps(kept.small)
    measured = {model.engine: model.version for sweep in kept.sweeps.values() for model in sweep.models}
    absent = dict.fromkeys(absent_engines(sweeps, pythons), "not installed")
    absent |= {label: why for label, why in pythons.not_queried.items() if label in measured}
    for label, reason in absent.items():
        say(f"{folder}: {label}: {reason}: its version is taken to be that of the figures", error=True)
    assumed = {label: {"engine_version": measured.get(label, "")} for label in absent}
    now = {sweep.name: sweep_models(source, sweep, plan_of(sweep, pythons, assumed=assumed)) for sweep in sweeps}
    return older_sweeps(kept, now)
