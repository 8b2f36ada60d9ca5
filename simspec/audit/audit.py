"""The audit of files: every engine that reads a file loads it as it is, in a separate process, and its model is read back."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

from simspec.audit import AuditFinding, CompiledProof, EngineAudit, FileAudit, FindingSeverity, What
from simspec.audit.compare import FileComparison, compare
from simspec.audit.meaning import Meaning, file_name, match, meaning_of
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.foreign import MESH, Reads
from simspec.engines.kit.process import Operation, Reply, side_by_side, start
from simspec.engines.kit.registry import auditors, engine_name, find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, Location, Problem, SpecError, clipped
from simspec.files import scratch_folder
from simspec.imports.files import Files
from simspec.language.foreign import ImportOptions, LossSeverity
from simspec.language.sources import project_folder
from simspec.plausibility.examine import examine
from simspec.plausibility.findings import Plausibility
from simspec.selection import compiling
from simspec.support.features import Feature
from simspec.world.types import Body, ReadBack, Shape, World

DEADLINE = 60.0
"""Seconds that one engine may take for one file, in addition to ``Engine.COMPILING``."""
AT_ONCE = 2
"""Engines side by side."""
NOT_RUN = "simspec runs no world in it"
LEVELS = ("L0", "L1", "L2", "L3", "L4", "L6")
"""Of the proof of what simspec compiles: all that is about the model, and not about contact laws, which robot files do
not have."""


def audit(
    path: Path,
    engines: Sequence[str],
    options: ImportOptions,
    *,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    prove: bool = True,
    allow_outside: bool = False,
    progress: Callable[[str], None] = lambda text: None,
    arrived: Callable[[FileAudit], None] = lambda partial: None,
    warm: WarmProcesses | None = None,
) -> FileAudit:
    """Audit one file in ``engines``, whose processes are forked from ``warm`` ones where there are such; engines that compile
    for each model are last. ``arrived`` receives the audit so far when an engine has finished: it is the last one there.
    Raises SpecError for what is no such file, or not readable; an engine that refuses the file or dies is a finding."""
    progress(f"{path.name}: reading")
    meaning = meaning_of(path, options, allow_outside)
    slow = compiling(engines)
    readers, skipped = readers_of(meaning.language, sorted(engines, key=lambda name: name in slow))
    progress(f"{path.name}: {', '.join(readers)}")
    name = file_name(path, options)
    audits: dict[str, EngineAudit] = {}

    def finished(engine: str) -> None:
        audits[engine] = _engine_audit(engine, readers[engine], meaning, actual[engine])
        missing = tuple(other for other in readers if other not in audits)
        some = tuple(audits.values())
        arrived(FileAudit(name, meaning.language, meaning.source, some, bodies=len(meaning.bodies), missing=missing))

    actual: dict[str, LoadedFile] = {}
    with side_by_side(AT_ONCE) as pool:
        roots = readable(meaning, options, allow_outside)
        futures = {
            pool.submit(loaded, engine, meaning, (pythons or {}).get(engine), deadline, warm, roots): engine
            for engine in readers
        }
        for future in as_completed(futures):
            actual[futures[future]] = future.result()
            if meaning.bodies:
                finished(futures[future])
    meaning = _defined(meaning, actual, readers)
    for engine in readers:
        if engine not in audits:
            finished(engine)
    results: tuple[CompiledProof, ...] = ()
    if prove and meaning.world is not None:
        progress(f"{path.name}: compiling and proving")
        results = proven(meaning.world, list(engines), meaning.locate, pythons, deadline, warm)
    losses = meaning.imported.losses() if meaning.imported is not None else []
    return FileAudit(
        name,
        meaning.language,
        meaning.source,
        tuple(audits[engine] for engine in readers),
        results,
        tuple(str(problem) for problem in meaning.defects),
        len(losses),
        sum(loss.severity is LossSeverity.PHYSICS for loss in losses),
        skipped,
        len(meaning.bodies),
        plausibility_of(meaning),
    )


def plausibility_of(meaning: Meaning) -> Plausibility:
    """Implausible values of a file's model; of a file that simspec does not import nothing is known. Findings about values
    that were repaired are left out: they are no values of the file."""
    if meaning.spec is None or meaning.read is None:
        return Plausibility(skipped={"all": "simspec does not import the file"})
    found = examine(meaning.spec, meaning.read)
    kept = [
        finding
        for finding in found.findings
        if not any(f"{finding.path}.".startswith(f"bodies.{path}.") for path in meaning.unsure)
    ]
    return dataclasses.replace(found, findings=tuple(kept))


def readers_of(language: str, engines: Iterable[str]) -> tuple[dict[str, Reads], dict[str, str]]:
    """The engines that read a language, and how; and of the others why not."""
    readers, skipped = {}, {}
    for name in engines:
        engine = find_engine(name)
        if language in engine.FOREIGN:
            readers[name] = engine.FOREIGN[language]
        else:
            skipped[name] = engine.LACKS.get(Capability.FOREIGN_FILES, "it does not read this language")
    return readers, skipped


class LoadedFile:
    """The result of loading a file in one engine: its answer, or the error."""

    def __init__(self, reply: Reply | None, error: EngineError | None, seconds: float):
        self.reply, self.error, self.seconds = reply, error, seconds

    @property
    def read_back(self) -> ReadBack | None:
        """The model in the engine."""
        return self.reply.answers[0].read_back if self.reply is not None else None


def readable(meaning: Meaning, options: ImportOptions, allow_outside: bool) -> list[str]:
    """The folders and files that engines may open for a file: those that an importer may."""
    if allow_outside:
        return ["/"]
    project = options.project or project_folder(meaning.path)
    allowed = Files(meaning.path, str(meaning.path), dataclasses.replace(options, project=project)).roots
    return list(dict.fromkeys([str(meaning.path.resolve()), *map(str, allowed), *meaning.packages.values()]))


def loaded(
    engine: str,
    meaning: Meaning,
    python: str | None,
    deadline: float,
    warm: WarmProcesses | None = None,
    roots: Sequence[str] = (),
) -> LoadedFile:
    """Load a file in an engine, in a process of its own that may open what is below ``roots`` (default: the file's folder) and
    what the engine needs (``confinement``)."""
    parameters = {
        "roots": list(roots) or [str(meaning.path.resolve().parent)],
        "file": str(meaning.path.resolve()),
        "language": meaning.language,
        "packages": dict(meaning.packages),
    }
    begun = time.perf_counter()
    with scratch_folder("audit") as nothing:
        try:
            operations = [Operation("foreign", parameters)]
            most = deadline + find_engine(engine).COMPILING
            with start(engine, nothing, operations, python=python, deadline=most, warm=warm) as running:
                return LoadedFile(running.wait(), None, time.perf_counter() - begun)
        except EngineError as error:
            return LoadedFile(None, error, time.perf_counter() - begun)


def _defined(meaning: Meaning, actual: Mapping[str, LoadedFile], readers: Mapping[str, Reads]) -> Meaning:
    """The meaning of a file that simspec does not import: the model in the engine that defines the language."""
    if meaning.bodies:
        return meaning
    for name, reads in readers.items():
        back = actual[name].read_back
        if reads.defines and back is not None:
            title = find_engine(name).TITLE or name
            source = f"what {title} holds, which defines the language; simspec does not import the file"
            return dataclasses.replace(meaning, source=source, bodies=back.bodies, gravity=back.gravity)
    return dataclasses.replace(meaning, source="not known: simspec does not import the file")


def _engine_audit(name: str, reads: Reads, meaning: Meaning, loading: LoadedFile) -> EngineAudit:
    reply, error = loading.reply, loading.error
    if error is not None or reply is None or reply.answers[0].read_back is None:
        refused = error is not None and error.refused
        text = str(error).removeprefix(f"{name}: ")
        what = What.REFUSED if refused else What.DIED
        given = clipped(text.removeprefix("refuses the file: "), 600)
        finding = AuditFinding(name, what, FindingSeverity.PHYSICS, "the file", "file", "", given, why=given)
        return EngineAudit(name, reads.how, False, (finding,), seconds=loading.seconds)
    answer = reply.answers[0]
    read_back = reply.answers[0].read_back
    findings, compared = compare(name, meaning, read_back, find_engine(name).FOREIGN_ADDITIONS)
    log = tuple(dict.fromkeys(clipped(line) for line in answer.log))
    version = reply.versions["engine_version"]
    return EngineAudit(name, reads.how, True, tuple(findings), compared, version, loading.seconds, log)


def proven(
    world: World,
    engines: Sequence[str],
    locate: Callable[[str], Location | None] = lambda path: None,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    warm: WarmProcesses | None = None,
) -> tuple[CompiledProof, ...]:
    """The proof's results in each of ``engines`` for a world of a robot file, as simspec compiles it. ``locate``: places in the
    file, by dotted paths of the world."""
    from simspec.proof.verify import verify
    from simspec.selection import supporting

    running = [name for name in engines if engine_name(name) not in auditors()]
    world = accepting(world, running)
    compiled, left = supporting(world, running, locate, pythons) if running else ({}, {})
    results = {name: CompiledProof(name, None, clipped(reason.reason)) for name, reason in left.items()}
    results |= {name: CompiledProof(name, None, NOT_RUN) for name in engines if name not in running}
    if compiled:
        certificate = verify(
            world,
            list(compiled),
            compiled=compiled,
            levels=LEVELS,
            pythons=pythons,
            locate=locate,
            deadline=deadline,
            warm=warm,
        )
        for name, proof in certificate.engines.items():
            wrong = [check for check in proof.checks if not check.passed]
            why = "" if not wrong else f"{wrong[0].level} {wrong[0].name} {wrong[0].where} {wrong[0].detail}"
            results[name] = CompiledProof(name, not wrong and bool(proof.checks), clipped(why.strip()))
    return tuple(results[name] for name in engines if name in results)


def accepting(world: World, engines: Sequence[str]) -> World:
    """A world in which every approximation is accepted that can be: a robot file says nothing about it, and what is
    approximate is how an engine moves the model, not the model."""
    words = tuple(feature.value for feature in Feature)
    names = [engine_name(label) for label in engines]
    options = tuple(
        dataclasses.replace(world.options(name), accept=words, outside=words) for name in sorted(set(names))
    )
    kept = tuple(engine for engine in world.engines if engine.engine not in names)
    return dataclasses.replace(world, engines=tuple(sorted((*kept, *options), key=lambda entry: entry.engine)))


# Two files of one robot, in any languages: how what they mean differs.

SECOND = "B"


@dataclass(frozen=True)
class PairAudit:
    """How two files differ: ``findings`` have the first's value as ``file_value``, the second's as ``engine_value``; bodies are
    matched by name, those that only one file has are listed."""

    first: str
    second: str
    matched: int
    compared: int
    findings: tuple[AuditFinding, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether both mean one model."""
        return not any(finding.silent for finding in self.findings) and not self.only_first and not self.only_second


def pair(
    first: tuple[Path, ImportOptions], second: tuple[Path, ImportOptions], allow_outside: bool = False
) -> PairAudit:
    """Compare two files, each with what is said to its importer. Raises SpecError where simspec does not read one of them, or
    they have no body in common."""
    meanings = [meaning_of(path, options, allow_outside) for path, options in (first, second)]
    names = file_name(*first), file_name(*second)
    for meaning in meanings:
        if not meaning.bodies:
            problems = meaning.defects or (
                Problem(f"{meaning.path}: simspec does not import files of this language", code="I114"),
            )
            raise SpecError(problems)
    entry, other = meanings
    matched = match(entry.bodies, other.bodies)
    if not matched.partners:
        raise SpecError([Problem(f"{names[0]} and {names[1]} have no body of the same name", code="R105")])
    shared = frozenset(matched.partners)
    partners = frozenset(body.name for body in matched.partners.values())
    read_back = ReadBack(tuple(map(_as_read_back, other.bodies)), other.gravity or (0.0, 0.0, 0.0), 0.0)
    compared = FileComparison(SECOND, dataclasses.replace(entry, gravity=None), read_back, {}).run()
    findings = tuple(
        finding
        for finding in compared.findings
        if not (finding.quantity == "body" and finding.what in (What.DROPPED, What.ADDED, What.MERGED))
        and finding.severity is not FindingSeverity.DEFAULT
    )
    return PairAudit(
        *names,
        len(shared),
        compared.compared,
        findings,
        _rest(entry, shared),
        _rest(other, partners),
        tuple(str(problem) for meaning in meanings for problem in meaning.defects),
    )


def _rest(meaning: Meaning, shared: frozenset[str]) -> tuple[str, ...]:
    return tuple(body.name for body in meaning.bodies if body.name not in shared)


def _as_read_back(body: Body) -> Body:
    """A body as an engine would tell it: meshes by their support functions."""
    return dataclasses.replace(body, shapes=tuple(_support(shape) for shape in body.shapes))


def _support(shape: Shape) -> Shape:
    if shape.kind != MESH:
        return shape
    import numpy as np

    from simspec.engines.kit.foreign import support

    return dataclasses.replace(shape, size=support(np.array(shape.size, dtype=float).reshape(-1, 3)))
