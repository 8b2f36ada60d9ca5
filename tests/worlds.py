"""The shipped worlds of tests, with what simspec's own engines need to be accepted in them, for tests that compile a world for
several engines at once."""

from __future__ import annotations

import dataclasses

from simspec.proof.selftest_worlds import FRICTION
from simspec.testing import worlds as shipped
from simspec.testing.worlds import *  # noqa: F403 - the same module, with options added to four of its worlds
from simspec.world.types import EngineOptions, Pose, Shape, World

MUJOCO = EngineOptions(
    "mujoco",
    accept=(*FRICTION,),
)
"""Features to accept in a world with friction and moving bodies."""
MJX = EngineOptions(
    "mjx",
    accept=(*FRICTION,),
)
"""The same."""
MJWARP = EngineOptions(
    "mjwarp",
    accept=(*FRICTION,),
)
"""The same."""
BULLET = EngineOptions("pybullet", accept=("contact.cone.elliptic",))
"""Features to accept in a world where shapes other than balls have friction, under the elliptic cone."""
GAZEBO = EngineOptions("gazebo", accept=("contact.cone.elliptic",))
"""Features to accept in a world with friction, under the elliptic cone."""
RAPIER = EngineOptions("rapier", accept=("contact.cone.elliptic",))
"""Features to accept in a world where shapes other than balls have friction, under the elliptic cone."""
PHYSX = EngineOptions("physx", accept=("contact.cone.elliptic", "shape.box", "shape.mesh"))
"""Features to accept in a world with friction, under the elliptic cone, where boxes or hulls may meet each other."""
ROUGH = (MUJOCO, MJX, MJWARP, BULLET, GAZEBO, RAPIER, PHYSX)
KINDS = ("sphere", "box", "cylinder", "capsule")


def shapes_world(kinds: tuple[str, ...] = KINDS, friction: float = 0.4) -> World:
    """As shipped. DART has no collision detector that is exact for all these shapes: its deviations are accepted."""
    accepted = tuple(f"shape.{kind}" for kind in ("capsule", "cylinder", "ellipsoid", "plane"))
    options = (
        EngineOptions("dart", accept=accepted),
        EngineOptions("ode", accept=("shape.cylinder",)),
        *(MUJOCO, BULLET, RAPIER, PHYSX),
        dataclasses.replace(GAZEBO, accept=(*GAZEBO.accept, "shape.cylinder")),
    )
    return dataclasses.replace(shipped.shapes_world(kinds, friction), engines=options)


def gripper() -> World:
    """As shipped."""
    return dataclasses.replace(shipped.gripper(), engines=ROUGH)


def ball_with_law(**law: object) -> World:
    """As shipped."""
    return dataclasses.replace(shipped.ball_with_law(**law), engines=(MUJOCO, GAZEBO, PHYSX))


def table(friction: dict[tuple[str, str], float], **law: object) -> World:
    """As shipped."""
    return dataclasses.replace(shipped.table(friction, **law), engines=ROUGH)


def mixed_shapes() -> World:
    """A body with a visual shape between two collision shapes, one of which is not seen."""
    base = shapes_world(("box",))
    shapes = (
        Shape("solid", "sphere", (0.1,), Pose((0.1, 0.0, 0.0)), "default", visual=False),
        Shape("seen", "capsule", (0.1, 0.3), Pose((0.0, 0.2, 0.0)), collision=False, colour=(0.1, 0.2, 0.3, 0.4)),
        Shape("both", "cylinder", (0.1, 0.3), Pose((0.0, 0.0, 0.3)), "default"),
    )
    return dataclasses.replace(base, bodies=(base.bodies[0], dataclasses.replace(base.bodies[1], shapes=shapes)))
