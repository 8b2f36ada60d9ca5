"""Output of simspec run and simspec diff: tables of one study on a terminal."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simspec.comparison.floor import Floor, load_floor
from simspec.comparison.runs import QUANTITIES, TOLERANCE, Diff, summary
from simspec.comparison.runs import diff as compare_runs
from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError, code_of_failure
from simspec.generated import CERTIFICATE_FILE, read_certificate
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import STUDY, read_marker
from simspec.proof.certificate import Certificate
from simspec.report.certificate import show_certificate
from simspec.report.console import Screen
from simspec.report.differences import differences, repeatability
from simspec.report.screen import REPORT_FILE, REPORT_SCHEMA, console
from simspec.report.table import BAD, Table, TableCell, length, number, passed_cell, shortened
from simspec.runner.expectations import Outcome, evaluate
from simspec.runner.run import Run
from simspec.runner.store import is_run, load_run, stored_runs
from simspec.runner.unphysical import together
from simspec.stored import Report, read_as
from simspec.world.frames import to_rpy
from simspec.world.kinematics import display_name, rigid_groups
from simspec.world.types import World

# Final state: last recorded poses and joint positions, engines side by side.

MOST_ROWS = 16
"""Rows of bodies, and as many of joints, that the terminal shows; the files have all."""


def shown_bodies(world: World, show: Sequence[str]) -> list[str]:
    """The bodies of `record.show`; where it names none, the roots that can move."""
    names = {body.name for body in world.bodies}
    chosen = [name for name in show if name in names]
    if chosen or show:
        return chosen
    groups = rigid_groups(world)
    # of a root with several joints the body itself, not what stands between them
    tops = [body for body in world.bodies if body.joint.parent is None and groups[body.name] != "world"]
    return [display_name(body.name, names) for body in tops]


def shown_joints(world: World, show: Sequence[str]) -> list[str]:
    """The hinges and slides of `record.show`; where it names none, all of them."""
    movable = [body.joint.name for body in world.bodies if body.joint.kind in SCALAR_JOINTS]
    return [name for name in show if name in movable] if show else movable


def shown_of(run: Run) -> tuple[str, ...]:
    """What `record.show` named when the run was made; nothing where it named nothing, or where that was not kept."""
    spec = run.provenance.get("spec")
    names = spec.get("show") if isinstance(spec, Mapping) else None
    return tuple(name for name in names if isinstance(name, str)) if isinstance(names, list) else ()


def ends(run: Run, show: Sequence[str]) -> dict[str, Any]:
    """The last record of a run: time (s), bodies (xyz, quat) and joints (rad, m) by name; empty where nothing was recorded."""
    if not run.recorded:
        return {}
    poses = run.arrays["pose"][-1]
    return {
        "time": float(run.time[-1]),
        "bodies": {
            name: {"xyz": poses[run.index[name], :3].tolist(), "quat": poses[run.index[name], 3:].tolist()}
            for name in shown_bodies(run.world, show)
        },
        "joints": {name: float(run.q(name)[-1]) for name in shown_joints(run.world, show)},
    }


def final_table(runs: Mapping[str, Run], show: Sequence[str]) -> Table | None:
    """One row per body and joint, one column per run that recorded anything; None where there is nothing to show."""
    shown = [run for run in runs.values() if run.recorded]
    if not shown:
        return None
    world = shown[0].world
    bodies, joints = shown_bodies(world, show), shown_joints(world, show)
    if not bodies and not joints:
        return None
    times = {f"{run.time[-1]:.4g} s" for run in shown}
    when = times.pop() if len(times) == 1 else "the last record"
    title = f"Final state at {when}  (x y z in m, roll pitch yaw; joints in rad or m)"
    ends_by_engine = Table(title, "", *(run.label for run in shown))
    for name in bodies[:MOST_ROWS]:
        ends_by_engine.add(name, *(_pose(run.arrays["pose"][-1, run.index[name]].tolist()) for run in shown))
    units = {body.joint.name: "rad" if body.joint.kind == "hinge" else "m" for body in world.bodies}
    for name in joints[:MOST_ROWS]:
        ends_by_engine.add(name, *(f"{_number(float(run.q(name)[-1]))} {units[name]}" for run in shown))
    counts = {"bodies": len(bodies) - MOST_ROWS, "joints": len(joints) - MOST_ROWS}
    if more := " and ".join(f"{count} more {noun}" for noun, count in counts.items() if count > 0):
        ends_by_engine.note = f"and {more}: select with record.show; all are in bodies.parquet and states.parquet"
    return ends_by_engine


def _pose(pose: Sequence[float]) -> str:
    if not all(map(math.isfinite, pose)):
        return "not finite"
    place = " ".join(_number(value) for value in pose[:3])
    angles = to_rpy((pose[3], pose[4], pose[5], pose[6]))
    turn = " ".join(f"{math.degrees(angle):.1f}".replace("-0.0", "0.0") for angle in angles)
    return f"{place}\n{turn}°"  # two lines: three engines side by side fit 80 columns


def _number(value: float) -> str:
    """Four decimals: a tenth of a millimetre."""
    return f"{value:.4f}".replace("-0.0000", "0.0000")


# Results and expectations.


def results(runs: Mapping[str, Run]) -> Table:
    """The results: one column per run, one row per quantity."""
    shown = list(runs.values())
    quantities = Table("Results", "", *(run.label for run in shown), right=range(1, len(shown) + 1))
    values = [summary(run) for run in shown]
    for name, unit in QUANTITIES:
        cells = [values_of_run.get(name) for values_of_run in values]
        if any(cell is not None for cell in cells):
            quantities.add(name, *(length(cell) if unit == "m" else number(cell, unit) for cell in cells))
    quantities.add("real-time factor of the steps", *(number(run.real_time_factor) for run in shown))
    quantities.add("real-time factor end to end", *(number(run.end_to_end_factor) for run in shown))
    if any("control" in run.provenance for run in shown):
        quantities.add("control, µs per step", *(number(_per_step(run, "control")) for run in shown))
    failures = [run.failed for run in shown]
    if any(failures):
        quantities.add("failed", *(TableCell(shortened(why), BAD) if why else "" for why in failures))
    return quantities


def _per_step(run: Run, part: str) -> float | None:
    """Microseconds that a part of a run took for each step."""
    seconds, steps = run.provenance.get("seconds", {}).get(part), run.provenance.get("steps")
    return 1e6 * seconds / steps if seconds is not None and steps else None


def expectations(outcomes: Mapping[str, Sequence[Outcome]]) -> Table | None:
    """The expectations: one row per expectation and engine. None when the spec has none."""
    if not any(outcomes.values()):
        return None
    rows = Table("Expectations", "expectation", "engine", "", "measured", "bound", "", right=(3, 4))
    for index in range(max(len(run_outcomes) for run_outcomes in outcomes.values())):
        for engine, row in outcomes.items():
            outcome = row[index]
            figures = (number(value, outcome.unit) for value in (outcome.measured, outcome.bound))
            rows.add(outcome.kind, engine, passed_cell(outcome.passed), *figures, shortened(outcome.detail, 80))
    return rows


def show_study(study: Study, screen: Screen, show: Sequence[str] = ()) -> None:
    """All tables of one study, in the order of the questions."""
    for line in together({name: run.unphysical for name, run in study.runs.items() if run.recorded}):
        screen.note(f"not physical: {line}", "bold yellow")
    if study.certificate is not None:
        show_certificate(study.certificate, screen)
    for shown in (
        results(study.runs),
        final_table(study.runs, show),
        expectations(study.outcomes),
        repeatability(study.floors),
        differences(study.diffs),
    ):
        if shown is not None:
            screen.print(shown)
    hints = [outcome.hint for outcomes in study.outcomes.values() for outcome in outcomes if outcome.hint]
    for hint in dict.fromkeys(hints):
        screen.note(hint)
    for note in dict.fromkeys(note for diff in study.diffs for note in diff.notes):
        screen.note(f"note: {note}")


# Output of ``simspec run`` and ``simspec diff``.


def show_run(study: Study, folder: Path, show: Sequence[str]) -> None:
    """Print every table of a study that was written to ``folder``."""
    screen = console()
    show_study(study, screen, show)
    screen.print(f"written: {folder}", soft_wrap=True)


def show_failures(study: Study) -> None:
    """Print on standard error, in full, why engines failed."""
    for name, run in study.runs.items():
        if run.failed is not None:
            code = code_of_failure(run.failed)
            console(error=True).message(f"error[{code}]: {name} failed: {run.failed}", style="bold red")


# Studies read back from their folders.

LARGEST_REPORT = 256 * 2**20
"""Bytes of ``report.json``: a line for each body of each comparison."""


@dataclass(frozen=True)
class StoredStudy:
    """A study that was read back, the folder that it is from, and what there is to say about the folder: runs of other
    worlds, a certificate that is missing or is of another world. ``left_out``: requested engines that did
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
        raise SpecError(
            [Problem(f"{folder}: no such folder", allowed="the folder of a run, or of a study", code="R103")]
        )
    hashes = stored_runs(folder)
    if not hashes:
        marker = read_marker(folder)
        message = f"{folder} is neither a saved run nor a study"
        if marker is not None and marker.kind == STUDY:
            message = f"{folder} is a study without runs"
        raise SpecError([Problem(message, hint="run it: simspec run SPEC --all-engines", code="R103")])
    report = _report(folder)
    wanted = report.world_sha256 if report is not None else _only_world(folder, hashes)
    notes = [
        f"{folder / name} is of another world (an earlier spec, or another --set): it is not in this report"
        for name, digest in hashes.items()
        if digest is not None and digest != wanted
    ]
    # a run whose provenance cannot be read is loaded too: that raises the error which names the file
    runs: dict[str, Run] = {}
    for name in (name for name, digest in hashes.items() if digest in (None, wanted)):
        run = load_run(folder / name)
        if run.engine in runs:
            message = f"{folder} contains two runs in {run.engine} of one world: {folder / name} is the second"
            raise SpecError([Problem(message, hint="report one run: simspec report FOLDER/ENGINE", code="R108")])
        runs[run.engine] = run
    if not runs:
        message = f"{folder}: no run is of the world in {REPORT_FILE}"
        raise SpecError([Problem(message, hint="run it again: simspec run", code="R101")])
    floors = _by_engine([load_floor(folder / name) for name, digest in hashes.items() if digest in (None, wanted)])
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
        compare_runs(a, b, tolerance=tolerance, floor=[floors[run.engine] for run in (a, b) if run.engine in floors])
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
        raise SpecError([Problem(message, hint="run it again: simspec run", code="R101")])
    return report


def _only_world(folder: Path, hashes: Mapping[str, str | None]) -> str:
    """The hash of the one world that all readable runs are of. Raises SpecError where there are several, or none."""
    worlds = {digest for digest in hashes.values() if digest is not None}
    if not worlds:
        load_run(folder / next(iter(hashes)))  # raises the error that names the damaged file
    if len(worlds) != 1:
        message = f"{folder} contains runs of {len(worlds)} worlds, and no {REPORT_FILE} that says which is meant"
        raise SpecError([Problem(message, hint="report one run: simspec report FOLDER/ENGINE", code="R108")])
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
    """The tolerance (m) that the stored comparisons were made with. Raises SpecError where it is not a number."""
    if report is None or not report.diffs:
        return TOLERANCE
    tolerance = report.diffs[-1].get("tolerance")
    if not isinstance(tolerance, (int, float)) or isinstance(tolerance, bool) or not tolerance >= 0.0:
        message = f"{REPORT_FILE}: the tolerance of a comparison is not a number"
        raise SpecError([Problem(message, found=repr(tolerance), code="R108")])
    return float(tolerance)
