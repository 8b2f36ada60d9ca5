"""Fields of sidecars on joints, for quantities that the language of the files lacks: springs and armature, by the name of the
body."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from simspec.formats.kit.forms import check_distinct, check_known
from simspec.world.actions import Fluid, InertiaBox
from simspec.world.inertia import lumped_gravity_scale
from simspec.world.kinematics import initial_state, layout
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Body, World

UNREADABLE: Final[Mapping[str, str]] = {
    "collision_group": "the files carry what touches what, not the names of groups",
    "control.native": "the engine's own controllers are switched on when a run begins",
}
"""Quantities that files of most dialects cannot express, for ``ReadBack.unreadable``."""


@dataclass(frozen=True, slots=True)
class JointSpring:
    """A joint's spring: effort −k (q − rest), stiffness k (N m/rad, N/m), rest (rad, m)."""

    body: str
    stiffness: float
    rest: float


@dataclass(frozen=True, slots=True)
class JointValue:
    """A number of a body's joint."""

    body: str
    value: float


@dataclass(frozen=True, slots=True)
class Armature:
    """The addition to a joint's diagonal of the mass matrix (kg m², kg)."""

    body: str
    armature: float


class OfBody(Protocol):
    """An entry that speaks of one body."""

    @property
    def body(self) -> str:
        """The body's name."""
        ...


def springs_of(world: World) -> tuple[JointSpring, ...]:
    """The springs of a world's joints."""
    return tuple(
        JointSpring(body.name, body.joint.spring_stiffness, body.joint.spring_rest)
        for body in world.bodies
        if body.joint.spring_stiffness
    )


def armature_of(world: World) -> tuple[Armature, ...]:
    """The armature of a world's joints."""
    return tuple(Armature(body.name, body.joint.armature) for body in world.bodies if body.joint.armature)


def check_of_bodies(lists: Mapping[str, Iterable[OfBody]], bodies: Collection[str]) -> None:
    """Raise ValueError where one of a sidecar's lists names a body twice, or one that is not there."""
    for name, entries in lists.items():
        names = [entry.body for entry in entries]
        check_distinct(names, f"sidecar.{name}")
        check_known(names, bodies, f"sidecar.{name}")


def add_springs(bodies: dict[str, Body], springs: Iterable[JointSpring]) -> None:
    """Give the joints of ``bodies`` (by name) their springs."""
    for spring in springs:
        body = bodies[spring.body]
        joint = dataclasses.replace(body.joint, spring_stiffness=spring.stiffness, spring_rest=spring.rest)
        bodies[spring.body] = dataclasses.replace(body, joint=joint)


def add_armature(bodies: dict[str, Body], armature: Iterable[Armature]) -> None:
    """Give the joints of ``bodies`` (by name) their armature."""
    for entry in armature:
        body = bodies[entry.body]
        bodies[entry.body] = dataclasses.replace(body, joint=dataclasses.replace(body.joint, armature=entry.armature))


# Fields of sidecars on forces that act on bodies at all times and that a format lacks: weights that are not
# mass × gravity, damping of free bodies, and a fluid. Engines are given them as efforts before every step
# (``engines/kit/efforts.py``).


@dataclass(frozen=True, slots=True)
class GravityScale:
    """The weight of a body is so many times mass × gravity."""

    body: str
    scale: float


@dataclass(frozen=True, slots=True)
class FreeDamping:
    """A free body's damping: a force −``linear`` v at its centre of mass (N s/m) and a torque −``angular`` ω (N m s/rad)."""

    body: str
    linear: float
    angular: float


@dataclass(frozen=True, slots=True)
class InFluid:
    """The box by which a body feels the fluid (``world/actions.py``)."""

    body: str
    box: InertiaBox


@dataclass(frozen=True, slots=True)
class Around:
    """A fluid, and the bodies that feel it."""

    fluid: Fluid
    boxes: tuple[InFluid, ...]


@dataclass(frozen=True, slots=True)
class Passive:
    """The bodies for which there is something to say, each once, in the world's order."""

    gravity_scales: tuple[GravityScale, ...]
    free_damping: tuple[FreeDamping, ...]
    around: Around | None = None

    def check(self, bodies: Collection[str]) -> None:
        """Raise ValueError where a list names a body twice, or one that is not there."""
        lists = {
            "gravity_scales": [entry.body for entry in self.gravity_scales],
            "free_damping": [entry.body for entry in self.free_damping],
            "around.boxes": [] if self.around is None else [entry.body for entry in self.around.boxes],
        }
        for name, names in lists.items():
            check_distinct(names, f"sidecar.passive.{name}")
            check_known(names, bodies, f"sidecar.passive.{name}")


def passive_of(world: World) -> Passive | None:
    """The fields of a world; None where it has none."""
    scales = ((body.name, lumped_gravity_scale(world, body)) for body in world.bodies)
    passive = Passive(
        tuple(GravityScale(name, scale) for name, scale in scales if scale != 1.0),
        tuple(
            FreeDamping(body.name, body.joint.damping, body.joint.angular_damping)
            for body in world.bodies
            if body.joint.kind == "free" and (body.joint.damping or body.joint.angular_damping)
        ),
        _around(world),
    )
    return passive if passive.gravity_scales or passive.free_damping or passive.around else None


def _around(world: World) -> Around | None:
    boxes = tuple(InFluid(body.name, body.box) for body in world.bodies if body.box is not None)
    return None if world.physics.fluid is None or not boxes else Around(world.physics.fluid, boxes)


def fluid_of(passive: Passive | None) -> Fluid | None:
    """The fluid that a sidecar says."""
    return None if passive is None or passive.around is None else passive.around.fluid


def with_passive(bodies: tuple[Body, ...], passive: Passive | None) -> tuple[Body, ...]:
    """``bodies`` as an engine receives them, completed by the efforts that it receives at every step."""
    if passive is None:
        return bodies
    scales = {entry.body: entry.scale for entry in passive.gravity_scales}
    damping = {entry.body: entry for entry in passive.free_damping}
    boxes = {} if passive.around is None else {entry.body: entry.box for entry in passive.around.boxes}
    completed = []
    for body in bodies:
        if body.name in damping:
            entry = damping[body.name]
            joint = dataclasses.replace(body.joint, damping=entry.linear, angular_damping=entry.angular)
            body = dataclasses.replace(body, joint=joint)
        scale, box = scales.get(body.name, body.gravity_scale), boxes.get(body.name, body.box)
        completed.append(dataclasses.replace(body, gravity_scale=scale, box=box))
    return tuple(completed)


# Whether the trees that a sidecar lists fit its bodies: for dialects whose files hold one tree each.

UNIT: Final = 1e-9
"""How far a quaternion may be from unit length: numbers are printed to round-trip, and normalised before."""


def check_every_body(trees: Iterable[Sequence[str]], kinds: Mapping[str, str]) -> None:
    """Raise ValueError unless each body of ``kinds`` (joint kind by name) is in one of the ``trees``, once."""
    named = [name for bodies in trees for name in bodies]
    check_distinct(named, "sidecar.instances")
    if set(named) != set(kinds):
        raise ValueError(f"sidecar.instances and sidecar.bodies differ in {sorted(set(named) ^ set(kinds))}")


def check_by_body(bodies: Sequence[str], lists: Mapping[str, Sequence[object]], at: str) -> None:
    """Raise ValueError where a tree has no bodies, or one of its lists has not one entry for each."""
    if not bodies:
        raise ValueError(f"{at} has no bodies")
    for name, entries in lists.items():
        if len(entries) != len(bodies):
            raise ValueError(f"{at}.{name} has {len(entries)} entries for {len(bodies)} bodies")


def check_coordinates(kinds: Sequence[str], position: Sequence[float], velocity: Sequence[float], at: str) -> None:
    """Raise ValueError where positions or velocities are not as many as joints of these ``kinds`` have."""
    for name, sizes, numbers in (("position", POSITION_SIZE, position), ("velocity", VELOCITY_SIZE, velocity)):
        size = sum(sizes[kind] for kind in kinds)
        if len(numbers) != size:
            raise ValueError(f"{at}.{name} has {len(numbers)} numbers, should have {size}")


def check_unit(quaternions: Iterable[Sequence[float]], at: str) -> None:
    """Raise ValueError where a quaternion is not of unit length."""
    if any(abs(math.hypot(*quaternion) - 1.0) > UNIT for quaternion in quaternions):
        raise ValueError(f"{at} has a quaternion that is not of unit length")


# A world's initial state, tree by tree, for sidecars.


class InitialCoordinates:
    """The world's initial state in generalised coordinates, by body."""

    def __init__(self, world: World):
        self._q, self._v = initial_state(world)
        self._places = layout(world.bodies)
        self._index = {body.name: index for index, body in enumerate(world.bodies)}

    def of(self, bodies: Iterable[Body]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The positions and velocities of these bodies, one after the other."""
        q: list[float] = []
        v: list[float] = []
        for body in bodies:
            index = self._index[body.name]
            q.extend(self._q[self._places.position[index]].tolist())
            v.extend(self._v[self._places.velocity[index]].tolist())
        return tuple(q), tuple(v)
