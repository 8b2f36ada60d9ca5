"""What sidecars say of forces that act on bodies at all times and that the files of a format do not have: weights that are not
mass × gravity, damping of free bodies, and a fluid. Engines are given them as efforts before every step
(``engines/kit/passive.py``)."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass

from simspec.formats.kit.forms import check_distinct, check_known
from simspec.world.actions import Box, Fluid
from simspec.world.inertia import lumped_gravity_scale
from simspec.world.types import Body, World


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
    box: Box


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
    """What a world has of it; None where it has nothing."""
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
    """``bodies`` as an engine is told them, completed by what it is given at every step."""
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
