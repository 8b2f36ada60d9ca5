"""Every change that an XML file can suffer, one at a time; see ``mutations.py``."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from simspec.dialects.kit.mutations import Addition, Mutation, MutationTable, text_values


def _label(element: Element) -> str:
    name = element.get("name") or element.get("class")
    return f"{element.tag}[{name}]" if name else element.tag


class Tree:
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


def xml_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    tree = Tree(text)
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


def _elements(tree: Tree, element: Element, here: str, made: Made) -> Iterator[Mutation]:
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


def _siblings(tree: Tree, made: Made) -> Iterator[Mutation]:
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


def _xml_additions(tree: Tree, additions: Sequence[Addition], made: Made) -> Iterator[Mutation]:
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
