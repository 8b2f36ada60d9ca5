"""A study as it was: read back from what ``simspec run`` wrote, for reports."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from simspec.comparison.floor import Floor, load_floor
from simspec.comparison.runs import TOLERANCE, Diff, diff
from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError
from simspec.generated import CERTIFICATE_FILE, read_certificate
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import STUDY, read_marker
from simspec.proof.certificate import Certificate
from simspec.report.plain import REPORT_FILE, REPORT_SCHEMA
from simspec.runner.expectations import evaluate
from simspec.runner.run import Run
from simspec.runner.store import is_run, load_run, stored_runs
from simspec.stored import Report, read_as
from simspec.world.canonical import sha256

LARGEST_REPORT = 256 * 2**20
"""Bytes of ``report.json``: a line for each body of each comparison."""


@dataclass(frozen=True)
class StoredStudy:
    """A study that was read back, the folder that it is from, and what there is to say about the folder: runs of other
    worlds, a certificate that is missing or is of another world. ``left_out``: engines that were asked for and did
    not run, each with the reason."""

    study: Study
    folder: Path
    notes: tuple[str, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)


def load_study(folder: Path) -> StoredStudy:
    """The study in ``folder``, or the study of one run whose folder it is.

    Expectations and comparisons are computed again from the stored runs and noise floors, with the tolerance of the stored
    report. Raises SpecError, which names the file, where a part is damaged, edited or of another world, and where there
    is nothing to read.
    """
    if is_run(folder):
        run, floor = load_run(folder), load_floor(folder)
        why = "the certificate of a run is in the folder of its study: report that folder"
        return StoredStudy(study_of({run.engine: run}, _by_engine([floor]), None, TOLERANCE), folder, (why,))
    if not folder.is_dir():
        raise SpecError([Problem(f"{folder}: no such folder", allowed="the folder of a run, or of a study")])
    hashes = stored_runs(folder)
    if not hashes:
        marker = read_marker(folder)
        message = f"{folder} is neither a saved run nor a study"
        if marker is not None and marker.kind == STUDY:
            message = f"{folder} is a study without runs"
        raise SpecError([Problem(message, hint="run it: simspec run SPEC --all-engines")])
    report = _report(folder)
    wanted = report.world_sha256 if report is not None else _only_world(folder, hashes)
    notes = [
        f"{folder / name} is of another world (an earlier spec, or another --set): it is not in this report"
        for name, own in hashes.items()
        if own is not None and own != wanted
    ]
    # a run whose provenance cannot be read is loaded too: that raises the error which names the file
    runs: dict[str, Run] = {}
    for name in (name for name, own in hashes.items() if own in (None, wanted)):
        run = load_run(folder / name)
        if run.engine in runs:
            message = f"{folder} contains two runs in {run.engine} of one world: {folder / name} is the second"
            raise SpecError([Problem(message, hint="report one run: simspec report FOLDER/ENGINE")])
        runs[run.engine] = run
    if not runs:
        message = f"{folder}: no run is of the world in {REPORT_FILE}"
        raise SpecError([Problem(message, hint="run it again: simspec run")])
    floors = _by_engine([load_floor(folder / name) for name, own in hashes.items() if own in (None, wanted)])
    certificate, why_none = _certificate(folder, wanted)
    notes += [why_none] if why_none else []
    left_out = {} if report is None else {name: why for name, why in report.left_out.items() if name not in runs}
    return StoredStudy(study_of(runs, floors, certificate, _tolerance(report)), folder, tuple(notes), left_out)


def study_of(
    runs: Mapping[str, Run], floors: Mapping[str, Floor], certificate: Certificate | None, tolerance: float
) -> Study:
    """A study of runs of one world by engine; expectations and comparisons are computed. ``tolerance``: m."""
    world = next(iter(runs.values())).world
    recorded = [run for run in runs.values() if run.recorded]
    diffs: tuple[Diff, ...] = tuple(
        diff(a, b, tolerance=tolerance, floor=[floors[run.engine] for run in (a, b) if run.engine in floors])
        for a, b in itertools.combinations(recorded, 2)
    )
    noise = {name: floor.position for name, floor in floors.items()}
    outcomes = {name: tuple(evaluate(run, noise.get(name))) for name, run in runs.items()}
    return Study(world, certificate, runs, {}, floors, outcomes, diffs)


def _by_engine(floors: list[Floor | None]) -> dict[str, Floor]:
    return {floor.engine: floor for floor in floors if floor is not None}


def _report(folder: Path) -> Report | None:
    """The stored report; None where the study was ended before it was written."""
    path = folder / REPORT_FILE
    try:
        content = read_bytes(path, LARGEST_REPORT, folder)
    except FileNotFoundError:
        return None
    report = read_as(Report, content, str(path))
    if report.schema_ != REPORT_SCHEMA:
        message = f"{path}: schema {report.schema_}, this simspec reads {REPORT_SCHEMA}"
        raise SpecError([Problem(message, hint="run it again: simspec run")])
    return report


def _only_world(folder: Path, hashes: Mapping[str, str | None]) -> str:
    """The hash of the one world that all readable runs are of. Raises SpecError where there are several, or none."""
    worlds = {own for own in hashes.values() if own is not None}
    if not worlds:
        load_run(folder / next(iter(hashes)))  # raises the error that names the damaged file
    if len(worlds) != 1:
        message = f"{folder} contains runs of {len(worlds)} worlds, and no {REPORT_FILE} that says which is meant"
        raise SpecError([Problem(message, hint="report one run: simspec report FOLDER/ENGINE")])
    return worlds.pop()


def _certificate(folder: Path, wanted: str) -> tuple[Certificate | None, str | None]:
    """The certificate of the study's world; else None and why there is none."""
    certificate = read_certificate(folder)
    if certificate is None:
        return None, f"{folder} has no {CERTIFICATE_FILE}: the models were not compared"
    if certificate.world_sha256 != wanted:
        return None, f"{folder / CERTIFICATE_FILE} is of another world: it is not in this report"
    return certificate, None


def _tolerance(report: Report | None) -> float:
    """The tolerance (m) that the stored comparisons were made with. Raises SpecError where it is no number."""
    if report is None or not report.diffs:
        return TOLERANCE
    tolerance = report.diffs[-1].get("tolerance")
    if not isinstance(tolerance, (int, float)) or isinstance(tolerance, bool) or not tolerance >= 0.0:
        raise SpecError(
            [Problem(f"{REPORT_FILE}: the tolerance of a comparison is not a number", found=repr(tolerance))]
        )
    return float(tolerance)


def world_hash(study: Study) -> str:
    """The hash of the world that a study is of."""
    return sha256(study.world)
