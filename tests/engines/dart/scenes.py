"""Scenes of contact for DART."""

from __future__ import annotations

from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape
from tests import worlds


def scene(shape, at, velocity, friction=0.0, restitution=0.0, cone="elliptic", floor="box"):
    """One body of 1 kg above a floor that cannot move: a big box or a plane."""
    size, pose = ((20.0, 20.0, 0.2), Pose((0.0, 0.0, -0.1))) if floor == "box" else ((), Pose())
    ground = Body(
        "floor",
        "floor",
        Inertial(0.0),
        Joint("floor_joint", "fixed"),
        (Shape("floor_0", floor, size, pose, "default"),),
    )
    joint = Joint("b_joint", "free", position=(*at, 1.0, 0.0, 0.0, 0.0), velocity=(*velocity, 0.0, 0.0, 0.0))
    inertial = Inertial(1.0, inertia=(0.004, 0.004, 0.004, 0.0, 0.0, 0.0))
    body = Body("b", "b", inertial, joint, (Shape("b_0", *shape, Pose(), "default"),))
    contact = Contact(
        cone,
        materials=(Material("default", friction, restitution),),
        pairs=(PairContact("default", "default", friction, restitution),),
    )
    return worlds.world((ground, body), contact=contact)
