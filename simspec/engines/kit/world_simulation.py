"""Engines that load ``world.json`` and its sidecar: their simulations, read-backs and the methods that follow from these."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from simspec.contact import ContactPlan, contact_plan
from simspec.control.reference import Servos
from simspec.dialects.kit.sidecar import Passive
from simspec.dialects.kit.world import WorldSidecar
from simspec.engines.kit.arrays import CollisionUnit, sorted_pairs
from simspec.engines.kit.inventory import expected_labels
from simspec.engines.kit.settings import written_settings
from simspec.engines.kit.simulated import Stepped, SteppedEngine
from simspec.errors import EngineError
from simspec.formats.kit.contract import restore_frames
from simspec.formats.world import JsonShape, WorldJson, rows_of
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world import frames
from simspec.world.actions import JointSum
from simspec.world.kinematics import layout_of_kinds
from simspec.world.rotations import unit
from simspec.world.types import (
    Body,
    Constraint,
    EngineValue,
    Hardness,
    Joint,
    PairContact,
    Pose,
    ReadBack,
    Shape,
    Vector3,
    World,
)

SidecarType = TypeVar("SidecarType", bound=WorldSidecar)
MANY = 4096
"""Room for pairs of shapes that touch, at first."""


class CollidingWorld(Stepped, Protocol):
    """A loaded ``world.json`` whose shapes collide."""

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """:meth:`Engine.move_to`."""
        ...

    def contacts(self) -> dict[str, np.ndarray]:
        """:meth:`Engine.contacts`."""
        ...

    def touching(self) -> np.ndarray:
        """Pairs (n, 2) of the numbers of units that touch at the present state."""
        ...

    def units(self) -> Sequence[tuple[int, str]]:
        """The row of the body and the name of the shape of each unit."""
        ...


S = TypeVar("S", bound=CollidingWorld)


class Parts(NamedTuple, Generic[S]):
    """The modules of an engine: its simulation of a folder and a sidecar, the read-back of a simulation, its inventory, the
    defaults of the engine, and the inventory that follows from a world, its settings, its contact plan and the defaults."""

    simulation: Callable[[Path, Mapping[str, Any]], S]
    read_back: Callable[[S, dict[str, str]], ReadBack]
    inventory: Callable[[S], dict[str, EngineValue]]
    neutral: Callable[[S], dict[str, EngineValue]]
    expected: Callable[[World, Mapping[str, Any], ContactPlan, Mapping[str, EngineValue]], dict[str, EngineValue]]


class WorldEngine(SteppedEngine[S], Generic[S], abstract=True):
    """An engine that loads ``world.json``."""

    ALONGSIDE: ClassVar[tuple[str, ...]] = ("scipy",)  # hulls of meshes
    PARTS: ClassVar[Parts[Any]]

    @classmethod
    def expected_inventory(cls, world: World, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        plan = contact_plan(world, cls.RULES, cls.LAYERS)
        return cls.PARTS.expected(world, written_settings(cls, world), plan, neutral) | expected_labels(cls, world)

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> S:
        simulation: S = self.PARTS.simulation(folder, sidecar)
        return simulation

    def _read_model(self) -> ReadBack:
        sim = self._simulation
        model = self.PARTS.read_back(sim, dict(self.UNREADABLE))
        return dataclasses.replace(model, inventory=self.PARTS.inventory(sim), neutral=self.PARTS.neutral(sim))

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        self._simulation.move_to(q, v)

    def contacts(self) -> dict[str, np.ndarray]:
        return self._simulation.contacts()

    def collision_units(self) -> Sequence[CollisionUnit]:
        return [CollisionUnit(body, (name,)) for body, name in self._simulation.units()]

    def detect_units(self) -> np.ndarray:
        return sorted_pairs(self._simulation.touching())


class TrackingWorld(CollidingWorld, Protocol):
    """A simulation with controllers of the engine's own."""

    def track(self, v: np.ndarray) -> Servos:
        """Drive the joints with their velocities at the places ``v`` (n,), by the gains of ``world.json``."""
        ...


T = TypeVar("T", bound=TrackingWorld)


class TrackingEngine(WorldEngine[T], Generic[T], abstract=True):
    """Such an engine with controllers of its own, whose gains it takes from ``world.json``: the proof compares them."""

    def track(
        self, q: np.ndarray, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ) -> Servos:
        return self._simulation.track(v)


class WorldSimulation(Generic[SidecarType]):
    """A loaded ``world.json``. ``offsets`` (n, 3): where the file's frame of each body is in the world's frame;
    ``q_places`` and ``v_places``: where each body's joint has its coordinates in q (nq,) and v (nv,), those of
    ``world/kinematics.py``."""

    def __init__(self, engine: str, kind: type[SidecarType], folder: Path, sidecar: Mapping[str, Any]):
        """Raises EngineError for files that are damaged, or that do not belong together."""
        try:
            self.document = WorldJson().read(folder)
            self.typed = kind.of(sidecar)
            self.typed.check_document(self.document)
        except (ValueError, FileNotFoundError) as error:
            raise EngineError(engine, str(error)) from error
        self.engine, self.sidecar, self.settings = engine, sidecar, self.typed.settings
        self.passive: Passive | None = self.typed.passive
        self.constraints: tuple[Constraint, ...] = self.typed.constraints or ()
        self.sums: tuple[JointSum, ...] = self.typed.sums or ()
        bodies = self.document.bodies
        self.names = [body.name for body in bodies]
        self.offsets = np.array([body.frame_offset for body in self.typed.bodies], dtype=float).reshape(-1, 3)
        layout = layout_of_kinds(body.joint.kind for body in bodies)
        self.q_places, self.v_places, self.nq, self.nv = layout.position, layout.velocity, layout.nq, layout.nv
        turns = [
            range(place.stop - 4, place.stop)
            for place, body in zip(self.q_places, bodies, strict=True)
            if body.joint.kind in QUATERNION_JOINTS
        ]
        self._units = [(row, shape.name) for row, body in enumerate(bodies) for shape in body.shapes if shape.copies]
        self._quaternions = np.array(turns, dtype=np.intp).reshape(-1, 4)

    def normalised(self, q: np.ndarray) -> np.ndarray:
        """A copy of q (nq,) whose quaternions are of unit length."""
        q = np.array(q, dtype=float)
        if len(self._quaternions):
            q[self._quaternions] = unit(q[self._quaternions])
        return q

    def tree_places(self) -> list[np.ndarray]:
        """The places in v of each tree that has velocities, in the order of the trees' roots."""
        trees: dict[int, list[int]] = {}
        for root, place in zip(rows_of(self.document.bodies).roots, self.v_places, strict=True):
            trees.setdefault(root, []).extend(range(place.start, place.stop))
        return [np.array(places) for places in trees.values() if places]

    def tree_rows(self) -> list[list[int]]:
        """The rows of the bodies of these trees."""
        trees: dict[int, list[int]] = {}
        for row, root in enumerate(rows_of(self.document.bodies).roots):
            trees.setdefault(root, []).append(row)
        return [
            rows for rows in trees.values() if any(self.v_places[row].stop > self.v_places[row].start for row in rows)
        ]

    def rows_at(self, v: np.ndarray) -> list[int]:
        """The rows of the bodies whose joints have their first velocities at the places ``v`` (n,)."""
        rows = {place.start: row for row, place in enumerate(self.v_places) if place.stop > place.start}
        return [rows[place] for place in np.asarray(v, dtype=int).tolist()]

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        """Put the simulation into the state (q, v)."""
        raise NotImplementedError

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same; an engine that keeps contacts of earlier steps keeps them here."""
        self.set_state(q, v)

    def units(self) -> Sequence[tuple[int, str]]:
        """The row of the body and the name of each collision shape."""
        return [
            (row, shape.name) for row, body in enumerate(self.document.bodies) for shape in body.shapes if shape.copies
        ]

    def messages(self) -> list[str]:
        """None: the engine has no log."""
        return []

    def close(self) -> None:
        """Nothing to do: the engine's objects are freed with this one."""

    def model(
        self,
        bodies: Iterable[Body],
        gravity: Vector3,
        timestep: float,
        unreadable: Mapping[str, str],
        cone: str = "",
        laws: tuple[PairContact, ...] = (),
    ) -> ReadBack:
        """A read-back of ``bodies``, which are in the file's frames; ``cone``: the document's where it is empty."""
        moved = zip(self.names, self.offsets.tolist(), strict=True)
        offsets: dict[str, Vector3] = {name: tuple(offset) for name, offset in moved if any(offset)}
        restored = restore_frames(tuple(bodies), offsets)
        return ReadBack(restored, gravity, timestep, cone or self.document.friction_cone, dict(unreadable), laws=laws)


def pose_of_row(row: np.ndarray) -> Pose:
    """A pose of x y z w x y z."""
    return Pose(tuple(row[:3].tolist()), frames.normalise(tuple(row[3:].tolist())))


def free_joint(name: str, position: list[float], velocity: list[float]) -> Joint:
    """The joint of a free body in its coordinates."""
    turn = frames.normalise(tuple(position[3:]))  # type: ignore[arg-type]
    angular = frames.rotate(turn, tuple(velocity[3:]))  # type: ignore[arg-type]
    return Joint(name, "free", position=(*position[:3], *turn), velocity=(*velocity[:3], *angular))


def visual_shape(shape: JsonShape) -> Shape:
    """The visual part of a shape, which engines without visuals do not store."""
    visual = Shape(shape.name, shape.kind, shape.size, shape.pose, collision=False, visual=shape.colour is not None)
    return visual if shape.colour is None else dataclasses.replace(visual, colour=shape.colour)


def tensor_of(inertia: Iterable[float]) -> np.ndarray:
    """(3, 3) of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def positive_definite(inertia: Iterable[float]) -> bool:
    """Whether an inertia tensor has an inverse."""
    return bool(np.linalg.eigvalsh(tensor_of(inertia))[0] > 0.0)


def only_common(law: PairContact) -> str | None:
    """The part of a law that engines with the common hardness alone, without margins, do not support; None without one."""
    if law.hardness.kind != "common":
        return f"the hardness {law.hardness.kind}"
    if law.hardness != Hardness():
        return "numbers that deviate from the common hardness"
    return "a margin" if law.margin is not None else None


def unit_responses(
    trees: Sequence[np.ndarray], size: int, respond: Callable[[np.ndarray], np.ndarray]
) -> list[np.ndarray]:
    """For each tree, given by its places in v (size,), the matrix of the responses to a unit at each of them. Trees do not act
    on each other: ``respond`` is called with a unit in each tree at once."""
    matrices = [np.zeros((len(tree), len(tree))) for tree in trees]
    for column in range(max(map(len, trees), default=0)):
        present = [(tree, matrix) for tree, matrix in zip(trees, matrices, strict=True) if column < len(tree)]
        units = np.zeros(size)
        units[[tree[column] for tree, _ in present]] = 1.0
        found = respond(units)
        for tree, matrix in present:
            matrix[:, column] = found[tree]
    return matrices


def growing_pairs(query: Callable[[Any, int], int]) -> np.ndarray:
    """The pairs (n, 2) of numbers that a function in C writes to an array with room for some; it returns how many there are."""
    room = MANY
    while True:
        pairs = np.empty((room, 2), dtype=np.int32)
        count = query(pairs.ctypes.data_as(ctypes.POINTER(ctypes.c_int)), room)
        if count <= room:
            return pairs[:count].astype(np.int64)
        room = count


def contact_table(units: np.ndarray, table: np.ndarray, bodies: Sequence[int]) -> dict[str, np.ndarray]:
    """The arrays of :meth:`Engine.contacts` of rows (n, 8): position 3, normal 3, depth, normal force; ``units`` (n, 2):
    numbers of shapes, ``bodies``: by these the row of the body."""
    return {
        "body": np.array(bodies, dtype=np.int64)[units],
        "unit": units,
        "position": table[:, :3].copy(),
        "normal": table[:, 3:6].copy(),
        "distance": -table[:, 6],
        "normal_force": np.maximum(table[:, 7], 0.0),
    }
