"""Links without mass between joints that move, as several joints of the body that moves with the last of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.elements import Element
from simspec.imports.urdf.joints import Joint
from simspec.imports.urdf.table import INFORMATION, LOST
from simspec.imports.urdf.tree import Tree
from simspec.language.foreign import Fate
from simspec.language.vocabulary import SCALAR_JOINTS

MOST: Final = 6
"""Joints of one body."""
FRAME: Final = "a frame without mass between joints: what moves there is called after the joint"


@dataclass
class Chain:
    """The joints that lead to a link over links without mass, from the parent outwards; the last is the link's own."""

    joints: list[Joint]
    parent: str
    """The link that the first of them hangs on, by the file's name."""
    between: list[str] = field(default_factory=list)
    """The links without mass."""


def chains(tree: Tree, groups: Mapping[str, Sequence[str]], is_empty: Callable[[str], bool]) -> dict[str, Chain]:
    """The chains by the link that they move. ``groups``: links that are fixed to each other, by the one nearest to the root.

    A group is passed over where it is one link that is empty (no mass, no shapes), a hinge, a slide or a planar joint leads to
    it, and one joint leads away.
    """
    passed = {
        head
        for head, group in groups.items()
        if head != tree.root
        and len(group) == 1
        and is_empty(head)
        and tree.above[head].kind in (*SCALAR_JOINTS, "planar")
        and len(tree.below[head]) == 1
        and tree.below[head][0].kind in (*SCALAR_JOINTS, "planar", "ball")
    }
    made: dict[str, Chain] = {}
    for head in groups:
        if head == tree.root or head in passed or tree.above[head].parent not in passed:
            continue
        joints, between = [tree.above[head]], list[str]()
        while (name := joints[0].parent) in passed:
            between.insert(0, name)
            joints.insert(0, tree.above[name])
        if sum(len(joint.listed()) for joint in joints) <= MOST:
            made[head] = Chain(joints, joints[0].parent, between)
    return made


def leave_out(links: Mapping[str, Element], chain: Chain, called: str) -> None:
    """Say of the links between that they are no bodies of the spec. ``called``: the body that the chain moves."""
    for name, joint in zip(chain.between, chain.joints, strict=False):
        element = links[name]
        element.set_aside(
            "name", Fate.CARRIED, f"called {called}.{joint.listed()[-1]['name']} in the world", INFORMATION
        )
        for part in element.look("inertial"):
            part.set_aside(None, LOST, FRAME, INFORMATION)


def written(chain: Chain) -> list[dict[str, Any]]:
    """The word `joints` of a body."""
    return [data for joint in chain.joints for data in joint.listed()]
