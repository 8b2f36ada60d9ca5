"""What was read of an MJCF file: elements with their lines, defaults resolved, nothing of what an engine makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simspec.formats.kit.text import finite_numbers
from simspec.formats.kit.xml_elements import Element


@dataclass(frozen=True, slots=True)
class Frame:
    """A ``frame`` or ``replicate`` around an element, and what is around that, up to its body."""

    element: Element
    outer: Frame | None


@dataclass(frozen=True, slots=True)
class Item:
    """An element as the language's defaults complete it."""

    file: str
    element: Element
    class_name: str
    """The class of defaults that it takes, by itself or from the bodies around it."""
    defaults: Mapping[str, str]
    frame: Frame | None = None

    @property
    def tag(self) -> str:
        """The name of the element."""
        return self.element.tag

    @property
    def own(self) -> Mapping[str, str]:
        """The attributes that it states itself."""
        return self.element.attributes

    @property
    def values(self) -> Mapping[str, str]:
        """All its attributes: its own before those of its class."""
        return {**self.defaults, **self.element.attributes} if self.defaults else self.element.attributes

    def refused(self, why: str) -> ValueError:
        """The error of something that is wrong with it, with file, line and name."""
        name = self.element.attributes.get("name")
        called = f"<{self.tag}>" if name is None else f"<{self.tag}> {name[:200]!r}"
        return ValueError(f"{self.file}:{self.element.line}: {called}: {why}")

    def text(self, name: str) -> str:
        """An attribute. Raises ValueError, with the place, where neither it nor its class states one."""
        value = self.element.attributes.get(name)
        if value is None:
            value = self.defaults.get(name)
        if value is None:
            raise self.refused(f"no attribute {name!r}")
        return value

    def numbers(self, name: str, count: int | None = None) -> tuple[float, ...]:
        """The numbers of an attribute. Raises ValueError where they are none, not finite, or not ``count``."""
        text = self.text(name)
        try:
            return finite_numbers(text, count)
        except ValueError as error:
            raise self.refused(f"{name} {error}") from None

    def number(self, name: str) -> float:
        """The one number of an attribute."""
        return self.numbers(name, 1)[0]


@dataclass(frozen=True, slots=True)
class Body:
    """A body, and what stands in it directly or in frames, other bodies aside."""

    item: Item
    parent: int | None
    """Its parent's place in ``Document.bodies``; None: the world."""
    items: tuple[Item, ...]

    def all(self, tag: str) -> tuple[Item, ...]:
        """Its elements of this tag."""
        return tuple(item for item in self.items if item.tag == tag)


@dataclass(frozen=True, slots=True)
class Class:
    """A class of defaults: the attributes of each element, with those of the classes around it."""

    name: str
    parent: str | None
    elements: Mapping[str, Mapping[str, str]]


@dataclass(frozen=True, slots=True)
class Document:
    """One file. Sections that stand several times are one; of attributes that stand several times the last holds."""

    file: str
    root: Element
    """All of it as it stands."""
    compiler: Item
    option: Item
    flags: Item
    size: Item
    main: str
    """The name of the outermost class, which all others take over."""
    classes: Mapping[str, Class]
    world: tuple[Item, ...]
    """What stands in the world itself, bodies aside."""
    bodies: tuple[Body, ...]
    """Depth first, as in the file."""
    sections: Mapping[str, tuple[Item, ...]]
    """What stands in each other section (``contact``, ``actuator``, ``keyframe``, ``asset``, …), in order."""
    includes: tuple[Element, ...]
    """References to other files, which are not read: where there is one, what it holds is missing here."""
    missing_classes: frozenset[str]
    """Classes that are asked for and are not here: only where there are includes."""
    unknown: tuple[Element, ...]
    """Elements of names that the language, as known here, does not have there; they stay in ``root`` and in their place."""
    meshes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """The vertices (flat, m) of the files of convex hulls in the folder, by relative path."""

    def section(self, name: str) -> tuple[Item, ...]:
        """What stands in a section; nothing where it is not there."""
        return self.sections.get(name, ())
