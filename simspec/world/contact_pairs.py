"""Which bodies, shapes and materials may touch in a world, the laws of those that do, and the sizes that bound solver
settings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from simspec.world.canonical import derived
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Pair, PairContact, Shape, World

# Which materials and which shapes may meet in a world, and the laws of those that do.


class CollisionFilter:
    """Which bodies may touch, by the world's rules (see :class:`simspec.world.types.Contact`)."""

    def __init__(self, world: World):
        self._groups = rigid_groups(world)
        self._collision_group = {body.name: body.collision_group for body in world.bodies}
        self._ignored = set(world.contact.ignored_groups)
        self._excluded = set(world.contact.excluded_bodies)
        self._solid = {body.name for body in world.bodies if any(shape.collision for shape in body.shapes)}
        self._passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}
        self._materials = (
            {body.name: {shape.material for shape in body.shapes if shape.collision} for body in world.bodies}
            if self._passing
            else {}
        )

    def may_touch(self, first: str, second: str) -> bool:
        """Whether contact between the two bodies is allowed; False for a body with itself or without shapes."""
        if first == second or first not in self._solid or second not in self._solid:
            return False
        if self._groups[first] == self._groups[second]:
            return False
        if (min(first, second), max(first, second)) in self._excluded:
            return False
        group, other = self._collision_group[first], self._collision_group[second]
        if (min(group, other), max(group, other)) in self._ignored:
            return False
        return not self._passing or any(
            self.may_materials_touch(a, b) for a in self._materials[first] for b in self._materials[second]
        )

    def may_materials_touch(self, first: str, second: str) -> bool:
        """Whether shapes of the two materials collide at all."""
        return (min(first, second), max(first, second)) not in self._passing


@derived
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
    for index, entry in enumerate(chosen):
        if len(found) == len(world.contact.pairs):
            break  # all that there are
        for other in chosen[index + 1 :]:
            if len(found) < len(world.contact.pairs) and allowed.may_touch(entry.name, other.name):
                for a in {shape.material for shape in entry.shapes if shape.collision}:
                    for b in {shape.material for shape in other.shapes if shape.collision}:
                        if allowed.may_materials_touch(a, b):
                            found.add((min(a, b), max(a, b)))
    return frozenset(found)


@derived
def meeting_laws(world: World) -> Mapping[Pair, PairContact]:
    """The laws of the pairs of materials that meet and collide, by their sorted names."""
    met = meeting_materials(world)
    laws = {(pair.first, pair.second): pair for pair in world.contact.pairs if (pair.first, pair.second) in met}
    return MappingProxyType(laws)


@derived
def meeting_kinds(world: World) -> frozenset[tuple[str, str]]:
    """The sorted pairs of kinds of collision shapes of which some body may touch some other.

    The search for one such pair of bodies passes over excluded pairs only, so that its cost grows with their number.
    """
    allowed = CollisionFilter(world)
    rigid = rigid_groups(world)
    ignored = set(world.contact.ignored_groups)
    classes: dict[str, dict[tuple[bool, str], list[Body]]] = {}
    for body in world.bodies:
        key = (rigid[body.name] == "world", body.collision_group)
        for kind in {shape.kind for shape in solid_shapes(body)}:
            classes.setdefault(kind, {}).setdefault(key, []).append(body)

    def meet(name: str, other: str) -> bool:
        for (static, group), bodies in classes[name].items():
            for (other_static, other_group), others in classes[other].items():
                if static and other_static:
                    continue
                if (min(group, other_group), max(group, other_group)) in ignored:
                    continue
                if any(allowed.may_touch(a.name, b.name) for a in bodies for b in others):
                    return True
        return False

    return frozenset(
        (class_, other) for class_ in classes for other in classes if class_ <= other and meet(class_, other)
    )


@derived
def frictionless(world: World) -> bool:
    """Whether the world has contact and none of its pairs of materials, also of those that never meet, has friction."""
    return bool(world.contact.pairs) and not any(pair.friction for pair in world.contact.pairs)


@derived
def only_free_spheres(world: World) -> bool:
    """Whether the world is without friction, all that moves is a free body by itself, held to no other, and each has spheres
    alone as collision shapes: every two shapes then meet in one point."""
    groups = rigid_groups(world)
    moving = [body for body in world.bodies if groups[body.name] != "world"]
    return (
        frictionless(world)
        and not world.constraints
        and all(body.joint.kind == "free" for body in moving)  # a body that is joined to another is not free
        and all(shape.kind == "sphere" for body in moving for shape in solid_shapes(body))
    )


def solid_shapes(body: Body) -> tuple[Shape, ...]:
    """The collision shapes of a body."""
    return tuple(shape for shape in body.shapes if shape.collision)


def shape_pairs(world: World, pairs: Iterable[Pair]) -> Iterator[tuple[str, str]]:
    """The sorted names of every two shapes of these pairs of materials that may touch."""
    shapes: dict[str, list[tuple[int, str, str]]] = {}
    for index, body in enumerate(world.bodies):
        for shape in solid_shapes(body):
            shapes.setdefault(shape.material, []).append((index, body.name, shape.name))
    allowed = CollisionFilter(world)
    for entry, two in pairs:
        for index, owner, name in shapes.get(entry, ()):
            for other_index, other_owner, other in shapes.get(two, ()):
                if (entry != two or index < other_index) and allowed.may_touch(owner, other_owner):
                    yield (min(name, other), max(name, other))


@derived
def excluded_pairs(world: World) -> tuple[Pair, ...]:
    """Every pair of bodies in the *same rigid group* that moves, and every explicitly excluded pair, sorted: the pairs that an
    engine's filter needs.

    Bodies without collision shapes are left out. A pair of immovable bodies needs no filter: no engine tests static bodies
    against each other in a way that moves anything. Collision groups are written separately, by each dialect's own means.
    """
    solid = {body.name for body in world.bodies if solid_shapes(body)}
    pairs = {pair for pair in world.contact.excluded_bodies if pair[0] in solid and pair[1] in solid}
    members: dict[str, list[str]] = {}
    for name, group in rigid_groups(world).items():
        if group != "world" and name in solid:
            members.setdefault(group, []).append(name)
    for names in members.values():
        names.sort()
        pairs.update((first, second) for index, first in enumerate(names) for second in names[index + 1 :])
    return tuple(sorted(pairs))


# The smallest shape of a world, and the heaviest body that can touch something: sizes that bound solver settings.


@dataclass(frozen=True, slots=True)
class Thinnest:
    """A collision shape by its body, its place among the body's shapes, and its inner radius (m)."""

    body: str
    index: int
    inner: float


@derived
def thinnest(world: World) -> Thinnest | None:
    """The collision shape of the least inner radius; None where all have no end, or there are none."""
    shapes = [
        Thinnest(body.name, index, SHAPES[shape.kind].inner_radius(shape.size))
        for body in world.bodies
        for index, shape in enumerate(body.shapes)
        if shape.collision
    ]
    finite = [shape for shape in shapes if 0.0 < shape.inner < math.inf]
    return min(finite, key=lambda entry: entry.inner, default=None)


@derived
def heaviest(world: World) -> tuple[str, float] | None:
    """The name and mass (kg) of the heaviest rigid body that moves and can touch something; None where there is none. Kinematic
    bodies, which no contact moves, are left out."""
    groups, kinematic = rigid_groups(world), {motion.body for motion in world.motions}
    masses: dict[str, float] = {}
    solid: set[str] = set()
    for body in world.bodies:
        group = groups[body.name]
        if group == "world" or group in kinematic:
            continue
        masses[group] = masses.get(group, 0.0) + body.inertial.mass
        if any(shape.collision for shape in body.shapes):
            solid.add(group)
    touching = [(mass, name) for name, mass in masses.items() if name in solid and mass]
    if not touching:
        return None
    mass, name = max(touching)
    return name, mass
