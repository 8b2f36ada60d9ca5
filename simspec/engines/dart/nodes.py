"""DART's body nodes: the world's bodies, and the welded nodes that hold further copies of their shapes.

DART holds friction and restitution per shape, but filters collision per body node (see ``dialects/dart/contact.py``).
Facts marked *measured*: dartpy 6.20.0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from simspec.dialects.dart.sidecar import DartSidecar
from simspec.engines.dart.coordinates import NAME
from simspec.errors import EngineError
from simspec.formats.skel.format import WORLD, file_name


def shape_nodes(node: Any) -> list[Any]:
    """A node's shapes; each is either a visual or a collision shape of the file."""
    return [node.getShapeNode(index) for index in range(node.getNumShapeNodes())]


def collision_nodes(node: Any) -> list[Any]:
    """A node's collision shapes, in the order of the file."""
    return [shape for shape in shape_nodes(node) if shape.hasCollisionAspect()]


class DartNodes:
    """The nodes of a world.

    names     of the world's bodies, in its order
    bodies    DART's own node of each
    place     index of a body, by the name of any of its nodes
    place_of_body  the same, by the body's own name in the world
    """

    def __init__(self, world: Any, sidecar: DartSidecar):
        self._sidecar = sidecar
        self.names = [entry.name for entry in sidecar.bodies]
        nodes: dict[str, Any] = {}
        for index in range(world.getNumSkeletons()):
            for node in world.getSkeleton(index).getBodyNodes():
                nodes[node.getName()] = node
        file_names = [file_name(name) for name in self.names]
        copies = {copy.node: file_name(copy.body) for copy in sidecar.copies}
        wanted = {*file_names, *copies}
        missing, more = sorted(wanted - set(nodes)), sorted(set(nodes) - wanted)
        if missing or more:
            raise EngineError(NAME, f"{WORLD} has no bodies {missing}, and the sidecar has no bodies {more}")
        self.bodies = [nodes[name] for name in file_names]
        self.place = {name: index for index, name in enumerate(file_names)}
        self.place_of_body = {name: index for index, name in enumerate(self.names)}
        self._of: list[list[Any]] = [[body] for body in self.bodies]
        for name, body in copies.items():
            place = self.place[name] = self.place[body]
            self._of[place].append(nodes[name])
        self._nodes = nodes
        self._copies = self._find_copies()
        self._layer_of = {frozenset((name, other)): layer for name, other, layer in sidecar.filter.layers}

    def of(self, index: int) -> Sequence[Any]:
        """All nodes of a body, its own first."""
        return self._of[index]

    def solid(self, index: int) -> bool:
        """Whether a body has collision shapes."""
        return any(collision_nodes(node) for node in self._of[index])

    def _find_copies(self) -> dict[str, tuple[int, int]]:
        """Of every collision shape of DART, by its name and its node's, the sidecar's entry and the number of the copy."""
        left = {name: collision_nodes(node) for name, node in self._nodes.items()}
        found = {}
        for number, shape in enumerate(self._sidecar.shapes):
            for index, copy in enumerate(shape.surfaces):
                if not left.get(copy.node):
                    raise EngineError(NAME, f"{WORLD} has too few collision shapes on {copy.node!r}")
                shape = left[copy.node].pop(0)
                found[_key(shape)] = (number, index)
        extra = sorted(name for name, shapes in left.items() if shapes)
        if extra:
            raise EngineError(NAME, f"{extra} have collision shapes that the sidecar does not name")
        return found

    def copy(self, shape: Any) -> tuple[int, int]:
        """The place in the sidecar's list of the shape that a collision shape of DART is a copy of, and which copy."""
        return self._copies[_key(shape)]

    def wrong_meeting(self, shape: Any, other: Any) -> str:
        """The fault where two collision shapes touch that are not the intended copies; "" for the intended ones.

        The filter is DART's own and cannot be listed; a contact shows what it lets through.
        """
        shapes, copies = self._sidecar.shapes, (self.copy(shape), self.copy(other))
        pair = frozenset(shapes[number].material for number, _ in copies)
        layers = {shapes[number].surfaces[index].layer for number, index in copies}
        if pair in self._layer_of and layers != {self._layer_of[pair]}:
            names = " and ".join(repr(shapes[number].name) for number, _ in copies)
            return f"lets copies of {names} touch that are in layers {sorted(layers)}, not {self._layer_of[pair]}"
        return ""

    def set_surfaces(self) -> None:
        """Give every copy of a shape its numbers."""
        for node in self._nodes.values():
            for shape in collision_nodes(node):
                number, index = self.copy(shape)
                numbers, aspect = self._sidecar.shapes[number].surfaces[index], shape.getDynamicsAspect()
                aspect.setFrictionCoeff(numbers.friction)
                aspect.setRestitutionCoeff(numbers.restitution)

    def without_friction(self) -> bool:
        """Whether no collision shape has friction in DART."""
        nodes = self._nodes.values()
        return not any(
            shape.getDynamicsAspect().getFrictionCoeff() for node in nodes for shape in collision_nodes(node)
        )

    def excluded_pairs(self) -> Iterator[tuple[Any, Any]]:
        """The pairs of nodes that must not touch; a pair may come twice."""
        sidecar = self._sidecar
        of = dict(zip(self.names, self._of, strict=True))
        for class_ in self._of:  # a body does not touch itself
            yield from ((node, other) for index, node in enumerate(class_) for other in class_[index + 1 :])
        bodies = list(sidecar.excluded)
        for first, second in sidecar.ignored_groups:
            bodies.extend(
                (name, other) for name in sidecar.groups[first] for other in sidecar.groups[second] if name != other
            )
        for item, other in bodies:
            yield from ((a, b) for a in of[item] for b in of[other])
        classes = {name: [self._nodes[node] for node in class_] for name, class_ in sidecar.filter.classes.items()}
        for first, second in sidecar.filter.excluded:
            if first == second:
                class_ = classes[first]
                yield from ((node, other) for index, node in enumerate(class_) for other in class_[index + 1 :])
            else:
                yield from ((node, other) for node in classes[first] for other in classes[second])


def _key(shape: Any) -> str:
    return f"{shape.getBodyNodePtr().getName()}/{shape.getName()}"
