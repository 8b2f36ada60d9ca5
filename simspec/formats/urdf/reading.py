"""From URDF files to a :class:`Document`, with lxml: it shares nothing with the templates that write, nor with an engine.

What comes may be a stranger's: no entities, no document type, no network, no other encoding than UTF-8, and bounded in size,
depth and number of elements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from simspec.errors import SpecError
from simspec.formats.urdf.document import (
    Document,
    Dynamics,
    Inertial,
    Joint,
    Limit,
    Link,
    Material,
    Node,
    Origin,
    Place,
    Robot,
    Shape,
)
from simspec.outputs.reading import files_below, read_bytes
from simspec.world.types import Vector3

LARGEST_FILE: Final = 64 * 2**20
"""Bytes of one file; that of a tree of 10,000 links has 10 million."""
MOST_TAGS: Final = 2_000_000
"""Beginnings and ends of elements in one file: each takes up to 500 bytes of memory. A link with its joint has some 40."""
DEEPEST: Final = 64
"""Elements within each other; the language has five."""

Part = TypeVar("Part")


def read_folder(folder: Path) -> Document:
    """All files of a folder, and of those below it, whose names end in ``.urdf``. Raises ValueError with the place."""
    try:
        names = [name for name in files_below(folder) if name.endswith(".urdf")]
        return Document({name: read_robot(read_bytes(folder / name, LARGEST_FILE, folder), name) for name in names})
    except SpecError as error:
        raise ValueError(str(error)) from None


def read_robot(content: bytes, file: str) -> Robot:
    """One file; ``file`` is its name in errors and places. Raises ValueError with the place."""
    node = parse(content, file)
    if node.tag != "robot":
        raise node.error(f"<{node.tag[:60]}> is the outermost element, should be <robot>")
    links = _distinct([_link(child) for child in node.all("link")], "links")
    joints = _distinct([_joint(child) for child in node.all("joint")], "joints")
    return Robot(node, node.word("name"), links, joints, _root(node, links, joints))


def parse(content: bytes, file: str) -> Node:
    """The outermost element of an XML file. Raises ValueError with the place for what is damaged, too large or hostile."""
    from lxml import etree  # type: ignore[import-untyped]  # it has no types

    start = Place(file, 1)
    if len(content) > LARGEST_FILE or content.count(b"<") > MOST_TAGS:
        raise ValueError(f"{start}: more than the {LARGEST_FILE:,} bytes or {MOST_TAGS:,} tags that are read")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{start}: not UTF-8 at byte {error.start}") from None
    for word in ("<!DOCTYPE", "<!ENTITY"):
        if word in text:
            raise ValueError(f"{file}:{text[: text.index(word)].count(chr(10)) + 1}: {word} is not read")
    parser = etree.XMLParser(
        encoding="utf-8",  # whatever the file says of itself
        resolve_entities=False,
        load_dtd=False,
        no_network=True,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        line = error.lineno or 1
        raise ValueError(f"{file}:{line}: not XML: {str(error.msg)[:200]}") from None
    return _node(root, file, 1)


def _node(element: Any, file: str, depth: int) -> Node:
    place = Place(file, element.sourceline)
    if depth > DEEPEST:
        raise ValueError(f"{place}: more than {DEEPEST} elements within each other")
    children = tuple(_node(child, file, depth + 1) for child in element)
    return Node(str(element.tag), place, dict(element.attrib), children, (element.text or "").strip())


def _distinct(parts: Sequence[Part], what: str) -> tuple[Part, ...]:
    """The same parts. Raises ValueError where two have one name."""
    seen: set[str] = set()
    for part in parts:
        name: str = part.name  # type: ignore[attr-defined]
        if name in seen:
            raise part.node.error(f"two {what} are called {name!r}")  # type: ignore[attr-defined]
        seen.add(name)
    return tuple(parts)


def _root(node: Node, links: Sequence[Link], joints: Sequence[Joint]) -> str:
    """The one link from which joints lead to all others. Raises ValueError where there is none."""
    names = {link.name for link in links}
    below: dict[str, list[str]] = {}
    held: set[str] = set()
    for joint in joints:
        for name in (joint.parent, joint.child):
            if name not in names:
                raise joint.node.error(f"joint {joint.name!r} names a link {name!r}, which there is not")
        if joint.child in held:
            raise joint.node.error(f"link {joint.child!r} is the child of two joints")
        held.add(joint.child)
        below.setdefault(joint.parent, []).append(joint.child)
    roots = [link.name for link in links if link.name not in held]
    if len(roots) != 1:
        raise node.error(f"{len(roots)} links are no joint's child ({', '.join(roots[:5])}), should be one")
    waiting, reached = [roots[0]], 0
    while waiting:
        reached += 1
        waiting.extend(below.get(waiting.pop(), ()))
    if reached != len(links):
        raise node.error(f"joints lead from {roots[0]!r} to {reached} of {len(links)} links: others are in a circle")
    return roots[0]


# --- parts --------------------------------------------------------------------------------------------------------


def _of(node: Node, tag: str, read: Callable[[Node], Part]) -> Part | None:
    """The first element of this tag, read; None where there is none."""
    child = node.child(tag)
    return None if child is None else read(child)


def _vector(node: Node, name: str) -> Vector3 | None:
    values = node.numbers(name, 3)
    return None if values is None else (values[0], values[1], values[2])


def _origin(node: Node) -> Origin:
    return Origin(node, _vector(node, "xyz"), _vector(node, "rpy"))


def _inertial(node: Node) -> Inertial:
    inertia = node.need("inertia")
    values = tuple(inertia.number(name) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    return Inertial(node, _of(node, "origin", _origin), node.need("mass").need_number("value"), values)


def _material(node: Node) -> Material:
    colour = node.child("color")
    rgba = None if colour is None else colour.numbers("rgba", 4)
    return Material(node, node.attributes.get("name"), rgba)


def _shape(node: Node) -> Shape:
    geometry = node.need("geometry")
    if len(geometry.children) != 1:
        raise geometry.error(f"<geometry> has {len(geometry.children)} elements, should have one")
    return Shape(
        node,
        node.attributes.get("name"),
        _of(node, "origin", _origin),
        geometry.children[0],
        _of(node, "material", _material),
    )


def _link(node: Node) -> Link:
    return Link(
        node,
        node.word("name"),
        _of(node, "inertial", _inertial),
        tuple(map(_shape, node.all("visual"))),
        tuple(map(_shape, node.all("collision"))),
    )


def _joint(node: Node) -> Joint:
    axis = node.child("axis")
    return Joint(
        node,
        node.word("name"),
        node.word("type"),
        node.need("parent").word("link"),
        node.need("child").word("link"),
        _of(node, "origin", _origin),
        None if axis is None else _vector(axis, "xyz"),
        _of(node, "dynamics", lambda child: Dynamics(child, child.number("damping"), child.number("friction"))),
        _of(
            node,
            "limit",
            lambda child: Limit(child, *(child.number(name) for name in ("lower", "upper", "effort", "velocity"))),
        ),
    )
