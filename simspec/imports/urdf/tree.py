"""The tree that the links and joints of a file form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from simspec.imports.draft import Draft
from simspec.imports.elements import Element
from simspec.imports.urdf.joints import Joint
from simspec.imports.urdf.table import LOST

WORLD: Final = "world"
"""The link that stands for the world, and the name that no body may have."""
ROOTS: Final = "several-roots"
UNDECLARED: Final = "undeclared-world"
PARENTS: Final = "undeclared-parents"
RULES: Final = {
    PARENTS: "a link that joints lead from, and that there is not, is added without mass: a part of a robot by itself",
    ROOTS: "only the tree with most links is kept",
    UNDECLARED: "a joint whose parent is `world`, where there is no such link, leads from the world",
}


@dataclass
class Tree:
    """Links from the root outwards, by the file's names; ``above``: the joint of each link to its parent."""

    root: str
    order: list[str]
    above: Mapping[str, Joint]
    below: Mapping[str, Sequence[Joint]]

    def groups(self) -> dict[str, str]:
        """For every link, the link nearest to the root that it is fixed to."""
        top = {self.root: self.root}
        for link in self.order[1:]:
            joint = self.above[link]
            top[link] = top[joint.parent] if joint.kind == "fixed" else link
        return top


def tree_of(root: Element, links: Mapping[str, Element], joints: Sequence[Joint], draft: Draft) -> Tree | None:
    """The tree; None where the links and joints form none, which is reported."""
    above: dict[str, Joint] = {}
    below: dict[str, list[Joint]] = {name: [] for name in links}
    broken = False
    children = {joint.child for joint in joints}
    for joint in joints:
        unknown = [name for name in (joint.parent, joint.child) if name not in links]
        for name in unknown:
            rule = missing_rule(name) if name == joint.parent and name not in children else ""
            draft.defect(joint.element, f"there is no link {name[:80]!r}", rule, RULES.get(rule, ""), found=name)
        if joint.child in above:
            first = above[joint.child].element
            message = f"the link {joint.child[:80]!r} is the child of two joints: URDF has trees only"
            draft.defect(joint.element, message, found=f"first: {first.label} at {first.location}")
            broken = True
        elif not unknown:
            above[joint.child] = joint
            below[joint.parent].append(joint)
        broken = broken or bool(unknown)
    if broken or not links:
        return None
    roots = [name for name in links if name not in above]
    trees = [list(_outwards(name, below)) for name in roots]
    reached = {name for tree in trees for name in tree}
    if looping := [name for name in links if name not in reached]:
        _report_loops(looping, above, draft)
        return None
    if len(trees) > 1:
        return _of_several(root, trees, links, above, below, draft)
    return Tree(roots[0], trees[0], above, below)


def missing_rule(name: str) -> str:
    """The rule that adds a link that joints lead from."""
    return UNDECLARED if name == WORLD else PARENTS


def _outwards(start: str, below: Mapping[str, Sequence[Joint]]) -> Iterator[str]:
    waiting = [start]
    while waiting:
        name = waiting.pop()
        yield name
        waiting.extend(joint.child for joint in reversed(below[name]))


def _report_loops(names: Sequence[str], above: Mapping[str, Joint], draft: Draft) -> None:
    """Every loop of parents once."""
    seen: set[str] = set()
    for start in names:
        chain: list[str] = []
        name = start
        while name not in seen:
            seen.add(name)
            chain.append(name)
            name = above[name].parent
        if name in chain:
            loop = chain[chain.index(name) :]
            shown = " -> ".join([*loop[:6], *(["..."] if len(loop) > 6 else []), loop[0]])
            draft.defect(above[loop[0]].element, f"these links are each other's parents: {shown[:300]}")


def _of_several(
    root: Element,
    trees: list[list[str]],
    links: Mapping[str, Element],
    above: Mapping[str, Joint],
    below: Mapping[str, Sequence[Joint]],
    draft: Draft,
) -> Tree | None:
    trees.sort(key=len, reverse=True)  # stable: of equal ones the first of the file
    kept, *others = trees
    if not draft.repairing(ROOTS):
        shown = ", ".join(tree[0] for tree in trees[:6]) + (", ..." if len(trees) > 6 else "")
        message = f"{len(trees)} links have no parent, and a robot has one root"
        draft.defect(links[others[0][0]], message, ROOTS, RULES[ROOTS], found=shown)
        return None
    for tree in others:
        for name in tree:
            _leave_out(links[name])
            if name in above:
                _leave_out(above[name].element)
    what = f"{sum(map(len, others))} links outside the tree of {kept[0]} are left out: " + ", ".join(
        name for tree in others for name in tree
    )
    draft.repaired(ROOTS, root, what[:300], ("model", "bodies"))
    return Tree(kept[0], kept, above, below)


def _leave_out(element: Element) -> None:
    """Say that an element, with all in it, is left out by the rule."""
    waiting = [element]
    while waiting:
        part = waiting.pop()
        part.set_aside(None, LOST, f"left out by the rule {ROOTS}")
        for name in part.attributes:
            part.set_aside(name, LOST, f"left out by the rule {ROOTS}")
        waiting.extend(part.look())
