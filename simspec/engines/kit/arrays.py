"""The arrays that engines answer, and what their modules make them with."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.errors import EngineError
from simspec.world.rotations import cross, rotate

CONTACT_FIELDS: Mapping[str, tuple[int, ...]] = {
    "body": (2,),
    "position": (3,),
    "normal": (3,),
    "distance": (),
    "normal_force": (),
}
"""The arrays of ``Engine.contacts`` and the shape of one row. ``body``: indices into the world's bodies; ``position``: in
the world (m); ``normal``: unit vector in the world, pointing from the second body to the first; ``distance``: gap in m,
negative when the bodies overlap; ``normal_force``: N, ≥ 0."""
CONTACT_UNIT = "unit"
"""A further array (2,) of ``Engine.contacts``, optional: indices into ``Engine.collision_units``, of units of ``body``."""

SECONDS = ("step", "step_cpu", "control", "control_cpu", "record", "record_cpu")
"""Columns of ``seconds`` of a run: wall and processor time (s) since its begin, until the row was reached: in the engine's step
calls, in the controllers with passing states and efforts, and in recording the rows before."""


@dataclass(frozen=True, slots=True)
class CollisionUnit:
    """A unit that an engine's collision detection reports: ``body`` is the index in the world's bodies (−1: of none of them),
    ``shapes`` are the names of those of its shapes that it may be."""

    body: int
    shapes: tuple[str, ...]


def plain_units(units: Sequence[CollisionUnit]) -> list[dict[str, Any]]:
    """Collision units as plain data of an answer."""
    return [{"body": unit.body, "shapes": list(unit.shapes)} for unit in units]


def sorted_pairs(pairs: np.ndarray) -> np.ndarray:
    """Pairs (n, 2) of indices with the smaller one first, sorted, each once."""
    return np.unique(np.sort(np.asarray(pairs, dtype=np.int64).reshape(-1, 2), axis=1), axis=0)


def bodies_of(units: Sequence[CollisionUnit], pairs: np.ndarray) -> np.ndarray:
    """The pairs (n, 2) of indices of bodies, sorted and each once, of pairs of ``units``."""
    return sorted_pairs(np.array([unit.body for unit in units], dtype=np.int64)[pairs]) if len(pairs) else pairs


def pick_blocks(blocks: Sequence[np.ndarray], values: Iterable[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """The parts of M for ``blocks`` (see :meth:`Engine.mass_blocks`), out of those that an engine holds: for each of its own
    trees the places (n,) in v and M (n, n) there."""
    found = [np.zeros((len(block), len(block))) for block in blocks]
    where = {int(place): (index, row) for index, block in enumerate(blocks) for row, place in enumerate(block)}
    for places, mass in values:
        wanted = [(number, *where[int(place)]) for number, place in enumerate(places) if int(place) in where]
        for index in {index for _, index, _ in wanted}:
            theirs, ours = zip(*((number, row) for number, local, row in wanted if local == index), strict=True)
            found[index][np.ix_(ours, ours)] = mass[np.ix_(theirs, theirs)]
    return found


def empty_contacts() -> dict[str, np.ndarray]:
    """Contact arrays with no rows, that of the units among them."""
    fields = {**CONTACT_FIELDS, CONTACT_UNIT: (2,)}
    return {
        name: np.zeros((0, *shape), dtype=np.int64 if name in ("body", CONTACT_UNIT) else np.float64)
        for name, shape in fields.items()
    }


ContactRow = tuple[tuple[int, int], Sequence[float] | np.ndarray, Sequence[float] | np.ndarray, float, float]
"""One contact: the numbers of its two units, the smaller first, its position and normal (from the second to the first), its
distance and its normal force."""


def contact_arrays(rows: list[ContactRow], bodies: Sequence[int]) -> dict[str, np.ndarray]:
    """The arrays of :meth:`Engine.contacts` of an engine that reports units; ``bodies``: by unit, the row of its body. Sorted
    by units: an engine's own order is often that in which they first touched."""
    if not rows:
        return empty_contacts()
    rows = sorted(rows, key=lambda row: row[0])
    units = np.array([row[0] for row in rows], dtype=np.int64)
    normals = np.array([row[2] for row in rows])
    return {
        "body": np.array(bodies, dtype=np.int64)[units],
        "unit": units,
        "position": np.array([row[1] for row in rows]),
        "normal": normals / np.linalg.norm(normals, axis=1, keepdims=True),
        "distance": np.array([row[3] for row in rows]),
        "normal_force": np.array([row[4] for row in rows]),
    }


def restore_velocities(poses: np.ndarray, velocities: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From states of the *file's* body frames to states of the world's: origin p − R c, velocity v − ω × R c.

    ``poses`` (bodies, 7), ``velocities`` (bodies, 6), ``offsets`` (bodies, 3) the file frame's position in the world's
    body frame. Returns new arrays.
    """
    poses, velocities = poses.copy(), velocities.copy()
    moved = np.flatnonzero(offsets.any(axis=1))
    if len(moved):
        lever = rotate(poses[moved, 3:7], offsets[moved])
        poses[moved, :3] -= lever
        velocities[moved, :3] -= cross(velocities[moved, 3:], lever)
    return poses, velocities


# Numbers for an engine of single precision, which takes zero or infinity in silence for those that it has not.

LARGEST, SMALLEST = float(np.finfo(np.float32).max), float(np.finfo(np.float32).tiny)
"""Numbers of single precision."""


def checked_singles(engine: str, values: Iterable[float], what: str) -> tuple[float, ...]:
    """Numbers that ``engine`` can hold. Raises EngineError for others."""
    found = tuple(values)
    for value in found:
        if not math.isfinite(value) or abs(value) > LARGEST or 0.0 < abs(value) < SMALLEST:
            raise EngineError(engine, f"has single precision, in which there is no {value!r} ({what})")
    return found


def checked_limit(engine: str, value: float | None, what: str) -> float:
    """A limit that ``engine`` can hold, infinite for None. Raises EngineError for others."""
    return math.inf if value is None else checked_singles(engine, (value,), what)[0]


def demand_singles(engine: str, values: np.ndarray, what: str) -> None:
    """Raise EngineError for a state or an effort that ``engine`` cannot hold. A value below its smallest number becomes zero
    there, which is right to 1e-38 of its unit: other engines' states have such rests."""
    checked_singles(engine, np.where(np.abs(values) < SMALLEST, 0.0, values).tolist(), what)


# Controllers of engines that set velocities, in terms of gains.


def motor_rate(stiffness: np.ndarray, damping: np.ndarray, timestep: float) -> np.ndarray:
    """How fast (1/s) a motor that sets velocities takes back an error: kp / (kd + dt kp); 0 without kp.

    Such a motor makes v' = v* + rate (q* − q). That is the law kp (q* − q) + kd (v* − v) at the end of the step, of a joint
    whose inertia is negligible compared to kd dt + kp dt²: kp (q* + dt v* − q − dt v') + kd (v* − v') = 0.
    """
    divisor = damping + timestep * stiffness
    rate: np.ndarray = np.divide(stiffness, divisor, out=np.zeros_like(divisor), where=divisor > 0.0)
    return rate


def motor_limit(stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The largest effort of such motors: none where a joint has neither kp nor kd."""
    return np.where((stiffness > 0.0) | (damping > 0.0), limit, 0.0)
