"""Runs of a study that are played back on its page: of each engine the first of the plan, where the store has it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from simspec.errors import Problem, SpecError, visible
from simspec.experiments.store import Store
from simspec.proof.certificate import Certificate
from simspec.report.kit import table
from simspec.report.page.packing import Packed
from simspec.report.page.section import Section, section
from simspec.report.stored_study import StoredStudy, study_of
from simspec.report.study.done import Done, Record, Shown, milliseconds
from simspec.runner.run import Run
from simspec.stored import StudyTables
from simspec.world.canonical import sha256

PLAYBACK = "playback"
TOLERANCE = 1e-3
"""m, of the differences that the page names: that of ``simspec run``."""


def playback_tables(done: Done) -> list[Shown]:
    """``playback``: which runs are played back on the page of the study."""
    made = table(f"{done.sweep.name}: Runs that are played back", "engine", "timestep", "run", right=(1,))
    records: list[Record] = []
    chosen: dict[str, None] = {}
    for cell, row in done.runs(whole=True):
        if cell.engine in chosen:
            continue
        chosen[cell.engine] = None
        made.add_row(cell.engine, milliseconds(row.timestep), f"{row.key[:16]}…")
        certificate = done.outcome.index.certificates.get(cell.key)
        records.append({"engine": cell.engine, "timestep": row.timestep, "run": row.key, "certificate": certificate})
    return [Shown(PLAYBACK, made, records)]


def playbacks(tables: StudyTables, store: Store, packed: Packed) -> list[Section]:
    """The parts of the page that play runs back, with their plots over time, expectations and differences.

    Raises SpecError, which names the file, where a run is damaged; a run that is not in the store is left out, and named.
    """
    made = []
    for sweep, own in tables.sweeps.items():
        for shown in own:
            if (
                shown.name == PLAYBACK
                and (part := _part(tables.study, sweep, shown.records, store, packed)) is not None
            ):
                made.append(part)
    return made


def _part(study: str, sweep: str, records: Sequence[Record], store: Store, packed: Packed) -> Section | None:
    runs: dict[str, Run] = {}
    notes: list[str] = []
    certificates: list[Certificate] = []
    for record in records:
        key, engine, proof = (record.get(name) for name in ("run", "engine", "certificate"))
        if not isinstance(key, str) or not isinstance(engine, str) or not isinstance(proof, str | None):
            raise SpecError([Problem(f"{study}: {sweep} does not name the runs that are played back")])
        if not store.has(key):
            notes.append(f"{engine}: the run is not in the store {store.told}: it is not played back")
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
        engines = {name: proof for one in certificates for name, proof in one.engines.items()}
        certificate = dataclasses.replace(certificates[0], engines=engines)
    stored = StoredStudy(study_of(runs, {}, certificate, TOLERANCE), Path(), tuple(notes))
    made = section(stored, packed)
    title = f"{sweep}: one run of each engine at {milliseconds(world.physics.timestep)}"
    return dataclasses.replace(made, name=visible(title), details=())


def _motion(run: Run) -> str:
    """What runs have in common that can be overlaid: their world without what an engine is told."""
    return sha256(dataclasses.replace(run.world, name="", expectations=(), engines=()))
