"""Contact of engines that store trees in arrays: points between links, and room for them that grows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from simspec.engines.kit.arrays import ContactRow, contact_arrays
from simspec.engines.kit.building import Walk
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint
from simspec.world.rotations import from_xyzw, rotate


@dataclass(frozen=True)
class ContactPoints:
    """Points of contact: ``units`` (n, 2), ``places`` (n, 3), ``normals`` (n, 3) from the first unit to the second,
    ``distances`` (n,)."""

    units: np.ndarray
    places: np.ndarray
    normals: np.ndarray
    distances: np.ndarray

    @classmethod
    def between(cls, units: np.ndarray, poses: np.ndarray, local: Sequence[np.ndarray], normals: np.ndarray) -> Self:
        """Points between the ends ``local`` (2 of (n, 3)) in the frames of two links at ``poses`` (n, 2, 7)."""
        ends = [poses[:, end, :3] + rotate(from_xyzw(poses[:, end, 3:]), local[end]) for end in range(2)]
        gaps = np.einsum("ni,ni->n", normals, ends[1] - ends[0])
        return cls(units, 0.5 * (ends[0] + ends[1]), normals, gaps)

    def arrays(self, forces: np.ndarray, bodies: Sequence[int]) -> dict[str, np.ndarray]:
        """The arrays of :meth:`Engine.contacts`. ``forces`` (n,): normal forces; ``bodies``: by unit, the row of its body."""
        rows: list[ContactRow] = []
        for pair, at, normal, distance, force in zip(
            self.units.tolist(), self.places, self.normals, self.distances.tolist(), forces.tolist(), strict=True
        ):
            if distance <= 0.0 or force > 0.0:
                towards = -normal if pair[0] < pair[1] else normal
                rows.append(((min(pair), max(pair)), at, towards, distance, max(0.0, force)))
        return contact_arrays(rows, bodies)


MOST_ROOM = 1 << 20
"""Points of contact for which there is room at most."""


@dataclass(frozen=True)
class ContactRoom:
    """For how many points of contact, and rows of trees, an engine has room that grows. Room costs time: of 216 spheres a step
    with room for 10,608 rows of trees takes 31 ms, with room for one 2 ms (measured)."""

    contacts: int
    rows: int

    @classmethod
    def first(cls, walk: Walk) -> ContactRoom:
        """Room at the start: rows for limits and some contacts of trees, and none where every body is free by itself."""
        limited = sum(isinstance(placed.body.joint, AxisJoint) for placed in walk.bodies)
        alone = {placed.row for placed in walk.bodies if placed.moves} <= set(walk.single)
        return cls(64 + 4 * len(walk.units), 1 if alone else 64 + 2 * limited)

    def larger(self, engine: str, found: int) -> ContactRoom:
        """Twice as much, for points of contact where so many were ``found`` that they are full, else for rows. Raises
        EngineError where that is too much."""
        if max(self.contacts, self.rows) > MOST_ROOM:
            raise EngineError(engine, f"has room for {self.contacts} points of contact and {self.rows} rows of trees")
        full = found >= self.contacts
        return ContactRoom(self.contacts * (2 if full else 1), self.rows * (1 if full else 2))
