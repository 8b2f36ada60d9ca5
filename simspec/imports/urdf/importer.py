"""The importer of URDF."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from simspec.errors import Location, Problem, SpecError
from simspec.imports.draft import FROM_SHAPES, Draft, density_of, plain, shown, solids_of
from simspec.imports.elements import (
    INFORMATION,
    MOST_BODIES,
    SPLIT,
    Element,
    names,
    outermost,
    parse,
    renamed,
    without_comments,
)
from simspec.imports.files import Files
from simspec.imports.reference import ElementRow
from simspec.imports.urdf import SUFFIXES, joints, links, masses, shapes
from simspec.imports.urdf.elements import RULES as NUMERAL_RULES
from simspec.imports.urdf.elements import mend, rows, set_aside, settle
from simspec.imports.urdf.joints import UrdfJointRead
from simspec.imports.urdf.links import WORLD, JointChain, UrdfTree
from simspec.imports.urdf.masses import UrdfMass
from simspec.imports.urdf.shapes import UrdfShapeRead
from simspec.imports.writing import add_timestep
from simspec.language.document import Path_
from simspec.language.foreign import Imported, ImportOptions
from simspec.language.models import VERSION
from simspec.language.moments import principal_moments
from simspec.world import frames
from simspec.world.types import Pose

MASSLESS: Final = "massless"
RULES: Final[Mapping[str, str]] = {
    **masses.RULES,
    MASSLESS: "the joint above links that have no mass becomes fixed",
    **joints.RULES,
    **joints.MIMIC_RULES,
    **shapes.RULES,
    **links.TREE_RULES,
    **masses.UNIT_RULES,
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
class UrdfLinkRead:
    """A link of the file; ``name`` is that of its body."""

    element: Element
    name: str
    mass: UrdfMass | None = None
    shapes: list[UrdfShapeRead] = field(default_factory=list)

    @property
    def path(self) -> Path_:
        """The body in the data."""
        return ("model", "bodies", self.name)

    @property
    def is_empty(self) -> bool:
        """Whether the link has neither mass nor shapes."""
        return not self.shapes and (self.mass is None or not self.mass.written())


class RobotReader:
    """The reading of one file."""

    def __init__(self, root: Element, files: Files):
        self.root = root
        self.draft = Draft(files, files.options, RULES, (FROM_SHAPES,))
        self.density, wrong = density_of(files.options.repairs, files.shown)
        self.draft.problems += wrong
        self.links: dict[str, UrdfLinkRead] = {}
        self.joints: list[UrdfJointRead] = []
        self.fixed = False
        """Whether the root is fixed to the world."""
        self.materials: dict[str, dict[str, Any]] = {}
        self.chains: dict[str, JointChain] = {}
        self.between: set[str] = set()
        self.weightless: frozenset[str] = frozenset()
        """The links on which gravity does not act, by the file's names."""

    def imported(self) -> Imported:
        """The spec and the accounts. Raises SpecError with every problem."""
        if self.root.tag != "robot":
            raise self.root.error(
                "not URDF: the outermost element is not <robot>", self.root.tag[:80], "robot", code="I114"
            )
        set_aside(self.root)
        mend(self.root, self.draft)
        masses.scale_file(self.root, self.draft)
        self._read()
        elements = {name: link.element for name, link in self.links.items()}
        # where a joint could not be read, its child looks like a root
        tree = links.tree_of(self.root, elements, self.joints, self.draft) if self.all_read else None
        data: dict[str, Any] = {}
        if tree is not None:
            self._check_masses(tree)
            kept = {name: (self.links[name].element, self.links[name].shapes) for name in tree.order}
            self.materials = links.add_materials(self.root, kept, self.draft)
            self.weightless = links.weightless(
                self.root, [name for name in tree.order if self.links[name].mass is not None]
            )
            data = self._written(tree)
        else:
            for link in self.links.values():
                if link.mass is not None:
                    masses.check_mass(link.mass, bool(link.shapes), self.draft, link.path)
        self.draft.finish()
        settle(self.root)
        imported = self.draft.imported(data, list(self.root.accounts()))
        add_timestep(imported)
        return imported

    def _read(self) -> None:
        known = shapes.colours(self.root)
        elements = self.root.children("link")
        if len(elements) > MOST_BODIES:
            found = f"{len(elements):,}"
            raise elements[MOST_BODIES].error("too many links", found, f"{MOST_BODIES:,}", SPLIT, code="I105")
        for element, given in zip(elements, joints.names_of(elements, WORLD), strict=True):
            with self.draft.collecting():
                self._link(element, known, given)
        seen: dict[str, UrdfJointRead] = {}
        bodies = {name: link.name for name, link in self.links.items()}
        elements = self.root.children("joint")
        called, parts = joints.names_of_joints(elements)
        for index, element in enumerate(elements):
            with self.draft.collecting():
                joint = joints.read_joint(element, called[index], parts.get(index, ()), bodies, self.draft)
                name = element.attributes["name"].strip()
                if name in seen:
                    first = seen[name].element.location
                    self.draft.defect(element, f"two joints are called {name[:80]!r}", found=f"first at {first}")
                seen.setdefault(name, joint)
                self.joints.append(joint)
        with self.draft.collecting():
            joints.reflect(self.root, self.joints)
        joints.lock(self.joints)
        self._judge_meshes()
        shapes.name_shapes([shape for link in self.links.values() for shape in link.shapes])
        self.all_read = len(self.joints) == len(elements)
        self._declare_missing()
        if not self.links and not self.draft.problems:
            raise self.root.error("a robot without links", code="I113")

    def _declare_missing(self) -> None:
        """Add the links that joints lead from, and that the file does not have, where the rule is requested."""
        children = {joint.child for joint in self.joints}
        for joint in self.joints:
            name, rule = joint.parent, links.missing_rule(joint.parent)
            if name in self.links or name in children or not self.draft.repairing(rule):
                continue
            element = Element("link", {"name": name}, joint.element.location, "", self.root)
            (given,) = joints.names_of([element], WORLD, *(link.name for link in self.links.values()))
            self.links[name] = UrdfLinkRead(element, given)
            what = "the joint leads from the world" if name == WORLD else f"the link {name[:80]} is added, without mass"
            self.draft.repaired(rule, joint.element, what, ("model", "bodies"))

    def _judge_meshes(self) -> None:
        """Read all meshes of the file together: starting the process that reads them takes longer than most of them."""
        usable = shapes.judge_meshes([shape for link in self.links.values() for shape in link.shapes], self.draft)
        large = masses.large_meshes(usable, self.joints, self.draft)
        again = {id(shape) for shape in large}
        usable = [shape for shape in usable if id(shape) not in again] + shapes.judge_meshes(large, self.draft)
        kept = {id(shape) for shape in usable}
        for link in self.links.values():
            link.shapes = shapes.merged([shape for shape in link.shapes if id(shape) in kept])

    def _link(self, element: Element, known: Mapping[str, Any], given: str) -> None:
        name = element.need("name")
        if name in self.links:
            first = self.links[name].element.location
            raise element.error(f"two links are called {name[:80]!r}", found=f"first at {first}", code="I101")
        link = self.links[name] = UrdfLinkRead(element, given)
        renamed(element, "name", link.name)
        with self.draft.collecting():
            link.mass = masses.read_mass(element)
        link.shapes = shapes.read_shapes(element, known, self.draft)

    def _check_masses(self, tree: UrdfTree) -> None:
        top = tree.groups()
        members: dict[str, list[str]] = {}
        for name in tree.order:
            members.setdefault(top[name], []).append(name)
        self.fixed = self._root_is_fixed(tree, members[tree.root])
        self.chains = links.chains(tree, members, lambda name: self.links[name].is_empty)
        self.between = {name for chain in self.chains.values() for name in chain.between}
        self._compare_moments(tree, top)
        for head, group in members.items():
            static = head == tree.root and self.fixed
            if not static and self.draft.repairing(FROM_SHAPES):
                self._give_masses(head, group)
            for name in group:
                self._check_link(self.links[name], static)
            if not static:
                self._check_group(tree, head, group)

    def _give_masses(self, head: str, group: list[str]) -> None:
        """The rule that gives masses by a density: to links whose mass is missing or below 0, and where nothing that moves as
        one has a mass, to each of it that has a shape with a volume."""
        rigid = [self.links[name] for name in group]
        weigh = any(link.mass is not None and link.mass.mass > 0.0 for link in rigid)
        has_none = head not in self.between and not weigh
        for link in rigid:
            solids = solids_of(link.shapes)
            if solids and (has_none or (link.mass is not None and link.mass.lacks_mass)):
                link.mass = link.mass or UrdfMass(link.element, 0.0)
                masses.give_mass(link.mass, solids, self.density, self.draft, link.path)

    def _compare_moments(self, tree: UrdfTree, top: Mapping[str, str]) -> None:
        moving: list[masses.LinkSize] = []
        for name in tree.order:
            link = self.links[name]
            if link.mass is not None and not (top[name] == tree.root and self.fixed):
                size = masses.reach(link.shapes, link.mass, tree.below[name])
                moving.append(masses.LinkSize(link.path, link.mass, size))
        masses.scale_moments(moving, self.draft)

    def _root_is_fixed(self, tree: UrdfTree, group: list[str]) -> bool:
        """Whether the root does not move: it is the world, or nothing in it has a mass, and what moves freely has one."""
        masses = [self.links[name].mass for name in ([tree.root] if tree.root == WORLD else group)]
        return not any(mass is not None and mass.mass for mass in masses)

    def _check_link(self, link: UrdfLinkRead, static: bool) -> None:
        mass = link.mass
        if mass is None or mass.density:
            return
        if not static:
            masses.check_mass(mass, bool(link.shapes), self.draft, link.path)
        elif mass.missing or mass.mass < 0.0 or mass.is_impossible:
            masses.leave_out_mass(mass)
            link.mass = None

    def _check_group(self, tree: UrdfTree, head: str, group: list[str]) -> None:
        """Links that move as one need a mass and moments of inertia, whichever of them has these."""
        inertials = {name: mass for name in group if (mass := self.links[name].mass) is not None}
        if any(mass.missing or mass.mass < 0.0 or mass.is_impossible or mass.density for mass in inertials.values()):
            return  # reported, or given
        if not any(mass.mass for mass in inertials.values()):
            if head not in self.between:  # else a joint of the body that moves with the last of the chain
                self._massless(tree, head, group)
            return
        if any(mass.from_shapes for mass in inertials.values()):
            return
        poses = {head: Pose()}
        for name in group:
            if name != head:
                joint = tree.above[name]
                poses[name] = frames.compose(poses[joint.parent], joint.origin)
        moments = principal_moments(masses.total((mass, poses[name]) for name, mass in inertials.items()).inertia)
        if min(moments) <= 0.0:
            name, mass = max(inertials.items(), key=lambda item: item[1].mass)
            link = self.links[name]
            why = f"the principal moments of what moves must be above 0: {shown(moments)} kg m²"
            masses.not_positive(mass, bool(link.shapes), why, self.draft, link.path)

    def _massless(self, tree: UrdfTree, head: str, group: list[str]) -> None:
        joint = tree.above[head]
        link = self.links[head]
        listed = (", ".join(group[:6]) + (", ..." if len(group) > 6 else ""))[:300]
        if not self.draft.repairing(MASSLESS):
            rule = FROM_SHAPES if any(solids_of(self.links[name].shapes) for name in group) else MASSLESS
            self.draft.defect(joint.element, "this joint moves no mass", rule, listed)
            return
        what = f"a {joint.kind} joint became fixed, since what it moves has no mass: {listed}"
        joint.kind, joint.parts, kept = "fixed", (), joint.data.get("origin")
        joint.data = {} if kept is None else {"origin": kept}
        self.draft.take_back((*link.path, "joint"))
        self.draft.repaired(MASSLESS, joint.element, what, (*link.path, "joint"))

    def _written(self, tree: UrdfTree) -> dict[str, Any]:
        order, root = tree.order, tree.root
        first = self.links[root]
        below = tree.below[root]
        bodies: dict[str, Any] = {}
        is_world = first.is_empty and len(below) == 1 and (root == WORLD or below[0].kind == "free")
        if is_world:
            order = order[1:]
            child = self.links[below[0].child]
            if below[0].child not in self.between:
                bodies[child.name] = self._world_child(below[0], child)
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
                        reason = "fixed to the world: it has no mass, and what moves freely needs one"
                        self.draft.note(link.path, reason)
            self._fill(link, body, joined)
        given = self.root.word("name") or ""
        name = names([given])[0] if given else "robot"
        if given:
            renamed(self.root, "name", name)
        self.draft.place((), self.root)
        coupled = joints.constraints([tree.above[name] for name in tree.order if name in tree.above], self.draft)
        more = {"constraints": coupled} if coupled else {}
        said: dict[str, Any] = {"materials": self.materials} if self.materials else {}
        with self.draft.collecting():
            moving = {name: self.links[name].name for name in order if name not in self.between}
            if pairs := links.excluded(self.root, self.links, moving):
                said["exclude"] = pairs
        contact = {"contact": said} if said else {}
        return {"simspec": VERSION, "name": name, **contact, "model": {"bodies": bodies, **more}}

    def _write_chain(self, link: UrdfLinkRead, body: dict[str, Any], chain: JointChain, from_world: bool) -> None:
        if not from_world:
            body["parent"] = self.links[chain.parent].name
        owners = [joint for joint in chain.joints for _ in joint.listed()]
        for index, joint in enumerate(owners):
            self.draft.place((*link.path, "joints", index), joint.element)
        body["joints"] = links.chain_joints(chain)
        elements = {name: self.links[name].element for name in chain.between}
        links.leave_out_between(elements, chain, link.name)
        listed = ", ".join(chain.between)
        self.draft.note((*link.path, "joints"), f"without mass between them in the file: {listed}"[:300])

    def _world_child(self, joint: UrdfJointRead, child: UrdfLinkRead) -> dict[str, Any]:
        """The words of the body that hangs on the link `world`: there is no such body, since it is the world itself."""
        self._place_joint(child.path, joint)
        body: dict[str, Any] = {"fixed": True} if joint.kind == "fixed" else {}
        if joint.kind in ("fixed", "free"):
            if "origin" in joint.data:
                body["pose"] = joint.data["origin"]
            how = "fixed to the world" if joint.kind == "fixed" else "free"
            joint.element.lose("name", f"the root {child.name} is {how}, without a joint", INFORMATION)
        else:
            body |= joint.placed(child.name)
        return body

    def _place_joint(self, path: Path_, joint: UrdfJointRead) -> None:
        for index in range(len(joint.parts)):
            self.draft.place((*path, "joints", index), joint.element)
        self.draft.place((*path, "joint"), joint.element)
        self.draft.place((*path, "pose"), joint.element)
        for tag, word in PLACES:
            for part in joint.element.look(tag)[:1]:
                self.draft.place((*path, "joint", word), part)

    def _fill(self, link: UrdfLinkRead, body: dict[str, Any], joined: dict[str, Any]) -> None:
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
            link.shapes = shapes.without_planes(link.shapes)
        if link.mass is not None and (link.mass.from_shapes or link.mass.density):
            for shape in solids_of(link.shapes):
                shape.fill()
                if link.mass.density:
                    shape.data["density"] = plain(link.mass.density)
        if link.shapes:
            body["shapes"] = [shape.written() for shape in link.shapes]
            for index, shape in enumerate(link.shapes):
                self.draft.place((*path, "shapes", index), shape.element)


ROBOT: Final = b"robot"
_PROGRAM: Final = re.compile(rb"<xacro:[A-Za-z]|=\s*[\"'][^\"'<>]*\$(?:\{|\((?:optenv|env|arg|eval|dirname|anon)\b)")
"""Syntax of xacro alone; ``$(find PACKAGE)`` stands in paths of plain URDF, too, and so may a namespace that nothing
uses."""


class UrdfImporter:
    """Reads URDF by itself: every element and attribute is seen, with its line."""

    NAME = "URDF"
    SUFFIXES = SUFFIXES

    def recognises(self, content: bytes) -> bool:
        """Whether a file has the outermost element of URDF, and nothing that only xacro gives a meaning."""
        return outermost(content) == ROBOT and not is_program(content)

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """The robot as a model file. Raises SpecError with every problem."""
        files = Files(path, shown, options)
        return self.parsed(files.content(), files)

    def table(self) -> Iterator[ElementRow]:
        """The fate of every element and attribute."""
        return rows()

    def rules(self) -> Mapping[str, str]:
        """Rules of repair, with what they do."""
        return RULES

    def parsed(self, content: bytes, files: Files) -> Imported:
        """The same of a text that is no file. Raises SpecError, also for a program that has not been run."""
        plain = without_comments(content)
        if (found := _PROGRAM.search(plain)) is not None:
            line = plain.count(b"\n", 0, found.start()) + 1
            text = plain[found.start() :].split(b"\n", 1)[0][:60].decode("utf-8", "replace")
            raise SpecError(
                [Problem("unexpanded xacro", location=Location(files.shown, line, 1), found=text, code="I111")]
            )
        return RobotReader(parse(content, files.shown), files).imported()


def is_program(content: bytes) -> bool:
    """Whether a file, its comments aside, has what is to be expanded by xacro, whatever its name ends in."""
    return _PROGRAM.search(without_comments(content)) is not None
