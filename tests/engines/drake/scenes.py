"""Worlds for tests of Drake: a floor, and boxes or other shapes on it."""

from __future__ import annotations

from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Physics, Pose, Shape, World
from tests import worlds

FREE = (1.0, 0.0, 0.0, 0.0)


def with_settings(world, **settings):
    """``world`` with settings for Drake, and its approximations accepted."""
    accept = (
        *("contact.cone.elliptic", *worlds.FRICTION, "joint.limits.position"),
        "shape.box",
    )
    return worlds.with_options(world, "drake", accept=accept, settings=tuple(sorted(settings.items())))


def boxes(count, timestep=0.001, friction=0.5, tower=True, kind="box", floor="box"):
    """A floor, and boxes on one another or in a row."""
    solid = {"box": (5.0, 5.0, 1.0), "plane": ()}[floor]
    below = Pose((0.0, 0.0, -0.5)) if floor == "box" else Pose()
    bodies = [
        Body(
            "floor",
            "floor",
            Inertial(1.0),
            Joint("floor_joint", "fixed"),
            (Shape("floor_0", floor, solid, below, "a"),),
        )
    ]
    size = {"box": (0.1, 0.1, 0.1), "cylinder": (0.05, 0.1), "sphere": (0.05,)}[kind]
    for index in range(count):
        at = (0.0, 0.0, 0.05 + 0.1 * index) if tower else (0.2 * index, 0.0, 0.05)
        joint = Joint(f"j{index}", "free", position=(*at, *FREE), velocity=(0.0,) * 6)
        inertial = Inertial(1.0, inertia=(0.00166, 0.00166, 0.00166, 0.0, 0.0, 0.0))
        bodies.append(
            Body(f"b{index}", f"b{index}", inertial, joint, (Shape(f"b{index}_0", kind, size, material="a"),))
        )
    contact = Contact("elliptic", (Material("a", friction),), (PairContact("a", "a", friction, 0.0),))
    return World("boxes", tuple(bodies), contact, Physics(timestep=timestep, steps=1000))
