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
SEED = 12


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
