"""The models of a published study: kept next to its figures, and compared to the models that the present code makes of the
study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from simspec.errors import Problem, SpecError
from simspec.experiments.cases import case_of
from simspec.experiments.certify import changed, models_of, plain_model, read_model
from simspec.experiments.plan import Plan, digest
from simspec.experiments.store import Store
from simspec.experiments.sweep import SweepOutcome, stored_key
from simspec.language.study_specs import StudySource, SweepOfStudy
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import STUDY, read_marker
from simspec.stored import StudyModels, read_as

MODELS_FILE = "models.json"
SCHEMA = 1
LARGEST = 64 * 2**20
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
        raise SpecError([Problem(f"{folder} is not a published study", hint=hint)])
    try:
        models = read_as(StudyModels, read_bytes(path, LARGEST, folder), str(path))
    except FileNotFoundError:
        raise SpecError([Problem(f"{path} is missing", hint=hint)]) from None
    if models.schema_ != SCHEMA:
        raise SpecError([Problem(f"{path}: schema {models.schema_}, this simspec reads {SCHEMA}", hint=hint)])
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
