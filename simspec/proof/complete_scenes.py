"""Motions of the complete self-test that show whether a mutation acts, and how far two answers to them are apart."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation
from simspec.proof.verify import Probes
from simspec.world.kinematics import layout_of
from simspec.world.types import World

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
        still = tuple(observed(answer) for answer in once)
        unsteady = departure(still, [observed(answer) for answer in again])
        seconds = tuple(answer.load_seconds + answer.seconds for answer in again)
        return cls(tuple(operations), still, unsteady, seconds)

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
        asked = dict(operation.parameters)
        if operation.op == "drive":
            asked["phases"] = [[min(steps, GLIMPSE // len(asked["phases"])), 1] for steps, _ in asked["phases"]]
        elif "steps" in asked:
            asked |= {"steps": min(asked["steps"], GLIMPSE), "every": 1}
        begun.append(dataclasses.replace(operation, parameters=asked))
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
            apart = float(np.max(np.abs(a[name] - values) / np.maximum(1.0, np.abs(a[name])), initial=0.0))
            worst = max(worst, apart) if math.isfinite(apart) else math.inf
    return worst
