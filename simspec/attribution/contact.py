"""The first contact of a run, as both sides have it from the same state: whose it is, and which of its quantities differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.attribution.configuration import Configuration, windows_operation
from simspec.attribution.windows import exact, map_states, touching_pairs
from simspec.engines.kit.process import Answer, Operation

SAME = 1e-6
"""Relative difference from which quantities are told to differ."""
QUANTITIES: Mapping[str, str] = {"points": "", "depth": "m", "normal force": "N"}
"""What is compared of a contact, in this order, with units."""


@dataclass(frozen=True)
class FirstContact:
    """``bodies``: the pair that touches first in the first side's run; by quantity the values on each side, from the same state
    (None: the pair does not touch there); ``differs``: the first quantity that does, "" where none does."""

    bodies: tuple[str, str]
    quantities: Mapping[str, tuple[float | None, float | None]]
    differs: str


def contact_questions(first: Configuration, second: Configuration, run: Answer) -> list[Operation]:
    """What is asked of each side about the first contact of ``run``, which is the first side's: a window up to the row in which
    something touches. Empty where nothing does, or where the second side's steps do not fit between two rows."""
    row, _ = touching_pairs(run.arrays)
    if not len(row):
        return []
    before = int(row[0]) - 1
    steps = run.arrays["step"]
    timestep = exact(first.world.physics.timestep)
    begin, length = int(steps[before]) * timestep, int(steps[before + 1] - steps[before]) * timestep
    states = (run.arrays["q"][before : before + 1], run.arrays["v"][before : before + 1])
    operations = []
    for side in (first, second):
        start, count = (time / exact(side.world.physics.timestep) for time in (begin, length))
        if start.denominator != 1 or count.denominator != 1:
            return []
        q, v = map_states(first.world, side.world, *states)
        operations.append(windows_operation(side, q, v, [start.numerator], count.numerator, contacts=True))
    return operations


def first_contact(sides: tuple[Configuration, Configuration], answers: Sequence[Answer]) -> FirstContact | None:
    """The first contact, from the answers of both sides to :func:`contact_questions`; None where neither has any."""
    contacts = [_by_pair(side, answer) for side, answer in zip(sides, answers, strict=True)]
    pair = next(iter([*contacts[0], *contacts[1]]), None)
    if pair is None:
        return None
    ours, theirs = (contact.get(pair) for contact in contacts)
    values = {name: (ours[name] if ours else None, theirs[name] if theirs else None) for name in QUANTITIES}
    return FirstContact(pair, values, _differs(values))


def _differs(values: Mapping[str, tuple[float | None, float | None]]) -> str:
    for name, (one, other) in values.items():
        if one is None or other is None:
            return "whether they touch"
        if abs(one - other) > SAME * max(abs(one), abs(other)):
            return name
    return ""


def _by_pair(side: Configuration, answer: Answer) -> dict[tuple[str, str], dict[str, float]]:
    """Of each pair of bodies that touches: points, largest depth, normal force of all."""
    _, pairs = touching_pairs(answer.arrays)
    acting = (answer.arrays["contact.normal_force"] > 0.0) | (answer.arrays["contact.distance"] <= 0.0)
    depth, force = -answer.arrays["contact.distance"][acting], answer.arrays["contact.normal_force"][acting]
    names = [body.name for body in side.world.bodies]
    found = {}
    unique: NDArray[np.int64] = np.unique(pairs, axis=0)
    for one, other in unique:
        here = (pairs == (one, other)).all(axis=1)
        first, second = sorted((names[one], names[other]))
        found[first, second] = {
            "points": float(here.sum()),
            "depth": float(depth[here].max()),
            "normal force": float(force[here].sum()),
        }
    return found
