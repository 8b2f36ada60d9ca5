"""The complete self-test: every change that compiled files can suffer, one at a time, and what the proof makes of it.

Each mutation (``dialects/kit/mutations.py``) is tried in stages, and leaves at the first that notices it. One that the engine
refuses needs no proof. Then what the engine says it holds (levels L1, L2 and L4). One that its format declares inert must now
move every body as the unchanged files do, with contact, without and under control, within 1e-12. All else goes on to what the
engine is probed for (L2 to L4, L6, L7), and to the whole proof with its contact probes (L5); what that does not notice is
*missed*. Level L0 does not count: the text alone says nothing of the engine.

Many mutations share one engine process, which works on each apart (``engines/kit/attempts.py``): one that crashes is refused.
"""

from __future__ import annotations

import dataclasses
import importlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np

from simspec.compiler import Compiled, compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.mutating import mutations
from simspec.dialects.kit.mutations import STILL, Inert, Mutation, MutationTable
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, call, side_by_side
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError, UnsupportedError
from simspec.proof.checks import Check
from simspec.proof.complete_scenes import departure, observed, scenes_of
from simspec.proof.complete_verdicts import CompleteTest, Verdict
from simspec.proof.mutation_worlds import WORLDS
from simspec.proof.selftest_worlds import SMALLER
from simspec.proof.verify import Probes, engine_checks, prepare, read_back_checks, verify
from simspec.scratch import scratch_folder
from simspec.world.canonical import from_plain
from simspec.world.types import ReadBack, World

NOTHING = Inert("", "")
BATCH = 100
"""Mutations that share a process."""
DEADLINE = 60.0
"""Seconds of one process, and ``EACH`` more for every mutation in it: none comes near (0.05 to 2 s for each)."""
EACH = 2.0
LOST = 10.0
"""Seconds of CPU after which one operation is given up: no sound world's takes 2, some changed files make an engine go round
in circles (parents that are each other's)."""
WORKERS = 2


def table_of(dialect: str) -> MutationTable:
    """The table of a dialect: ``TABLE`` of the module ``mutations`` beside its own; empty without one."""
    name = f"{type(dialects()[dialect]).__module__.rpartition('.')[0]}.mutations"
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        return MutationTable()
    table: MutationTable = module.TABLE
    return table


def unused_rows(table: MutationTable, verdicts: Iterable[Verdict]) -> tuple[str, ...]:
    """The rows of ``table`` that declare something inert, and by which none of ``verdicts`` is."""
    used = {verdict.row for verdict in verdicts if verdict.verdict == "inert"}
    return tuple(dict.fromkeys(row.name for row in table.inert if row.name not in used))


def complete_self_test(
    engines: Sequence[str],
    *,
    worlds: Sequence[str] = (),
    only: Callable[[Mutation], bool] | None = None,
    progress: Callable[[str], None] | None = None,
) -> CompleteTest:
    """Try every mutation of every world (or of those named) in every engine.

    ``only`` chooses among the mutations. A world that only stands in for another (``SMALLER``) is left out for engines that
    support that one, unless it is named. Raises AssertionError when an unchanged world does not verify, or does not move
    twice alike: then nothing could be said.
    """
    say = progress or (lambda text: None)
    started = time.monotonic()
    verdicts: list[Verdict] = []
    skipped: dict[str, str] = {}
    unused: dict[str, tuple[str, ...]] = {}
    for engine in engines:
        tried: list[Verdict] = []
        stand_ins: dict[str, str] = {}
        for name in worlds or WORLDS:
            larger = stand_ins.get(name)
            bench = f"stands in for the world {larger!r}, which the engine has" if larger else _Bench.of(engine, name)
            if isinstance(bench, str):
                skipped[f"{engine}, {name}"] = bench
                continue
            if name in SMALLER and not worlds:
                stand_ins[SMALLER[name][0]] = name
            begun = time.monotonic()
            of_world = bench.verdicts(only or (lambda mutation: True))
            tried += of_world
            missed = sum(verdict.verdict == "missed" for verdict in of_world)
            say(f"{engine}, {name}: {len(of_world)} mutations, {missed} missed, {time.monotonic() - begun:.0f} s")
        verdicts += tried
        if not worlds and only is None:
            unused[engine] = unused_rows(table_of(find_engine(engine).DIALECT), tried)
    versions = {engine: str(find_engine(engine).version()) for engine in engines}
    return CompleteTest(tuple(verdicts), skipped, versions, time.monotonic() - started, unused)


@dataclass(frozen=True)
class _Bench:
    """One world in one engine: compiled, proven sound, and what it does when it is left alone."""

    name: str
    engine: type[Engine]
    world: World
    compiled: Compiled
    probes: Probes
    table: MutationTable
    scenes: tuple[Operation, ...]
    still: tuple[Mapping[str, np.ndarray], ...]

    @classmethod
    def of(cls, engine: str, name: str) -> _Bench | str:
        """The bench, or the reason why this engine cannot have this world."""
        world = WORLDS[name](engine)
        try:
            compiled = compile_world(world, [engine])[engine]
        except UnsupportedError as error:
            return error.problems[0].message
        probes = prepare(world)
        certificate = verify(world, [engine], probes=probes)
        if not certificate.valid:
            _, check = certificate.failures()[0]
            raise AssertionError(f"{engine}: the sound world {name!r} fails {check.level} {check.name}: {check.detail}")
        scenes = scenes_of(world, probes, find_engine(engine))
        with scratch_folder("sound") as place:
            write_folder(compiled.files, place / engine)
            answers = call(engine, place / engine, [*scenes, *scenes]).answers
        still = tuple(observed(answer) for answer in answers[: len(scenes)])
        again = tuple(observed(answer) for answer in answers[len(scenes) :])
        if departure(still, again) > STILL:
            raise AssertionError(f"{engine}: the world {name!r} does not repeat its own motion")
        table = table_of(compiled.dialect)
        return cls(name, find_engine(engine), world, compiled, probes, table, scenes, still)

    def verdicts(self, only: Callable[[Mutation], bool]) -> list[Verdict]:
        planted = (mutation for mutation in mutations(self.compiled.files, self.table) if only(mutation))
        with side_by_side(WORKERS) as pool:
            # batches are made as they are asked for: all texts at once would be large
            batches = list(pool.map(self._batch, _batches(planted)))
        return [verdict for some in batches for verdict in some]

    def _batch(self, batch: Sequence[Mutation]) -> list[Verdict]:
        verdicts: dict[str, Verdict] = {}
        left = list(batch)
        acting: dict[str, str] = {}
        stages = (self._held, partial(self._unmoved, acting=acting), self._probed, partial(self._whole, acting=acting))
        for stage in stages:
            for mutation, verdict in stage(left):
                if verdict is not None:
                    verdicts[mutation.name] = verdict
            left = [mutation for mutation in left if mutation.name not in verdicts]
            if not left:
                break
        return [verdicts[mutation.name] for mutation in batch]

    # --- stages ---------------------------------------------------------------------------------------------------

    def _held(self, batch: Sequence[Mutation]) -> Iterator[tuple[Mutation, Verdict | None]]:
        """By what the engine says it holds."""
        for mutation, answers in self._ask(batch, [Operation("read_back")]):
            verdict = self._refused(mutation, answers)
            if verdict is None and not isinstance(answers, EngineError):
                verdict = self._judged(mutation, partial(self._read_back_checks, answers))
            yield mutation, verdict

    def _unmoved(self, batch: Sequence[Mutation], acting: dict[str, str]) -> Iterator[tuple[Mutation, Verdict | None]]:
        """What is declared inert must move as the sound files do; what does not is noted in ``acting``, and goes on."""
        declared = [mutation for mutation in batch if self.table.inertness(mutation) is not None]
        for mutation, answers in self._ask(declared, self.scenes):
            verdict = self._refused(mutation, answers)
            if verdict is None and not isinstance(answers, EngineError):
                row = self.table.inertness(mutation) or NOTHING
                apart = departure(self.still, [observed(answer) for answer in answers])
                if apart <= row.within:
                    verdict = self._verdict(mutation, "inert", why=row.why, row=row.name)
                else:
                    acting[mutation.name] = f"declared inert, but the motion differs by {apart:.1e}: {row.why}"
            yield mutation, verdict

    def _probed(self, batch: Sequence[Mutation]) -> Iterator[tuple[Mutation, Verdict | None]]:
        """By every probe but those of contact."""
        for mutation, answers in self._ask(batch, self.probes.operations(self.engine)):
            verdict = self._refused(mutation, answers)
            if verdict is None and not isinstance(answers, EngineError):
                verdict = self._judged(mutation, partial(self._probe_checks, answers))
            yield mutation, verdict

    def _whole(self, batch: Sequence[Mutation], acting: Mapping[str, str]) -> Iterator[tuple[Mutation, Verdict | None]]:
        """By the whole proof, with its contact probes; else it is missed."""
        for mutation in batch:
            why = acting.get(mutation.name, "")
            yield mutation, self._proven(mutation) or self._verdict(mutation, "missed", why=why)

    def _proven(self, mutation: Mutation) -> Verdict | None:
        with scratch_folder("mutation") as place:
            folder = place / self.engine.NAME
            write_folder({**self.compiled.files, mutation.file: mutation.text}, folder)

            def checks() -> list[Check]:
                artifacts = {self.engine.NAME: folder}
                proof = verify(self.world, [self.engine.NAME], artifacts=artifacts, probes=self.probes)
                return [check for _, check in proof.failures()]

            return self._judged(mutation, checks)

    # --- judging --------------------------------------------------------------------------------------------------

    def _read_back_checks(self, answers: Sequence[Answer]) -> Sequence[Check]:
        return read_back_checks(self.world, self.engine, _held(answers))

    def _probe_checks(self, answers: Sequence[Answer]) -> Sequence[Check]:
        return engine_checks(self.world, self.engine, answers, self.probes)[0]

    def _judged(self, mutation: Mutation, checks: Callable[[], Iterable[Check]]) -> Verdict | None:
        try:
            failures = [check for check in checks() if not check.passed and check.level != "L0"]
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # the proof itself must stand whatever an engine answers
            return self._verdict(mutation, "missed", why=f"the proof fails: {type(error).__name__}: {error}")
        if not failures:
            return None
        first = min(failures, key=lambda check: check.level)
        return self._verdict(mutation, "caught", first.level, f"{first.name}: {first.detail or first.worst}")

    def _refused(self, mutation: Mutation, answers: Sequence[Answer] | EngineError) -> Verdict | None:
        if isinstance(answers, EngineError):
            return self._verdict(mutation, "refused", why=str(answers))
        refusals = [answer.result["refused"] for answer in answers if "refused" in answer.result]
        return self._verdict(mutation, "refused", why=refusals[0]) if refusals else None

    def _verdict(self, mutation: Mutation, verdict: str, by: str = "", why: str = "", row: str = "") -> Verdict:
        place = (mutation.file, mutation.kind, mutation.site, mutation.place, mutation.change)
        return Verdict(self.engine.NAME, self.name, *place, verdict, by, why, row)

    # --- asking ---------------------------------------------------------------------------------------------------

    def _ask(
        self, batch: Sequence[Mutation], operations: Sequence[Operation]
    ) -> Iterator[tuple[Mutation, Sequence[Answer] | EngineError]]:
        """The answers to ``operations`` for each mutation, or the error of the process that ended over it alone."""
        if not batch:
            return
        with scratch_folder("mutations") as place:
            asked = []
            for index, mutation in enumerate(batch):
                folder = place / str(index)
                write_folder({**self.compiled.files, mutation.file: mutation.text}, folder)
                more = {"artifacts": str(folder), "attempt": True, "cpu_seconds": LOST}
                asked += [
                    dataclasses.replace(operation, parameters={**operation.parameters, **more})
                    for operation in operations
                ]
            count = len(operations)
            try:
                deadline = DEADLINE + EACH * len(batch)
                answers = call(self.engine.NAME, place, asked, deadline=deadline).answers
            except EngineError as error:
                failed = error
            else:
                for index, mutation in enumerate(batch):
                    yield mutation, answers[index * count : (index + 1) * count]
                return
        if len(batch) == 1:
            yield batch[0], failed
            return
        # the whole process ended: what it was at is asked alone again, as it can have been ended by what came before
        at = failed.operation // count if failed.operation is not None else len(batch) // 2
        last = at + 1 if failed.operation is not None else at
        for part in (batch[:at], batch[at:last], batch[last:]):
            yield from self._ask(part, operations)


def _batches(planted: Iterable[Mutation]) -> Iterator[list[Mutation]]:
    iterator = iter(planted)
    while batch := list(islice(iterator, BATCH)):
        yield batch


def _held(answers: Sequence[Answer]) -> ReadBack:
    read_back: ReadBack = from_plain(ReadBack, answers[0].result)
    return read_back
