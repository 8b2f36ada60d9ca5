"""What sidecars say of joints that the language of their files does not: springs and armature, by the name of the body."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from simspec.formats.kit.forms import check_distinct, check_known
from simspec.world.types import Body, World

UNREADABLE: Final[Mapping[str, str]] = {
    "collision_group": "the files carry what touches what, not the names of groups",
    "control.native": "the engine's own controllers are switched on when a run begins",
}
"""What files of most dialects cannot tell, for ``ReadBack.unreadable``."""


@dataclass(frozen=True, slots=True)
class Spring:
    """A joint's spring: effort −k (q − rest), stiffness k (N m/rad, N/m), rest (rad, m)."""

    body: str
    stiffness: float
    rest: float


@dataclass(frozen=True, slots=True)
class Armature:
    """What is added to a joint's diagonal of the mass matrix (kg m², kg)."""

    body: str
    armature: float


class OfBody(Protocol):
    """An entry that speaks of one body."""

    @property
    def body(self) -> str:
        """The body's name."""
        ...


def springs_of(world: World) -> tuple[Spring, ...]:
    """The springs of a world's joints."""
    return tuple(
        Spring(body.name, body.joint.spring_stiffness, body.joint.spring_rest)
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


def add_springs(bodies: dict[str, Body], springs: Iterable[Spring]) -> None:
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
