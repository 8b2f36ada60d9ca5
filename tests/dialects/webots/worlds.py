"""The worlds of the self-test, each without what Webots has no word for."""

from __future__ import annotations

import dataclasses

from simspec.errors import UnsupportedError
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing.worlds import accepting
from simspec.world.kinematics import joined
from simspec.world.types import World


def bare(world: World) -> World:
    """A world without filters but for joints and with one material on each body; Webots' approximations are accepted."""
    law = world.contact
    passing = {pair.first if pair.first != "ice" else pair.second for pair in law.pairs if not pair.collide}
    bodies = tuple(
        dataclasses.replace(
            body,
            collision_group="default",
            shapes=tuple(shape for shape in body.shapes if not shape.collision or shape.material == first),
        )
        for body in world.bodies
        for first in [next((shape.material for shape in body.shapes if shape.collision), "")]
        if first not in passing
    )
    pairs = tuple(pair for pair in law.pairs if not {pair.first, pair.second} & passing)
    contact = dataclasses.replace(
        law,
        materials=tuple(material for material in law.materials if material.name not in passing),
        pairs=pairs,
        ignored_groups=(),
        excluded_bodies=tuple(sorted(joined(bodies))),
    )
    return accepting(dataclasses.replace(world, bodies=bodies, contact=contact), "webots")


def every() -> dict[str, World]:
    """By name those that Webots then supports."""
    found = {}
    for name, make in WORLDS.items():
        try:
            found[name] = bare(make("webots"))
        except UnsupportedError:
            continue
    return found
