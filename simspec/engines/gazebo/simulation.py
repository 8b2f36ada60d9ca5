"""A world in gz-physics, in its initial state: stepping, efforts, contact."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.kit.world import WorldSidecar
from simspec.engines.gazebo.building import (
    CONE,
    DETECTOR,
    KINDS,
    NAME,
    Integers,
    Keys,
    SdfPlan,
    Text,
    hull_library,
    library,
    losses,
    pointer,
    proper,
)
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.building import Walk
from simspec.engines.kit.hulls import DOUBTED
from simspec.engines.kit.world_simulation import WorldSimulation, contact_table, growing_pairs
from simspec.errors import EngineError
from simspec.formats.world import initial_coordinates

MOST_CONTACTS = 1_000_000
"""Contacts that DART takes in a step; its own bound is 1,000, gz-physics' 10,000."""
NOT_FINITE = "a state or effort is not finite, or beyond 1e100, by which gz-physics would end its process"


class GazeboSimulation(WorldSimulation[WorldSidecar]):
    """A loaded world. Coordinates are those of the part in C++, and of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        super().__init__(NAME, WorldSidecar, folder, sidecar)
        self.walk = Walk.of(self.document)
        self.plan = SdfPlan(self.walk)
        self._shape_of = np.array([unit.of.number for unit in self.walk.units], dtype=np.int64)
        self.library = library()
        self.sim: Any = None
        self._load()
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def _load(self) -> None:
        try:
            solver = str(self.settings["contact_solver"])
        except KeyError as error:
            raise EngineError(NAME, f"the sidecar's settings lack {error}") from error
        lib, plan = self.library, self.plan
        self.sim = lib.gz_load(plan.text.encode(), self.document.timestep, DETECTOR.encode(), solver.encode())
        if not self.sim:
            raise EngineError(NAME, f"refuses the world: {lib.said()}")
        bodies = self.document.bodies
        kinds = np.array([KINDS.index(body.joint.kind) for body in bodies], dtype=np.int32)
        values = losses(self.document)
        names = [f"b{row}" for row in range(len(bodies))]
        self._done(lib.gz_bodies(self.sim, len(bodies), _texts(names), kinds.ctypes.data_as(Integers), pointer(values)))
        for row, body in enumerate(bodies):
            if not proper(body):
                lib.gz_inertia(self.sim, row, pointer(np.array([body.mass, *body.centre_of_mass, *body.inertia])))
        owners = [unit.of.owner for unit in self.walk.units]
        unit_rows = [(owner.row, kind, owner.carrier) for owner, kind in zip(owners, plan.classes, strict=True)]
        units = np.array(unit_rows, dtype=np.int32).reshape(-1, 3)
        meet = np.ascontiguousarray(plan.meet)
        self._done(
            lib.gz_units(
                self.sim,
                len(units),
                _texts(plan.names),
                units.ctypes.data_as(Integers),
                len(meet),
                meet.ctypes.data_as(Text),
                len(plan.excluded),
                plan.excluded.ctypes.data_as(Keys),
                MOST_CONTACTS,
            )
        )
        for number, restitution in plan.lively():
            lib.gz_restitution(self.sim, number, restitution)
        self.hulls = self._hulls()

    def _hulls(self) -> dict[int, Any]:
        """The geoms of hulls, by the numbers of their units: each in place of the geom of the ball that the text has."""
        found: dict[int, Any] = {}
        for number, unit in enumerate(self.walk.units):
            shape = unit.of.shape
            if shape.kind != "mesh":
                continue
            space, known = self.library.gz_space(self.sim), self.library.gz_object(self.sim, number)
            vertices = np.array(shape.size)
            geom = (
                space and known and hull_library().hull_instead(space, known, pointer(vertices), len(shape.size) // 3)
            )
            if not geom:
                raise EngineError(NAME, f"has no place for the hull {shape.name!r} in its collision detector")
            found[number] = geom
        return found

    def _done(self, failed: int) -> None:
        if failed:
            raise EngineError(NAME, f"has another world than the SDF text: {self.library.said()}")

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v). Raises EngineError for one that is not finite."""
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise EngineError(NAME, NOT_FINITE)
        q, v = self.normalised(q), np.array(v, dtype=float)
        self.library.gz_set(self.sim, pointer(q), pointer(v))

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        """(q, v)."""
        q, v = np.empty(self.nq), np.empty(self.nv)
        self.library.gz_get(self.sim, pointer(q), pointer(v))
        return q, v

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the file has them."""
        poses, velocities = np.empty((len(self.names), 7)), np.empty((len(self.names), 6))
        self.library.gz_frames(self.sim, pointer(poses), pointer(velocities))
        return poses, velocities

    # --- steps ------------------------------------------------------------------------------------------------

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero, and the damping and springs of the joints."""
        given = None if effort is None else np.ascontiguousarray(effort, dtype=float)
        failed = self.library.gz_step(self.sim, count, None if given is None else pointer(given))
        if failed:
            raise EngineError(NAME, NOT_FINITE if failed == 1 else f"a step failed: {self.library.said()}")

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J), springs included."""
        found = np.empty(2)
        self.library.gz_energy(self.sim, pointer(found))
        return float(found[0]), float(found[1])

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The mass matrix as parts (places, M), one for each tree, armature included."""
        parts = []
        for number in range(self.library.gz_tree_count(self.sim)):
            size = self.library.gz_tree_size(self.sim, number)
            if size:
                places, mass = np.empty(size, dtype=np.int32), np.empty((size, size))
                self.library.gz_tree(self.sim, number, places.ctypes.data_as(Integers))
                self.library.gz_mass(self.sim, number, pointer(mass))
                parts.append((places.astype(np.intp), mass))
        return parts

    def bias(self) -> np.ndarray:
        """Coriolis, centrifugal and gravity forces (nv,)."""
        found = np.zeros(self.nv)
        self.library.gz_bias(self.sim, pointer(found))
        return found

    # --- contact ----------------------------------------------------------------------------------------------

    @property
    def cone(self) -> str:
        """The friction cone; that of the request where nothing has friction, and no solver makes use of it."""
        copies = (copy for body in self.document.bodies for shape in body.shapes for copy in shape.copies)
        return CONE if any(copy.friction for copy in copies) else self.document.friction_cone

    def contacts(self) -> dict[str, np.ndarray]:
        """The contacts that the last step used."""
        count = self.library.gz_contact_count(self.sim)
        if not count:
            return empty_contacts()
        units, table = np.empty((count, 2), dtype=np.int32), np.empty((count, 8))
        self.library.gz_contacts(self.sim, units.ctypes.data_as(Integers), pointer(table))
        return contact_table(self._shape_of[units], table, [row for row, _ in self.units()])

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of shapes that touch at the present state."""
        pairs = growing_pairs(lambda pairs, room: int(self.library.gz_touching(self.sim, pairs, room)))
        found: np.ndarray = self._shape_of[pairs]
        return found

    def disable_contact(self) -> None:
        """Nothing touches anything."""
        for geom in self.hulls.values():
            hull_library().hull_gone(geom)
        self.hulls = {}
        self.library.gz_no_contact(self.sim)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the joints at the places ``v`` (n,) away."""
        for row in self.rows_at(v):
            self.library.gz_no_dry_friction(self.sim, row)

    def messages(self) -> list[str]:
        """The messages of gz-physics from loading."""
        lines = [line for line in self.library.gz_log(self.sim).decode(errors="replace").splitlines() if line.strip()]
        doubted = hull_library().hulls_doubted() if self.hulls else 0
        counts = (ctypes.c_int * 2)()
        self.library.gz_counts(self.sim, counts)
        if counts[1]:
            lines.append(
                f"of {counts[0]} solutions with friction in contact {counts[1]} ended before its bounds fitted the normal "
                "forces"
            )
        return [*lines, DOUBTED.format(doubted)] if doubted else lines

    def close(self) -> None:
        sim, self.sim = self.sim, None
        if sim:
            self.library.gz_free(sim)


def _texts(names: list[str]) -> Any:
    return (ctypes.c_char_p * max(1, len(names)))(*(name.encode() for name in names))
