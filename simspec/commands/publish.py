"""``simspec study --publish``: a study's results as a folder for version control: figures, and what they are of."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simspec.errors import Problem, SpecError
from simspec.experiments.published import (
    MODELS_FILE,
    MOST_MODELS,
    SCHEMA,
    strangers,
    sweep_models,
)
from simspec.language.study_specs import StudySource
from simspec.outputs.marker import STUDY
from simspec.outputs.targets import demand, folder_problem
from simspec.outputs.writing import write_folder
from simspec.report.study.done import Done

MOST_NAMED = 3


def demand_publishable(folder: Path, source: StudySource, name: str) -> None:
    """Raise SpecError, before anything is run, where a study could not be published into ``folder``."""
    problem = None
    if Path(name).is_absolute():
        hint = "give a relative path"
        problem = Problem("a published study names its file, which is to be found on other machines too", hint=hint)
    demand([problem, folder_problem(folder, STUDY, source.files())])


def publish(
    source: StudySource, name: str, done: Sequence[Done], files: dict[str, str], small: bool, folder: Path
) -> None:
    """Write ``files`` (``study.json`` among them), and the hashes of the models that they are of, into ``folder``.

    Raises SpecError where a run in the store is not of the model that the code makes of it today, or where there is none.
    """
    problems = []
    for one in done:
        outcome = one.outcome
        if outcome.invalid_count:
            problems.append(Problem(f"{one.sweep.name}: values make the scenario invalid: nothing is published"))
        if len(outcome.plan) > MOST_MODELS:
            problems.append(
                Problem(f"{one.sweep.name}: {len(outcome.plan):,} runs; a published sweep has {MOST_MODELS:,}")
            )
        old = list(itertools.islice(strangers(outcome, one.store), MOST_NAMED + 1))
        if old:
            named = ", ".join(old[:MOST_NAMED]) + (", …" if len(old) > MOST_NAMED else "")
            message = f"{one.sweep.name}: the store has runs of models that this code no longer makes: {named}"
            problems.append(Problem(message, hint="use a new --store"))
    if problems:
        raise SpecError(problems)
    models: dict[str, Any] = {
        "schema": SCHEMA,
        "source": name,
        "small": small,
        "study_sha256": hashlib.sha256(files["study.json"].encode()).hexdigest(),
        "sweeps": {one.sweep.name: sweep_models(source, one.sweep, one.outcome.plan) for one in done},
    }
    text = json.dumps(models, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_folder({**files, MODELS_FILE: text}, folder, STUDY)
