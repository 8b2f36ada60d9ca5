"""Classes of defaults of an MJCF file: which there are, and what an element takes from its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from simspec.formats.kit.xml_elements import MOST_ATTRIBUTES, Element
from simspec.formats.mjcf.document import Class
from simspec.formats.mjcf.schema import (
    ACTUATOR,
    ACTUATOR_ATTRIBUTES,
    ACTUATORS,
    ORIENTATIONS,
    defaults_of,
)

MAIN: Final = "main"
"""The name of the outermost class."""
MOST_DEFAULTS: Final = 4_000_000
"""Attributes of all classes together, those that they take over included: a chain of classes repeats them."""


class Classes:
    """The classes of one file, called ``file`` in errors.

    Raises ValueError, with the line, for classes without a name, names that stand twice, and more attributes than are read.
    """

    def __init__(self, root: Element, file: str):
        self._file = file
        self._count = 0
        self._together: dict[tuple[int, ...], Mapping[str, str]] = {}
        self._open = any(element.tag == "include" for element in root.walk())
        self.missing: set[str] = set()
        """Names that are asked for and not there; only where the file includes others."""
        outermost = root.all("default")
        names = [element.attributes["class"] for element in outermost if "class" in element.attributes]
        self.main = names[0] if names else MAIN
        elements: Mapping[str, Mapping[str, str]] = {}
        for element in outermost:
            elements = self._with_own(elements, element)
        self.by_name = {self.main: Class(self.main, None, elements)}
        waiting = [(child, self.main) for element in reversed(outermost) for child in reversed(element.all("default"))]
        while waiting:
            element, parent = waiting.pop()
            name = element.attributes.get("class")
            if name is None:
                raise self._refused(element, "a class of defaults without a name")
            if name in self.by_name:
                raise self._refused(element, f"a second class of defaults {name[:200]!r}")
            self.by_name[name] = Class(name, parent, self._with_own(self.by_name[parent].elements, element))
            waiting.extend((child, name) for child in reversed(element.all("default")))

    def find(self, name: str, element: Element) -> Class:
        """A class that ``element`` names; the outermost answers to ``main`` too. Raises ValueError where there is none."""
        known = self.by_name.get(self.main if name == MAIN else name)
        if known is not None:
            return known
        if not self._open:
            raise self._refused(element, f"no class of defaults {name[:200]!r}")
        self.missing.add(name)
        return Class(name, None, {})

    def taken(self, element: Element, section: str, inherited: str) -> tuple[str, Mapping[str, str]]:
        """The class of an element in a section, and what it takes from there; ``inherited`` holds where it names none."""
        tags = defaults_of(section, element.tag)
        if not tags:
            return inherited, {}
        name = element.attributes.get("class", inherited)
        elements = self.find(name, element).elements
        sources = [elements[tag] for tag in tags if tag in elements]
        if len(sources) < 2:
            return name, self._overridden(element, sources[0] if sources else {}, element.attributes)
        key = tuple(map(id, sources))  # of mappings that live as long as the classes
        if key not in self._together:
            self._together[key] = {name: value for source in sources for name, value in source.items()}
            self._counted(element, len(self._together[key]))
        return name, self._overridden(element, self._together[key], element.attributes)

    def _with_own(self, outer: Mapping[str, Mapping[str, str]], element: Element) -> Mapping[str, Mapping[str, str]]:
        """The defaults of a class: those around it, overridden by its own."""
        own = [child for child in element.children if child.tag not in ("default", "include")]
        if not own:
            return outer
        resolved = dict(outer)
        for child in own:
            parts: dict[str, dict[str, str]] = {child.tag: dict(child.attributes)}
            if child.tag in ACTUATORS:  # what is not of one kind alone holds for all
                parts = {ACTUATOR: {}, child.tag: {}}
                for name, value in child.attributes.items():
                    parts[ACTUATOR if name in ACTUATOR_ATTRIBUTES else child.tag][name] = value
            for tag, attributes in parts.items():
                earlier = self._overridden(child, resolved.get(tag, {}), attributes)
                resolved[tag] = {**earlier, **attributes}
                self._counted(child, len(resolved[tag]))
                if len(resolved[tag]) > MOST_ATTRIBUTES:
                    why = f"more than {MOST_ATTRIBUTES} attributes with those of the classes around it"
                    raise self._refused(child, why)
        self._counted(element, len(resolved))
        return resolved

    def _overridden(self, element: Element, earlier: Mapping[str, str], own: Mapping[str, str]) -> Mapping[str, str]:
        """``earlier`` without what ``own`` says in another way: one orientation, in whichever words."""
        if earlier.keys().isdisjoint(ORIENTATIONS) or ORIENTATIONS.isdisjoint(own):
            return earlier
        left = {name: value for name, value in earlier.items() if name not in ORIENTATIONS}
        self._counted(element, len(left))
        return left

    def _counted(self, element: Element, attributes: int) -> None:
        self._count += attributes
        if self._count > MOST_DEFAULTS:
            raise self._refused(element, f"classes of defaults with more than {MOST_DEFAULTS:,} attributes together")

    def _refused(self, element: Element, why: str) -> ValueError:
        return ValueError(f"{self._file}:{element.line}: {why}")
