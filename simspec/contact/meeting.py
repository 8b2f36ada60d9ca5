"""Which materials may meet in a world."""

from __future__ import annotations

import functools

from simspec.world.kinematics import CollisionFilter, rigid_groups
from simspec.world.types import Body, Shape, World


@functools.lru_cache(maxsize=8)
def meeting_materials(world: World) -> frozenset[tuple[str, str]]:
    """The sorted pairs of materials of which some body may touch some other."""
    representatives: dict[tuple[object, ...], list[Body]] = {}
    groups = rigid_groups(world)
    special = {name for pair in world.contact.excluded_bodies for name in pair}
    for body in world.bodies:
        materials = frozenset(shape.material for shape in body.shapes if shape.collision)
        if materials:
            static = groups[body.name] == "world"
            key = (materials, body.collision_group, static, body.name if body.name in special else "")
            representatives.setdefault(key, [])
            if len(representatives[key]) < 2:
                representatives[key].append(body)
    chosen = [body for bodies in representatives.values() for body in bodies]
    allowed = CollisionFilter(world)
    found: set[tuple[str, str]] = set()
    for index, one in enumerate(chosen):
        for other in chosen[index + 1 :]:
            if len(found) < len(world.contact.pairs) and allowed.may_touch(one.name, other.name):
                for a in {shape.material for shape in one.shapes if shape.collision}:
                    for b in {shape.material for shape in other.shapes if shape.collision}:
                        if allowed.may_materials_touch(a, b):
                            found.add((min(a, b), max(a, b)))
    return frozenset(found)


def solid_shapes(body: Body) -> tuple[Shape, ...]:
    """The collision shapes of a body."""
    return tuple(shape for shape in body.shapes if shape.collision)
