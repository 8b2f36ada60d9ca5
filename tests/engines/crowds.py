"""Bodies of all kinds that all overlap, for what may touch."""

from __future__ import annotations

import dataclasses

from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests import worlds

BOX = (Shape("box", "box", (0.1, 0.1, 0.1), Pose(), "default"),)


def crowd() -> World:
    """Trees of all kinds whose boxes all overlap: groups, exclusions, fixed bodies with and without mass."""

    def body(name: str, parent: str | None, kind: str, group: str = "default", mass: float = 1.0) -> Body:
        size = {"fixed": 0, "hinge": 1, "slide": 1, "ball": 3, "free": 6}[kind]
        position = {"fixed": (), "ball": (1.0, 0.0, 0.0, 0.0), "free": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)}.get(
            kind, (0.01,)
        )
        axis = (0.0, 0.0, 1.0) if kind in ("hinge", "slide") else (0.0, 0.0, 0.0)
        joint = Joint(f"{name}_joint", kind, parent, axis=axis, position=position, velocity=(0.0,) * size)
        inertia = (0.01, 0.01, 0.01, 0.0, 0.0, 0.0) if mass else (0.0,) * 6
        return Body(name, name, Inertial(mass, inertia=inertia), joint, BOX, group)

    bodies = (
        body("floor", None, "fixed", mass=0.0),
        body("wall", None, "fixed", "g", mass=3.0),
        body("shelf", "wall", "fixed", mass=0.0),
        body("arm", "shelf", "hinge"),
        body("root", None, "free"),
        body("a", "root", "hinge", "g"),
        body("b", "a", "fixed", "h"),
        body("c", "b", "slide"),
        body("d", "root", "ball", "h"),
        body("e", "c", "fixed"),
        body("pendulum", None, "hinge", "g"),
        body("ball", None, "free", "h"),
    )
    excluded = {*worlds.parent_pairs(bodies), ("ball", "d"), ("arm", "c")}
    contact = Contact(
        materials=(Material("default", 0.4),),
        pairs=(PairContact("default", "default", 0.4, 0.0),),
        ignored_groups=(("default", "h"), ("g", "g")),
        excluded_bodies=tuple(sorted(excluded)),
    )
    return worlds.world(bodies, contact=contact)


def crowd_and_contacts(parents_touch: bool) -> tuple[World, list[list[int]]]:
    """The crowd, and the pairs of its bodies that may touch; ``parents_touch``: a joint's two bodies among them."""
    world = crowd()
    if parents_touch:  # worlds always exclude parent and child; the engine must not do so by itself
        excluded = tuple(pair for pair in world.contact.excluded_bodies if pair != ("a", "root"))
        world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, excluded_bodies=excluded))
    allowed = CollisionFilter(world)
    names = [body.name for body in world.bodies]
    return world, [
        [i, j] for i in range(len(names)) for j in range(i + 1, len(names)) if allowed.may_touch(names[i], names[j])
    ]
