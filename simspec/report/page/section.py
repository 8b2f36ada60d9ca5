"""One study as a part of a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from simspec.errors import visible
from simspec.report import differences, terminal
from simspec.report.final import final_table, shown_of
from simspec.report.kit import table
from simspec.report.page.curves import charts
from simspec.report.page.frames import FARTHEST, Frames, choose_frames
from simspec.report.page.packing import Packed
from simspec.report.page.playback import is_drawn, scene_data
from simspec.report.page.sheets import Sheet, sheet, sheets
from simspec.report.page.words import Sentence, verdict
from simspec.report.stored_study import StoredStudy, world_hash
from simspec.runner.run import Run

FACTS = ("engine_version", "simspec", "python_version", "numpy_version", "platform", "artifacts_sha256", "started")
"""What a run says of itself that is shown, each under its own name."""


@dataclass(frozen=True)
class Section:
    """One study on a page: ``scene`` is what its playback and plots are drawn from, None where no run recorded anything;
    ``charts``: plots of a study's figures (``page/src/data.ts``); ``description``: what it shows, in a sentence, or nothing.
    A page is named after the parts where it is not None, else after all."""

    name: str
    verdict: tuple[Sentence, ...]
    notes: tuple[str, ...]
    certificate: tuple[Sheet, ...]
    certificate_notes: tuple[str, ...]
    results: tuple[Sheet, ...]
    details: tuple[Sheet, ...]
    provenance: Sheet
    scene: dict[str, Any] | None
    caption: str
    charts: tuple[dict[str, Any], ...] = ()
    description: str | None = None


def section(stored: StoredStudy, packed: Packed) -> Section:
    """A study as a part of a page; its numbers go into ``packed``."""
    study = stored.study
    shown = [run for run in study.runs.values() if run.recorded]
    scene, caption = None, ""
    if shown:
        frames = choose_frames(study.world, shown)
        scene = scene_data(study.world, shown, frames, packed)
        scene["plots"] = [chart.data(packed) for chart in charts(study, shown, frames)]
        caption = _caption(frames, shown, scene)
    certificate = study.certificate
    return Section(
        name=visible(study.world.name),
        verdict=tuple(verdict(study)),
        notes=tuple(
            map(visible, dict.fromkeys([*stored.notes, *(note for diff in study.diffs for note in diff.notes)]))
        ),
        certificate=sheets(terminal.certificate_tables(certificate)) if certificate is not None else (),
        certificate_notes=tuple(map(visible, terminal.certificate_notes(certificate)))
        if certificate is not None
        else (),
        results=sheets(
            [
                terminal.not_run_table(stored.left_out),
                terminal.results(study.runs),
                terminal.expectations(study.outcomes),
                differences.repeatability(study.floors),
                differences.differences(study.diffs),
                final_table(study.runs, shown_of(next(iter(study.runs.values())))),
            ]
        ),
        details=tuple(sheet(part) for diff in study.diffs for part in differences.diff_tables(diff)),
        provenance=_provenance(stored),
        scene=scene,
        caption=caption,
    )


def _caption(frames: Frames, runs: list[Run], scene: dict[str, Any]) -> str:
    """How what is drawn differs from what was computed."""
    parts = [
        f"Drawn positions are rounded to {1e3 * frames.step:.2g} mm; every figure and plot is computed from the runs."
    ]
    if len(runs) > 1:
        parts.append("Overlaid, what is at the same place has one mixed, greyish colour.")
    if frames.every > 1:
        parts.append(f"Plots and playback show every {frames.every}th record.")
    if not all(is_drawn(shape) for body in runs[0].world.bodies for shape in body.shapes):
        parts.append(f"Shapes of more than {FARTHEST:g} m are not drawn.")
    if frames.beyond:
        parts.append("Bodies that leave the scene are drawn at its edge.")
    forces = [(run["forces"], run["engine"]) for run in scene["runs"] if run["forces"] is not None]
    if forces:
        largest = max(own["largest"] for own, _ in forces)
        seldom = max(own["every"] for own, _ in forces)
        when = "" if seldom == 1 else f", drawn for every {seldom}th frame or more"
        parts.append(f"Bars are contact forces, as long as their square roots (longest: {largest:.3g} N){when}.")
    if scene["ghost"] is not None:
        parts.append("The grey ghost is where the targets of the driven joints would have their bodies.")
    for run, count in zip(runs, frames.shown, strict=True):
        if count < len(frames.rows):
            parts.append(f"{run.engine} stays where its records end, at {run.time[frames.rows[count - 1]]:.4g} s.")
    return visible(" ".join(parts))


def _provenance(stored: StoredStudy) -> Sheet:
    """Where the runs came from: what it takes to do them again."""
    study = stored.study
    rows = table("Provenance", "", *study.runs)
    for fact in FACTS:
        values = [run.provenance.get(fact) for run in study.runs.values()]
        if any(value is not None for value in values):
            rows.add_row(fact.replace("_", " "), *("–" if value is None else str(value) for value in values))
    settings = [run.provenance.get("settings") or {} for run in study.runs.values()]
    rows.add_row("settings", *("\n".join(f"{name}: {value}" for name, value in own.items()) or "–" for own in settings))
    rows.add_row("steps", *(str(run.provenance.get("steps", "–")) for run in study.runs.values()))
    rows.add_row("timestep", *(f"{run.world.physics.timestep:g} s" for run in study.runs.values()))
    rows.add_row("world sha256", *(world_hash(study) for _ in study.runs))
    return sheet(rows)
