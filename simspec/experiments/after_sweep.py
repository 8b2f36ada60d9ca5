"""Work on a sweep whose runs are done: a second pass, and the models of a published study.

The second pass has runs moved by the size of the engines' first gap. The growth of a difference in a scene depends on its
size, so that repeats moved in the last bits do not show it. The size is rounded to a power of ten, and follows from stored
runs alone: the same store gives the same second pass.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simspec.analysis.horizons import first_gap, perturbation_of
from simspec.comparison.floor import Floor, measure_floor
from simspec.errors import Problem, SpecError
from simspec.experiments.cases import case_of
from simspec.experiments.certify import changed, models_of, plain_model, read_model
from simspec.experiments.index import RunRow
from simspec.experiments.plan import Cell, Plan, digest
from simspec.experiments.store import Store
from simspec.experiments.sweep import SweepOutcome, stored_key
from simspec.language.load import StudySource, SweepOfStudy
from simspec.language.sweep import Perturb
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import STUDY, read_marker
from simspec.runner.run import Run
from simspec.stored import StudyModels, read_as

ROUND_OFF = 1e-12
"""Relative changes of the initial state up to which a run shows noise; moved by more, it is another run."""
SMALLEST, LARGEST = ROUND_OFF, 0.1
"""Relative changes of the initial state between which a second pass is run: below, it is round-off; above, another scene."""

Overrides = tuple[tuple[str, object], ...]


@dataclass(frozen=True)
class SecondPass:
    """Runs of one world (``overrides`` of the sweep), all engines, moved by ``amount``, that are to be run."""

    overrides: Overrides
    amount: float
    plan: Plan


def unmoved(outcome: SweepOutcome) -> dict[Overrides, dict[str, tuple[Cell, RunRow]]]:
    """The whole runs whose initial state is not moved, by what the sweep puts in and by engine; without its named cases."""
    worlds: dict[Overrides, dict[str, tuple[Cell, RunRow]]] = {}
    for cell, row in outcome.rows():
        if row is not None and row.failed is None and cell.case is None and cell.seed is None and cell.repeat == 0:
            worlds.setdefault(cell.overrides, {})[cell.engine] = (cell, row)
    return worlds


Repeats = Iterable[tuple[Cell, RunRow]]


def floors_of(pair: Sequence[Run], overrides: Overrides, repeats: Repeats, store: Store) -> list[Floor]:
    """The floors of two runs of the world that ``overrides`` make, from those of ``repeats`` that are of it and of their
    engines;
    none where either has none."""
    given = [(cell, row) for cell, row in repeats if cell.overrides == overrides and cell.case is None]
    floors = []
    for run in pair:
        local = [store.load(row.key) for cell, row in given if cell.engine == run.engine]
        floor = measure_floor(run, local)
        if floor is not None:
            floors.append(floor)
    return floors if len(floors) == len(pair) else []


def moved_by_round_off(outcome: SweepOutcome) -> list[tuple[Cell, RunRow]]:
    """The runs of a sweep that show noise, with an initial state moved in the last bits."""
    return [
        (cell, row)
        for cell, row in outcome.rows()
        if row is not None and cell.seed is not None and cell.perturb <= ROUND_OFF and cell.repeat == 0
    ]


def amount_of(a: Run, b: Run, floors: Sequence[Floor]) -> float | None:
    """The relative change of the initial state that is of the size of two runs' first gap, a power of ten; None where they
    never
    part, or where it is no perturbation. Raises SpecError where the runs have nothing in common."""
    gap = first_gap(a, b, floors)
    if gap is None or not math.isfinite(gap.size):
        return None
    amount = 10.0 ** round(math.log10(perturbation_of(a.world, gap.size)))
    return amount if SMALLEST <= amount <= LARGEST else None


def second_passes(outcome: SweepOutcome, store: Store, seeds: int) -> Iterator[SecondPass]:
    """The second passes of a sweep whose runs are done: for each world, one for each size of gap that two of its engines
    have."""
    plan, noisy = outcome.plan, moved_by_round_off(outcome)
    for overrides, members in unmoved(outcome).items():
        runs = {engine: store.load(row.key) for engine, (_, row) in members.items()}
        amounts: dict[float, None] = {}
        for first, second in itertools.combinations(runs, 2):
            try:
                pair = (runs[first], runs[second])
                amount = amount_of(*pair, floors_of(pair, overrides, noisy, store))
            except SpecError:  # no common time or body: the table of the study says so
                continue
            if amount is not None:
                amounts[amount] = None
        for amount in amounts:
            changed = {
                "perturb": Perturb(amount=amount, seeds=seeds),
                "over": {path: (value,) for path, value in overrides},
                "together": [],
                "cases": {},
                "only_cases": False,
                "samples": None,
                "repeat": 1,
                "measure": "physics",
            }
            sweep = plan.sweep.model_copy(update=changed)
            yield SecondPass(overrides, amount, Plan(plan.spec, plan.engines, plan.versions, sweep))


# The models of a published study: kept next to its figures, and compared to those that the present code makes of the study.

MODELS_FILE = "models.json"
SCHEMA = 1
LARGEST_FILE = 64 * 2**20
MOST_MODELS = 20_000
"""Models of a study that is published: each is compiled for every check."""


def request_of(source: StudySource, study: SweepOfStudy) -> str:
    """The hash of the request of a study in a sweep, except its models: repetitions, seeds, what is shown, figures from
    elsewhere."""
    figures = [figure.model_dump(mode="json") for figure in source.figures if figure.sweep == study.name]
    words = study.words
    swept = study.spec.source.document.data.get("sweep")
    return digest([swept, words.show, {name: dict(local) for name, local in words.unequal.items()}, figures]).hex()


def sweep_models(source: StudySource, study: SweepOfStudy, plan: Plan) -> dict[str, Any]:
    """The models of one sweep as plain data."""
    return {"asked": request_of(source, study), "models": [plain_model(model) for model in models_of(plan)]}


def outdated_runs(outcome: SweepOutcome, store: Store) -> Iterator[str]:
    """Runs that a sweep took from its store and that are not of the models that the code makes of it today, in words."""
    plan = outcome.plan
    for cell, row in outcome.rows():
        if row is None:
            continue
        try:
            case = case_of(plan, cell)
        except SpecError:
            continue
        if stored_key(case, cell, plan.versions[cell.engine], plan.measure) != row.key:
            yield f"run {row.key[:16]}… of {cell.engine}"


def read_models(folder: Path) -> StudyModels:
    """The models of a published study. Raises SpecError where it is missing or damaged."""
    marker = read_marker(folder) if folder.is_dir() else None
    path = folder / MODELS_FILE
    hint = "simspec study STUDY --publish DIR writes it"
    if marker is None or marker.kind != STUDY or not marker.owns(MODELS_FILE):
        raise SpecError([Problem(f"{folder} is not a published study", hint=hint, code="R101")])
    try:
        models = read_as(StudyModels, read_bytes(path, LARGEST_FILE, folder), str(path))
    except FileNotFoundError:
        raise SpecError([Problem(f"{path} is missing", hint=hint, code="R101")]) from None
    if models.schema_ != SCHEMA:
        raise SpecError(
            [Problem(f"{path}: schema {models.schema_}, this simspec reads {SCHEMA}", hint=hint, code="R104")]
        )
    return models


def older_sweeps(kept: StudyModels, now: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """By sweep, in words, why figures are older than the code; sweeps whose models are those of today are not there.

    ``now``: :func:`sweep_models` of each sweep.
    """
    given: dict[str, str] = {}
    for name in dict.fromkeys([*kept.sweeps, *now]):
        if name not in now:
            given[name] = "the study has no such sweep any more"
        elif name not in kept.sweeps:
            given[name] = "the sweep was not measured"
        else:
            before = [read_model(model.model_dump()) for model in kept.sweeps[name].models]
            why = changed(before, [read_model(model) for model in now[name]["models"]])
            if why is None and kept.sweeps[name].request != now[name]["asked"]:
                why = "the study requests something else (repetitions, seeds, what is shown, or figures from elsewhere)"
            if why is not None:
                given[name] = why
    return given
