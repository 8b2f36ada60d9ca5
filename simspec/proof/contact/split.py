"""A trial in several worlds: for engines whose time grows faster than the number of bodies in one world.

What does not meet and is not joined does not act on each other, so each body moves as in the whole trial.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from simspec.proof.contact.probe import Motion, Phase, Trial
from simspec.world.types import Body


def split(trial: Trial, most: int | None) -> list[Trial]:
    """``trial`` in parts of at most ``most`` moving bodies each, in their order; None: whole. Fixed roots are in every part;
    bodies that are joined, or that may meet, stay together even where they are more."""
    if most is None:
        return [trial]
    together = list(_together(trial))
    chunks: list[set[str]] = []
    for unit in together:
        if not chunks or len(chunks[-1]) + len(unit) > most:
            chunks.append(set())
        chunks[-1] |= unit
    if len(chunks) < 2:
        return [trial]
    return [_part(trial, chunk) for chunk in chunks]


def _stands(body: Body) -> bool:
    return body.joint.kind == "fixed" and body.joint.parent is None


def _together(trial: Trial) -> Iterator[set[str]]:
    """The names of bodies that have to be in one world, in the order of the first of each."""
    root = {body.name: body.name for body in trial.bodies}

    def find(name: str) -> str:
        while root[name] != name:
            name = root[name]
        return name

    standing = {body.name for body in trial.bodies if _stands(body)}
    of_group: dict[str, list[str]] = {}
    for body in trial.bodies:
        of_group.setdefault(body.collision_group, []).append(body.name)
        if body.joint.parent is not None and body.joint.parent not in standing:
            root[find(body.name)] = find(body.joint.parent)
    for pair in trial.meets:
        names = [name for group in pair for name in of_group.get(group, ()) if name not in standing]
        for name in names[1:]:
            root[find(name)] = find(names[0])
    units: dict[str, set[str]] = {}
    for body in trial.bodies:
        if body.name not in standing:
            units.setdefault(find(body.name), set()).add(body.name)
    yield from units.values()


def _part(trial: Trial, names: set[str]) -> Trial:
    bodies = tuple(body for body in trial.bodies if body.name in names or _stands(body))
    phases = tuple(
        Phase(phase.steps, phase.every, {name: effort for name, effort in phase.effort.items() if name in names})
        for phase in trial.phases
    )
    groups = {body.collision_group for body in bodies}
    return Trial(bodies, phases, tuple(pair for pair in trial.meets if set(pair) <= groups))


def joined(motions: Sequence[Motion]) -> Motion:
    """The motion of a whole trial from those of its parts. Raises ValueError where their times differ."""
    first = motions[0]
    if any(not np.array_equal(first.time, other.time) for other in motions[1:]):
        raise ValueError("parts of a trial were seen at different times")
    pose: dict[str, np.ndarray] = {}
    velocity: dict[str, np.ndarray] = {}
    for motion in motions:
        pose.update(motion.pose)
        velocity.update(motion.velocity)
    return Motion(first.time, pose, velocity)
