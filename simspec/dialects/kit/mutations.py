"""Every change that a compiled file can suffer, one at a time: the tools, for any XML or JSON file.

What is changed is found in the file itself, so that nothing is left out: every number (scaled, moved from zero, its sign,
swapped with its neighbour, dropped from its list), every word and flag (replaced by every other), every attribute and element
(removed, doubled), and the same for every field of the sidecar. What could stand in a file and does not is told by its
format, in a module beside its own called ``<format>_mutations`` with a :class:`MutationTable` named ``TABLE``:

words      by site the other words that may stand there (others get every word of the same site, and an unknown one)
integers   sites whose numbers are whole: they are changed by one, not by a hundredth
moved      by site what a zero becomes, where 0.01 would not act
additions  by file (a pattern) :class:`Addition` rows: attributes, elements or fields that the engine knows and the emitter does
           not write, with a value that acts. ``where`` is the tag (XML) or site (JSON) of what gets it; each such element gets
           it, one at a time. ``{joint[0]}`` in a value is the name of the first joint of the file; rows whose names a file
           does not have are left out of it
inert      :class:`Inert` rows: sites (patterns) and kinds of changes that move nothing, with the reason. A row is only
           believed for a change after which the engine moves as before (see ``proof/complete.py``)

A *site* is the place of a value without names and numbers: ``joint@damping``, ``mass/text()``, ``geom`` (the element itself),
and in JSON ``settings.solver``, ``bodies.*.frame_offset.*``.
"""

from __future__ import annotations

import copy
import fnmatch
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

Files = Mapping[str, str]

KINDS = (
    "scaled",
    "moved",
    "sign",
    "swapped",
    "number dropped",
    "word",
    "flag",
    "attribute removed",
    "element removed",
    "element doubled",
    "attribute added",
    "element added",
    "field removed",
    "field added",
)
"""The classes of changes, in the order of tables."""
SCALE = 1.01
MOVED = 0.01
"""What a zero becomes: far above every tolerance, small enough to be a sound value almost everywhere."""
STILL = 1e-12
"""Metres, radians and their rates, relative to the larger of one and the value: motions within it are the same."""
UNKNOWN = "something-else"
FLAGS = {"true": "false", "false": "true", "enable": "disable", "disable": "enable"}


@dataclass(frozen=True, slots=True)
class Mutation:
    """One change: ``text`` is the whole of ``file`` with it. ``site`` and ``kind`` are what declarations match, ``place`` and
    ``change`` what people read."""

    file: str
    kind: str
    site: str
    place: str
    change: str
    text: str

    @property
    def name(self) -> str:
        """Unique within the files of a world."""
        return f"{self.file}: {self.place}: {self.kind}: {self.change}"


@dataclass(frozen=True, slots=True)
class Addition:
    """Something that the emitter does not write: an attribute (XML, ``name`` given), an element (XML, ``value`` its text), or a
    field (JSON, ``name`` and ``value``, which is JSON). ``once``: only in the first such place of a file."""

    where: str
    value: str
    name: str = ""
    once: bool = False


@dataclass(frozen=True, slots=True)
class Inert:
    """Changes that move nothing: ``site`` a pattern as of ``fnmatch``, ``kinds`` of change (empty: all), and the reason.

    ``place``: a pattern of the mutation's place, with round brackets: ``*/default(visual)/*``. ``without``: only where an XML
    file has nothing at this path (as of ElementTree: ``.//worldbody//geom``). ``within``: how far motion may depart; more than
    ``STILL`` only where the reason says that the same is computed in another order.
    """

    site: str
    why: str
    kinds: tuple[str, ...] = ()
    file: str = "*"
    place: str = "*"
    without: str = ""
    within: float = STILL

    def says(self, mutation: Mutation) -> bool:
        """Whether this row declares ``mutation``."""
        return (
            fnmatch.fnmatchcase(mutation.site, self.site)
            and fnmatch.fnmatchcase(mutation.file, self.file)
            and fnmatch.fnmatchcase(_plain(mutation.place), self.place)
            and (not self.kinds or mutation.kind in self.kinds)
            and (not self.without or ElementTree.fromstring(mutation.text).find(self.without) is None)
        )


def _plain(place: str) -> str:
    """A place without the brackets that patterns would take for sets of letters: ``default(visual)/geom``."""
    return place.translate(str.maketrans("[]", "()"))


@dataclass(frozen=True, slots=True)
class MutationTable:
    """What a format knows of its files beyond what stands in them; see the head of this module."""

    words: Mapping[str, Sequence[str]] = field(default_factory=dict)
    integers: frozenset[str] = frozenset()
    moved: Mapping[str, str] = field(default_factory=dict)
    additions: Mapping[str, Sequence[Addition]] = field(default_factory=dict)
    inert: Sequence[Inert] = ()

    def inertness(self, mutation: Mutation) -> Inert | None:
        """The row that declares ``mutation`` inert; None when none does."""
        return next((row for row in self.inert if row.says(mutation)), None)


def mutations(files: Files, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of ``files``, each once; those that change no byte are left out. Raises ValueError for a file that is
    neither XML nor JSON."""
    for name, text in sorted(files.items()):
        if name.endswith(".json"):
            unchanged, found = _printed(json.loads(text)), _json(name, text, table)
        elif text.lstrip().startswith("<"):
            unchanged, found = _Tree(text).text(), _xml(name, text, table)
        else:
            raise ValueError(f"{name} is neither XML nor JSON")
        seen = {unchanged}
        for mutation in found:
            if mutation.text not in seen:
                seen.add(mutation.text)
                yield mutation


# --- numbers and words --------------------------------------------------------------------------------------------


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _changed(value: float, site: str, table: MutationTable) -> Iterator[tuple[str, str]]:
    """The kinds of change of one number, with the new text."""
    if site in table.integers:
        yield ("moved" if value == 0 else "scaled"), str(int(value) + 1)
        if value:
            yield "sign", str(-int(value))
    elif value == 0.0:
        yield "moved", table.moved.get(site, str(MOVED))
    elif math.isfinite(value):
        yield "scaled", repr(value * SCALE)
        yield "sign", repr(-value)


def _values(text: str, site: str, others: Sequence[str], table: MutationTable) -> Iterator[tuple[str, str, str]]:
    """Every change of one attribute's or element's text: (kind, what, new text). ``others``: other texts of the same site."""
    tokens = text.split()
    values = [_number(token) for token in tokens]
    numeric = [index for index, value in enumerate(values) if value is not None]
    if len(numeric) == len(tokens) and tokens:
        for index, value in enumerate(values):
            for kind, new in _changed(float(value or 0.0), site, table):
                yield kind, f"[{index}] {tokens[index]} to {new}", _with(tokens, index, new)
        for index in range(len(tokens) - 1):
            swapped = [*tokens[:index], tokens[index + 1], tokens[index], *tokens[index + 2 :]]
            yield "swapped", f"[{index}] with [{index + 1}]", " ".join(swapped)
        if len(tokens) > 1:
            yield "number dropped", f"[{len(tokens) - 1}]", " ".join(tokens[:-1])
        return
    if text in FLAGS:
        yield "flag", f"{text} to {FLAGS[text]}", FLAGS[text]
    words = table.words.get(site)
    if words is None:
        words = (*sorted(set(others) - {text}), UNKNOWN) if text not in FLAGS else ()
    for word in words:
        if word != text:
            yield "word", f"{text} to {word}", word


def _with(tokens: Sequence[str], index: int, new: str) -> str:
    return " ".join([*tokens[:index], new, *tokens[index + 1 :]])


# --- XML ----------------------------------------------------------------------------------------------------------


def _label(element: Element) -> str:
    name = element.get("name") or element.get("class")
    return f"{element.tag}[{name}]" if name else element.tag


class _Tree:
    """A parsed file that is changed in place, printed, and put back."""

    def __init__(self, text: str):
        self.root = ElementTree.fromstring(text)
        self.parent: dict[Element, Element] = {child: above for above in self.root.iter() for child in above}
        self.elements = list(self.root.iter())
        self.names: dict[str, list[str]] = {}
        for element in self.elements:
            if name := element.get("name"):
                self.names.setdefault(element.tag, []).append(name)

    def text(self) -> str:
        return ElementTree.tostring(self.root, encoding="unicode")

    def place(self, element: Element) -> str:
        above = self.parent.get(element)
        if above is None:
            return _label(element)
        same = [child for child in above if child.tag == element.tag]
        named = element.get("name") or element.get("class")
        own = _label(element) if named or len(same) == 1 else f"{element.tag}[{same.index(element)}]"
        return f"{self.place(above)}/{own}"


def _xml(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    tree = _Tree(text)
    others: dict[str, list[str]] = {}
    for element in tree.elements:
        for name, value in element.attrib.items():
            others.setdefault(f"{element.tag}@{name}", []).append(value)
        if element.text and element.text.strip():
            others.setdefault(f"{element.tag}/text()", []).append(element.text.strip())

    def made(kind: str, site: str, place: str, change: str) -> Mutation:
        return Mutation(file, kind, site, place, change, tree.text())

    for element in tree.elements:
        here = tree.place(element)
        for name, value in list(element.attrib.items()):
            site = f"{element.tag}@{name}"
            for kind, what, new in _values(value, site, others[site], table):
                element.set(name, new)
                yield made(kind, site, f"{here}@{name}", what)
                element.set(name, value)
            before = dict(element.attrib)
            del element.attrib[name]
            yield made("attribute removed", site, f"{here}@{name}", value)
            element.attrib.clear()
            element.attrib.update(before)
        if element.text and element.text.strip():
            site, value = f"{element.tag}/text()", element.text
            for kind, what, new in _values(value.strip(), site, others[site], table):
                element.text = new
                yield made(kind, site, here, what)
            element.text = value
        yield from _elements(tree, element, here, made)
    yield from _siblings(tree, made)
    yield from _xml_additions(tree, _additions(file, table), made)


Made = Callable[[str, str, str, str], Mutation]


def _elements(tree: _Tree, element: Element, here: str, made: Made) -> Iterator[Mutation]:
    """The element removed, and doubled."""
    above = tree.parent.get(element)
    if above is None:
        return
    index = list(above).index(element)
    above.remove(element)
    yield made("element removed", element.tag, here, "")
    above.insert(index, element)
    above.insert(index, copy.deepcopy(element))
    yield made("element doubled", element.tag, here, "")
    del above[index]


def _siblings(tree: _Tree, made: Made) -> Iterator[Mutation]:
    """The same attribute, or text, of two neighbours of one tag swapped; names too."""
    for above in tree.elements:
        last: dict[str, Element] = {}
        for element in above:
            other = last.get(element.tag)
            last[element.tag] = element
            if other is None:
                continue
            here = f"{tree.place(other)} with {tree.place(element)}"
            for name in element.attrib.keys() & other.attrib.keys():
                one, two = other.attrib[name], element.attrib[name]
                other.set(name, two)
                element.set(name, one)
                yield made("swapped", f"{element.tag}@{name}", f"{here}@{name}", f"{one} with {two}")
                other.set(name, one)
                element.set(name, two)
            if (element.text or "").strip() and (other.text or "").strip():
                other.text, element.text = element.text, other.text
                yield made("swapped", f"{element.tag}/text()", here, "")
                other.text, element.text = element.text, other.text


def _xml_additions(tree: _Tree, additions: Sequence[Addition], made: Made) -> Iterator[Mutation]:
    for row in additions:
        try:
            value = row.value.format_map(tree.names)
        except (KeyError, IndexError):
            continue  # this file has nothing of that name
        for element in tree.elements:
            if element.tag != row.where or (row.name and row.name in element.attrib):
                continue
            here = tree.place(element)
            if row.name:
                element.set(row.name, value)
                yield made("attribute added", f"{element.tag}@{row.name}", f"{here}@{row.name}", value)
                del element.attrib[row.name]
            else:
                fresh = list(ElementTree.fromstring(f"<addition>{value}</addition>"))
                element.extend(fresh)
                yield made("element added", f"{element.tag}/{fresh[0].tag}", here, value)
                for one in fresh:
                    element.remove(one)
            if row.once:
                break


# --- JSON ---------------------------------------------------------------------------------------------------------


def _json(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    root = json.loads(text)
    words: dict[str, list[str]] = {}
    for _, _, value, site, _ in _fields(root):
        if isinstance(value, str):
            words.setdefault(site, []).append(value)

    def made(kind: str, site: str, place: str, change: str) -> Mutation:
        return Mutation(file, kind, site, place, change, _printed(root))

    for holder, key, value, site, place in list(_fields(root)):
        for kind, new in _json_values(value, site, words, table):
            holder[key] = new
            yield made(kind, site, place, f"{value!r} to {new!r}")
        holder[key] = value
        if isinstance(holder, list):
            holder.insert(key, copy.deepcopy(value))
            yield made("element doubled", site, place, "")
            del holder[key]
            if key + 1 < len(holder):
                holder[key], holder[key + 1] = holder[key + 1], holder[key]
                yield made("swapped", site, place, "with the next")
                holder[key], holder[key + 1] = holder[key + 1], holder[key]
            del holder[key]
            yield made("element removed", site, place, "")
            holder.insert(key, value)
        else:
            before = dict(holder)
            del holder[key]
            yield made("field removed", site, place, "")
            holder.clear()
            holder.update(before)
    sites = [(root, "")] + [
        (value, site) for _, _, value, site, _ in list(_fields(root)) if isinstance(value, (dict, list))
    ]
    for row in _additions(file, table):
        for value, site in sites:
            if site != row.where or (isinstance(value, dict) and row.name in value):
                continue
            fresh = json.loads(row.value)
            if isinstance(value, dict):
                value[row.name] = fresh
                yield made("field added", f"{site}.{row.name}".lstrip("."), f"{site}.{row.name}", row.value)
                del value[row.name]
            else:
                value.append(fresh)
                yield made("field added", site, site, row.value)
                value.pop()
            if row.once:
                break


def _additions(file: str, table: MutationTable) -> list[Addition]:
    return [row for pattern, rows in table.additions.items() if fnmatch.fnmatchcase(file, pattern) for row in rows]


def _printed(value: Any) -> str:
    return json.dumps(value, indent=2) + "\n"


def _fields(value: Any, site: str = "", place: str = "") -> Iterator[tuple[Any, Any, Any, str, str]]:
    """Every field of a JSON value: (its holder, its key, itself, site, place)."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        # what is keyed by names of the world is one site
        step = "*" if isinstance(value, list) else str(key)
        own, there = f"{site}.{step}".lstrip("."), f"{place}.{key}".lstrip(".")
        yield value, key, item, own, there
        yield from _fields(item, own, there)


def _json_values(
    value: Any, site: str, words: Mapping[str, Sequence[str]], table: MutationTable
) -> Iterator[tuple[str, Any]]:
    if isinstance(value, bool):
        yield "flag", not value
    elif isinstance(value, int):
        yield ("scaled" if value else "moved"), value + 1
        if value:
            yield "sign", -value
    elif isinstance(value, float):
        for kind, new in _changed(value, site, table):
            yield kind, float(new)
    elif isinstance(value, str):
        given = table.words.get(site)
        for word in given if given is not None else (*sorted(set(words[site]) - {value}), UNKNOWN):
            if word != value:
                yield "word", word
    elif value is None:
        yield "moved", MOVED
