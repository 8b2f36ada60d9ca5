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
    Plan,
    Text,
    hull_library,
    library,
    losses,
    pointer,
    proper,
)
from simspec.engines.kit.arrays import empty_contacts
from simspec.engines.kit.hulls import DOUBTED
from simspec.errors import EngineError
from simspec.formats.world.format import WorldJson
from simspec.formats.world.tree import initial_coordinates
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world.rotations import unit
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE

MANY = 4096
"""Pairs of shapes that touch for which there is room at first."""
MOST_CONTACTS = 1_000_000
"""Contacts that DART takes in a step; its own bound is 1,000, gz-physics' 10,000."""
NOT_FINITE = "a state or effort is not finite, or beyond 1e100, by which gz-physics would end its process"


class Simulation:
    """A loaded world. Coordinates are the part in C++'s own, which are those of ``world/kinematics.py``."""

    def __init__(self, folder: Path, sidecar: Mapping[str, Any]):
        try:
            self.document = WorldJson().read(folder)
            told = WorldSidecar.of(sidecar)
            told.check_document(self.document)
        except (ValueError, FileNotFoundError) as error:
            raise EngineError(NAME, str(error)) from error
        self.sidecar, self.told = sidecar, told
        self.constraints, self.sums, self.passive = told.constraints or (), told.sums or (), told.passive
        bodies = self.document.bodies
        self.names = [body.name for body in bodies]
        self.offsets = np.array([body.frame_offset for body in told.bodies], dtype=float).reshape(-1, 3)
        kinds = [body.joint.kind for body in bodies]
        q = np.cumsum([0, *(POSITION_SIZE[kind] for kind in kinds)])
        v = np.cumsum([0, *(VELOCITY_SIZE[kind] for kind in kinds)])
        self.nq, self.nv = int(q[-1]), int(v[-1])
        self.q_places = [slice(a, b) for a, b in zip(q[:-1].tolist(), q[1:].tolist(), strict=True)]
        self.v_places = [slice(a, b) for a, b in zip(v[:-1].tolist(), v[1:].tolist(), strict=True)]
        turns = [
            range(place.stop - 4, place.stop)
            for place, kind in zip(self.q_places, kinds, strict=True)
            if kind in QUATERNION_JOINTS
        ]
        self._turns = np.array(turns, dtype=np.intp).reshape(-1, 4)
        self.plan = Plan(self.document)
        self.shapes = [(row, shape.name) for row, body in enumerate(bodies) for shape in body.shapes if shape.copies]
        """(body, name) of every collision shape."""
        self._body_of = np.array([row for row, _ in self.shapes], dtype=np.int64)
        numbers: dict[tuple[int, int], int] = {}
        self._shape_of = np.array(
            [numbers.setdefault((unit.body, unit.shape), len(numbers)) for unit in self.plan.units], dtype=np.int64
        )
        self.library = library()
        self.sim: Any = None
        self._load()
        self.set_state(*map(np.array, initial_coordinates(self.document)))

    def _load(self) -> None:
        settings = self.told.settings
        try:
            solver = str(settings["contact_solver"])
        except KeyError as error:
            raise EngineError(NAME, f"the sidecar's settings lack {error}") from error
        lib, plan = self.library, self.plan
        self.sim = lib.gz_load(plan.text.encode(), self.document.timestep, DETECTOR.encode(), solver.encode())
        if not self.sim:
            raise EngineError(NAME, f"refuses the world: {lib.said()}")
        bodies = self.document.bodies
        kinds = np.array([KINDS.index(body.joint.kind) for body in bodies], dtype=np.int32)
        own = losses(self.document)
        names = [f"b{row}" for row in range(len(bodies))]
        self._done(lib.gz_bodies(self.sim, len(bodies), _texts(names), kinds.ctypes.data_as(Integers), pointer(own)))
        for row, body in enumerate(bodies):
            if not proper(body):
                told = np.array([body.mass, *body.centre_of_mass, *body.inertia])
                lib.gz_inertia(self.sim, row, pointer(told))
        told_units = np.array(
            [(unit.body, kind, plan.groups[unit.body]) for unit, kind in zip(plan.units, plan.classes, strict=True)],
            dtype=np.int32,
        ).reshape(-1, 3)
        meet = np.ascontiguousarray(plan.meet)
        self._done(
            lib.gz_units(
                self.sim,
                len(plan.units),
                _texts([unit.name for unit in plan.units]),
                told_units.ctypes.data_as(Integers),
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
        for number, one in enumerate(self.plan.units):
            shape = self.document.bodies[one.body].shapes[one.shape]
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
            raise EngineError(NAME, f"holds another world than it was told: {self.library.said()}")

    # --- state ------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v). Raises EngineError for one that is not finite."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise EngineError(NAME, NOT_FINITE)
        if len(self._turns):
            q[self._turns] = unit(q[self._turns])
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
        units, told = np.empty((count, 2), dtype=np.int32), np.empty((count, 8))
        self.library.gz_contacts(self.sim, units.ctypes.data_as(Integers), pointer(told))
        pairs = self._shape_of[units.astype(np.intp)]
        return {
            "body": self._body_of[pairs],
            "unit": pairs,
            "position": told[:, :3].copy(),
            "normal": told[:, 3:6].copy(),
            "distance": -told[:, 6],
            "normal_force": np.maximum(told[:, 7], 0.0),
        }

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of shapes that touch at the present state."""
        room = MANY
        while True:
            pairs = np.empty((room, 2), dtype=np.int32)
            count = self.library.gz_touching(self.sim, pairs.ctypes.data_as(Integers), room)
            if count <= room:
                return self._shape_of[pairs[:count].astype(np.intp)]
            room = count

    def disable_contact(self) -> None:
        """Nothing touches anything."""
        for geom in self.hulls.values():
            hull_library().hull_gone(geom)
        self.hulls = {}
        self.library.gz_no_contact(self.sim)

    def disable_dry_friction(self, v: np.ndarray) -> None:
        """Take the dry friction of the joints at the places ``v`` (n,) away."""
        body_at = {place.start: row for row, place in enumerate(self.v_places) if place.stop > place.start}
        for place in np.asarray(v, dtype=int).tolist():
            self.library.gz_no_dry_friction(self.sim, body_at[place])

    def messages(self) -> list[str]:
        """What gz-physics said while it loaded."""
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
