"""Results as plain data, for ``--json`` and ``report.json``: the same facts as the tables, in SI units, whole."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec.errors import (
    MOST_PROBLEMS,
    MOST_WORDS,
    UNSEEN_CHARACTERS,
    EngineError,
    SimspecError,
    SpecError,
    UnsupportedError,
    clipped,
)

if TYPE_CHECKING:
    from simspec.comparison.floor import Floor
    from simspec.comparison.runs import Diff
    from simspec.comparison.study import Study
    from simspec.proof.certificate import Certificate, EngineProof
    from simspec.runner.expectations import Outcome
    from simspec.runner.run import Run

REPORT_SCHEMA = 1
REPORT_FILE = "report.json"
"""Where a study's folder has it."""
NOT_RUN = "left_out"
"""Its key for the requested engines that did not run, with the reasons."""
PAGE_FILE = "report.html"
"""Where the folder of a study, or of a run, has its page."""


def plain(value: Any) -> Any:
    """Dataclasses, tuples, numpy numbers and paths as JSON data. Numbers that are not finite are null: JSON has no word for
    them."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if (numpy := sys.modules.get("numpy")) is not None and isinstance(value, numpy.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def text(value: Any) -> str:
    """JSON text with two spaces and a newline at the end."""
    encoded = json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    # characters that JSON leaves raw and a terminal obeys, and halves of characters (names of files that are no text), as
    # escapes
    return UNSEEN_CHARACTERS.sub(_escaped, encoded) + "\n"


def _escaped(match: re.Match[str]) -> str:
    character = match.group()
    return character if character == "\n" else f"\\u{ord(character):04x}"


def error_data(error: SimspecError) -> dict[str, Any]:
    """An error with its problems: the first of them, and the number of all, where there are very many."""
    data: dict[str, Any] = {"kind": type(error).__name__, "message": str(error), "exit_code": error.exit_code}
    if isinstance(error, SpecError):
        data["problems"] = [
            {
                name: clipped(value, MOST_WORDS) if isinstance(value, str) else value
                for name, value in plain(problem).items()
            }
            for problem in error.problems[:MOST_PROBLEMS]
        ]
        if error.more:
            data["problem_count"] = len(error.problems)
    if isinstance(error, UnsupportedError) and error.ways_out is not None:
        data["ways_out"] = plain(error.ways_out)
    if isinstance(error, EngineError):
        data["engine"] = error.engine
    return {"error": data}


def run_data(run: Run, outcomes: tuple[Outcome, ...] = ()) -> dict[str, Any]:
    """One run without its arrays."""
    from simspec.comparison.runs import summary

    return {
        "engine": run.engine,
        "failed": run.failed,
        "provenance": plain(run.provenance),
        "real_time_factor": run.real_time_factor,
        "cpu_factor": run.cpu_factor,
        "end_to_end_factor": run.end_to_end_factor,
        "quantities": plain(summary(run)),
        "expectations": plain(outcomes),
        "unphysical": [{**plain(finding), "what": finding.short} for finding in run.unphysical.findings],
        "not_judged": run.unphysical.not_judged,
    }


def certificate_data(certificate: Certificate) -> dict[str, Any]:
    """A certificate, whole, with each engine's verdict and what its contact figures rest on."""
    data: dict[str, Any] = plain(certificate)
    for name, proof in certificate.engines.items():
        data["engines"][name] |= proof_data(proof)
    return data


def proof_data(proof: EngineProof) -> dict[str, Any]:
    """The verdict of one engine's proof, and what its contact figures rest on."""
    declared = {"declared": plain(proof.declared.data()), "contact_scope": proof.contact_scope} if proof.contact else {}
    return {"valid": proof.valid, "verdict": proof.verdict, **declared}


def diff_data(diff: Diff) -> dict[str, Any]:
    """One comparison, whole."""
    bodies = [{**plain(body), "verdict": body.verdict} for body in diff.bodies]
    return {**plain(diff), "bodies": bodies, "within": diff.within, "verdict": diff.verdict}


def floor_data(floor: Floor) -> dict[str, Any]:
    """An engine's own noise without the arrays."""
    return {
        "engine": floor.engine,
        "bitwise": floor.bitwise,
        "perturbation": floor.perturbation,
        "largest": plain(floor.largest),
    }


def study_data(study: Study) -> dict[str, Any]:
    """One study: what ``report.json`` holds."""
    return {
        "schema": REPORT_SCHEMA,
        "world": study.world.name,
        "exit_code": study.exit_code,
        "certificate_valid": study.certificate.valid if study.certificate is not None else None,
        "proofs": {
            name: proof_data(proof)
            for name, proof in (study.certificate.engines.items() if study.certificate is not None else ())
        },
        "runs": {name: run_data(run, study.outcomes.get(name, ())) for name, run in study.runs.items()},
        "floors": {name: floor_data(floor) for name, floor in study.floors.items()},
        "diffs": [diff_data(diff) for diff in study.diffs],
    }
