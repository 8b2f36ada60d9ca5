"""Names of the generalised coordinates, one for every column of q and of v.

A hinge or slide has its joint's name (``elbow``). A ball joint has a column for each component of its quaternion and of its
angular velocity (``shoulder.qw``, ``shoulder.wx``). A free body has those of its centre of mass, its quaternion and its
velocities, under the *body's* name (``base.x``, ``base.qw``, ``base.vx``, ``base.wx``). What they mean physically stands in
:mod:`simspec.world.kinematics`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from simspec.world.kinematics import layout_of
from simspec.world.types import World

POSITION_COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "fixed": (),
    "hinge": ("",),
    "slide": ("",),
    "ball": (".qw", ".qx", ".qy", ".qz"),
    "free": (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz"),
}
"""What stands behind the name in q, by the joint's kind."""
VELOCITY_COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "fixed": (),
    "hinge": ("",),
    "slide": ("",),
    "ball": (".wx", ".wy", ".wz"),
    "free": (".vx", ".vy", ".vz", ".wx", ".wy", ".wz"),
}
"""The same in v."""


@dataclass(frozen=True, slots=True)
class Coordinates:
    """The names of the columns of q (nq,) and v (nv,), and which columns belong to a name: those of a whole joint under the
    joint's name (of a free body also under the body's), and each column under its own."""

    q: tuple[str, ...]
    v: tuple[str, ...]
    q_columns: Mapping[str, slice]
    v_columns: Mapping[str, slice]

    def __repr__(self) -> str:
        return f"<Coordinates: {len(self.q)} positions, {len(self.v)} velocities>"


def coordinates(world: World) -> Coordinates:
    """The names of ``world``'s generalised coordinates."""
    where = layout_of(world)
    balls = {body.joint.name for body in world.bodies if body.joint.kind == "ball"}
    q: list[str] = []
    v: list[str] = []
    of_q: dict[str, slice] = {}
    of_v: dict[str, slice] = {}
    for body, position, velocity in zip(world.bodies, where.position, where.velocity, strict=True):
        joint = body.joint
        name = joint.name
        if joint.kind == "free":
            # no name of a spec has brackets: different from a ball joint that is called like the body
            name = body.name if body.name not in balls else f"{body.name}(free)"
        if joint.kind != "fixed":
            for known, part in ((of_q, position), (of_v, velocity)):
                known[name] = part
                known.setdefault(joint.name, part)
        q.extend(name + component for component in POSITION_COMPONENTS[joint.kind])
        v.extend(name + component for component in VELOCITY_COMPONENTS[joint.kind])
    of_q |= {name: slice(k, k + 1) for k, name in enumerate(q)}
    of_v |= {name: slice(k, k + 1) for k, name in enumerate(v)}
    return Coordinates(tuple(q), tuple(v), of_q, of_v)
