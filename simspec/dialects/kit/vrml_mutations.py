"""Every change that a file of nodes and fields in the manner of VRML97 can suffer, one at a time; see ``mutations.py``.

Sites are ``Node/field``; the place of a value is its path of nodes, each by its name after DEF or its number.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from simspec.dialects.kit.mutations import Mutation, MutationTable, changed

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
class _Found:
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


def _scan(text: str) -> _Found:
    """The values and nodes of a text that was written by a program: one that is damaged is not scanned."""
    found = _Found()
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
