"""From the elements of an MJCF file to a document: sections merged, defaults and classes resolved, bodies in one list."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from simspec.formats.kit.xml_elements import MOST_ATTRIBUTES, Element, read_xml
from simspec.formats.mjcf.document import Body, Class, Document, Frame, Item
from simspec.formats.mjcf.schema import CHILDREN, HOLDERS, defaults_of

MAIN: Final = "main"
"""The name of the outermost class where the file gives none."""
MOST_DEFAULTS: Final = 4_000_000
"""Attributes of all classes together, those that they take over included: a chain of classes repeats them."""
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
        self._missing: set[str] = set()
        self._values = 0
        self._main, self._classes = self._resolved_classes()
        self._together: dict[tuple[int, ...], Mapping[str, str]] = {}

    def document(self) -> Document:
        world, bodies = self._bodies()
        sections: dict[str, list[Item]] = {}
        for section in self._root.children:
            if section.tag not in MERGED:
                items = sections.setdefault(section.tag, [])
                items.extend(self._item(element, section.tag, self._main) for element in section.children)
        options = self._root.all("option")
        return Document(
            self._file,
            self._root,
            self._merged(self._root.all("compiler")),
            self._merged(options),
            self._merged(tuple(flag for option in options for flag in option.all("flag"))),
            self._merged(self._root.all("size")),
            self._main,
            self._classes,
            world,
            bodies,
            {name: tuple(items) for name, items in sections.items()},
            self._includes,
            frozenset(self._missing),
            tuple(_unknown(self._root)),
        )

    def _merged(self, elements: tuple[Element, ...]) -> Item:
        """Elements that stand for one, as one; the root, without attributes, where there are none."""
        if not elements:
            empty = Element(self._root.tag, self._root.line, {}, ())
            return Item(self._file, empty, self._main, {})
        earlier: dict[str, str] = {}
        for element in elements[:-1]:
            earlier.update(element.attributes)
        return Item(self._file, elements[-1], self._main, earlier)

    # --- defaults -------------------------------------------------------------------------------------------------

    def _resolved_classes(self) -> tuple[str, dict[str, Class]]:
        """The name of the outermost class, and all classes by name."""
        outermost = self._root.all("default")
        names = [element.attributes["class"] for element in outermost if "class" in element.attributes]
        main = names[0] if names else MAIN
        merged: Mapping[str, Mapping[str, str]] = {}
        for element in outermost:
            merged = self._with_own(merged, element)
        classes = {main: Class(main, None, merged)}
        waiting = [(child, main) for element in reversed(outermost) for child in reversed(element.all("default"))]
        while waiting:
            element, parent = waiting.pop()
            name = element.attributes.get("class")
            if name is None:
                raise self._refused(element, "a class of defaults without a name")
            if name in classes:
                raise self._refused(element, f"a second class of defaults {name[:200]!r}")
            classes[name] = Class(name, parent, self._with_own(classes[parent].elements, element))
            waiting.extend((child, name) for child in reversed(element.all("default")))
        return main, classes

    def _with_own(self, outer: Mapping[str, Mapping[str, str]], element: Element) -> Mapping[str, Mapping[str, str]]:
        """The defaults of a class: those around it, overridden by its own."""
        own = [child for child in element.children if child.tag not in ("default", "include")]
        if not own:
            return outer
        resolved = dict(outer)
        for child in own:
            resolved[child.tag] = {**resolved.get(child.tag, {}), **child.attributes}
            self._values += len(resolved[child.tag])
            if len(resolved[child.tag]) > MOST_ATTRIBUTES:
                raise self._refused(
                    child, f"more than {MOST_ATTRIBUTES} attributes with those of the classes around it"
                )
        self._values += len(resolved)
        if self._values > MOST_DEFAULTS:
            raise self._refused(element, f"classes of defaults with more than {MOST_DEFAULTS:,} attributes together")
        return resolved

    def _item(self, element: Element, section: str, inherited: str, frame: Frame | None = None) -> Item:
        """An element of a section with the defaults of its class; ``inherited`` is the class that holds where it names none."""
        sources = defaults_of(section, element.tag)
        if not sources:
            return Item(self._file, element, inherited, {}, frame)
        name = element.attributes.get("class", inherited)
        elements = self._class(name, element).elements
        return Item(
            self._file, element, name, self._joined([elements[tag] for tag in sources if tag in elements]), frame
        )

    def _joined(self, sources: list[Mapping[str, str]]) -> Mapping[str, str]:
        """Defaults of several elements as one, made once."""
        if len(sources) < 2:
            return sources[0] if sources else {}
        key = tuple(map(id, sources))  # of mappings that live as long as the classes
        if key not in self._together:
            self._together[key] = {name: value for source in sources for name, value in source.items()}
        return self._together[key]

    def _class(self, name: str, element: Element) -> Class:
        """A class by name; the outermost answers to its usual name too."""
        known = self._classes.get(self._main if name == MAIN else name)
        if known is not None:
            return known
        if not self._includes:
            raise self._refused(element, f"no class of defaults {name[:200]!r}")
        self._missing.add(name)
        return Class(name, None, {})

    # --- bodies ---------------------------------------------------------------------------------------------------

    def _bodies(self) -> tuple[tuple[Item, ...], tuple[Body, ...]]:
        """What stands in the world itself, and all bodies, depth first."""
        world: list[Item] = []
        bodies: list[tuple[Item, int | None, list[Item]]] = []
        # (element, its body's place, class that holds there, frame around it)
        waiting: list[tuple[Element, int | None, str, Frame | None]] = [
            (element, None, section.attributes.get("childclass", self._main), None)
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
                self._class(inherited, element)
            if element.tag == "body":
                bodies.append((Item(self._file, element, inherited, {}, frame), body, []))
                body, frame = len(bodies) - 1, None
            else:
                frame = Frame(element, frame)
            waiting.extend((child, body, inherited, frame) for child in reversed(element.children))
        return tuple(world), tuple(Body(item, parent, tuple(items)) for item, parent, items in bodies)

    def _refused(self, element: Element, why: str) -> ValueError:
        return ValueError(f"{self._file}:{element.line}: {why}")


def _unknown(root: Element) -> Iterator[Element]:
    """Elements that the language does not have where they stand; what is in them is theirs, and not looked at."""
    waiting = [root]
    while waiting:
        parent = waiting.pop()
        known = CHILDREN.get(parent.tag, frozenset())
        for child in parent.children:
            if child.tag in known:
                waiting.append(child)
            elif child.tag != "include":
                yield child
