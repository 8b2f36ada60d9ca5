"""``simspec explain``: where the difference of two runs, or of two engines, comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from simspec.arguments import demand_installed, engine_names, interpreters, load_spec, print_json
from simspec.attribution.configuration import Configuration
from simspec.attribution.models import ModelProof, proof_of
from simspec.attribution.sides import explain as explain_them
from simspec.attribution.sides import side_of_run
from simspec.commands.accept import accepted_sets
from simspec.commands.run import OF_A_MODEL
from simspec.engines.kit.registry import find_engine
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.generated import CERTIFICATE_FILE, GENERATED, read_certificate
from simspec.report.attribution import explanation_data, show_explanation
from simspec.report.progress import progress
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.runner.run import Run
from simspec.runner.store import load_run


def explain(
    a: str,
    b: str | None,
    *,
    engine: list[str] | None,
    others: list[str] | None,
    windows: int,
    verify: bool,
    sets: list[str] | None,
    accept: list[str] | None = None,
    allow_outside: bool,
    robot_files: RobotFiles = NO_WORDS,
    python: list[str] | None,
    deadline: float,
    as_json: bool,
) -> int:
    """Explain the difference of two run folders, or of a spec (or two) in engines. Always 0: there is nothing that could fail
    to hold."""
    pythons = interpreters(python, engine)
    notes: list[str] = []
    folders = [name for name in (a, b) if name is not None and Path(name).is_dir()]
    if folders:
        if len(folders) < 2 or b is None:
            message = "cannot explain this difference"
            raise SpecError(
                [Problem(message, found=", ".join(filter(None, (a, b))), allowed="two run folders, or specs")]
            )
        if engine or others or sets or accept:
            message = "--engine, --set, --accept and --with are for specs: runs have their own"
            raise SpecError([Problem(message, found=f"{a}, {b}")])
        robot_files.check_effect()
        runs = [load_run(name) for name in (a, b)]
        sides = [side_of_run(run, pythons, name) for run, name in zip(runs, (a, b), strict=True)]
        names = [f"{name} ({run.label})" for run, name in zip(runs, (a, b), strict=True)]
        notes = _other_versions(runs, names, pythons)
        folders_of_proof = [Path(name).parent for name in (a, b)]
        versions = [run.provenance.get("engine_version") for run in runs]
        demand_installed(list(dict.fromkeys(side.engine for side in sides)), pythons)
    else:
        sides, names = _of_specs(a, b, engine, others, sets, accept, allow_outside, robot_files, pythons)
        folders_of_proof = [GENERATED / side.world.name for side in sides]
        versions = [None, None]
    proofs = [_stored_proof(*facts) for facts in zip(sides, folders_of_proof, versions, strict=True)]
    with progress(not as_json) as tell:
        told = explain_them(
            *sides,
            windows=windows,
            names=(names[0], names[1]),
            deadline=deadline,
            proofs=() if verify else proofs,
            verify=verify,
            progress=tell,
        )
    if as_json:
        print_json({**explanation_data(told), "notes": notes})
    else:
        show_explanation(told, notes)
    return EXIT_OK


def _stored_proof(side: Configuration, folder: Path, version: str | None) -> ModelProof:
    """What the certificate in a folder proves of a side."""
    source = str(folder / CERTIFICATE_FILE)
    try:
        certificate = read_certificate(folder)
    except SpecError as error:
        return ModelProof(side.engine, missing=error.problems[0].message)
    if certificate is None:
        return ModelProof(side.engine, missing=f"there is no {source}")
    return proof_of(side, certificate, source, version)


def _of_specs(
    a: str,
    b: str | None,
    engine: list[str] | None,
    others: list[str] | None,
    sets: list[str] | None,
    accept: list[str] | None,
    allow_outside: bool,
    robot_files: RobotFiles,
    pythons: Mapping[str, str],
) -> tuple[list[Configuration], list[str]]:
    words = engine or []
    if not 1 <= len(words) <= 2:
        allowed = (
            "--engine A --engine B; or one --engine, and what the second side has: --with PATH=VALUE, or a second spec"
        )
        raise SpecError([Problem("explain takes one engine or two", found=", ".join(words) or "none", allowed=allowed)])
    if len(words) == 1 and b is None and not others:
        hint = "add a second --engine, --with PATH=VALUE for the second side, or a second spec"
        raise SpecError([Problem("there is only one side", found=words[0], hint=hint)])
    labels = [engine_names([word])[0] for word in words]
    demand_installed(labels, pythons)
    labels = [labels[0], labels[-1]]
    loaded = [
        load_spec(
            name,
            said,
            allow_outside,
            robot_files=robot_files,
            check_effect=False,
            warn=False,
            duration_of_model=OF_A_MODEL,
        )
        for name, said in _accepting(a, b or a, sets, others, accept, allow_outside, robot_files, words)
    ]
    robot_files.check_effect(*(one.spec for one in loaded))
    worlds = [one.world for one in loaded]
    sides = [Configuration(world, label, pythons.get(label)) for world, label in zip(worlds, labels, strict=True)]
    names = [
        f"{a} in {labels[0]}",
        " ".join([f"{b or a} in {labels[1]}", *(f"--with {word}" for word in others or ())]),
    ]
    return sides, names


def _accepting(
    a: str,
    b: str,
    sets: list[str] | None,
    others: list[str] | None,
    accept: list[str] | None,
    allow_outside: bool,
    robot_files: RobotFiles,
    engine: list[str],
) -> list[tuple[str, list[str]]]:
    """The spec of each side, with its overrides, those of ``accept`` included. Raises SpecError for a word of it that neither
    needs."""
    sides = [(a, list(sets or ())), (b, [*(sets or ()), *(others or ())])]
    said: list[tuple[str, list[str]]] = []
    failed: list[SpecError] = []
    for name, own in sides:
        try:
            said.append((name, accepted_sets(name, own, accept, allow_outside, robot_files, engine) or []))
        except SpecError as error:  # what is wrong with a spec itself is told when it is read
            said.append((name, own))
            failed.append(error)
    if len(failed) == len(sides):
        raise failed[0]
    return said


def _other_versions(runs: Sequence[Run], names: Sequence[str], pythons: Mapping[str, str]) -> list[str]:
    """A note for each run that was made with another version of its engine than is asked now."""
    notes = []
    for run, name in zip(runs, names, strict=True):
        made, here = run.provenance.get("engine_version"), find_engine(run.engine).version()
        if run.engine not in pythons and made != here:
            notes.append(f"note: {name} was made with {run.engine} {made}; {here} is asked")
    return notes
