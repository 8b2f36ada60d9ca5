"""XML elements that remember what of them was read, so that what an importer does not know is never passed over.

An importer takes attributes and children by name; :func:`accounts` then lists every element and attribute of the file: those
that it took are carried, those that it set aside have the fate and the reason that it gave, and all the rest is lost.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from simspec import numerals
from simspec.errors import Location, Problem, SpecError
from simspec.formats.kit.text import XmlElement, XmlError, parse_xml
from simspec.language.foreign import Account, Fate, LossSeverity
from simspec.language.words import LONGEST_NAME, NAME, clean_name

CARRIED, UNUSED, LOST = Fate.CARRIED, Fate.UNUSED, Fate.LOST
PHYSICS, APPEARANCE, INFORMATION = LossSeverity.PHYSICS, LossSeverity.APPEARANCE, LossSeverity.INFORMATION

LARGEST_FILE: Final = 64 * 2**20
"""Bytes of one file; the largest robot of the measured corpora has 3 million."""
MOST_TAGS: Final = 300_000
"""Beginnings and ends of elements in one file. To read, account for and check so many takes 4 to 8 s of processor time and
0.4 GB (measured: 60,000 shapes); the largest of 770 files of the measured corpora has 6,400."""
MOST_ATTRIBUTES: Final = 300_000
"""Signs of equality in one file, which every attribute has; the largest of the corpora has 5,000."""
MOST_BODIES: Final = 8_000
"""Bodies of one file: as many take 4 to 9 s of processor time, by the language. More are written once, with `array:` in a
scenario that uses the file."""
SPLIT: Final = "a scenario may use several files (models: {NAME: {use: FILE}}), and each many times (array:)"
DEEPEST: Final = 200
"""Elements within each other: trees of bodies nest in some languages, and a chain of 150 links is a rope."""
MOST_LABELS: Final = (3, 9)
"""Labels of a path that are kept where it is longer: those from the outside, and those from the inside. A path is reported of
every attribute, and in a tree of 200 bodies it would have 12,000 characters."""
NOT_READ: Final = "simspec does not read it"
LOCKED: Final = "its lower limit is its upper one"
"""Why a joint became a fixed one."""
NO_RATING: Final = "a rating of 0 lets nothing move: files say so where none is known"
HOW_HARD: Final = "how hard contact is: the spec's is rigid, by the law that all engines follow"
"""Of the softness of contact in the numbers of one solver, in every language: information, since a model states bodies and what
joins them, and how an engine separates them is chosen for all bodies of a scenario."""
HARDNESS_HINT: Final = "contact.hardness: {time_constant: T, damping_ratio: Z} says it, for the engines that have it"
SOLVER: Final = "how hard a constraint is, in the numbers of one solver: those of the spec are rigid"
_ROOT: Final = re.compile("<[A-Za-z_]")
_TAG: Final = re.compile(r"<[A-Za-z_][^<>]*>")
_TOUCHING: Final = re.compile("""("[^"]*"|'[^']*')(?=[A-Za-z_])""")
"""A value of an attribute that the name of the next one follows without a space."""
_FIRST_TAG: Final = re.compile(rb"<([A-Za-z_][\w:.-]*)")
_DECLARATION: Final = re.compile(r"<\?xml\s[^<>]*\?>")
IDENTIFYING: Final = ("name", "id", "class", "joint", "link")
"""Attributes by which a message distinguishes an element from others of its tag."""


ACTS: Final = re.compile(
    "mimic|gearbox|spring|damp|buoyan|hydrodyn|lift|drag|wind|thrust|propel|multicopter|motor_?model|magnet|adhes|suction|vacuum"
    "|attach|detach|link_?fix|gravity|friction|conveyor|track|surface|apply|force(?!_?torque)|destroy",
    re.IGNORECASE,
)
"""Names of plugins that act on bodies, or join them."""
WATCHES: Final = re.compile(
    "control|drive|trajectory|sensor|imu|force_?torque|camera|laser|lidar|gps|bumper|contact|odom|p3d|joint_?state|pose|publish|broadcast"
    "|interface|monitor|battery|rgbd|_ros_|yarp|scene|user-commands|physics-system",
    re.IGNORECASE,
)
"""Names of plugins that control, measure or report."""


def plugin_loss(element: Element) -> tuple[LossSeverity, str]:
    """The effect of the loss of a plugin, by its names: a program of another simulator, of which nothing else is known."""
    said = " ".join(element.attributes.get(name, "") for name in ("name", "filename"))
    if ACTS.search(said):
        return PHYSICS, "a plugin of another simulator that acts on bodies, by its name"
    if WATCHES.search(said):
        return INFORMATION, "a plugin of another simulator that controls or measures, by its name"
    return PHYSICS, "a plugin is a program of another simulator, which may do anything"


@dataclass(frozen=True, slots=True)
class _Set:
    """The fate of an element or attribute that an importer does not carry, or carries without effect."""

    fate: Fate
    severity: LossSeverity
    reason: str
    hint: str


class Element:
    """An element of a file. ``attributes`` are plain texts: reading them there does not count as taking them."""

    __slots__ = ("_children", "_fate", "_fates", "_taken", "attributes", "location", "parent", "tag", "text")

    def __init__(self, tag: str, attributes: Mapping[str, str], location: Location, text: str, parent: Element | None):
        self.tag, self.attributes, self.location, self.text, self.parent = tag, dict(attributes), location, text, parent
        self._children: list[Element] = []
        self._taken: set[str] = set()
        self._fates: dict[str, _Set] = {}
        self._fate: _Set | bool = False

    @property
    def label(self) -> str:
        """The element as messages call it: ``joint[elbow]``."""
        for name in IDENTIFYING:
            if name in self.attributes:
                return f"{self.tag}[{self.attributes[name][:60]}]"
        return self.tag

    @property
    def path(self) -> str:
        """The labels from below the outermost element to this one."""
        around: list[Element] = []
        element: Element | None = self
        while element is not None and (element.parent is not None or not around):
            around.append(element)
            element = element.parent
        first, last = MOST_LABELS
        if len(around) <= first + last:
            return "/".join(element.label for element in reversed(around))
        outside, inside = around[: -first - 1 : -1], around[last - 1 :: -1]
        return "/".join((*(element.label for element in outside), "...", *(element.label for element in inside)))

    def grow(self, tag: str, text: str) -> Element:
        """A new child at this element's place: the modern form of a word that an older version of the language has here."""
        child = Element(tag, {}, self.location, text.strip(), self)
        self._children.append(child)
        return child

    def take(self) -> Element:
        """This element itself is carried (its attributes and children are not thereby)."""
        self._fate = True
        return self

    def has(self, name: str) -> bool:
        """Whether the file says this attribute; does not take it."""
        return name in self.attributes

    def word(self, name: str, default: str | None = None) -> str | None:
        """The text of an attribute, without space around it, taken."""
        if name not in self.attributes:
            return default
        self._taken.add(name)
        return self.attributes[name].strip(numerals.SPACE)

    def need(self, name: str) -> str:
        """The text of an attribute, taken. Raises SpecError where there is none."""
        value = self.word(name)
        if value is None:
            raise self.error(f"<{self.tag}> has no attribute {name!r}", code="I101")
        return value

    def numbers(self, name: str, count: int | None) -> tuple[float, ...] | None:
        """Finite numbers of an attribute, taken; as many as ``count`` (None: any). None where there is no such attribute.
        Raises SpecError for others."""
        text = self.word(name)
        return None if text is None else self._read(name, text, count)

    def number(self, name: str, default: float | None = None) -> float | None:
        """One finite number of an attribute, taken. Raises SpecError for what is none."""
        values = self.numbers(name, 1)
        return default if values is None else values[0]

    def vector(self, name: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[float, float, float]:
        """Three finite numbers of an attribute, taken. Raises SpecError for others."""
        values = self.numbers(name, 3)
        return default if values is None else (values[0], values[1], values[2])

    def content(self, count: int | None) -> tuple[float, ...]:
        """The numbers of the element's text; the element is taken. Raises SpecError for others."""
        self.take()
        return self._read("the text", self.text, count)

    def _read(self, name: str, text: str, count: int | None) -> tuple[float, ...]:
        try:
            return numerals.numbers(text, count)
        except numerals.NumeralError as error:
            what = {None: "finite numbers", 1: "a finite number"}.get(count, f"{count} finite numbers")
            raise self.error(
                f"{name} of <{self.tag}> should be {what}{error.suffix}", found=text[:80], code="I101"
            ) from None

    def child(self, tag: str) -> Element | None:
        """The first child of this tag, taken; None where there is none. Further ones stay untaken, and so are lost."""
        for child in self._children:
            if child.tag == tag:
                return child.take()
        return None

    def children(self, *tags: str) -> list[Element]:
        """All children of these tags (all, where none is named), in the order of the file, taken."""
        found = [child for child in self._children if not tags or child.tag in tags]
        for child in found:
            child.take()
        return found

    def look(self, *tags: str) -> list[Element]:
        """The same, not taken."""
        return [child for child in self._children if not tags or child.tag in tags]

    def within(self) -> Iterator[Element]:
        """This element and all that is in it, not taken."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += element._children

    def same_as(self, other: Element) -> bool:
        """Whether another element says the same: tag, attributes, text and all that is in it."""
        waiting = [(self, other)]
        while waiting:
            first, second = waiting.pop()
            values = [(part.tag, part.attributes, part.text, len(part._children)) for part in (first, second)]
            if values[0] != values[1]:
                return False
            waiting += zip(first._children, second._children, strict=True)
        return True

    @property
    def is_settled(self) -> bool:
        """Whether the element is taken or set aside."""
        return self._fate is not False

    def leave(self, reason: str, severity: LossSeverity) -> None:
        """Say of what was neither taken nor set aside, of this element or in it, that it is lost."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            if element._fate is False:
                element.lose(None, reason, severity)
            elif element._fate is True:
                for name in element.attributes:
                    if name not in element._taken and name not in element._fates:
                        element.lose(name, reason, severity)
                waiting += element._children

    def set_aside(
        self, name: str | None, fate: Fate, reason: str, severity: LossSeverity = PHYSICS, hint: str = ""
    ) -> None:
        """Say what becomes of an attribute, or (None) of this element with all that is in it and was not taken."""
        said = _Set(fate, severity, reason, hint)
        if name is None:
            self._fate = said
        elif name in self.attributes:
            self._fates[name] = said

    def lose(self, name: str | None, reason: str, severity: LossSeverity = PHYSICS, hint: str = "") -> None:
        """Say that the spec does not have an attribute, or (None) this element with all that is in it and was not taken."""
        self.set_aside(name, LOST, reason, severity, hint)

    def ignore(self, name: str | None, reason: str, severity: LossSeverity = INFORMATION) -> None:
        """Say that an attribute, or (None) this element, has no effect in the spec."""
        self.set_aside(name, UNUSED, reason, severity)

    def set_aside_whole(self, fate: Fate, reason: str, severity: LossSeverity) -> None:
        """Say what becomes of this element and of each of its attributes."""
        for name in (None, *self.attributes):
            self.set_aside(name, fate, reason, severity)

    def lose_children(self, tags: str, reason: str, severity: LossSeverity = PHYSICS, hint: str = "") -> None:
        """Say that no child of these tags (a text of words) is in the spec."""
        for child in self.look(*tags.split()):
            child.lose(None, reason, severity, hint)

    def lose_child(self, tag: str, reason: str, severity: LossSeverity = PHYSICS) -> None:
        """Say that the first child of a tag, if any, is not in the spec."""
        for child in self.look(tag)[:1]:
            child.lose(None, reason, severity)

    def ignore_child(self, tag: str, reason: str, severity: LossSeverity = INFORMATION) -> None:
        """Say that the first child of a tag, if any, has no effect in the spec."""
        for child in self.look(tag)[:1]:
            child.ignore(None, reason, severity)

    def forget(self) -> None:
        """Take back what was read of this element and of all that is in it: it is lost as a whole."""
        for element in self.within():
            element._fate = False
            element._taken.clear()
            element._fates.clear()

    def error(
        self, message: str, found: str | None = None, allowed: str | None = None, hint: str | None = None, *, code: str
    ) -> SpecError:
        """The error of this element."""
        return SpecError([self.problem(message, found, allowed, hint, code=code)])

    def problem(
        self, message: str, found: str | None = None, allowed: str | None = None, hint: str | None = None, *, code: str
    ) -> Problem:
        """The same as a problem."""
        return Problem(message, self.path, self.location, found, allowed, hint, code=code)

    def accounts(self) -> Iterator[Account]:
        """The fates of this element, its attributes and all that is in it, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield from element._accounts()
            fate = element._fate
            if fate is not False:  # the children go with it
                # children that were not read are reported with an element that is set aside
                waiting.extend(
                    child for child in reversed(element._children) if child._fate is not False or fate is True
                )

    def _accounts(self) -> Iterator[Account]:
        fate, path = self._fate, self.path
        if fate is True:
            yield Account(self.location, path, CARRIED)
        elif fate is False:
            yield Account(self.location, path, LOST, PHYSICS, NOT_READ)
            return
        else:
            yield _account(self.location, path, fate)
        for name in self.attributes:
            what = f"{path}/@{name}"
            if name in self._fates:
                yield _account(self.location, what, self._fates[name])
            elif name in self._taken:
                yield Account(self.location, what, CARRIED)
            elif fate is True:
                yield Account(self.location, what, LOST, PHYSICS, NOT_READ)


def _account(location: Location, what: str, said: _Set) -> Account:
    return Account(location, what, said.fate, said.severity, said.reason, said.hint)


def without_comments(content: bytes) -> bytes:
    """A text with no comments in it, its lines where they were; a search that goes on where it was, so that no text takes more
    than its length."""
    parts, position = [], 0
    while (start := content.find(b"<!--", position)) >= 0 and (end := content.find(b"-->", start + 4)) >= 0:
        parts += [content[position:start], b"\n" * content.count(b"\n", start, end)]
        position = end + 3
    return b"".join([*parts, content[position:]])


def outermost(content: bytes) -> bytes:
    """The tag of the outermost element of a text that may be XML; b"" where there is none."""
    found = _FIRST_TAG.search(without_comments(content))
    return found.group(1) if found is not None else b""


def parse(content: bytes, file: str) -> Element:
    """The outermost element of an XML file, taken. Raises SpecError with the place for what is damaged, too large or hostile:
    no document type, no entities, UTF-8 only. Deviations that readers of robots accept are mended: XML declarations anywhere
    and of any version, ``--`` in comments, no space between attributes, prefixes without declaration."""
    tags, attributes = content.count(b"<"), content.count(b"=")
    if len(content) > LARGEST_FILE or tags > MOST_TAGS or attributes > MOST_ATTRIBUTES:
        found = f"{len(content):,} bytes, {tags:,} tags, {attributes:,} attributes"
        allowed = f"{LARGEST_FILE:,} bytes, {MOST_TAGS:,} tags, {MOST_ATTRIBUTES:,} attributes"
        place = Location(file, 1, 1)
        raise SpecError(
            [Problem("the file is too large", location=place, found=found, allowed=allowed, hint=SPLIT, code="I105")]
        )
    text = _text(content, file)
    mended = (text, _TAG.sub(lambda tag: _TOUCHING.sub(r"\1 ", tag.group()), without_comments(text.encode()).decode()))
    for attempt in mended:
        try:
            return _elements(parse_xml(attempt.encode(), file, "utf-8", numerals.SPACE), file)
        except XmlError as error:
            problem = Problem(f"not XML: {error.why}", location=Location(file, error.line, error.column), code="I103")
    raise SpecError([problem])


def _text(content: bytes, file: str) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        column = error.start - content.rfind(b"\n", 0, error.start)
        problem = Problem(
            "not UTF-8", location=Location(file, line, column), hint="save the file as UTF-8", code="I103"
        )
        raise SpecError([problem]) from None
    for word in ("<!DOCTYPE", "<!ENTITY"):
        if word in text:
            line = text.count("\n", 0, text.index(word)) + 1
            hint = "remove it; simspec reads no document types and no entities"
            raise SpecError([Problem(f"{word} is not read", location=Location(file, line, 1), hint=hint, code="I103")])
    # without the XML declaration, whose encoding is not believed; lines stay where they are
    start = _ROOT.search(text)
    before = text[: start.start()] if start is not None else ""
    return _DECLARATION.sub(lambda found: "\n" * found.group().count("\n"), before, count=1) + text[len(before) :]


def _elements(root: XmlElement, file: str) -> Element:
    """An XML file as elements that remember what is taken, without recursion; declarations of namespaces are left out."""
    top: Element | None = None
    waiting: list[tuple[XmlElement, Element | None, int]] = [(root, None, 1)]
    while waiting:
        read, parent, depth = waiting.pop()
        attributes = {name: value for name, value in read.attributes.items() if not name.startswith("xmlns")}
        element = Element(read.tag, attributes, Location(file, read.line, 1), read.text, parent)
        if depth > DEEPEST:
            raise (parent or element).error(f"more than {DEEPEST} elements within each other", code="I105")
        if parent is not None:
            parent._children.append(element)
        top = top or element
        waiting.extend((child, element, depth + 1) for child in reversed(read.children))
    assert top is not None
    return top.take()


def names(wanted: Sequence[str], reserved: Sequence[str] = ()) -> list[str]:
    """For each of ``wanted`` a name that the language allows, none twice: those that are allowed keep theirs, the others are
    cleaned, or get a number."""
    taken, numbers_of = set(reserved), dict[str, int]()
    given: list[str | None] = []
    for name in wanted:
        keeps = NAME.fullmatch(name) is not None and len(name) <= LONGEST_NAME and name not in taken
        given.append(name if keeps else None)
        if keeps:
            taken.add(name)
    for index, name in enumerate(wanted):
        if given[index] is not None:
            continue
        clean = (name if NAME.fullmatch(name) else clean_name(name))[:LONGEST_NAME]
        free = clean
        while free in taken:
            numbers_of[clean] = numbers_of.get(clean, 1) + 1
            free = f"{clean[: LONGEST_NAME - 8]}_{numbers_of[clean]}"
        taken.add(free)
        given[index] = free
    return [name for name in given if name is not None]


class UniqueNames:
    """Names of a spec, each given once."""

    def __init__(self, taken: Iterable[str] = ()):
        self.taken = set(taken)
        self._numbers: dict[str, int] = {}
        """The last number of each name that is wanted more than once."""

    def unique(self, wanted: str) -> str:
        """``wanted``, or it with the first number that is free."""
        name, number = wanted, self._numbers.get(wanted, 1)
        while name in self.taken:
            number += 1
            name = f"{wanted}_{number}"
        self._numbers[wanted] = number
        self.taken.add(name)
        return name


def renamed(element: Element, name: str, given: str) -> None:
    """Say of the attribute ``name`` of ``element`` that the spec calls it ``given``, where that is another name."""
    if element.attributes.get(name, "").strip() != given:
        element.set_aside(name, CARRIED, f"called {given} in the spec", INFORMATION)


Node = TypeVar("Node")


def outwards(tops: Iterable[Node], below: Callable[[Node], Sequence[Node]]) -> list[Node]:
    """The nodes of trees, each before all that is below it, and these before the next."""
    order, waiting = list[Node](), [*tops][::-1]
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(below(order[-1])))
    return order
