"""A world in ODE, in its initial state: stepping, efforts, contact."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.kit.world import LawSidecar
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.building import Walk
from simspec.engines.kit.hulls import DOUBTED
from simspec.engines.kit.world_simulation import WorldSimulation, contact_table, growing_pairs, unit_responses
from simspec.engines.ode.building import NAME, Integers, OdeBuild, library, pointer
from simspec.errors import EngineError
from simspec.formats.world import initial_coordinates
from simspec.world.rotations import unit


class OdeSimulation(WorldSimulation[LawSidecar]):
    """A loaded world. Coordinates are those of the part in C, and of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, LawSidecar, folder, sidecar)
        self.library = library()
        try:
            self.built = OdeBuild(self.library, Walk.of(self.document), self.typed)
        except (KeyError, ValueError) as error:
            raise EngineError(NAME, f"the sidecar's settings lack, or have a wrong, {error}") from error
        self.sim = self.built.sim
        self._poses, self._velocities = np.zeros((len(self.names), 12)), np.zeros((len(self.names), 6))
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v)."""
        q, v = self.normalised(q), np.array(v, dtype=float)
        self.library.sim_set(self.sim, pointer(q), pointer(v))

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        q, v = np.empty(self.nq), np.empty(self.nv)
        self.library.sim_get(self.sim, pointer(q), pointer(v))
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        self.library.sim_frames(self.sim, pointer(self._poses), pointer(self._velocities))
        poses = np.empty((len(self.names), 7))
        poses[:, :3], poses[:, 3:] = self._poses[:, :3], quaternions(self._poses[:, 3:].reshape(-1, 3, 3))
        return poses, self._velocities.copy()

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        given = None if effort is None else pointer(np.ascontiguousarray(effort, dtype=float))
        if self.library.sim_step(self.sim, count, given):
            raise EngineError(NAME, f"a step failed: {self.library.sim_text(self.sim).decode(errors='replace')}")

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J), springs included."""
        found = np.empty(2)
        self.library.sim_energy(self.sim, pointer(found))
        return float(found[0]), float(found[1])

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix as parts (places, M), one for each tree: the inverse of what unit efforts give for accelerations, of
        one joint of all trees at once, which do not act on each other."""
        trees, parts = self.tree_places(), []
        for tree, inverse in zip(trees, unit_responses(trees, self.nv, self.acceleration), strict=True):
            mass = np.linalg.inv(inverse)
            parts.append((tree, 0.5 * (mass + mass.T)))
        return parts

    def acceleration(self, effort: np.ndarray | None) -> np.ndarray:
        """v̇ (nv,) by ODE's own step: from rest under an effort alone, or (None) under gravity and the present velocities."""
        found = np.empty(self.nv)
        given = None if effort is None else pointer(effort)
        if self.library.sim_accelerate(self.sim, given, pointer(found)):
            raise EngineError(NAME, f"a step failed: {self.library.sim_text(self.sim).decode(errors='replace')}")
        return found

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,): −M v̇ of a body left to itself."""
        free, bias = self.acceleration(None), np.zeros(self.nv)
        for places, mass in self.mass_parts():
            bias[places] = -mass @ free[places]
        return bias

    # --- contact ----------------------------------------------------------------------------------------------

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        count = self.library.sim_size(self.sim, 3)
        if not count:
            return empty_contacts()
        units, table = np.empty((count, 2), dtype=np.int32), np.empty((count, 8))
        self.library.sim_points(self.sim, units.ctypes.data_as(Integers), pointer(table))
        return contact_table(units.astype(np.int64), table, [row for row, _ in self.units()])

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of shapes that touch at the present state."""
        return growing_pairs(lambda pairs, room: int(self.library.sim_touching(self.sim, pairs, room)))

    def disable_contact(self) -> None:
        """Nothing touches anything."""
        self.library.sim_contact(self.sim, 0)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the joints at the places ``v`` (n,) away."""
        for row in self.rows_at(v):
            self.library.sim_no_dry_friction(self.sim, row)

    def messages(self) -> list[str]:
        """ODE's messages, and steps that had to be solved again."""
        counts = (ctypes.c_long * 6)()
        self.library.sim_counts(self.sim, counts)
        retries, unsolved, said, doubtful, unsettled, stepped = counts
        lines = []
        if said:
            lines.append(f"{self.library.sim_text(self.sim).decode(errors='replace').strip()} ({said} messages)")
        if retries:
            lines.append(
                f"{retries} solutions repeated, with contacts separated slightly or softer, since ODE could not solve a step"
            )
        if unsolved:
            lines.append(
                f"{unsolved} steps that ODE did not solve, with contacts as soft as they may be: forces are missing there"
            )
        if unsettled:
            lines.append(
                f"of {stepped} steps with friction in contact {unsettled} ended before its bounds fitted the normal forces"
            )
        if doubtful:
            lines.append(DOUBTED.format(doubtful))
        return lines

    def close(self) -> None:
        self.built.close()


def quaternions(turns: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) with w ≥ 0 of rotation matrices (n, 3, 3), each by its largest component."""
    xx, yy, zz = turns[:, 0, 0], turns[:, 1, 1], turns[:, 2, 2]
    squares = np.stack([xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy], axis=1)
    largest = np.argmax(squares, axis=1)
    a, b, c = turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0], turns[:, 1, 0] - turns[:, 0, 1]
    d, e, f = turns[:, 1, 0] + turns[:, 0, 1], turns[:, 0, 2] + turns[:, 2, 0], turns[:, 2, 1] + turns[:, 1, 2]
    squared = 1.0 + squares
    rows = np.stack(
        [
            np.stack([squared[:, 0], a, b, c], axis=1),
            np.stack([a, squared[:, 1], d, e], axis=1),
            np.stack([b, d, squared[:, 2], f], axis=1),
            np.stack([c, e, f, squared[:, 3]], axis=1),
        ],
        axis=1,
    )
    return unit(rows[np.arange(len(turns)), largest])
