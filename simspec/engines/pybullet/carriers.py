"""Which shapes which of PyBullet's links carries (see ``dialects/pybullet/contact.py``)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from simspec.dialects.pybullet.sidecar import Instance


def own_solid(instance: Instance, position: int) -> list[str]:
    """The names of the collision shapes on the own link of a tree's body: all of its first solid shape's material. Links of
    their own carry the other materials, and further copies of the first."""
    seen = set(instance.visual_only[position])
    solid = [name for index, name in enumerate(instance.shapes[position]) if index not in seen]
    carried = [copy.shapes for copy in instance.copies if copy.body == instance.bodies[position]]
    again = next((names for names in carried if solid and solid[0] in names), None)
    elsewhere = {name for names in carried for name in names}
    return [name for name in solid if (name in again if again is not None else name not in elsewhere)]


def carriers(trees: Iterable[Any], instances: Iterable[Instance]) -> dict[tuple[int, int], tuple[int, tuple[str, ...]]]:
    """Of every link (tree's uid, link) that stands for a body or carries its shapes: the body's index and those shapes' names.

    ``trees`` are ``pybullet_simulation.Tree``s, in the order of the sidecar's ``instances``.
    """
    found = {}
    for tree, instance in zip(trees, instances, strict=True):
        for position, link in enumerate(tree.links):
            found[tree.uid, link.link] = (link.index, tuple(own_solid(instance, position)))
        for (link, index), copy in zip(tree.copies, instance.copies, strict=True):
            found[tree.uid, link] = (index, tuple(copy.shapes))
    return found
