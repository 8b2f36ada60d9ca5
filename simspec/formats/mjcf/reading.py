"""MJCF files as documents: sections merged, classes of defaults resolved, bodies in one list, every element with its line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from simspec.formats.kit.text import MOST_ATTRIBUTES, XmlElement, finite_numbers, read_xml

# --- language ---


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_IN_FRAMES: Final = _words(
    "body frame replicate joint freejoint geom site camera light attach composite flexcomp plugin"
)
ACTUATORS: Final = _words(
    "general motor position velocity intvelocity damper cylinder muscle adhesion dcmotor orientation pid"
)
_SENSORS: Final = _words(
    "touch accelerometer velocimeter gyro force torque magnetometer rangefinder camprojection jointpos jointvel "
    "jointactuatorfrc jointlimitpos jointlimitvel jointlimitfrc tendonpos tendonvel tendonactuatorfrc "
    "tendonlimitpos tendonlimitvel tendonlimitfrc actuatorpos actuatorvel actuatorfrc ballquat ballangvel framepos "
    "framequat framexaxis frameyaxis framezaxis framelinvel frameangvel framelinacc frameangacc subtreecom "
    "subtreelinvel subtreeangmom insidesite distance normal fromto contact e_potential e_kinetic clock tactile user "
    "plugin"
)

CHILDREN: Final[Mapping[str, frozenset[str]]] = {
    "mujoco": _words(
        "compiler option size statistic visual default extension custom asset worldbody contact deformable tendon "
        "equality actuator sensor keyframe"
    ),
    "compiler": _words("lengthrange"),
    "option": _words("flag"),
    "visual": _words("global quality headlight map scale rgba"),
    "default": ACTUATORS | _words("default joint geom site camera light pair equality tendon mesh texture material"),
    "extension": _words("plugin"),
    "plugin": _words("instance config"),
    "instance": _words("config"),
    "custom": _words("numeric text tuple"),
    "tuple": _words("element"),
    "asset": _words("mesh hfield skin texture material model"),
    "mesh": _words("plugin"),
    "skin": _words("bone"),
    "material": _words("layer"),
    "worldbody": _IN_FRAMES,
    "body": _IN_FRAMES | {"inertial"},
    "frame": _IN_FRAMES,
    "replicate": _IN_FRAMES,
    "geom": _words("plugin"),
    "composite": _words("joint geom site skin plugin"),
    "flexcomp": _words("edge elasticity contact pin plugin"),
    "deformable": _words("flex skin"),
    "flex": _words("edge elasticity contact"),
    "contact": _words("pair exclude"),
    "tendon": _words("spatial fixed"),
    "spatial": _words("site geom pulley"),
    "fixed": _words("joint"),
    "equality": _words("connect weld joint tendon flex flexvert flexstrain"),
    "actuator": ACTUATORS | {"plugin"},
    "sensor": _SENSORS,
    "keyframe": _words("key"),
}
"""Elements that may stand in each element, ``include`` aside, which may stand anywhere. Elements that are not here hold
none."""

ACTUATOR: Final = "actuator"
"""In a class of defaults: the common attributes of all actuators, of whichever kind they are stated."""
ACTUATOR_ATTRIBUTES: Final = _words(
    "group nsample interp delay ctrllimited forcelimited actlimited ctrlrange forcerange actrange lengthrange gear "
    "cranklength user joint jointinparent tendon cranksite slidersite site refsite body armature damping"
)
"""Attributes of actuators of every kind; a class states them once for all kinds, and the last one said holds."""
ORIENTATIONS: Final = _words("quat axisangle xyaxes zaxis euler")
"""Attributes that say the same in other words: of an element's own and its class's only the element's own holds."""
HOLDERS: Final = _words("worldbody body frame replicate")
"""Elements in which bodies stand. The two last only place, and repeat, what is in them."""


def defaults_of(section: str, tag: str) -> tuple[str, ...]:
    """The elements of a class of defaults that ``tag`` in ``section`` takes attributes from; later ones override."""
    if section == "worldbody":
        return (tag,) if tag in ("joint", "geom", "site", "camera", "light") else ()
    if section == "actuator":
        return (ACTUATOR, tag) if tag in ACTUATORS else ()
    if section in ("equality", "tendon"):
        return (section,)
    if (section, tag) in (("contact", "pair"), ("asset", "mesh"), ("asset", "material"), ("asset", "texture")):
        return (tag,)
    return ()


# --- document ---


@dataclass(frozen=True, slots=True)
class MjcfFrame:
    """A ``frame`` or ``replicate`` around an element, and what is around that, up to its body."""

    element: XmlElement
    outer: MjcfFrame | None


@dataclass(frozen=True, slots=True)
class MjcfItem:
    """An element as the language's defaults complete it."""

    element: XmlElement
    class_name: str
    """The class of defaults that it takes, by itself or from the bodies around it."""
    defaults: Mapping[str, str]
    frame: MjcfFrame | None = None

    @property
    def tag(self) -> str:
        """The name of the element."""
        return self.element.tag

    @property
    def stated(self) -> Mapping[str, str]:
        """The attributes that it states itself."""
        return self.element.attributes

    @property
    def values(self) -> Mapping[str, str]:
        """All its attributes: its own before those of its class."""
        return {**self.defaults, **self.element.attributes} if self.defaults else self.element.attributes

    def refused(self, why: str) -> ValueError:
        """The error of something that is wrong with it, with file, line and name."""
        return self.element.refused(why)

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
class MjcfBodyItem:
    """A body, and what stands in it directly or in frames, other bodies aside."""

    item: MjcfItem
    parent: int | None
    """Its parent's place in ``Document.bodies``; None: the world."""
    items: tuple[MjcfItem, ...]

    def all(self, tag: str) -> tuple[MjcfItem, ...]:
        """Its elements of this tag."""
        return tuple(item for item in self.items if item.tag == tag)


@dataclass(frozen=True, slots=True)
class MjcfClass:
    """A class of defaults: the attributes of each element, with those of the classes around it."""

    name: str
    parent: str | None
    elements: Mapping[str, Mapping[str, str]]


@dataclass(frozen=True, slots=True)
class MjcfDocument:
    """One file. Sections that stand several times are one; of attributes that stand several times the last holds."""

    file: str
    root: XmlElement
    """All of it as it stands."""
    compiler: MjcfItem
    option: MjcfItem
    flags: MjcfItem
    size: MjcfItem
    main: str
    """The name of the outermost class, which all others take over."""
    classes: Mapping[str, MjcfClass]
    world: tuple[MjcfItem, ...]
    """Elements in the world itself, bodies aside."""
    bodies: tuple[MjcfBodyItem, ...]
    """Depth first, as in the file."""
    sections: Mapping[str, tuple[MjcfItem, ...]]
    """Elements in each other section (``contact``, ``actuator``, ``keyframe``, ``asset``, …), in order."""
    includes: tuple[XmlElement, ...]
    """References to other files, which are not read: where there is one, what it holds is missing here."""
    missing_classes: frozenset[str]
    """Classes that are referenced and missing: only where there are includes."""
    unknown: tuple[XmlElement, ...]
    """Elements of names that the language, as known here, does not have there; they stay in ``root`` and in their place."""
    meshes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """The vertices (flat, m) of the files of convex hulls in the folder, by relative path."""

    def section(self, name: str) -> tuple[MjcfItem, ...]:
        """Elements in a section; none where it is missing."""
        return self.sections.get(name, ())


# --- classes of defaults ---

MAIN: Final = "main"
"""The name of the outermost class."""
MOST_DEFAULTS: Final = 4_000_000
"""Attributes of all classes together, those that they take over included: a chain of classes repeats them."""


class MjcfClasses:
    """The classes of one file, called ``file`` in errors.

    Raises ValueError, with the line, for classes without a name, names that stand twice, and more attributes than are read.
    """

    def __init__(self, root: XmlElement, file: str):
        self._file = file
        self._count = 0
        self._together: dict[tuple[int, ...], Mapping[str, str]] = {}
        self._open = any(element.tag == "include" for element in root.walk())
        self.missing: set[str] = set()
        """Names that are referenced and missing; only where the file includes others."""
        outermost = root.all("default")
        names = [element.attributes["class"] for element in outermost if "class" in element.attributes]
        self.main = names[0] if names else MAIN
        elements: Mapping[str, Mapping[str, str]] = {}
        for element in outermost:
            elements = self._with_elements(elements, element)
        self.by_name = {self.main: MjcfClass(self.main, None, elements)}
        waiting = [(child, self.main) for element in reversed(outermost) for child in reversed(element.all("default"))]
        while waiting:
            element, parent = waiting.pop()
            name = element.attributes.get("class")
            if name is None:
                raise self._refused(element, "a class of defaults without a name")
            if name in self.by_name:
                raise self._refused(element, f"a second class of defaults {name[:200]!r}")
            self.by_name[name] = MjcfClass(name, parent, self._with_elements(self.by_name[parent].elements, element))
            waiting.extend((child, name) for child in reversed(element.all("default")))

    def find(self, name: str, element: XmlElement) -> MjcfClass:
        """A class that ``element`` names; the outermost answers to ``main`` too. Raises ValueError where there is none."""
        known = self.by_name.get(self.main if name == MAIN else name)
        if known is not None:
            return known
        if not self._open:
            raise self._refused(element, f"no class of defaults {name[:200]!r}")
        self.missing.add(name)
        return MjcfClass(name, None, {})

    def taken(self, element: XmlElement, section: str, inherited: str) -> tuple[str, Mapping[str, str]]:
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

    def _with_elements(
        self, outer: Mapping[str, Mapping[str, str]], element: XmlElement
    ) -> Mapping[str, Mapping[str, str]]:
        """The defaults of a class: those around it, overridden by its own."""
        children = [child for child in element.children if child.tag not in ("default", "include")]
        if not children:
            return outer
        resolved = dict(outer)
        for child in children:
            parts: dict[str, dict[str, str]] = {child.tag: dict(child.attributes)}
            if child.tag in ACTUATORS:  # attributes that are not of one kind alone hold for all
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

    def _overridden(
        self, element: XmlElement, earlier: Mapping[str, str], local: Mapping[str, str]
    ) -> Mapping[str, str]:
        """``earlier`` without what ``own`` says in another way: one orientation, in whichever words."""
        if earlier.keys().isdisjoint(ORIENTATIONS) or ORIENTATIONS.isdisjoint(local):
            return earlier
        left = {name: value for name, value in earlier.items() if name not in ORIENTATIONS}
        self._counted(element, len(left))
        return left

    def _counted(self, element: XmlElement, attributes: int) -> None:
        self._count += attributes
        if self._count > MOST_DEFAULTS:
            raise self._refused(element, f"classes of defaults with more than {MOST_DEFAULTS:,} attributes together")

    def _refused(self, element: XmlElement, why: str) -> ValueError:
        return element.error(why)


MERGED: Final = ("compiler", "option", "size", "statistic", "default", "worldbody", "include")
"""Sections that do not list elements: those have one set of attributes, or a place of their own in the document."""


def read_document(path: Path) -> MjcfDocument:
    """The document of an MJCF file; included files are not read.

    Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no MJCF.
    """
    return document_of(read_xml(path), path.name)


def document_of(root: XmlElement, file: str) -> MjcfDocument:
    """The document of a parsed file, called ``file`` in errors. Raises ValueError as :func:`read_document`."""
    if root.tag != "mujoco":
        raise ValueError(f"{file}:{root.line}: the root is <{root.tag[:60]}>, should be <mujoco>")
    return _MjcfReader(root, file).document()


class _MjcfReader:
    def __init__(self, root: XmlElement, file: str):
        self._root, self._file = root, file
        self._includes = tuple(element for element in root.walk() if element.tag == "include")
        self._classes = MjcfClasses(root, file)

    def document(self) -> MjcfDocument:
        world, bodies = self._bodies()
        sections: dict[str, list[MjcfItem]] = {}
        for section in self._root.children:
            if section.tag not in MERGED:
                items = sections.setdefault(section.tag, [])
                items.extend(self._item(element, section.tag, self._classes.main) for element in section.children)
        options = self._root.all("option")
        return MjcfDocument(
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

    def _merged(self, elements: tuple[XmlElement, ...]) -> MjcfItem:
        """Elements that stand for one, as one; the root, without attributes, where there are none."""
        if not elements:
            empty = XmlElement(self._root.tag, self._root.line, {}, (), file=self._file)
            return MjcfItem(empty, self._classes.main, {})
        earlier: dict[str, str] = {}
        for element in elements[:-1]:
            earlier.update(element.attributes)
        return MjcfItem(elements[-1], self._classes.main, earlier)

    def _item(self, element: XmlElement, section: str, inherited: str, frame: MjcfFrame | None = None) -> MjcfItem:
        """An element of a section, with the defaults of its class or of ``inherited``."""
        name, defaults = self._classes.taken(element, section, inherited)
        return MjcfItem(element, name, defaults, frame)

    # --- bodies ---------------------------------------------------------------------------------------------------

    def _bodies(self) -> tuple[tuple[MjcfItem, ...], tuple[MjcfBodyItem, ...]]:
        """Elements in the world itself, and all bodies, depth first."""
        world: list[MjcfItem] = []
        bodies: list[tuple[MjcfItem, int | None, list[MjcfItem]]] = []
        # (element, its body's place, class that holds there, frame around it)
        waiting: list[tuple[XmlElement, int | None, str, MjcfFrame | None]] = [
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
                bodies.append((MjcfItem(element, inherited, {}, frame), body, []))
                body, frame = len(bodies) - 1, None
            else:
                frame = MjcfFrame(element, frame)
            waiting.extend((child, body, inherited, frame) for child in reversed(element.children))
        return tuple(world), tuple(MjcfBodyItem(item, parent, tuple(items)) for item, parent, items in bodies)


def _unknown(root: XmlElement) -> Iterator[XmlElement]:
    """Elements that the language does not have where they stand; their content is not checked."""
    waiting = [(root, True)]
    while waiting:
        element, is_known = waiting.pop()
        if not is_known:
            yield element
            continue
        known = CHILDREN.get(element.tag, frozenset())
        below = (child for child in reversed(element.children) if child.tag != "include")
        waiting.extend((child, child.tag in known) for child in below)
