"""Every change that a JSON file can suffer, one at a time; see ``mutations.py``."""

from __future__ import annotations

import copy
import itertools
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from simspec.dialects.kit.mutations import (
    MOVED,
    FileAddition,
    Inert,
    Mutation,
    MutationTable,
    changed,
    text_values,
)
from simspec.dialects.kit.mutations import (
    UNKNOWN as UNKNOWN_CHANGE,
)


def json_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    root = json.loads(text)
    words: dict[str, list[str]] = {}
    for _, _, value, site, _ in _fields(root):
        if isinstance(value, str):
            words.setdefault(site, []).append(value)

    def made(kind: str, site: str, place: str, change: str) -> Mutation:
        return Mutation(file, kind, site, place, change, printed(root))

    for holder, key, value, site, place in list(_fields(root)):
        for kind, new in _value_changes(value, site, words, table):
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
    for row in table.added(file):
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


def printed(value: Any) -> str:
    return json.dumps(value, indent=2) + "\n"


def _fields(value: Any, site: str = "", place: str = "") -> Iterator[tuple[Any, Any, Any, str, str]]:
    """Every field of a JSON value: (its holder, its key, itself, site, place)."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        # an object with names of the world as keys is one site
        step = "*" if isinstance(value, list) else str(key)
        text, there = f"{site}.{step}".lstrip("."), f"{place}.{key}".lstrip(".")
        yield value, key, item, text, there
        yield from _fields(item, text, there)


def _value_changes(
    value: Any, site: str, words: Mapping[str, Sequence[str]], table: MutationTable
) -> Iterator[tuple[str, Any]]:
    if isinstance(value, bool):
        yield "flag", not value
    elif isinstance(value, int):
        yield ("scaled" if value else "moved"), value + 1
        if value:
            yield "sign", -value
    elif isinstance(value, float):
        for kind, new in changed(value, site, table):
            yield kind, float(new)
    elif isinstance(value, str):
        given = table.words.get(site)
        for word in given if given is not None else (*sorted(set(words[site]) - {value}), UNKNOWN_CHANGE):
            if word != value:
                yield "word", word
    elif value is None:
        yield "moved", MOVED


# Every change that a mesh file can suffer, one at a time; see ``mutations.py``.
#
# A file of a hull is a list of lines: those of one kind (``v``, ``f``) are one site, since each is as good as any other.
# Numbers are changed in every vertex; of triangles, which follow from the vertices, in the first.

SPIKE = "v 0.9 0.8 0.7"
"""A vertex outside every hull of the self-test's worlds."""

INERT = (
    Inert(
        "obj/f",
        "the same triangles in another order, whose sums differ by round-off",
        ("swapped",),
        "*.obj",
        within=1e-9,
    ),
    Inert("obj/o", "a name that nothing refers to", ("word", "element removed", "element doubled"), "*.obj"),
)
"""Changes that no engine moves differently for: rows of every dialect that has mesh files."""


def obj_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of one OBJ file: numbers of lines, lines removed, doubled and swapped, and lines added."""
    lines = text.splitlines()

    def made(kind: str, site: str, place: str, change: str, changed: list[str]) -> Mutation:
        return Mutation(file, kind, site, place, change, "\n".join(changed) + "\n")

    for word in dict.fromkeys(line.split()[0] for line in lines if line and not line.startswith("#")):
        at = [index for index, line in enumerate(lines) if line.split()[0] == word]
        for order, index in enumerate(at):
            place, values = f"{word}[{order}]", lines[index].partition(" ")[2]
            if word == "v" or order == 0:
                for kind, what, new in text_values(values, f"obj/{word}", (), table):
                    yield made(kind, f"obj/{word}", place, what, [*lines[:index], f"{word} {new}", *lines[index + 1 :]])
            yield made("element removed", f"obj/{word}", place, "", [*lines[:index], *lines[index + 1 :]])
            yield made("element doubled", f"obj/{word}", place, "", [*lines[: index + 1], *lines[index:]])
        for first, other in itertools.pairwise(at):
            swapped = list(lines)
            swapped[first], swapped[other] = lines[other], lines[first]
            yield made("swapped", f"obj/{word}", word, f"lines {first + 1} and {other + 1}", swapped)
    yield made("element added", "obj/v", "v", SPIKE, [*lines, SPIKE])
    spike = sum(line.startswith("v ") for line in lines) + 1
    used = [SPIKE, f"f 1 2 {spike}", f"f 2 3 {spike}", f"f 3 1 {spike}"]
    yield made("element added", "obj/v", "v", f"{SPIKE} with triangles", [*lines, *used])
    yield made("element added", "obj/o", "o", "a second object", [*lines, "o more", "v 0.9 0.8 0.7", "v 0.9 0.8 0.8"])


# Every change that an XML file can suffer, one at a time; see ``mutations.py``.


def _label(element: Element) -> str:
    name = element.get("name") or element.get("class")
    return f"{element.tag}[{name}]" if name else element.tag


class MutableTree:
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
        label = _label(element) if named or len(same) == 1 else f"{element.tag}[{same.index(element)}]"
        return f"{self.place(above)}/{label}"


def xml_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    tree = MutableTree(text)
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
            for kind, what, new in text_values(value, site, others[site], table):
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
            for kind, what, new in text_values(value.strip(), site, others[site], table):
                element.text = new
                yield made(kind, site, here, what)
            element.text = value
        yield from _elements(tree, element, here, made)
    yield from _siblings(tree, made)
    yield from _xml_additions(tree, table.added(file), made)


Made = Callable[[str, str, str, str], Mutation]


def _elements(tree: MutableTree, element: Element, here: str, made: Made) -> Iterator[Mutation]:
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


def _siblings(tree: MutableTree, made: Made) -> Iterator[Mutation]:
    """The same attribute, or text, of two neighbours of one tag swapped; names too."""
    for above in tree.elements:
        last: dict[str, Element] = {}
        for element in above:
            other = last.get(element.tag)
            last[element.tag] = element
            if other is None:
                continue
            here = f"{tree.place(other)} with {tree.place(element)}"
            for name in [name for name in element.attrib if name in other.attrib]:
                entry, two = other.attrib[name], element.attrib[name]
                other.set(name, two)
                element.set(name, entry)
                yield made("swapped", f"{element.tag}@{name}", f"{here}@{name}", f"{entry} with {two}")
                other.set(name, entry)
                element.set(name, two)
            if (element.text or "").strip() and (other.text or "").strip():
                other.text, element.text = element.text, other.text
                yield made("swapped", f"{element.tag}/text()", here, "")
                other.text, element.text = element.text, other.text


def _xml_additions(tree: MutableTree, additions: Sequence[FileAddition], made: Made) -> Iterator[Mutation]:
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
                for entry in fresh:
                    element.remove(entry)
            if row.once:
                break


# Every change that a file of nodes and fields in the manner of VRML97 can suffer, one at a time; see ``mutations.py``.
#
# Sites are ``Node/field``; the place of a value is its path of nodes, each by its name after DEF or its number.

_TOKEN = re.compile(r'#[^\n]*|("(?:[^"\\]|\\.)*"|[\[\]{}]|[^\s,\[\]{}"#]+)')
_FLAGS = {"TRUE": "FALSE", "FALSE": "TRUE"}
UNKNOWN = '"something-else"'


@dataclass(slots=True)
class _Value:
    """A field's plain values: where each stands in the text; ``whole`` is the field with its name."""

    site: str
    place: str
    spans: list[tuple[int, int]] = field(default_factory=list)
    whole: tuple[int, int] = (0, 0)


@dataclass(slots=True)
class _VrmlValues:
    values: list[_Value] = field(default_factory=list)
    nodes: list[tuple[str, str, int, int]] = field(default_factory=list)
    """Type, place and span of every node that stands in a list or in no other."""


def vrml_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of ``text``, the content of ``file``."""
    found = _scan(text)
    words: dict[str, list[str]] = {}
    for value in found.values:
        words.setdefault(value.site, []).extend(text[a:b] for a, b in value.spans)

    def made(kind: str, value: _Value, change: str, a: int, b: int, new: str) -> Mutation:
        return Mutation(file, kind, value.site, value.place, change, text[:a] + new + text[b:])

    for value in found.values:
        for index, (a, b) in enumerate(value.spans):
            token = text[a:b]
            for kind, new in _news(token, value.site, words[value.site], table):
                yield made(kind, value, f"[{index}] {token} to {new}", a, b, new)
        for index in range(len(value.spans) - 1):
            (a, b), (c, d) = value.spans[index : index + 2]
            yield made("swapped", value, f"[{index}] with [{index + 1}]", a, d, text[c:d] + text[b:c] + text[a:b])
        if len(value.spans) > 1:
            a, b = value.spans[-1]
            yield made("number dropped", value, f"[{len(value.spans) - 1}]", a, b, "")
        yield made("field removed", value, text[slice(*value.whole)], *value.whole, "")
    for kind, place, a, b in found.nodes:
        yield Mutation(file, "element removed", kind, place, "", text[:a] + text[b:])
        yield Mutation(file, "element doubled", kind, place, "", f"{text[:b]}\n{text[a:b]}{text[b:]}")


def _news(token: str, site: str, others: Sequence[str], table: MutationTable) -> Iterator[tuple[str, str]]:
    """The changes of one value: kind, and the new text."""
    if token in _FLAGS:
        yield "flag", _FLAGS[token]
    elif token.startswith('"'):
        for word in (*sorted(set(others) - {token}), UNKNOWN):
            yield "word", word
    else:
        try:
            number = float(token)
        except ValueError:
            return
        yield from changed(number, site, table)


def _scan(text: str) -> _VrmlValues:
    """The values and nodes of a text that was written by a program: one that is damaged is not scanned."""
    found = _VrmlValues()
    tokens = [(match[1], match.start(1), match.end(1)) for match in _TOKEN.finditer(text) if match[1]]
    open_nodes: list[tuple[str, str, int, str]] = []  # type, path, beginning, the field around
    numbers: list[int] = [0]
    current: _Value | None = None
    begin, at = -1, 0
    while at < len(tokens):
        token, start, end = tokens[at]
        if token == "}":
            kind, path, first, around = open_nodes.pop()
            numbers.pop()
            if around in ("", "["):
                found.nodes.append((kind, path, first, end))
            current = None
        elif token == "DEF" or (at + 1 < len(tokens) and tokens[at + 1][0] == "{"):
            label = tokens[at + 1][0] if token == "DEF" else ""
            kind = tokens[at + 2][0] if label else token
            parent = open_nodes[-1][1] if open_nodes else ""
            path = f"{parent}/{kind}({label or numbers[-1]})".lstrip("/")
            numbers[-1] += 1
            around = "" if not open_nodes else "[" if begin >= 0 else "one"
            open_nodes.append((kind, path, start, around))
            numbers.append(0)
            at += 3 if label else 1
            current, begin = None, -1
        elif token == "[":
            begin = end
        elif token == "]":
            if current is not None:
                current.whole = (current.whole[0], end)
            current, begin = None, -1
        elif current is None or (begin < 0 and not _follows(token, current, text)):
            kind, path, *_ = open_nodes[-1]
            current = _Value(f"{kind}/{token}", f"{path}/{token}", whole=(start, end))
            found.values.append(current)
        else:
            current.spans.append((start, end))
            current.whole = (current.whole[0], end)
        at += 1
    found.values = [value for value in found.values if value.spans or text[slice(*value.whole)].endswith("]")]
    return found


def _follows(token: str, current: _Value, text: str) -> bool:
    """Whether a token is a value of the field before it: the first is, and numbers after numbers."""
    if not current.spans:
        return True
    before = text[slice(*current.spans[-1])]
    return all(re.fullmatch(r"[-+.\d][-+.\deE]*", word) for word in (token, before))
