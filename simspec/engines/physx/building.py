"""A world in PhysX, built by calls of SAPIEN's API from ``world.json`` and its sidecar.

Static bodies are static actors; a free root with all bodies that are fixed to it is one dynamic actor. A shape with several
laws has a copy with its own material for each. Facts marked *measured*: SAPIEN 3.0.3, PhysX 5.3.1.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from simspec.dialects.physx import PhysxSidecar
from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.building import PlacedBody, ShapeUnit, Walk, refuse
from simspec.errors import EngineError
from simspec.formats.world import FreeJoint, JsonBody
from simspec.world import frames
from simspec.world.frames import quaternion, vector3
from simspec.world.inertia import principal_axes
from simspec.world.rotations import matrices
from simspec.world.types import Pose

# Collision filter. Each shape has four words of bits; shapes with the words a and b touch where ``(a₀ & b₁ or a₁ & b₀) and
# not (a₂ & b₂ and a₃ = b₃)``. Shapes that touch the same others share a bit of the first two words, up to 32 kinds. Bodies
# that must not touch share a bit of the third: those connected by such pairs have a number in the fourth, and up to 32 bits.

BITS = 32
"""Of a word."""
MOST_NUMBERS = 0xFFFF
"""Of the fourth word only the lower half counts."""
Words = tuple[int, int, int, int]
K = TypeVar("K")


def kinds(keys: Sequence[K], meet: Callable[[K, K], bool]) -> Mapping[K, tuple[int, int]]:
    """The first two words of each of the distinct ``keys``, of which ``meet`` says whether shapes of two touch. Raises
    ValueError where these are more kinds than bits."""
    rows = {key: tuple(meet(key, other) for other in keys) for key in keys}
    number: dict[tuple[bool, ...], int] = {}
    for key in keys:
        if any(rows[key]):
            number.setdefault(rows[key], len(number))
    if len(number) > BITS:
        raise ValueError(f"distinguishes {BITS} kinds of shapes by what they touch, and here are {len(number)}")
    found = {}
    for key in keys:
        if not any(rows[key]):
            found[key] = (0, 0)
            continue
        others = {number[rows[other]] for other, touched in zip(keys, rows[key], strict=True) if touched}
        found[key] = (1 << number[rows[key]], sum(1 << other for other in others))
    return found


def exclusions(pairs: Iterable[tuple[str, str]]) -> Mapping[str, tuple[int, int]]:
    """The last two words of each name of ``pairs``, of bodies that must not touch. Raises ValueError where bits do not do."""
    neighbours: dict[str, set[str]] = {}
    for entry, other in pairs:
        neighbours.setdefault(entry, set()).add(other)
        neighbours.setdefault(other, set()).add(entry)
    found: dict[str, tuple[int, int]] = {}
    number = 0
    for start in sorted(neighbours):
        if start in found:
            continue
        number += 1
        if number > MOST_NUMBERS:
            raise ValueError(f"distinguishes {MOST_NUMBERS} sets of bodies that must not touch, and here are more")
        cliques = _cliques(_reached(start, neighbours), neighbours)
        if len(cliques) > BITS:
            raise ValueError(
                f"has {BITS} bits for bodies that must not touch each other and hang together by such pairs, as {start!r} "
                f"does; here it takes {len(cliques)}"
            )
        for bit, clique in enumerate(cliques):
            for name in clique:
                found[name] = (found.get(name, (0, number))[0] | 1 << bit, number)
    return found


def _reached(start: str, neighbours: Mapping[str, set[str]]) -> list[str]:
    found, queue = {start}, [start]
    for name in queue:
        for other in sorted(neighbours[name] - found):
            found.add(other)
            queue.append(other)
    return queue


def _cliques(names: Sequence[str], neighbours: Mapping[str, set[str]]) -> list[set[str]]:
    """Sets of names, each of which are all neighbours of each other, in which every two neighbours are together once."""
    left = {frozenset((name, other)) for name in names for other in neighbours[name]}
    cliques = []
    for name in names:
        for other in sorted(neighbours[name]):
            if frozenset((name, other)) not in left:
                continue
            clique = {name, other}
            for more in names:
                if more not in clique and clique <= neighbours[more]:
                    clique.add(more)
            left -= {frozenset((a, b)) for a in clique for b in clique if a != b}
            cliques.append(clique)
    return cliques


def touches(a: Sequence[int], b: Sequence[int]) -> bool:
    """Whether shapes with these words touch, of different bodies of which one moves."""
    if a[2] & b[2] and (a[3] & MOST_NUMBERS) == (b[3] & MOST_NUMBERS):
        return False
    return bool(a[0] & b[1] or a[1] & b[0])


NAME = "physx"
SCALE = 512.0
"""PhysX's unit of length is 1/512 m. Slides slower than 0.01 units per second, and rest, have a square along the world's
axes in place of the cone: with the metre, pushes at 45° meet up to 1.41 times the friction (measured). A power of two
changes no digit."""
CONTACT_OFFSET = 3.75e-6
"""Distance (m) from a shape in which it has contacts. That of two shapes together must be less than 0.004 units, 7.8e-6
m, beyond which points have no friction; with 1.5e-6 contacts at rest come and go, and towers lean (measured)."""
LEAST = 1e-6
"""The smallest speed (m/s) that PhysX accepts, for zero."""
FASTEST, FASTEST_LINEAR = 1e6, 1e16
"""Bounds of speeds (rad/s, 1/512 m/s), by default 100 rad/s."""
MOST_ITERATIONS = 255
SHAPES = ("sphere", "box", "capsule", "plane", "mesh")
_HALF = math.sqrt(0.5)
AXES: Mapping[str, Pose] = {
    "plane": Pose(quaternion=(_HALF, 0.0, -_HALF, 0.0)),
    "capsule": Pose(quaternion=(_HALF, 0.0, -_HALF, 0.0)),
}
"""Poses of PhysX's shapes, whose axis is x, in those of the world."""


def imported() -> Any:
    """SAPIEN, without the environment variables that it sets for its renderer."""
    before = dict(os.environ)
    import sapien

    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)
    return sapien


def lengths(values: Iterable[float], name: str) -> tuple[float, ...]:
    """Lengths (m, m/s, m/s²) in PhysX's unit."""
    return checked_singles(NAME, (SCALE * value for value in values), name)


class PhysxBuild:
    """``entities`` and ``actors``: those that represent each body of ``walk``, or the body that it is a part of;
    ``shapes``: those of each unit."""

    def __init__(self, walk: Walk, sidecar: PhysxSidecar):
        kinds = ("fixed", "free")
        refuse(walk, NAME, cones=("elliptic",), joints=kinds, shapes=SHAPES, moving_planes=False, carried_mass=False)
        self.sapien, self.walk = imported(), walk
        self.physx = self.sapien.physx
        self.iterations = int(sidecar.settings["iterations"])
        if not 1 <= self.iterations <= MOST_ITERATIONS:
            raise EngineError(NAME, f"takes from 1 to {MOST_ITERATIONS} iterations, not {self.iterations}")
        self.system = self._system(sidecar.restitution_threshold)
        self.scene = self.sapien.Scene([self.system])
        self.shapes: list[Any] = []
        of_body: dict[int, list[Any]] = {}
        for unit, words in zip(walk.units, self._words(), strict=True):
            shape, owner = self._shape(unit), unit.of.owner
            shape.set_collision_groups(list(words))
            self.shapes.append(shape)
            of_body.setdefault(owner.carrier if owner.moves else owner.row, []).append(shape)
        self.entities: list[Any] = []
        self.actors: list[Any] = []
        for placed in walk.bodies:
            if placed.moves and placed.carrier != placed.row:
                entity, actor = self.entities[placed.carrier], self.actors[placed.carrier]
            else:
                entity, actor = self._body(placed, of_body.get(placed.row, []))
            self.entities.append(entity)
            self.actors.append(actor)

    def _system(self, threshold: float) -> Any:
        """A scene; SAPIEN takes its settings from a configuration for all scenes that are made next."""
        physx, document = self.physx, self.walk.document
        config = physx.PhysxSceneConfig()
        config.gravity = lengths(document.gravity, "gravity")
        timestep = checked_singles(NAME, (document.timestep,), "timestep")[0]
        config.bounce_threshold = lengths((max(threshold, LEAST),), "restitution_threshold")[0]
        config.enable_pcm = False  # it would keep contacts of earlier steps
        config.enable_tgs = False  # with it slow slides stop a quarter too soon, and bodies at rest creep (measured)
        config.enable_ccd = False
        config.enable_enhanced_determinism = True
        config.enable_friction_every_iteration = True
        physx.set_scene_config(config)
        system = physx.PhysxCpuSystem()
        system.timestep = timestep
        return system

    def _words(self) -> list[tuple[int, int, int, int]]:
        """The filter of every unit."""
        try:
            first = kinds(self.walk.kinds, self.walk.meet)
            last = exclusions(self.walk.document.excluded.bodies)
        except ValueError as error:
            raise EngineError(NAME, str(error)) from error
        return [(*first[unit.kind], *last.get(unit.of.owner.body.name, (0, 0))) for unit in self.walk.units]

    def _body(self, placed: PlacedBody, shapes: list[Any]) -> tuple[Any, Any]:
        body, joint = placed.body, placed.body.joint
        actor = self._dynamic(body) if placed.moves else self.physx.PhysxRigidStaticComponent()
        for shape in shapes:
            actor.attach(shape)
        if placed.moves:
            self._set_mass(actor, body)
        pose = placed.pose
        if isinstance(joint, FreeJoint):
            pose = Pose(vector3(joint.position[:3]), frames.normalise(quaternion(joint.position[3:])))
        entity = self.sapien.Entity()
        entity.add_component(actor)
        entity.pose = self.pose(pose, f"pose of {body.name}")
        self.scene.add_entity(entity)
        return entity, actor

    def _dynamic(self, body: JsonBody) -> Any:
        if not body.mass > 0.0:
            raise EngineError(NAME, f"does not support {body.name!r}, which moves and has no mass")
        actor = self.physx.PhysxRigidDynamicComponent()
        actor.linear_damping = actor.angular_damping = 0.0
        actor.max_angular_velocity, actor.max_linear_velocity = FASTEST, FASTEST_LINEAR
        actor.max_depenetration_velocity = SCALE * LEAST
        actor.sleep_threshold = 0.0
        actor.solver_position_iterations, actor.solver_velocity_iterations = self.iterations, 1
        return actor

    def _set_mass(self, actor: Any, body: JsonBody) -> None:
        moments, axes = principal_axes(body.inertia)
        if not min(moments) > 0.0:
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
        actor.mass = checked_singles(NAME, (body.mass,), f"mass of {body.name}")[0]
        actor.inertia = checked_singles(NAME, (SCALE * SCALE * moment for moment in moments), f"inertia of {body.name}")
        actor.cmass_local_pose = self.pose(Pose(body.centre_of_mass, axes), f"centre of mass of {body.name}")

    def _shape(self, unit: ShapeUnit) -> Any:
        shape, copy, physx = unit.of.shape, unit.copy, self.physx
        size = lengths(shape.size, f"size of {shape.name}")
        # PhysX would replace such numbers, with a message on the error output alone
        if shape.kind != "mesh" and not all(edge > 0.0 for edge in size):
            raise EngineError(NAME, f"has no {shape.kind} of the size {min(shape.size)!r} ({shape.name})")
        friction, restitution = checked_singles(NAME, (copy.friction, copy.restitution), f"numbers of {shape.name}")
        if friction < 0.0 or not 0.0 <= restitution <= 1.0:
            raise EngineError(NAME, f"does not support the numbers of {shape.name!r}: {friction:g} and {restitution:g}")
        if copy.torsional_friction or copy.rolling_friction or copy.hardness is not None:
            raise EngineError(NAME, f"does not support more than friction and restitution of {shape.name!r}")
        material = physx.PhysxMaterial(friction, friction, restitution)
        match shape.kind:
            case "sphere":
                made = physx.PhysxCollisionShapeSphere(*size, material)
            case "box":
                made = physx.PhysxCollisionShapeBox([0.5 * edge for edge in size], material)
            case "capsule":
                made = physx.PhysxCollisionShapeCapsule(size[0], 0.5 * size[1], material)
            case "plane":
                made = physx.PhysxCollisionShapePlane(material)
            case _:
                made = self._hull(shape.name, size, material)
        pose = frames.compose(unit.of.pose, AXES[shape.kind]) if shape.kind in AXES else unit.of.pose
        made.local_pose = self.pose(pose, f"pose of {shape.name}")
        made.contact_offset, made.rest_offset = SCALE * CONTACT_OFFSET, 0.0
        made.patch_radius = made.min_patch_radius = 0.0
        return made

    def _hull(self, name: str, size: tuple[float, ...], material: Any) -> Any:
        """A convex hull of vertices (1/512 m, flat). PhysX computes the hull again: it drops some vertices silently
        (``approximations.py``), and makes a solid with other vertices of flat ones."""
        vertices = np.array(size, dtype=np.float32).reshape(-1, 3)
        try:
            made = self.physx.PhysxCollisionShapeConvexMesh(vertices, np.ones(3, dtype=np.float32), material)
        except RuntimeError as error:
            raise EngineError(NAME, f"makes no hull of the {len(vertices)} corners of {name!r}: {error}") from error
        wanted, actual = ({tuple(corner) for corner in points.tolist()} for points in (vertices, made.vertices))
        if actual != wanted:
            lost, added = len(wanted - actual), len(actual - wanted)
            raise EngineError(
                NAME, f"leaves {lost} of the {len(vertices)} corners of {name!r} out of its hull, and adds {added}"
            )
        return made

    def pose(self, pose: Pose, name: str) -> Any:
        return self.sapien.Pose(list(lengths(pose.position, name)), list(pose.quaternion))


SMALL = 1e-9
"""Torque that measures a mass matrix, as a share of the body's moment: it leaves no gyroscopic term."""


def unit_of(quaternion: Any) -> np.ndarray:
    turn = np.array(quaternion, dtype=float)
    found: np.ndarray = turn / np.linalg.norm(turn)
    return found


def inertia_of(actor: Any) -> np.ndarray:
    """The inertia (3, 3) of an actor about its centre of mass, in its own axes."""
    turn = matrices(unit_of(actor.cmass_local_pose.q))
    found: np.ndarray = turn @ np.diag(np.array(actor.inertia, dtype=float)) @ turn.T
    return found / (SCALE * SCALE)


def pose_of(pose: Any) -> Pose:
    """One of SAPIEN's poses as the world's."""
    x, y, z = (np.array(pose.p, dtype=float) / SCALE).tolist()
    return Pose((x, y, z), tuple(unit_of(pose.q).tolist()))


def mass_matrices(
    system: Any, bodies: Sequence[tuple[Any, Any]], poses: Sequence[Any], moments: np.ndarray
) -> np.ndarray:
    """The mass matrices (n, 6, 6) of ``bodies`` (entity, actor) of a scene without contact, at these poses: the inverse of what
    unit efforts give. ``moments`` (n,): about as large as their moments of inertia."""
    timestep = float(system.timestep)
    turns = [matrices(unit_of(pose.q)) for pose in poses]
    inverse = np.zeros((len(bodies), 6, 6))
    for column in range(6):
        for (entity, actor), pose, turn, moment in zip(bodies, poses, turns, moments, strict=True):
            entity.pose = pose
            actor.disable_gravity = True
            actor.linear_velocity = actor.angular_velocity = (0.0, 0.0, 0.0)
            force, torque = np.zeros(3), np.zeros(3)
            if column < 3:
                force[column] = SCALE
            else:
                torque = turn[:, column - 3] * (SMALL * moment * SCALE * SCALE)
            actor.add_force_torque(force, torque)
        system.step()
        for number, (_, actor) in enumerate(bodies):
            size = 1.0 if column < 3 else SMALL * moments[number]
            speed = np.array(actor.linear_velocity, dtype=float) / SCALE
            spin = turns[number].T @ np.array(actor.angular_velocity, dtype=float)
            inverse[number, :3, column] = speed / (size * timestep)
            inverse[number, 3:, column] = spin / (size * timestep)
    masses = np.linalg.inv(inverse)
    found: np.ndarray = 0.5 * (masses + masses.transpose(0, 2, 1))
    return found


NUMBERS = 13
"""Single-precision numbers of each packed body: quaternion, position, velocity, angular velocity (measured, not documented)."""


class PackedActors:
    """The states of ``actors``, all dynamic actors of a system, in one call of ``PhysxCpuSystem.pack``: of 216 bodies in
    14 µs, not 1.2 ms. Raises EngineError where the system has other actors, or packs other values than theirs."""

    def __init__(self, system: Any, actors: Sequence[Any]):
        self._system = system
        numbers = {actor: number for number, actor in enumerate(system.rigid_dynamic_components)}
        self._count = len(actors)
        self._order = np.array([numbers.get(actor, -1) for actor in actors], dtype=np.int64)
        if len(numbers) != self._count or (self._order < 0).any():
            raise EngineError(NAME, f"has {len(numbers)} bodies that move, not {self._count}")
        poses, speeds = self.read()
        for pose, speed, actor in zip(poses, speeds, actors, strict=True):
            at = actor.entity.pose
            state = (*at.p, *at.q, *actor.linear_velocity, *actor.angular_velocity)
            if not np.array_equal((*pose, *speed), np.array(state, dtype=float)):
                raise EngineError(NAME, "packs states in another way than SAPIEN 3.0.3")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7), position before quaternion, and velocities (n, 6) in world axes, in PhysX's unit."""
        packed = np.frombuffer(self._system.pack(), dtype=np.float32)
        if packed.size != NUMBERS * self._count:
            raise EngineError(NAME, f"packs {packed.size} numbers of {self._count} bodies, not {NUMBERS} of each")
        rows = packed.reshape(-1, NUMBERS)[self._order].astype(float)
        return rows[:, [4, 5, 6, 0, 1, 2, 3]], rows[:, 7:]
