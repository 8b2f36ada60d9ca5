"""Two bodies in random poses with a given overlap, and the contacts of an engine compared with the true gap."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simspec.engines.kit.contract import Engine
from simspec.proof.touch.geometry import ShapeGap, gap, solids, transforms
from simspec.world import frames
from simspec.world.types import World

DEPTH = 1e-4
FAR = 5.0
"""m above the floor."""


def overlaps(
    engine: Engine, world: World, count: int, seed: int
) -> Iterator[tuple[ShapeGap, float | None, float, np.ndarray]]:
    """Of the last two shapes of a world, with random turns and directions between them: the true gap, ``DEPTH`` deep; how far
    (m) the engine's deepest point is off (None: it has no contact), how far its normal is turned (its sine), and the axes of
    both bodies (6, 3). The first of them may be a plane, which stays."""
    first_solid, second_solid = solids(world)[-2:]
    floor = first_solid.shape.kind == "plane"
    base = np.array([0.0, 0.0, 0.0 if floor else FAR])
    draw = np.random.default_rng(seed)
    for _ in range(count):
        turns = [frames.normalise(tuple(draw.normal(size=4).tolist())) for _ in range(2)]
        away = draw.normal(size=3)
        if floor:
            turns[0], away = (1.0, 0.0, 0.0, 0.0), np.array([0.0, 0.0, 1.0])
        away /= np.linalg.norm(away)

        def poses(far: float, turns=turns, away=away) -> np.ndarray:
            return np.array([[*base, *turns[0]], [*(base + far * away), *turns[1]]])

        def between(far: float, poses=poses) -> ShapeGap:
            first, second = transforms(poses(far))
            return gap(first_solid, first, second_solid, second)

        near, far = 0.0, 1.0
        for _ in range(40):
            middle = 0.5 * (near + far)
            near, far = (middle, far) if between(middle).distance < -DEPTH else (near, middle)
        true = between(far)
        q = poses(far)[1:] if floor else poses(far)
        engine.set_state(q.ravel(), np.zeros(6 * len(q)))
        engine.step(1)
        contacts = engine.contacts()
        axes = np.concatenate([np.array(frames.matrix(turn)).T for turn in turns])
        if not len(contacts["distance"]):
            yield true, None, 0.0, axes
            continue
        deepest = int(np.argmin(contacts["distance"]))
        turned = float(np.linalg.norm(np.cross(contacts["normal"][deepest], true.normal)))
        yield true, float(abs(contacts["distance"][deepest] - true.distance)), turned, axes
