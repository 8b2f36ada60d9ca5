"""The same questions about many changed folders of files, in one process of an engine.

The process works on each apart (``engines/kit/attempts.py``): one that crashes is refused, and the next one follows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.compiler import write_folder
from simspec.dialects.kit.mutations import Files, Mutation
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.proof.verify import Probes
from simspec.world.kinematics import layout_of
from simspec.world.types import World

Answers = Sequence[Answer] | EngineError
"""One for each operation, or the error of a process that ended over one plant alone."""
DEADLINE = 60.0
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
            deadline = DEADLINE + max(EACH, SLOWER * longest) * len(requested) + compiling * len(plants)
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
    # the whole process ended: what it was at is asked alone again, as it can have been ended by what came before
    at = failed.operation // count if failed.operation is not None else len(plants) // 2
    last = at + 1 if failed.operation is not None else at
    for part in (plants[:at], plants[at:last], plants[last:]):
        yield from ask(engine, files, part, operations, longest, python)


# Motions of the complete self-test that show whether a mutation acts, and how far two answers to them are apart.

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
    """Scenes, and what the unchanged files do in them: ``still``. ``unsteady``: how far they depart from it the next time;
    ``seconds``: what each takes."""

    operations: tuple[Operation, ...]
    still: tuple[Mapping[str, np.ndarray], ...]
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
        return departure(self.still, [observed(answer) for answer in answers])


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
    """What is asked of the unchanged files to know their course when they are left alone."""
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
    """A motion of at most ``SCENE_STEPS``: what acts has shown by then."""
    steps = operation.parameters.get("steps")
    if steps is None:
        return operation
    return dataclasses.replace(operation, parameters={**operation.parameters, "steps": min(steps, SCENE_STEPS)})


def observed(answer: Answer) -> Mapping[str, np.ndarray]:
    """The arrays of a scene's answer, with what touches told by what it is, not by the place it has in the engine's list."""
    if "units" not in answer.result:
        return answer.arrays
    names = [(unit["body"], *unit["shapes"]) for unit in answer.result["units"]]
    order = np.argsort(np.argsort(np.array([repr(name) for name in names], dtype=object), kind="stable"), kind="stable")
    rows = answer.arrays["units"]
    renamed = np.column_stack([rows[:, :1], np.sort(order[rows[:, 1:]], axis=1)])
    return {**answer.arrays, "units": renamed[np.lexsort(renamed.T[::-1])]}


def departure(first: Sequence[Mapping[str, np.ndarray]], other: Sequence[Mapping[str, np.ndarray]]) -> float:
    """How far two answers to the same scenes are apart, relative to the larger of one and the value; infinite when they
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
                same_way = np.sign(np.sum(a[name][..., 3:] * values[..., 3:], axis=-1, keepdims=True))
                values = np.concatenate(
                    [values[..., :3], values[..., 3:] * np.where(same_way < 0.0, -1.0, 1.0)], axis=-1
                )
            value = float(np.max(np.abs(a[name] - values) / np.maximum(1.0, np.abs(a[name])), initial=0.0))
            worst = max(worst, value) if math.isfinite(value) else math.inf
    return worst
