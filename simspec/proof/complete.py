"""The complete self-test: every change that compiled files can suffer, one at a time, and what the proof makes of it.

Each mutation (``dialects/kit/mutations.py``) is tried in stages, and leaves at the first that notices it. One that the engine
refuses needs no proof. Then what the engine says it holds (levels L1, L2 and L4). One that its format declares inert must now
move every body as the unchanged files do, with contact, without and under control, within 1e-12. All else goes on to what the
engine is probed for (L2 to L4, L6, L7), and to the whole proof with its contact probes (L5); a mutation that the proof does not
notice is *missed*. Level L0 does not count: the text alone says nothing of the engine.

Whole motions take most of the time. So what is declared inert is seen twice: alone in glimpses (the beginnings of all motions,
and windows along the course of the unchanged files; an engine that hashes all that its numbers follow from,
``ReadBack.made_of``, need not move where that is the same), and together with others in whole motions. That counts where both
agree with the unchanged files *to the last bit*; else the mutation moves alone, in whole. Mutations that move together are in
different elements (``dialects/kit/mutating.py``), and a group that moves otherwise, or is refused, is halved until a part of it
does not, or is one mutation. One that acts could be taken for inert only if it changed no bit in any glimpse, and another of
its group, without effect in its own glimpses too, undid it to the last bit in every motion.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice

from simspec.compiler import Compiled, compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.mutating import Together, mutations
from simspec.dialects.kit.mutations import KINDS, SAME_MOTION, Inert, Mutation, MutationTable
from simspec.engines.kit.capabilities import DOUBLE, ROUNDING
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, call, side_by_side
from simspec.engines.kit.registry import find_engine, version_of
from simspec.errors import EngineError, UnsupportedError
from simspec.files import scratch_folder
from simspec.proof.checks import Check
from simspec.proof.mutation_worlds import STAND_INS, WORLDS
from simspec.proof.selftest import Answers, Plant, Seen, ask, course_of, glimpses_of, scenes_of
from simspec.proof.verify import Probes, engine_checks, prepare, read_back_checks, verify
from simspec.world.canonical import from_plain
from simspec.world.types import ReadBack, World

# Verdicts on the mutations of the complete self-test, and their counts.

VERDICTS = ("caught", "refused", "inert", "missed")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one mutation: ``verdict`` is one of ``VERDICTS``, ``by`` the first level that noticed, ``why`` what it
    said, or what the engine refused it with, or the reason that is declared for its being inert; ``row`` names the row of
    the dialect's table that declares it."""

    engine: str
    world: str
    file: str
    kind: str
    site: str
    place: str
    change: str
    verdict: str
    by: str = ""
    why: str = ""
    row: str = ""


@dataclass(frozen=True)
class CompleteTest:
    """All verdicts; ``skipped``: worlds that an engine was not tested with, with the reason, by "engine, world"; ``versions``
    by engine; ``seconds`` in all; ``unused``: by engine the rows of its dialect's table that declare something inert and no
    change needed, known only when every world and every change was tried."""

    verdicts: tuple[Verdict, ...]
    skipped: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    unused: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def count(self, engine: str | None = None, kind: str | None = None, verdict: str | None = None) -> int:
        """How many there are of an engine, a kind of change, a verdict (None: all)."""
        return sum(
            engine in (None, entry.engine) and kind in (None, entry.kind) and verdict in (None, entry.verdict)
            for entry in self.verdicts
        )

    @property
    def engines(self) -> tuple[str, ...]:
        """The engines, in the order in which they were tested."""
        return tuple(dict.fromkeys(verdict.engine for verdict in self.verdicts))

    @property
    def missed(self) -> tuple[Verdict, ...]:
        """The mutations that were not noticed."""
        return tuple(verdict for verdict in self.verdicts if verdict.verdict == "missed")

    @property
    def passed(self) -> bool:
        """Whether something was planted and nothing missed."""
        return bool(self.verdicts) and not self.missed

    def rows(self) -> list[tuple[str, str, tuple[int, ...]]]:
        """(engine, kind, (planted, caught, refused, inert, missed)) for each that occurs, and a sum ("all") per engine."""
        rows = []
        for engine in self.engines:
            for kind in (*KINDS, None):
                counts = tuple(self.count(engine, kind, verdict) for verdict in (None, *VERDICTS))
                if counts[0]:
                    rows.append((engine, kind or "all", counts))
        return rows


def unused_rows(table: MutationTable, verdicts: Iterable[Verdict]) -> tuple[str, ...]:
    """The rows of ``table`` that declare something inert, and by which none of ``verdicts`` is."""
    used = {verdict.row for verdict in verdicts if verdict.verdict == "inert"}
    return tuple(dict.fromkeys(row.name for row in table.inert if row.name not in used))


NOTHING = Inert("", "")
BATCH = 300
"""Mutations that share a process."""
SHORT = 0.3
"""s that whole motions of unchanged files take, below which nothing is won by glimpses."""
WORKERS = 2


def table_of(dialect: str) -> MutationTable:
    """``TABLE`` of a dialect's module, or of the module ``mutations`` or ``defects`` next to it; empty without one."""
    text = type(dialects()[dialect]).__module__
    package = text.rpartition(".")[0]
    for name in (text, f"{package}.mutations", f"{package}.defects"):
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                raise
            continue
        if hasattr(module, "TABLE"):
            table: MutationTable = module.TABLE
            return table
    return MutationTable()


def complete_self_test(
    engines: Sequence[str],
    *,
    worlds: Sequence[str] = (),
    done: Collection[str] = (),
    only: Callable[[Mutation], bool] | None = None,
    progress: Callable[[str], None] | None = None,
    keep: Callable[[str, Sequence[Verdict], float], None] = lambda world, verdicts, seconds: None,
    pythons: Mapping[str, str] | None = None,
) -> CompleteTest:
    """Try every mutation of every world (or of those named) in every engine, but of those that are ``done``.

    ``only`` chooses among the mutations; ``keep`` is called with each world as soon as it is done, and the seconds it took;
    ``pythons``: the interpreters of engines that do not live in this one. A world that only stands in for another
    (``STAND_INS``) is left out for engines that support that one, unless it is named.

    Raises AssertionError when an unchanged world does not verify, or does not move twice alike: then nothing could be said.
    """
    say = progress or (lambda text: None)
    started = time.monotonic()
    verdicts: list[Verdict] = []
    skipped: dict[str, str] = {}
    unused: dict[str, tuple[str, ...]] = {}
    for engine in engines:
        python = (pythons or {}).get(engine)
        tried: list[Verdict] = []
        stand_ins: dict[str, str] = {}
        for name in worlds or WORLDS:
            larger = stand_ins.get(name)
            bench: _WorldBench | str
            if name in done:
                bench, larger = "was done before", larger or name
            elif larger:
                bench = f"stands in for the world {larger!r}, which the engine has"
            else:
                bench = _WorldBench.of(engine, name, python)
            if name in STAND_INS and not worlds and (larger or not isinstance(bench, str)):
                stand_ins[STAND_INS[name]] = larger or name
            if isinstance(bench, str):
                skipped[f"{engine}, {name}"] = bench
                continue
            begun = time.monotonic()
            of_world = bench.verdicts(only or (lambda mutation: True))
            tried += of_world
            missed = sum(verdict.verdict == "missed" for verdict in of_world)
            spent = time.monotonic() - begun
            say(f"{engine}, {name}: {len(of_world)} mutations, {missed} missed, {spent:.0f} s")
            keep(name, of_world, spent)
        verdicts += tried
        if not worlds and not done and only is None:
            unused[engine] = unused_rows(table_of(find_engine(engine).DIALECT), tried)
    versions = {engine: str(version_of(engine, (pythons or {}).get(engine))) for engine in engines}
    return CompleteTest(tuple(verdicts), skipped, versions, time.monotonic() - started, unused)


@dataclass
class _MutationVerdicts:
    """The verdicts on some mutations: ``verdicts`` by name; ``steady``: those that are declared inert, and are in glimpses;
    ``acting``: by name what was seen of those that are declared inert and act; ``same``: names of those that leave all that the
    engine's numbers follow from as it was, where it says so."""

    verdicts: dict[str, Verdict] = field(default_factory=dict)
    steady: list[Mutation] = field(default_factory=list)
    acting: dict[str, str] = field(default_factory=dict)
    same: set[str] = field(default_factory=set)

    def left(self, batch: Iterable[Mutation]) -> list[Mutation]:
        """Those of a batch that go on to the next stage."""
        steady = {mutation.name for mutation in self.steady}
        return [mutation for mutation in batch if mutation.name not in self.verdicts and mutation.name not in steady]

    def add(self, other: _MutationVerdicts) -> None:
        """Add what became of others."""
        self.verdicts |= other.verdicts
        self.steady += other.steady


@dataclass(frozen=True)
class _WorldBench:
    """One world in one engine: compiled, proven sound, and what it does when it is left alone."""

    name: str
    engine: type[Engine]
    world: World
    compiled: Compiled
    probes: Probes
    table: MutationTable
    whole: Seen
    glimpses: Seen
    made_of: str
    """The hash of all that the engine's numbers follow from with the unchanged files; "" where it gives none."""
    python: str | None

    @classmethod
    def of(cls, engine: str, name: str, python: str | None = None) -> _WorldBench | str:
        """The bench, or the reason why this engine cannot have this world."""
        world = WORLDS[name](engine)
        try:
            compiled = compile_world(world, [engine])[engine]
        except UnsupportedError as error:
            return error.problems[0].message
        probes = prepare(world, precision=find_engine(engine).PRECISION)
        certificate = verify(world, [engine], probes=probes, pythons=_given(engine, python))
        if not certificate.valid:
            _, check = certificate.failures()[0]
            raise AssertionError(f"{engine}: the sound world {name!r} fails {check.level} {check.name}: {check.detail}")
        scenes = scenes_of(world, probes, find_engine(engine))
        with scratch_folder("sound") as place:
            write_folder(compiled.files, place / engine)
            requested = partial(call, engine, place / engine, python=python)
            course, *answers = requested([course_of(world), *scenes, *scenes]).answers
            whole = Seen.of(scenes, answers)
            glimpses = glimpses_of(world, scenes, course.arrays)
            looked = Seen.of(glimpses, requested([*glimpses, *glimpses]).answers)
            read_back = _stored_model(requested([Operation("read_back")]).answers)
        if max(whole.unsteady, looked.unsteady) > SAME_MOTION:
            raise AssertionError(f"{engine}: the world {name!r} does not repeat its own motion")
        table = table_of(compiled.dialect)
        return cls(name, find_engine(engine), world, compiled, probes, table, whole, looked, read_back.made_of, python)

    def verdicts(self, only: Callable[[Mutation], bool]) -> list[Verdict]:
        planted = (mutation for mutation in mutations(self.compiled.files, self.table) if only(mutation))
        names: list[str] = []
        found = _MutationVerdicts()
        with side_by_side(WORKERS) as pool:
            # batches are made on demand: all texts at once would be large
            for of_batch, batch_names in pool.map(self._batch, _batches(planted)):
                found.add(of_batch)
                names += batch_names
            together = Together(self.compiled.files)
            groups = [Plant(tuple(group), together.files(group)) for group in together.groups(found.steady)]
            shares = [groups[worker::WORKERS] for worker in range(WORKERS)]
            for settled, alone in pool.map(partial(self._together, together), shares):
                found.verdicts |= settled
                found.add(self._alone(alone))
        return [found.verdicts[name] for name in names]

    def _batch(self, batch: Sequence[Mutation]) -> tuple[_MutationVerdicts, list[str]]:
        found = _MutationVerdicts()
        for stage in (self._stored_model, self._untouched, self._glimpsed, self._unmoved, self._probed, self._shown):
            left = found.left(batch)
            if not left:
                break
            stage(left, found)
        return found, [mutation.name for mutation in batch]

    def _alone(self, batch: Sequence[Mutation]) -> _MutationVerdicts:
        """The verdicts on mutations that move otherwise in whole motions."""
        found = _MutationVerdicts()
        for stage in (self._unmoved, self._probed, self._shown):
            if left := found.left(batch):
                stage(left, found)
        return found

    # --- stages ---------------------------------------------------------------------------------------------------

    def _stored_model(self, batch: Sequence[Mutation], found: _MutationVerdicts) -> None:
        """By what the engine says it holds."""
        self._judge(batch, found, [Operation("read_back")], self._read_back_checks)

    def _untouched(self, batch: Sequence[Mutation], found: _MutationVerdicts) -> None:
        """Mutations that are declared inert and change nothing that the engine's numbers follow from: they need no glimpses."""
        found.steady += [mutation for mutation in self._declared(batch) if mutation.name in found.same]

    def _glimpsed(self, batch: Sequence[Mutation], found: _MutationVerdicts) -> None:
        """Mutations that are declared inert, in glimpses: their motion is the same to the last bit, or they are noted."""
        if sum(self.whole.seconds) < SHORT:
            return
        for mutation, answers in self._ask(self._declared(batch), self.glimpses.operations):
            if (refused := self._refused(mutation, answers)) is not None:
                found.verdicts[mutation.name] = refused
            elif not isinstance(answers, EngineError):
                departure = self.glimpses.departure(answers)
                if departure == 0.0:
                    found.steady.append(mutation)
                else:
                    self._note(mutation, departure, found)

    def _unmoved(self, batch: Sequence[Mutation], found: _MutationVerdicts) -> None:
        """Mutations that are declared inert must move as the sound files do; others are noted, and go on."""
        left = [mutation for mutation in self._declared(batch) if mutation.name not in found.acting]
        for mutation, answers in self._ask(left, self.whole.operations):
            if (refused := self._refused(mutation, answers)) is not None:
                found.verdicts[mutation.name] = refused
            elif not isinstance(answers, EngineError):
                departure = self.whole.departure(answers)
                if not self._note(mutation, departure, found):
                    found.verdicts[mutation.name] = self._inert(mutation)

    def _together(self, together: Together, groups: Sequence[Plant]) -> tuple[dict[str, Verdict], list[Mutation]]:
        """The verdicts of those that are shown to be inert together with others, and those to be seen alone."""
        settled: dict[str, Verdict] = {}
        alone: list[Mutation] = []
        waiting = list(groups)
        while waiting:
            plants, waiting = waiting, []
            for plant, answers in self._put(plants, self.whole.operations):
                members, same = plant.members, not self._refusals(answers)
                if same and not isinstance(answers, EngineError) and self.whole.departure(answers) == 0.0:
                    settled |= {mutation.name: self._inert(mutation) for mutation in members}
                elif len(members) == 1:
                    alone += members
                else:
                    half = len(members) // 2
                    waiting += [Plant(part, together.files(part)) for part in (members[:half], members[half:])]
        return settled, alone

    def _probed(self, batch: Sequence[Mutation], found: _MutationVerdicts) -> None:
        """By every probe but those of contact."""
        self._judge(batch, found, self.probes.operations(self.engine), self._probe_checks)

    def _shown(self, batch: Sequence[Mutation], found: _MutationVerdicts) -> None:
        """By the whole proof, with its contact probes; else it is missed."""
        for mutation in batch:
            why = found.acting.get(mutation.name, "")
            found.verdicts[mutation.name] = self._proven(mutation) or self._verdict(mutation, "missed", why=why)

    def _proven(self, mutation: Mutation) -> Verdict | None:
        with scratch_folder("mutation") as place:
            folder = place / self.engine.NAME
            write_folder({**self.compiled.files, mutation.file: mutation.text}, folder)

            def checks() -> list[Check]:
                artifacts = {self.engine.NAME: folder}
                pythons = _given(self.engine.NAME, self.python)
                proof = verify(self.world, [self.engine.NAME], artifacts=artifacts, probes=self.probes, pythons=pythons)
                return [check for _, check in proof.failures()]

            return self._judged(mutation, checks)

    def _declared(self, batch: Iterable[Mutation]) -> list[Mutation]:
        return [mutation for mutation in batch if self.table.inertness(mutation) is not None]

    def _inert(self, mutation: Mutation) -> Verdict:
        row = self.table.inertness(mutation) or NOTHING
        return self._verdict(mutation, "inert", why=row.why, row=row.name)

    def _note(self, mutation: Mutation, difference: float, found: _MutationVerdicts) -> bool:
        """Whether a mutation moves otherwise than its row allows; then it is noted."""
        row = self.table.inertness(mutation) or NOTHING
        acts = difference > max(row.within, SAME_MOTION * ROUNDING[self.engine.PRECISION] / ROUNDING[DOUBLE])
        if acts:
            found.acting[mutation.name] = f"declared inert, but the motion differs by {difference:.1e}: {row.why}"
        return acts

    # --- judging --------------------------------------------------------------------------------------------------

    def _read_back_checks(self, answers: Sequence[Answer]) -> Sequence[Check]:
        return read_back_checks(self.world, self.engine, _stored_model(answers))

    def _probe_checks(self, answers: Sequence[Answer]) -> Sequence[Check]:
        return engine_checks(self.world, self.engine, answers, self.probes)[0]

    def _judge(
        self,
        batch: Sequence[Mutation],
        found: _MutationVerdicts,
        operations: Sequence[Operation],
        checks: Callable[[Sequence[Answer]], Sequence[Check]],
    ) -> None:
        for mutation, answers in self._ask(batch, operations):
            verdict = self._refused(mutation, answers)
            if verdict is None and not isinstance(answers, EngineError):
                verdict = self._judged(mutation, partial(checks, answers))
                if self.made_of and answers[0].result.get("made_of") == self.made_of:
                    found.same.add(mutation.name)
            if verdict is not None:
                found.verdicts[mutation.name] = verdict

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

    def _refused(self, mutation: Mutation, answers: Answers) -> Verdict | None:
        refusals = self._refusals(answers)
        return self._verdict(mutation, "refused", why=refusals[0]) if refusals else None

    def _refusals(self, answers: Answers) -> list[str]:
        if isinstance(answers, EngineError):
            return [str(answers)]
        return [answer.result["refused"] for answer in answers if "refused" in answer.result]

    def _verdict(self, mutation: Mutation, verdict: str, by: str = "", why: str = "", row: str = "") -> Verdict:
        place = (mutation.file, mutation.kind, mutation.site, mutation.place, mutation.change)
        return Verdict(self.engine.NAME, self.name, *place, verdict, by, why, row)

    # --- asking ---------------------------------------------------------------------------------------------------

    def _ask(self, batch: Sequence[Mutation], operations: Sequence[Operation]) -> Iterator[tuple[Mutation, Answers]]:
        for plant, answers in self._put([Plant.of(mutation) for mutation in batch], operations):
            yield plant.members[0], answers

    def _put(self, plants: Sequence[Plant], operations: Sequence[Operation]) -> Iterator[tuple[Plant, Answers]]:
        files, longest = self.compiled.files, max(self.whole.seconds)
        return ask(self.engine.NAME, files, plants, operations, longest, self.python)


def _batches(planted: Iterable[Mutation]) -> Iterator[list[Mutation]]:
    iterator = iter(planted)
    while batch := list(islice(iterator, BATCH)):
        yield batch


def _given(engine: str, python: str | None) -> dict[str, str]:
    return {} if python is None else {engine: python}


def _stored_model(answers: Sequence[Answer]) -> ReadBack:
    read_back: ReadBack = from_plain(ReadBack, answers[0].result)
    return read_back
