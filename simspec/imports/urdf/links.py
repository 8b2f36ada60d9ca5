"""Links of URDF: their tree, chains of massless links, surfaces and weights."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from simspec.imports.draft import CONTACT_OF_LINK, Draft, LinkSurface, Materials, plain
from simspec.imports.elements import CARRIED, INFORMATION, LOST, PHYSICS, UNUSED, Element, outwards
from simspec.imports.urdf.joints import UrdfJointRead
from simspec.imports.urdf.shapes import UrdfShapeRead
from simspec.language.foreign import Fate, LossSeverity
from simspec.language.vocabulary import SCALAR_JOINTS

WORLD: Final = "world"
"""The link that stands for the world, and the name that no body may have."""
ROOTS: Final = "several-roots"
UNDECLARED: Final = "undeclared-world"
PARENTS: Final = "undeclared-parents"
TREE_RULES: Final = {
    PARENTS: "a link that joints lead from, and that there is not, is added without mass: a part of a robot by itself",
    ROOTS: "only the tree with most links is kept",
    UNDECLARED: "a joint whose parent is `world`, where there is no such link, leads from the world",
}


@dataclass
class UrdfTree:
    """Links from the root outwards, by the file's names; ``above``: the joint of each link to its parent."""

    root: str
    order: list[str]
    above: Mapping[str, UrdfJointRead]
    below: Mapping[str, Sequence[UrdfJointRead]]

    def groups(self) -> dict[str, str]:
        """For every link, the link nearest to the root that it is fixed to."""
        top = {self.root: self.root}
        for link in self.order[1:]:
            joint = self.above[link]
            top[link] = top[joint.parent] if joint.kind == "fixed" else link
        return top


def tree_of(
    root: Element, links: Mapping[str, Element], joints: Sequence[UrdfJointRead], draft: Draft
) -> UrdfTree | None:
    """The tree; None where the links and joints form none, which is reported."""
    above: dict[str, UrdfJointRead] = {}
    below: dict[str, list[UrdfJointRead]] = {name: [] for name in links}
    broken = False
    children = {joint.child for joint in joints}
    for joint in joints:
        unknown = [name for name in (joint.parent, joint.child) if name not in links]
        for name in unknown:
            rule = missing_rule(name) if name == joint.parent and name not in children else ""
            draft.defect(joint.element, f"there is no link {name[:80]!r}", rule, name)
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
    trees = [outwards([name], lambda name: [joint.child for joint in below[name]]) for name in roots]
    reached = {name for tree in trees for name in tree}
    if looping := [name for name in links if name not in reached]:
        _report_loops(looping, above, draft)
        return None
    if len(trees) > 1:
        return _of_several(root, trees, links, above, below, draft)
    return UrdfTree(roots[0], trees[0], above, below)


def missing_rule(name: str) -> str:
    """The rule that adds a link that joints lead from."""
    return UNDECLARED if name == WORLD else PARENTS


def _report_loops(names: Sequence[str], above: Mapping[str, UrdfJointRead], draft: Draft) -> None:
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
    above: Mapping[str, UrdfJointRead],
    below: Mapping[str, Sequence[UrdfJointRead]],
    draft: Draft,
) -> UrdfTree | None:
    trees.sort(key=len, reverse=True)  # stable: of equal ones the first of the file
    kept, *others = trees
    if not draft.repairing(ROOTS):
        shown = ", ".join(tree[0] for tree in trees[:6]) + (", ..." if len(trees) > 6 else "")
        message = f"{len(trees)} links have no parent, and a robot has one root"
        draft.defect(links[others[0][0]], message, ROOTS, shown)
        return None
    left_out = [name for tree in others for name in tree]
    for name in left_out:
        for element in (links[name], *([above[name].element] if name in above else [])):
            for part in element.within():
                part.set_aside_whole(LOST, f"left out by the rule {ROOTS}", PHYSICS)
    what = f"{len(left_out)} links outside the tree of {kept[0]} are left out: {', '.join(left_out)}"
    draft.repaired(ROOTS, root, what[:300], ("model", "bodies"))
    return UrdfTree(kept[0], kept, above, below)


# Links without mass between joints: several joints of the body behind them.

MOST: Final = 6
"""Joints of one body."""
FRAME: Final = "a frame without mass between joints: its motion is called after the joint"


@dataclass
class JointChain:
    """The joints that lead to a link over links without mass, from the parent outwards; the last is the link's own."""

    joints: list[UrdfJointRead]
    parent: str
    """The link that the first of them hangs on, by the file's name."""
    between: list[str] = field(default_factory=list)
    """The links without mass."""


def chains(
    tree: UrdfTree, groups: Mapping[str, Sequence[str]], is_empty: Callable[[str], bool]
) -> dict[str, JointChain]:
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
    made: dict[str, JointChain] = {}
    for head in groups:
        if head == tree.root or head in passed or tree.above[head].parent not in passed:
            continue
        joints, between = [tree.above[head]], list[str]()
        while (name := joints[0].parent) in passed:
            between.insert(0, name)
            joints.insert(0, tree.above[name])
        if sum(len(joint.listed()) for joint in joints) <= MOST:
            made[head] = JointChain(joints, joints[0].parent, between)
    return made


def leave_out_between(links: Mapping[str, Element], chain: JointChain, called: str) -> None:
    """Say of the links between that they are no bodies of the spec. ``called``: the body that the chain moves."""
    for name, joint in zip(chain.between, chain.joints, strict=False):
        element = links[name]
        element.set_aside("name", CARRIED, f"called {called}.{joint.listed()[-1]['name']} in the world", INFORMATION)
        for part in element.look("inertial"):
            part.lose(None, FRAME, INFORMATION)


def chain_joints(chain: JointChain) -> list[dict[str, Any]]:
    """The word `joints` of a body."""
    return [data for joint in chain.joints for data in joint.listed()]


# Surfaces: plain URDF has none, two programs add elements for them.

CONTACT_DEFAULT: Final = LinkSurface(friction=0.5)
"""Of a link without <contact>, in the program that has this element."""
GAZEBO_DEFAULT: Final = LinkSurface(friction=1.0)
"""Of a link of which no <gazebo> speaks, in Gazebo."""
FIRST: Final = "mu1"
SECOND: Final = "mu2"
DIRECTION: Final = "fdir1"
NO_EFFECT: Final = "friction is the same in every direction"
GROUP: Final = "drake:collision_filter_group"
UNSAID: Final = "unsaid"
"""The material of shapes of which the file says nothing, where it speaks of others."""


def add_materials(
    root: Element, links: Mapping[str, tuple[Element, Sequence[UrdfShapeRead]]], draft: Draft
) -> dict[str, dict[str, Any]]:
    """Give every collision shape its material, and return the materials by name; {} where the file speaks of no surface.
    ``links``: by the file's names, the element and its shapes."""
    said: dict[str, LinkSurface] = {}
    default = GAZEBO_DEFAULT
    for name, (element, _) in links.items():
        for contact in element.look("contact"):
            if not contact.look():
                continue  # as without it
            with draft.collecting():
                said[name] = _of_contact(contact, said.get(name, CONTACT_DEFAULT))
                default = CONTACT_DEFAULT
    for gazebo in root.look("gazebo"):
        name = gazebo.attributes.get("reference", "").strip()
        with draft.collecting():
            surface = _of_gazebo(gazebo)
            if surface is None:
                continue
            if name in links and any(shape.collides for shape in links[name][1]):
                _take_friction(gazebo, said.setdefault(name, surface) == surface)
            else:
                _aside(gazebo, UNUSED, "there is no such link with a collision shape", INFORMATION)
    return _named(links, said, default, draft) if said else {}


def _named(
    links: Mapping[str, tuple[Element, Sequence[UrdfShapeRead]]],
    said: Mapping[str, LinkSurface],
    default: LinkSurface,
    draft: Draft,
) -> dict[str, dict[str, Any]]:
    """The materials, and their names in all collision shapes; one that all of them have needs no name there."""
    materials, given = Materials(), dict[int, str]()
    silent: list[UrdfShapeRead] = []
    for name, (_, shapes) in links.items():
        for shape in shapes:
            if shape.collides and name in said:
                given[id(shape)] = materials.name(said[name])
            elif shape.collides:
                silent.append(shape)
    if not given:
        return {}
    data = {key: {word: plain(value) for word, value in item.items()} for key, item in materials.data().items()}
    if silent:
        data[UNSAID] = {"friction": plain(default.friction)}
        sentence = "the file says nothing of these surfaces: the default of the program whose words it uses for others"
        draft.note(("contact", "materials", UNSAID), sentence)
    if len(data) > 1:
        single = next(iter(data))
        for _, shapes in links.values():
            for shape in shapes:
                if shape.collides:
                    name = given.get(id(shape), UNSAID)
                    shape.material = name if name in data else single
    return data


def excluded(root: Element, links: Container[str], bodies: Mapping[str, str]) -> list[list[str]]:
    """Pairs of bodies that do not touch each other, by Drake's words for groups. ``bodies``: those of ``links`` that are bodies
    of the spec, by the file's names. Raises SpecError for a link that there is not."""
    members: dict[str, list[str]] = {}
    ignored: list[tuple[str, str]] = []
    for group in root.children(GROUP):
        name = group.need("name")
        for member in group.children("drake:member"):
            link = member.need("link").strip()
            if link not in links:
                raise member.error(f"there is no link {link[:80]!r}", link[:80], code="I101")
            if link in bodies:
                members.setdefault(name, []).append(bodies[link])
        ignored += [(name, other.need("name")) for other in group.children("drake:ignored_collision_filter_group")]
    pairs = {
        (min(name, two), max(name, two))
        for first, second in ignored
        for name in members.get(first, ())
        for two in members.get(second, ())
        if name != two
    }
    return [list(pair) for pair in sorted(pairs)]


def _of_contact(contact: Element, before: LinkSurface) -> LinkSurface:
    """The surface of a <contact>. Raises SpecError for values that are not finite or below 0."""
    numbers: dict[str, float] = {}
    contact.take()
    for tag, word in CONTACT_OF_LINK.items():
        child = contact.child(tag)
        if child is not None:
            child.need("value")
            numbers[word] = _not_negative(child, child.number("value") or 0.0)
    if numbers.get("restitution", 0.0) > 1.0:
        raise contact.error("restitution must not be above 1", f"{numbers['restitution']:g}", code="I102")
    return replace(before, **numbers)


def _not_negative(element: Element, value: float) -> float:
    if value < 0.0:
        raise element.error(f"<{element.tag}> must not be below 0", f"{value:g}", code="I102")
    return value


def _of_gazebo(gazebo: Element) -> LinkSurface | None:
    """The friction that a <gazebo> says; None for one that speaks of other things."""
    first, second = (_friction(gazebo, tag) for tag in (FIRST, SECOND))
    if first is None and second is None:
        return None
    return LinkSurface(friction=_or_default(first))


def _or_default(friction: float | None) -> float:
    return GAZEBO_DEFAULT.friction if friction is None else friction


def _friction(gazebo: Element, tag: str) -> float | None:
    for child in gazebo.look(tag):
        value = child.number("value") if child.has("value") else child.content(1)[0]
        return _not_negative(child, value or 0.0)
    return None


def _take_friction(gazebo: Element, is_used: bool) -> None:
    """Say what becomes of the words for friction; ``is_used``: unless the link has said another by other words."""
    if not is_used:
        _aside(gazebo, LOST, "the link says another friction by other words", PHYSICS)
        return
    first, second = (_friction(gazebo, tag) for tag in (FIRST, SECOND))
    equal = _or_default(first) == _or_default(second)
    for child in gazebo.look(FIRST)[:1]:
        child.take()
    for child in gazebo.look(SECOND)[:1]:
        if equal:
            child.take()
        else:
            child.lose(None, f"{NO_EFFECT} in the language: {FIRST} is carried", PHYSICS)
    if second is None and not equal:
        gazebo.look(FIRST)[0].lose(None, f"{NO_EFFECT} in the language; {SECOND} is 1 by default", PHYSICS)
    if equal:
        for child in gazebo.look(DIRECTION):
            child.ignore(None, NO_EFFECT)


def _aside(gazebo: Element, fate: Fate, reason: str, severity: LossSeverity) -> None:
    for child in gazebo.look(FIRST, SECOND, DIRECTION):
        child.set_aside(None, fate, reason, severity)


OFF: Final = {"gravity": ("0", "false"), "turnGravityOff": ("1", "true")}
"""The elements of a <gazebo> that say it, and the texts by which they do."""


def weightless(root: Element, links: Container[str]) -> frozenset[str]:
    """Those of ``links`` on which a <gazebo> says that gravity does not act; the element that says it is taken."""
    named = set()
    for gazebo in root.look("gazebo"):
        name = gazebo.attributes.get("reference", "").strip()
        for child in gazebo.look(*OFF) if name in links else ():
            if child.attributes.get("value", child.text).strip().lower() in OFF[child.tag]:
                child.take()
                child.word("value")
                named.add(name)
    return frozenset(named)
