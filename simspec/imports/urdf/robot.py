"""A robot of URDF as a model file of the language."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simspec.imports.draft import Draft, names, renamed
from simspec.imports.elements import MOST_BODIES, SPLIT, Element
from simspec.imports.files import Files
from simspec.imports.timestep import add_timestep
from simspec.imports.urdf import chains as chain_rules
from simspec.imports.urdf import joints as joint_rules
from simspec.imports.urdf import masses as mass_rules
from simspec.imports.urdf import mimic as mimic_rules
from simspec.imports.urdf import planar as planar_rules
from simspec.imports.urdf import shapes as shape_rules
from simspec.imports.urdf import tree as tree_rules
from simspec.imports.urdf import units as unit_rules
from simspec.imports.urdf.chains import Chain
from simspec.imports.urdf.contact import add_materials
from simspec.imports.urdf.joints import Joint, read_joint
from simspec.imports.urdf.locked import lock
from simspec.imports.urdf.masses import Mass, check_mass, leave_out, not_positive, read_mass, total
from simspec.imports.urdf.mimic import constraints
from simspec.imports.urdf.numerals import RULES as NUMERAL_RULES
from simspec.imports.urdf.numerals import mend
from simspec.imports.urdf.shapes import Shape, colours, judge_meshes, merged, name_shapes, read_shapes, without_planes
from simspec.imports.urdf.table import INFORMATION, LOST, set_aside
from simspec.imports.urdf.tree import WORLD, Tree, missing_rule, tree_of
from simspec.imports.urdf.weights import weightless
from simspec.language.document import Path_
from simspec.language.foreign import Imported, ImportOptions
from simspec.language.models import VERSION
from simspec.language.moments import impossible, principal_moments
from simspec.world import frames
from simspec.world.types import Pose

MASSLESS: Final = "massless"
RULES: Final[Mapping[str, str]] = {
    **mass_rules.RULES,
    MASSLESS: "the joint above links that have no mass becomes fixed",
    **joint_rules.RULES,
    **mimic_rules.RULES,
    **shape_rules.RULES,
    **tree_rules.RULES,
    **unit_rules.RULES,
    **NUMERAL_RULES,
}
"""Every rule of repair, with what it does."""


PLACES: Final = (
    ("origin", "origin"),
    ("axis", "axis"),
    ("limit", "limits"),
    ("dynamics", "damping"),
    ("dynamics", "dry_friction"),
)
"""Elements of a joint, and the words of the spec that are located there."""


@dataclass
class Link:
    """A link of the file; ``name`` is that of its body."""

    element: Element
    name: str
    mass: Mass | None = None
    shapes: list[Shape] = field(default_factory=list)

    @property
    def path(self) -> Path_:
        """The body in the data."""
        return ("model", "bodies", self.name)

    @property
    def is_empty(self) -> bool:
        """Whether the link has neither mass nor shapes."""
        return not self.shapes and (self.mass is None or not self.mass.written())


class Robot:
    """The reading of one file."""

    def __init__(self, root: Element, files: Files, options: ImportOptions):
        self.root = root
        self.draft = Draft(files, options, tuple(RULES))
        self.links: dict[str, Link] = {}
        self.joints: list[Joint] = []
        self.fixed = False
        """Whether the root is fixed to the world."""
        self.materials: dict[str, dict[str, Any]] = {}
        self.chains: dict[str, Chain] = {}
        self.between: set[str] = set()
        self.weightless: frozenset[str] = frozenset()
        """The links on which gravity does not act, by the file's names."""

    def imported(self) -> Imported:
        """The spec and the accounts. Raises SpecError with every problem."""
        if self.root.tag != "robot":
            raise self.root.error("not URDF: the outermost element is not <robot>", self.root.tag[:80], "robot")
        set_aside(self.root)
        mend(self.root, self.draft)
        unit_rules.scale_file(self.root, self.draft)
        self._read()
        elements = {name: link.element for name, link in self.links.items()}
        # where a joint could not be read, its child looks like a root
        tree = tree_of(self.root, elements, self.joints, self.draft) if self.all_read else None
        data: dict[str, Any] = {}
        if tree is not None:
            self._check_masses(tree)
            kept = {name: (self.links[name].element, self.links[name].shapes) for name in tree.order}
            self.materials = add_materials(self.root, kept, self.draft)
            self.weightless = weightless(self.root, [name for name in tree.order if self.links[name].mass is not None])
            data = self._written(tree)
        else:
            for link in self.links.values():
                if link.mass is not None:
                    check_mass(link.mass, bool(link.shapes), self.draft, link.path)
        self.draft.finish()
        draft = self.draft
        imported = Imported(
            data,
            draft.places,
            list(self.root.accounts()),
            draft.repairs,
            draft.meshes,
            read=draft.files.read,
            comments=draft.comments,
            suspicious=draft.suspicious,
        )
        add_timestep(imported)
        return imported

    # --- reading ----------------------------------------------------------------------------------------------

    def _read(self) -> None:
        known = colours(self.root)
        elements = self.root.children("link")
        if len(elements) > MOST_BODIES:
            found = f"{len(elements):,}"
            raise elements[MOST_BODIES].error("too many links", found, f"{MOST_BODIES:,}", SPLIT)
        for element, given in zip(elements, _given(elements, WORLD), strict=True):
            with self.draft.collecting():
                self._link(element, known, given)
        seen: dict[str, Joint] = {}
        elements = self.root.children("joint")
        called, parts = _given_to_joints(elements)
        for index, element in enumerate(elements):
            with self.draft.collecting():
                joint = read_joint(element, called[index], parts.get(index, ()), self.draft)
                name = element.attributes["name"].strip()
                if name in seen:
                    first = seen[name].element.location
                    self.draft.defect(element, f"two joints are called {name[:80]!r}", found=f"first at {first}")
                seen.setdefault(name, joint)
                self.joints.append(joint)
        lock(self.joints)
        self._judge_meshes()
        name_shapes([shape for link in self.links.values() for shape in link.shapes])
        self.all_read = len(self.joints) == len(elements)
        self._declare_missing()
        if not self.links and not self.draft.problems:
            raise self.root.error("a robot without links")

    def _declare_missing(self) -> None:
        """Add the links that joints lead from, and that the file does not have, where the rule is asked for."""
        children = {joint.child for joint in self.joints}
        for joint in self.joints:
            name, rule = joint.parent, missing_rule(joint.parent)
            if name in self.links or name in children or not self.draft.repairing(rule):
                continue
            element = Element("link", {"name": name}, joint.element.location, "", self.root)
            self.links[name] = Link(element, _given([element], WORLD, *(link.name for link in self.links.values()))[0])
            what = "the joint leads from the world" if name == WORLD else f"the link {name[:80]} is added, without mass"
            self.draft.repaired(rule, joint.element, what, ("model", "bodies"))

    def _judge_meshes(self) -> None:
        """Read all meshes of the file together: starting the process that reads them takes longer than most of them."""
        usable = judge_meshes([shape for link in self.links.values() for shape in link.shapes], self.draft)
        large = {id(shape): shape for shape in unit_rules.large_meshes(usable, self.joints, self.draft)}
        if large:  # they are read again
            usable = [shape for shape in usable if id(shape) not in large] + judge_meshes(
                list(large.values()), self.draft
            )
        kept = {id(shape) for shape in usable}
        for link in self.links.values():
            link.shapes = merged([shape for shape in link.shapes if id(shape) in kept])

    def _link(self, element: Element, known: Mapping[str, Any], given: str) -> None:
        name = element.need("name")
        if name in self.links:
            first = self.links[name].element.location
            raise element.error(f"two links are called {name[:80]!r}", found=f"first at {first}")
        link = self.links[name] = Link(element, given)
        renamed(element, "name", link.name)
        with self.draft.collecting():
            link.mass = read_mass(element)
        link.shapes = read_shapes(element, known, self.draft)

    # --- masses -----------------------------------------------------------------------------------------------

    def _check_masses(self, tree: Tree) -> None:
        """Defects and repairs of all links, and of those that are fixed to each other together."""
        top = tree.groups()
        members: dict[str, list[str]] = {}
        for name in tree.order:
            members.setdefault(top[name], []).append(name)
        self.fixed = self._root_is_fixed(tree, members[tree.root])
        self.chains = chain_rules.chains(tree, members, lambda name: self.links[name].is_empty)
        self.between = {name for chain in self.chains.values() for name in chain.between}
        self._compare_moments(tree, top)
        for head, group in members.items():
            still = head == tree.root and self.fixed
            for name in group:
                self._check_link(self.links[name], still)
            if not still:
                self._check_group(tree, head, group)

    def _compare_moments(self, tree: Tree, top: Mapping[str, str]) -> None:
        """Moments of inertia with the sizes of the links that may move."""
        moving: list[unit_rules.Link] = []
        for name in tree.order:
            link = self.links[name]
            if link.mass is not None and not (top[name] == tree.root and self.fixed):
                size = unit_rules.reach(link.shapes, link.mass, tree.below[name])
                moving.append(unit_rules.Link(link.path, link.mass, size))
        unit_rules.scale_moments(moving, self.draft)

    def _root_is_fixed(self, tree: Tree, group: list[str]) -> bool:
        """Whether the root does not move: it is the world, or nothing in it has a mass, and what moves freely has one."""
        masses = [self.links[name].mass for name in ([tree.root] if tree.root == WORLD else group)]
        return not any(mass is not None and mass.mass for mass in masses)

    def _check_link(self, link: Link, still: bool) -> None:
        mass = link.mass
        if mass is None:
            return
        if not still:
            check_mass(mass, bool(link.shapes), self.draft, link.path)
        elif mass.missing or mass.mass < 0.0 or impossible(principal_moments(mass.tensor or (0.0,) * 6)):
            leave_out(mass)
            link.mass = None

    def _check_group(self, tree: Tree, head: str, group: list[str]) -> None:
        """Links that move as one need a mass and moments of inertia, whichever of them has these."""
        masses = {name: mass for name in group if (mass := self.links[name].mass) is not None}
        if any(mass.missing or mass.mass < 0.0 or _negative(mass) for mass in masses.values()):
            return  # reported
        if not any(mass.mass for mass in masses.values()):
            if head in self.between:
                return  # a joint of the body that moves with the last of the chain
            self._massless(tree, head, group)
            return
        if any(mass.from_shapes for mass in masses.values()):
            return
        poses = {head: Pose()}
        for name in group:
            if name != head:
                joint = tree.above[name]
                poses[name] = frames.compose(poses[joint.parent], joint.origin)
        moments = principal_moments(total((mass, poses[name]) for name, mass in masses.items())[1])
        if min(moments) <= 0.0:
            name, mass = max(masses.items(), key=lambda item: item[1].mass)
            shown = ", ".join(f"{moment:.6g}" for moment in moments)
            link = self.links[name]
            why = f"the principal moments of what moves must be above 0: {shown} kg m²"
            not_positive(mass, bool(link.shapes), why, self.draft, link.path)

    def _massless(self, tree: Tree, head: str, group: list[str]) -> None:
        joint = tree.above[head]
        link = self.links[head]
        shown = ", ".join(group[:6]) + (", ..." if len(group) > 6 else "")
        if not self.draft.repairing(MASSLESS):
            self.draft.defect(
                joint.element, "what this joint moves has no mass", MASSLESS, RULES[MASSLESS], found=shown[:300]
            )
            return
        what = f"a {joint.kind} joint became fixed, since what it moves has no mass: {shown[:300]}"
        joint.kind, joint.parts, kept = "fixed", (), joint.data.get("origin")
        joint.data = {} if kept is None else {"origin": kept}
        self.draft.repaired(MASSLESS, joint.element, what, (*link.path, "joint"))

    # --- writing ----------------------------------------------------------------------------------------------

    def _written(self, tree: Tree) -> dict[str, Any]:
        order, root = tree.order, tree.root
        first = self.links[root]
        joints = tree.below[root]
        bodies: dict[str, Any] = {}
        is_world = first.is_empty and len(joints) == 1 and (root == WORLD or joints[0].kind == "free")
        if is_world:
            order = order[1:]
            child = self.links[joints[0].child]
            if joints[0].child not in self.between:
                bodies[child.name] = self._world_child(joints[0], child)
        for name in order:
            if name in self.between:
                continue
            link = self.links[name]
            body = bodies.setdefault(link.name, {})
            joined: dict[str, Any] = {}
            if name in self.chains:
                self._write_chain(link, body, self.chains[name], is_world and self.chains[name].parent == root)
            elif name in tree.above and not (is_world and name == order[0]):
                joint = tree.above[name]
                if joint.kind == "free":
                    message = "a floating joint is supported only below a root link without mass and shapes"
                    self.draft.defect(joint.element, message, hint="leave out the joint: a root with a mass is free")
                body["parent"] = self.links[joint.parent].name
                joined = joint.placed(link.name)
                self._place_joint(link.path, joint)
            else:
                joined = {word: body.pop(word) for word in ("joint", "joints") if word in body}
                if name == root and self.fixed:
                    body["fixed"] = True
                    if name != WORLD:
                        self.draft.note(
                            link.path, "fixed to the world: it has no mass, and what moves freely needs one"
                        )
            self._fill(link, body, joined)
        given = self.root.word("name") or ""
        name = names([given])[0] if given else "robot"
        if given:
            renamed(self.root, "name", name)
        self.draft.place((), self.root)
        coupled = constraints([tree.above[name] for name in tree.order if name in tree.above], self.draft)
        more = {"constraints": coupled} if coupled else {}
        contact = {"contact": {"materials": self.materials}} if self.materials else {}
        return {"simspec": VERSION, "name": name, **contact, "model": {"bodies": bodies, **more}}

    def _write_chain(self, link: Link, body: dict[str, Any], chain: Chain, from_world: bool) -> None:
        """The joints of a body that several lead to."""
        if not from_world:
            body["parent"] = self.links[chain.parent].name
        owners = [joint for joint in chain.joints for _ in joint.listed()]
        for index, joint in enumerate(owners):
            self.draft.place((*link.path, "joints", index), joint.element)
        body["joints"] = chain_rules.written(chain)
        elements = {name: self.links[name].element for name in chain.between}
        chain_rules.leave_out(elements, chain, link.name)
        links = ", ".join(chain.between)
        self.draft.note((*link.path, "joints"), f"without mass between them in the file: {links}"[:300])

    def _world_child(self, joint: Joint, child: Link) -> dict[str, Any]:
        """The words of the body that hangs on the link `world`: there is no such body, since it is the world itself."""
        self._place_joint(child.path, joint)
        body: dict[str, Any] = {"fixed": True} if joint.kind == "fixed" else {}
        if joint.kind in ("fixed", "free"):
            if "origin" in joint.data:
                body["pose"] = joint.data["origin"]
            how = "fixed to the world" if joint.kind == "fixed" else "free"
            reason = f"the root {child.name} is {how}, without a joint"
            joint.element.set_aside("name", LOST, reason, INFORMATION)
        else:
            body |= joint.placed(child.name)
        return body

    def _place_joint(self, path: Path_, joint: Joint) -> None:
        for index in range(len(joint.parts)):
            self.draft.place((*path, "joints", index), joint.element)
        self.draft.place((*path, "joint"), joint.element)
        self.draft.place((*path, "pose"), joint.element)
        for tag, word in PLACES:
            for part in joint.element.look(tag)[:1]:
                self.draft.place((*path, "joint", word), part)

    def _fill(self, link: Link, body: dict[str, Any], joined: dict[str, Any]) -> None:
        path = link.path
        self.draft.place(path, link.element)
        if link.mass is not None:
            body.update(link.mass.written())
            for word, tag in (("mass", "mass"), ("centre_of_mass", "origin"), ("inertia", "inertia")):
                part = (link.mass.element.look(tag) or [link.mass.element])[0]
                self.draft.place((*path, word), part)
            if link.element.attributes["name"].strip() in self.weightless:
                body["gravity_scale"] = 0.0
        body |= joined
        if not (body.get("fixed") or joined.get("joint", {}).get("type") == "fixed"):
            link.shapes = without_planes(link.shapes)
        if link.mass is not None and link.mass.from_shapes:
            for shape in link.shapes:
                if shape.is_open:  # only the hull has a volume
                    shape.data["mesh"] = {**shape.data["mesh"], "mass_from": "hull"}
        if link.shapes:
            body["shapes"] = [shape.written() for shape in link.shapes]
            for index, shape in enumerate(link.shapes):
                self.draft.place((*path, "shapes", index), shape.element)


def _negative(mass: Mass) -> bool:
    """Whether a link's own moments are wrong whatever else moves with it."""
    return mass.tensor is not None and impossible(principal_moments(mass.tensor)) is not None


def _given(elements: Sequence[Element], *reserved: str) -> list[str]:
    """The names of elements as the spec has them."""
    return names([element.attributes.get("name", "").strip() for element in elements], reserved)


def _given_to_joints(elements: Sequence[Element]) -> tuple[list[str], dict[int, list[str]]]:
    """The names of joints as the spec has them, and of the planar ones, by their places in the file, those of their parts."""
    wanted = [element.attributes.get("name", "").strip() for element in elements]
    several = [
        index for index, element in enumerate(elements) if element.attributes.get("type", "").strip() == "planar"
    ]
    more = [f"{wanted[index]}_{part}" for index in several for part in planar_rules.PARTS]
    given = names([*wanted, *more])
    count = len(planar_rules.PARTS)
    starts = range(len(wanted), len(given), count)
    return given[: len(wanted)], {index: given[at : at + count] for index, at in zip(several, starts, strict=True)}


def robot(root: Element, files: Files, options: ImportOptions) -> Imported:
    """The spec of a robot whose outermost element is ``root``. Raises SpecError with every problem."""
    return Robot(root, files, options).imported()
