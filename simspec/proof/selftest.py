"""Does the proof catch anything? One defect at a time is planted into compiled files, in each engine."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.compiler import Compiled, compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.defects import NAMES
from simspec.dialects.kit.defects import Plant as PlantDefect
from simspec.dialects.kit.mutations import Files, Mutation
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, call, side_by_side
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, UnsupportedError
from simspec.files import scratch_folder
from simspec.proof.certificate import Certificate
from simspec.proof.checks import NOTHING
from simspec.proof.selftest_worlds import EVERY, SMALLER
from simspec.proof.verify import LEVELS, Probes, prepare, verify
from simspec.world.kinematics import layout_of
from simspec.world.types import World

DEADLINE = 400.0
"""Seconds for one defective load, contact probes included: several times what the slowest engine takes for a sound one."""
WORKERS = 2
READ_BACK = LEVELS[:5]
"""Levels at which an engine is read back, and nothing moves."""
BUT_CONTACT = tuple(level for level in LEVELS if level != "L5")


@dataclass(frozen=True, slots=True)
class DefectOutcome:
    """The outcome of one defect in one engine.

    ``caught``: True, False, or None where the engine cannot hold it (``reason`` says why). ``by``: the levels that noticed;
    only those above L0 count as catching, since the text alone says nothing of the engine. ``first``: the first finding.
    """

    engine: str
    defect: str
    caught: bool | None
    by: tuple[str, ...] = ()
    first: str = ""
    reason: str = ""


@dataclass(frozen=True)
class SelfTest:
    """All outcomes, in the order of engines and defects."""

    outcomes: tuple[DefectOutcome, ...]

    @property
    def planted(self) -> int:
        """How many defects were planted (those that the engines can hold)."""
        return sum(outcome.caught is not None for outcome in self.outcomes)

    @property
    def caught(self) -> int:
        """How many of them the proof noticed."""
        return sum(outcome.caught is True for outcome in self.outcomes)

    @property
    def passed(self) -> bool:
        """Whether something was planted and all of it was caught."""
        return self.planted > 0 and self.caught == self.planted


def defects_of(dialect: str) -> Mapping[str, PlantDefect | str]:
    """The table of defects of a dialect: ``DEFECTS`` of its module, or of the module ``defects`` next to it.

    Raises LookupError when the table leaves out a defect.
    """
    module = importlib.import_module(type(dialects()[dialect]).__module__)
    if not hasattr(module, "DEFECTS"):
        module = importlib.import_module(f"{module.__package__}.defects")
    missing = [name for name in NAMES if name not in module.DEFECTS]
    if missing:
        raise LookupError(f"{module.__name__} does not cover {missing}")
    table: Mapping[str, PlantDefect | str] = module.DEFECTS
    return table


def self_test(
    engines: Sequence[str],
    *,
    defects: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
    pythons: Mapping[str, str] | None = None,
    every_level: bool = True,
) -> SelfTest:
    """Plant every defect (or those named) into every engine's files, one at a time, and verify each.

    ``every_level``: False reads engines back first, and moves (L5 to L7, most of the time it takes) only what that does
    not notice.

    Before the first defect of a world, the world itself must verify: a proof that refuses a sound world catches nothing.
    Contact (L5) is measured in it before the first defect that is looked for there. Raises AssertionError where it does not
    verify.
    """
    say = progress or (lambda text: None)
    outcomes: list[DefectOutcome] = []
    with WarmProcesses() as warm:
        for engine in engines:
            bench = _EngineBench(engine, pythons or {}, every_level, warm)
            names = [name for name in NAMES if defects is None or name in defects]
            for world in dict.fromkeys(NAMES[name] for name in names):
                say(f"{engine}: the sound world “{world}”")
                bench.open(world)
            say(f"{engine}: {len(names)} defects")
            with side_by_side(WORKERS) as pool:
                outcomes.extend(pool.map(bench.plant, names))
    return SelfTest(tuple(outcomes))


class _Sound:
    """A sound world of one engine: compiled, with its probes, and proven to be sound at the requested levels."""

    def __init__(self, name: str, world: World, compiled: Compiled, prove: Callable[..., Certificate]):
        self.name, self.world, self.compiled = name, world, compiled
        self._prove = prove
        self._precision = find_engine(compiled.engine).PRECISION
        self._probes: dict[tuple[str, ...], Probes] = {}
        self._proven: set[str] = set()
        self._lock = threading.Lock()

    def probes(self, levels: tuple[str, ...]) -> Probes:
        """Those of some levels, at which the world itself verifies. Raises AssertionError where it does not."""
        with self._lock:
            if levels not in self._probes:
                self._probes[levels] = prepare(self.world, levels, self._precision)
            new = tuple(level for level in levels if level not in self._proven)
            if new:
                self._demand(new)
                self._proven.update(levels)
            return self._probes[levels]

    def _demand(self, levels: tuple[str, ...]) -> None:
        engine = self.compiled.engine
        certificate = self._prove(self.world, [engine], compiled={engine: self.compiled}, levels=levels)
        if not certificate.valid:
            _, check = certificate.failures()[0]
            raise AssertionError(
                f"{engine}: the sound world {self.name!r} fails {check.level} {check.name}: {check.detail}"
            )


class _EngineBench:
    """One engine's sound worlds."""

    def __init__(self, engine: str, pythons: Mapping[str, str], every_level: bool, warm: WarmProcesses):
        self.engine = engine
        self._tries = (LEVELS,) if every_level else (READ_BACK, LEVELS)
        self._sound_at = LEVELS if every_level else BUT_CONTACT
        self._prove = functools.partial(verify, pythons=pythons, deadline=DEADLINE, warm=warm)
        self._sound: dict[str, _Sound | str] = {}

    def open(self, name: str) -> None:
        world = EVERY[name](self.engine)
        try:
            compiled = compile_world(world, [self.engine])[self.engine]
        except UnsupportedError as error:
            self._sound[name] = error.problems[0].message
            if name in SMALLER:
                self.open(SMALLER[name][0])
            return
        sound = self._sound[name] = _Sound(name, world, compiled, self._prove)
        sound.probes(self._sound_at)

    def plant(self, defect: str) -> DefectOutcome:
        name = NAMES[defect]
        sound = self._sound[name]
        while isinstance(self._sound[name], str) and name in SMALLER:
            name, fitting = SMALLER[name]
            if defect in fitting and not isinstance(self._sound[name], str):
                sound = self._sound[name]
        if isinstance(sound, str):
            return DefectOutcome(self.engine, defect, None, reason=sound)
        plant = defects_of(sound.compiled.dialect)[defect]
        if isinstance(plant, str):
            return DefectOutcome(self.engine, defect, None, reason=plant)
        with scratch_folder("defect") as place:
            folder = place / self.engine
            write_folder(plant(sound.compiled.files), folder)
            for levels in self._tries:
                certificate = self._prove(
                    sound.world,
                    [self.engine],
                    compiled={self.engine: sound.compiled},
                    artifacts={self.engine: folder},
                    levels=levels,
                    probes=sound.probes(levels),
                )
                failures = [check for _, check in certificate.failures()]
                # a missing comparison because of a refused text says nothing of the engine
                beyond_text = [check for check in failures if check.level != "L0" and check.name != NOTHING]
                if beyond_text:
                    break
        levels_that_noticed = tuple(sorted({check.level for check in failures}))
        first = beyond_text[0] if beyond_text else None
        said = f"{first.level} {first.name}: {first.detail or first.worst}" if first else ""
        return DefectOutcome(self.engine, defect, bool(beyond_text), levels_that_noticed, said)


# The same questions about many changed folders of files, in one process of an engine.
#
# The process works on each separately (``engines/kit/worker.py``): one that crashes is refused, and the next one follows.

Answers = Sequence[Answer] | EngineError
"""One for each operation, or the error of a process that ended over one plant alone."""
ANSWERS_DEADLINE = 60.0
"""Seconds of one process, and ``EACH`` more for each operation in it, or ``SLOWER`` times what the unchanged files take."""
EACH = 0.5
LOST = 10.0
"""Seconds of CPU after which one operation is given up, or ``SLOWER`` times what the unchanged files take, beyond what the
engine may take to compile: some changed files
make an engine go round in circles (parents that are each other's)."""
SLOWER = 20.0


@dataclass(frozen=True)
class Plant:
    """Mutations that are made together, and the texts of the files that they change."""

    members: tuple[Mutation, ...]
    files: Mapping[str, str]

    @classmethod
    def of(cls, mutation: Mutation) -> Plant:
        """One mutation alone."""
        return cls((mutation,), {mutation.file: mutation.text})


def ask(
    engine: str,
    files: Files,
    plants: Sequence[Plant],
    operations: Sequence[Operation],
    longest: float,
    python: str | None = None,
) -> Iterator[tuple[Plant, Answers]]:
    """The answers to ``operations`` about ``files`` with each of ``plants``. ``longest``: s that one operation takes at most
    with the unchanged files."""
    if not plants:
        return
    compiling = find_engine(engine).COMPILING
    with scratch_folder("mutations") as place:
        requested = []
        lost = max(LOST, SLOWER * longest) + compiling
        for index, plant in enumerate(plants):
            folder = place / str(index)
            write_folder({**files, **plant.files}, folder)
            more = {"artifacts": str(folder), "attempt": True, "cpu_seconds": lost}
            requested += [
                dataclasses.replace(operation, parameters={**operation.parameters, **more}) for operation in operations
            ]
        count = len(operations)
        try:
            deadline = ANSWERS_DEADLINE + max(EACH, SLOWER * longest) * len(requested) + compiling * len(plants)
            answers = call(engine, place, requested, python=python, deadline=deadline).answers
        except EngineError as error:
            failed = error
        else:
            for index, plant in enumerate(plants):
                yield plant, answers[index * count : (index + 1) * count]
            return
    if len(plants) == 1:
        yield plants[0], failed
        return
    # the whole process ended: its last request is repeated alone, since an earlier one can have ended it
    at = failed.operation // count if failed.operation is not None else len(plants) // 2
    last = at + 1 if failed.operation is not None else at
    for part in (plants[:at], plants[at:last], plants[last:]):
        yield from ask(engine, files, part, operations, longest, python)


# Motions of the complete self-test that show whether a mutation acts, and how far two answers to them differ.

SCENE_STEPS = 600
SCENE_EVERY = 20
GLIMPSE = 20
"""Steps that a motion takes in a glimpse of it."""
WINDOW = 4
"""Steps of a window."""
WINDOWS = 10
"""States of the unchanged files' motion from which windows begin: as it is there, and struck."""
STRUCK = 1.0
"""m/s and rad/s by which velocities of struck windows differ at most."""
SEED = 12


@dataclasses.dataclass(frozen=True)
class Seen:
    """Scenes, and what the unchanged files do in them: ``sound``. ``unsteady``: how far they depart from it the next time;
    ``seconds``: the time of each."""

    operations: tuple[Operation, ...]
    sound: tuple[Mapping[str, np.ndarray], ...]
    unsteady: float
    seconds: tuple[float, ...]

    @classmethod
    def of(cls, operations: Sequence[Operation], answers: Sequence[Answer]) -> Seen:
        """``answers``: to each of ``operations``, twice."""
        once, again = (answers[: len(operations)], answers[len(operations) :])
        values = tuple(observed(answer) for answer in once)
        unsteady = departure(values, [observed(answer) for answer in again])
        seconds = tuple(answer.load_seconds + answer.seconds for answer in again)
        return cls(tuple(operations), values, unsteady, seconds)

    def departure(self, answers: Sequence[Answer]) -> float:
        """How far ``answers`` to the same operations are from what the unchanged files do."""
        return departure(self.sound, [observed(answer) for answer in answers])


def glimpses_of(world: World, whole: Sequence[Operation], course: Mapping[str, np.ndarray]) -> tuple[Operation, ...]:
    """The beginnings of the ``whole`` scenes, and windows that begin along the ``course`` (``q``, ``v``) of the unchanged
    files: in contact, at limits, and wherever else it leads to."""
    q, v = (np.array(course[name][:WINDOWS]) for name in ("q", "v"))
    struck = v + np.random.default_rng(SEED).uniform(-STRUCK, STRUCK, v.shape)
    windows = {"starts": [0] * (2 * len(q)), "steps": WINDOW, "channels": []}
    begun = []
    for operation in whole:
        requested = dict(operation.parameters)
        if operation.op == "drive":
            requested["phases"] = [
                [min(steps, GLIMPSE // len(requested["phases"])), 1] for steps, _ in requested["phases"]
            ]
        elif "steps" in requested:
            requested |= {"steps": min(requested["steps"], GLIMPSE), "every": 1}
        begun.append(dataclasses.replace(operation, parameters=requested))
    states = {"q": np.concatenate([q, q]), "v": np.concatenate([v, struck])}
    return (*begun, Operation("windows", windows, states, world))


def course_of(world: World) -> Operation:
    """The operation that gives the course of the unchanged files when they are left alone."""
    return Operation("run", {"steps": SCENE_STEPS, "every": SCENE_STEPS // (WINDOWS - 1), "channels": []}, {}, world)


def scenes_of(world: World, probes: Probes, engine: type[Engine]) -> tuple[Operation, ...]:
    """Motions that show whether a change acts: left alone, pushed about, without contact, under control; and who touches."""
    nv = layout_of(world).nv
    generator = np.random.default_rng(SEED)
    weight = np.abs(np.diag(probes.oracle.mass_matrix(probes.q[0]))) if nv else np.zeros(0)
    pushed = generator.uniform(-5.0, 5.0, (2, nv)) * weight
    timed = {"timestep": world.physics.timestep}
    alone = {**timed, "phases": [[SCENE_STEPS, SCENE_EVERY]]}
    shoved = {**timed, "phases": [[SCENE_STEPS // 4, SCENE_EVERY], [SCENE_STEPS // 2, SCENE_EVERY]]}
    return (
        Operation("drive", alone, {"effort": np.zeros((1, nv))}),
        Operation("drive", shoved, {"effort": pushed}),
        *(
            _shortened(operation)
            for operation in probes.operations(engine)
            if operation.op in ("motion", "respond", "touching")
        ),
    )


def _shortened(operation: Operation) -> Operation:
    """A motion of at most ``SCENE_STEPS``: a change that acts has shown by then."""
    steps = operation.parameters.get("steps")
    if steps is None:
        return operation
    return dataclasses.replace(operation, parameters={**operation.parameters, "steps": min(steps, SCENE_STEPS)})


def observed(answer: Answer) -> Mapping[str, np.ndarray]:
    """The arrays of a scene's answer, with touching shapes by name, not by their place in the engine's list."""
    if "units" not in answer.result:
        return answer.arrays
    names = [(unit["body"], *unit["shapes"]) for unit in answer.result["units"]]
    order = np.argsort(np.argsort(np.array([repr(name) for name in names], dtype=object), kind="stable"), kind="stable")
    rows = answer.arrays["units"]
    shapes = order[rows[:, 1:]]
    renamed = np.column_stack([rows[:, :1], np.sort(shapes, axis=1)])
    return {**answer.arrays, "units": renamed[np.lexsort(renamed.T[::-1])]}


def departure(first: Sequence[Mapping[str, np.ndarray]], other: Sequence[Mapping[str, np.ndarray]]) -> float:
    """How far two answers to the same scenes differ, relative to the larger of one and the value; infinite when they
    differ in kind or one is not finite. A quaternion and its negative are the same; ``q`` is what poses say too."""
    if len(first) != len(other):
        return math.inf
    worst = 0.0
    for a, b in zip(first, other, strict=True):
        if a.keys() != b.keys() or any(a[name].shape != b[name].shape for name in a):
            return math.inf
        for name in a.keys() - {"q"}:
            values = b[name]
            if name == "pose" and values.size:
                first_turn, turn = a[name][..., 3:], values[..., 3:]
                same_way = np.sum(first_turn * turn, axis=-1, keepdims=True)
                values = np.concatenate([values[..., :3], turn * np.where(same_way < 0.0, -1.0, 1.0)], axis=-1)
            value = float(np.max(np.abs(a[name] - values) / np.maximum(1.0, np.abs(a[name])), initial=0.0))
            worst = max(worst, value) if math.isfinite(value) else math.inf
    return worst
