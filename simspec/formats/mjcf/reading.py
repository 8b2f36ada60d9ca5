"""From the elements of an MJCF file to a document: sections merged, defaults and classes resolved, bodies in one list."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from simspec.formats.kit.xml_elements import Element, read_xml
from simspec.formats.mjcf.defaults import Classes
from simspec.formats.mjcf.document import Body, Document, Frame, Item
from simspec.formats.mjcf.schema import CHILDREN, HOLDERS

MERGED: Final = ("compiler", "option", "size", "statistic", "default", "worldbody", "include")
"""Sections that do not list elements: those have one set of attributes, or a place of their own in the document."""


def read_document(path: Path) -> Document:
    """The document of an MJCF file; what it includes is not read.

    Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no MJCF.
    """
    return document_of(read_xml(path), path.name)


def document_of(root: Element, file: str) -> Document:
    """The document of a parsed file, called ``file`` in errors. Raises ValueError as :func:`read_document`."""
    if root.tag != "mujoco":
        raise ValueError(f"{file}:{root.line}: the root is <{root.tag[:60]}>, should be <mujoco>")
    return _Reader(root, file).document()


class _Reader:
    def __init__(self, root: Element, file: str):
        self._root, self._file = root, file
        self._includes = tuple(element for element in root.walk() if element.tag == "include")
        self._classes = Classes(root, file)

    def document(self) -> Document:
        world, bodies = self._bodies()
        sections: dict[str, list[Item]] = {}
        for section in self._root.children:
            if section.tag not in MERGED:
                items = sections.setdefault(section.tag, [])
                items.extend(self._item(element, section.tag, self._classes.main) for element in section.children)
        options = self._root.all("option")
        return Document(
            self._file,
            self._root,
            self._merged(self._root.all("compiler")),
            self._merged(options),
            self._merged(tuple(flag for option in options for flag in option.all("flag"))),
            self._merged(self._root.all("size")),
            self._classes.main,
            self._classes.by_name,
            world,
            bodies,
            {name: tuple(items) for name, items in sections.items()},
            self._includes,
            frozenset(self._classes.missing),
            tuple(_unknown(self._root)),
        )

    def _merged(self, elements: tuple[Element, ...]) -> Item:
        """Elements that stand for one, as one; the root, without attributes, where there are none."""
        if not elements:
            empty = Element(self._root.tag, self._root.line, {}, ())
            return Item(self._file, empty, self._classes.main, {})
        earlier: dict[str, str] = {}
        for element in elements[:-1]:
            earlier.update(element.attributes)
        return Item(self._file, elements[-1], self._classes.main, earlier)

    def _item(self, element: Element, section: str, inherited: str, frame: Frame | None = None) -> Item:
        """An element of a section, with the defaults of its class or of ``inherited``."""
        name, defaults = self._classes.taken(element, section, inherited)
        return Item(self._file, element, name, defaults, frame)

    # --- bodies ---------------------------------------------------------------------------------------------------

    def _bodies(self) -> tuple[tuple[Item, ...], tuple[Body, ...]]:
        """What stands in the world itself, and all bodies, depth first."""
        world: list[Item] = []
        bodies: list[tuple[Item, int | None, list[Item]]] = []
        # (element, its body's place, class that holds there, frame around it)
        waiting: list[tuple[Element, int | None, str, Frame | None]] = [
            (element, None, section.attributes.get("childclass", self._classes.main), None)
            for section in reversed(self._root.all("worldbody"))
            for element in reversed(section.children)
        ]
        while waiting:
            element, body, inherited, frame = waiting.pop()
            if element.tag not in HOLDERS or element.tag == "worldbody":
                items = world if body is None else bodies[body][2]
                items.append(self._item(element, "worldbody", inherited, frame))
                continue
            inherited = element.attributes.get("childclass", inherited)
            if "childclass" in element.attributes:
                self._classes.find(inherited, element)
            if element.tag == "body":
                bodies.append((Item(self._file, element, inherited, {}, frame), body, []))
                body, frame = len(bodies) - 1, None
            else:
                frame = Frame(element, frame)
            waiting.extend((child, body, inherited, frame) for child in reversed(element.children))
        return tuple(world), tuple(Body(item, parent, tuple(items)) for item, parent, items in bodies)


def _unknown(root: Element) -> Iterator[Element]:
    """Elements that the language does not have where they stand; what is in them is theirs, and not looked at."""
    waiting = [(root, True)]
    while waiting:
        element, is_known = waiting.pop()
        if not is_known:
            yield element
            continue
        known = CHILDREN.get(element.tag, frozenset())
        below = (child for child in reversed(element.children) if child.tag != "include")
        waiting.extend((child, child.tag in known) for child in below)
