"""Stages of a file: its import, the certification of its compiled files in engines, and the audit of the file itself.
Each stage is independent, so that any of them continues where it stopped."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from models import ENGINE_DEADLINE, ENGINES

from simspec.audit.audit import audit, proven
from simspec.audit.meaning import content_of, language_of
from simspec.engines.kit.registry import engines
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import Problem, SpecError, UnsupportedError
from simspec.language.foreign import Fate, Imported, ImportOptions, LossSeverity, importers, is_foreign
from simspec.language.load import load
from simspec.report.screen import plain

MOST = 20
"""Problems and losses of a file that are kept, of each kind."""


class Kept:
    """State that a worker keeps from file to file."""

    def __init__(self) -> None:
        self.warm = WarmProcesses()
        self.engines = [name for name in ENGINES if engines()[name].version() is not None]

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *error: object) -> None:
        self.warm.close()


def options_of(folders: Sequence[str]) -> ImportOptions:
    """Packages are looked for in all folders of the package that the file is of."""
    return ImportOptions(package_path=tuple(folders), base=Path("/"))


def importing(file: str, folders: Sequence[str], kept: Kept, engines: Sequence[str] = ()) -> dict[str, Any]:
    """Whether a file is imported and resolves to a world, what is lost, and of MJCF how far it is from the original."""
    path, options = Path(file), options_of(folders)
    if not is_foreign(path.name):
        return {"imported": None, "why": "no importer"}
    try:
        spec = load(path, options=options, allow_outside=True)
        world = spec.resolve()
    except SpecError as error:
        answer: dict[str, Any] = {"imported": False, "problems": _as_texts(error)}
        answer["repaired"] = _repaired(path, options)
    else:
        answer = {"imported": True, "bodies": len(world.bodies), **_losses(spec.source.imported)}
        answer["constraints"] = len(world.constraints)
    if path.suffix == ".xml":
        answer |= _original(path, options, answer["imported"])
    return answer


def _as_texts(error: SpecError) -> list[dict[str, str]]:
    """Problems as texts, each message once."""
    problems: dict[str, Problem] = {}
    for problem in error.problems:
        problems.setdefault(problem.message, problem)
    return [
        {
            "message": problem.message,
            "found": problem.found or "",
            "hint": problem.hint or "",
            "place": str(problem.location or ""),
        }
        for problem in list(problems.values())[:MOST]
    ]


def _repaired(path: Path, options: ImportOptions) -> bool:
    """Whether a refused file is imported with all rules of repair."""
    importer = next(
        (importer for importer in importers().values() if path.name.lower().endswith(importer.SUFFIXES)), None
    )
    rules = tuple(importer.rules()) if importer is not None and hasattr(importer, "rules") else ()
    if not rules:
        return False
    given = ImportOptions(package_path=options.package_path, base=options.base, repair=rules)
    try:
        load(path, options=given, allow_outside=True).resolve()
    except SpecError:
        return False
    return True


def _losses(imported: Imported | None) -> dict[str, Any]:
    lost: dict[str, list[str]] = {severity.value: [] for severity in LossSeverity}
    for account in imported.accounts if imported is not None else ():
        if account.fate is Fate.LOST:
            lost[account.severity.value].append(f"{account.what}: {account.reason}")
    counts = {severity: len(texts) for severity, texts in lost.items()}
    return {"losses": counts, "lost": lost[LossSeverity.PHYSICS.value][:MOST]}


def _original(path: Path, options: ImportOptions, imported: bool | None) -> dict[str, Any]:
    """Whether MuJoCo loads the file, and how far mass matrix, bias force, passive force and places of what was imported are
    from those of its own compiled model."""
    from simspec.imports.files import Files
    from simspec.imports.mjcf.assembly import assemble
    from simspec.imports.mjcf.comparison import deviations
    from simspec.imports.mjcf.compiled import compile_model

    try:
        model = compile_model(assemble(Files(path, str(path), options)))
    except SpecError:
        return {"loads": False}
    answer: dict[str, Any] = {"loads": True, "original_bodies": model.numbers["nbody"] - 1, "nv": model.numbers["nv"]}
    if imported and model.numbers["nv"]:
        try:
            worst, _ = deviations(path, options)
            answer["deviations"] = [worst.mass, worst.bias, worst.passive, worst.place]
        except (SpecError, ValueError) as error:
            answer["deviations"] = str(error)[:200]
    return answer


def certifying(
    file: str, folders: Sequence[str], kept: Kept, engines: Sequence[str] = (), no_self_collision: bool = False
) -> dict[str, Any]:
    """Verdicts of the proof in ``engines`` (none: in all) of the compiled files; empty for a refused file.
    ``no_self_collision``: of the same model without contact between its own bodies."""
    path, options = Path(file), dataclasses.replace(options_of(folders), self_collision=not no_self_collision)
    if not is_foreign(path.name):
        return {"proven": None}
    try:
        spec = load(path, options=options, allow_outside=True)
        selected = list(engines) or kept.engines
        results = proven(spec.resolve(), selected, locate=spec.locate, deadline=ENGINE_DEADLINE, warm=kept.warm)
    except UnsupportedError as error:
        return {"proven": [], "why": str(error)[:500]}
    except SpecError as error:
        return {"proven": None, "why": str(error)[:500]}
    return {"proven": [plain(result) for result in results]}


def auditing(file: str, folders: Sequence[str], kept: Kept, engines: Sequence[str] = ()) -> dict[str, Any]:
    """The audit of a file in every engine that reads it."""
    path, options = Path(file), options_of(folders)
    try:
        language_of(path, content_of(path))
    except SpecError as error:
        return {"audited": None, "why": str(error)[:300]}
    found = audit(
        path,
        kept.engines,
        options,
        deadline=ENGINE_DEADLINE,
        prove=False,
        allow_outside=True,
        warm=kept.warm,
    )
    counted = []
    for engine in found.engines:
        quantities: dict[str, int] = {}
        for finding in engine.silent:
            quantities[finding.quantity] = quantities.get(finding.quantity, 0) + 1
        why = "" if engine.loaded else engine.findings[0].why[:300]
        counted.append(
            {"engine": engine.engine, "loaded": engine.loaded, "died": engine.died, "silent": quantities, "why": why}
        )
    return {"audited": counted, "meaning": found.meaning}


STAGES: dict[str, Callable[[str, Sequence[str], Kept, Sequence[str]], dict[str, Any]]] = {
    "import": importing,
    "certify": certifying,
    "apart": functools.partial(certifying, no_self_collision=True),
    "audit": auditing,
}
