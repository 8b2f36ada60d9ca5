"""Changes of files, malicious or accidental: bytes, numbers, words, elements, depth, names of other files.

A change takes a text (or bytes), a generator of random numbers, and other files of the same language to take pieces from.
Nothing is known here of what the files mean.
"""

from __future__ import annotations

import itertools
import random
import re
from collections.abc import Callable, Sequence

NUMBER = re.compile(rb"(?<![\w#])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
QUOTED = re.compile(rb"\"[^\"<>\n]{0,200}\"|'[^'<>\n]{0,200}'")
ELEMENT = re.compile(rb"<([A-Za-z][\w:.-]*)(?:\s[^<>]*)?(?:/>|>)")
ATTRIBUTE = re.compile(rb"\s[A-Za-z_][\w:.-]*\s*=\s*(?:\"[^\"]*\"|'[^']*')")
WORD = re.compile(rb"[A-Za-z_][\w:]{2,40}")
FILE_NAME = re.compile(
    rb"[\w./:$() -]{1,120}\.(?:stl|obj|dae|glb|gltf|xml|sdf|urdf|xacro|usda|usdc|usd|yaml|bin|png)\b"
)

NUMBERS = (
    *b"0 -0.0 -1 1e308 -1e308 1e-320 1e-308 nan -nan inf -inf 1e999 1e30 1e-30 1e200 1e150 -1e-9 1e9".split(),
    *b"2147483648 -2147483649 18446744073709551616 0x10 1_0 1,5 100000 0.5 1e . - +1 1d3 true".split(),
    *(b"", b"1 2", b"1 2 3 4 5 6 7", b"9" * 400, "١٢".encode()),
)
TEXTS = (
    *b"world base __model__ $(touch__pwned) `id` ../x a/b a::b %s%n ${1/0} {} ~ null . .. - 0 1 &#0; &#55296; * **/* |".split(),
    *(b"", b" ", b"; rm -rf ~", b"$(touch pwned)", b"\xc3\xa9", b"a" * 3000, b"\x07", b"x y", b"\\", b"&lt;"),
    *("\u202eabc".encode(), "\ud7ff\U0001f600".encode()),
)
OUTSIDE = b"@OUTSIDE@"
"""Stands for the folder that no file may be read from, in absolute paths."""
REFERENCES = (
    *b"../outside/secret package://outside/secret model://outside/secret package://../outside/secret".split(),
    *(b"model://../outside/secret",),
    *b"link linked/secret a/../../outside/secret ./part part missing robot fifo folder loop ../project/part".split(),
    *b"/dev/zero /proc/self/environ https://127.0.0.1:9/secret package:// package://outside ~/secret file:secret".split(),
    *b"%2e%2e/outside/secret \\\\host\\secret".split(),
    *(b"$(find outside)/secret", b"$(find ../outside)/secret", b"part\x00"),
    *(OUTSIDE + b"/secret", b"file://" + OUTSIDE + b"/secret", b"//" + OUTSIDE + b"/secret"),
)
DEEP = (10, 150, 250, 3000, 60_000)

Change = Callable[[bytes, random.Random, Sequence[bytes]], bytes]


def _spot(found: Sequence[re.Match[bytes]], chance: random.Random) -> re.Match[bytes] | None:
    return chance.choice(found) if found else None


def _put(text: bytes, match: re.Match[bytes] | None, new: bytes) -> bytes:
    return text if match is None else text[: match.start()] + new + text[match.end() :]


# --- bytes ----------------------------------------------------------------------------------------------------------


def cut(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """The beginning, or the end."""
    place = chance.randrange(len(text) + 1)
    return text[:place] if chance.random() < 0.8 else text[place:]


def flip(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Some bytes are others."""
    changed = bytearray(text)
    for _ in range(chance.choice((1, 1, 2, 5, 40))):
        if changed:
            changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def without(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """A piece is gone."""
    start = chance.randrange(len(text) + 1)
    return text[:start] + text[start + chance.choice((1, 3, 20, 300)) :]


def twice(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """A piece stands there again, or many times."""
    start = chance.randrange(len(text) + 1)
    piece = text[start : start + chance.choice((1, 10, 200, 2000))]
    return text[:start] + piece * chance.choice((2, 2, 3, 500)) + text[start:]


def integer(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Four or eight bytes are a number that lies about a size."""
    value = chance.choice((0, 1, 2**31 - 1, 2**32 - 1, 2**16, 10_000_000, len(text), len(text) + 1))
    place = min(chance.choice((0, 4, 8, 12, 16, 80, chance.randrange(len(text) + 1))), len(text))
    raw = value.to_bytes(chance.choice((4, 8)), "little")
    return text[:place] + raw + text[place + len(raw) :]


def real(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Four bytes are a number that is not finite, or huge."""
    raw = chance.choice(
        (b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f", b"\xff\xff\x7f\x7f", b"\x01\x00\x00\x00", b"\x00\x00\x80\xff")
    )
    place = chance.randrange(len(text) + 1) // 4 * 4
    return text[:place] + raw + text[place + 4 :]


def spliced(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """The beginning of this file and the end of another."""
    other = chance.choice(others)
    return text[: chance.randrange(len(text) + 1)] + other[chance.randrange(len(other) + 1) :]


def encoded(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Another encoding than the file says."""
    way = chance.choice(("utf-16", "utf-16-le", "utf-32", "latin-1", "utf-8-sig", "utf-7"))
    return text.decode("utf-8", "replace").encode(way, "replace")


# --- texts ----------------------------------------------------------------------------------------------------------


def number(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Numbers are others."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        text = _put(text, _spot(list(NUMBER.finditer(text)), chance), chance.choice(NUMBERS))
    return text


def quoted(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Replace a text in quotation marks by another of the file, or by an unusual text."""
    found = list(QUOTED.finditer(text))
    new = chance.choice(TEXTS) if chance.random() < 0.6 or not found else chance.choice(found).group()[1:-1]
    return _put(text, _spot(found, chance), b'"' + new + b'"')


def word(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """A word is another of this file, or of another file."""
    pool = WORD.findall(text if chance.random() < 0.5 else chance.choice(others))
    return _put(text, _spot(list(WORD.finditer(text)), chance), chance.choice(pool or [b"x"]))


def everywhere(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """A word is another in the whole file."""
    pool = WORD.findall(text)
    if not pool:
        return text
    return text.replace(chance.choice(pool), chance.choice(pool), chance.choice((1, 2, -1)))


def attribute_gone(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """An attribute is not there."""
    return _put(text, _spot(list(ATTRIBUTE.finditer(text)), chance), b"")


def attribute_more(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """An element has an attribute of another element."""
    pool = ATTRIBUTE.findall(chance.choice([text, *others]))
    found = _spot(list(ELEMENT.finditer(text)), chance)
    if found is None or not pool:
        return text
    place = found.end(1)
    return text[:place] + chance.choice(pool) + text[place:]


def _element(text: bytes, chance: random.Random) -> tuple[int, int] | None:
    """Where an element begins and ends, by the next end of its tag."""
    found = _spot(list(ELEMENT.finditer(text)), chance)
    if found is None:
        return None
    if found.group().endswith(b"/>"):
        return found.span()
    end = text.find(b"</" + found.group(1) + b">", found.end())
    return (found.start(), len(text) if end < 0 else end + len(found.group(1)) + 3)


def element_gone(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """An element is not there."""
    span = _element(text, chance)
    return text if span is None else text[: span[0]] + text[span[1] :]


def element_more(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """An element of this file, or of another, stands somewhere else too."""
    source = text if chance.random() < 0.5 else chance.choice(others)
    span, place = _element(source, chance), _element(text, chance)
    if span is None or place is None:
        return text
    piece = source[span[0] : span[1]]
    return text[: place[0]] + piece * chance.choice((1, 1, 1, 2, 50)) + text[place[0] :]


def line_moved(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Lines are gone, doubled or elsewhere: the structure of languages of lines."""
    lines = text.split(b"\n")
    start = chance.randrange(len(lines))
    piece = lines[start : start + chance.choice((1, 1, 2, 8))]
    if chance.random() < 0.5:
        del lines[start : start + len(piece)]
    place = chance.randrange(len(lines) + 1)
    lines[place:place] = piece if chance.random() < 0.8 else [b"  " + line for line in piece]
    return b"\n".join(lines)


def deep(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """Something is within itself, many times."""
    span = _element(text, chance)
    count = chance.choice(DEEP)
    if span is None:
        opening, closing = chance.choice(((b"[", b"]"), (b"{a: ", b"}"), (b"(", b")"), (b'def "a" {', b"}")))
        place = chance.randrange(len(text) + 1)
        return text[:place] + opening * count + closing * chance.choice((count, 0)) + text[place:]
    tag = ELEMENT.match(text, span[0])
    if tag is None:
        return text
    start = tag.group().replace(b"/>", b">")
    return text[: span[0]] + start * count + (b"</" + tag.group(1) + b">") * count + text[span[0] :]


def reference(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """The name of a file is that of another, inside or outside of what may be read."""
    found = _spot(list(FILE_NAME.finditer(text)), chance)
    end = b"." + (found.group().rpartition(b".")[2] if found is not None else b"stl")
    name = chance.choice(REFERENCES) + (
        end if chance.random() < 0.9 else chance.choice((b".stl", b".obj", b".xml", b""))
    )
    if found is not None:
        return _put(text, found, name)
    return _put(text, _spot(list(QUOTED.finditer(text)), chance), b'"' + name + b'"')


def entity(text: bytes, chance: random.Random, others: Sequence[bytes]) -> bytes:
    """A document type, with entities of files or of each other."""
    secret = b'SYSTEM "file://' + OUTSIDE + b'/secret.xml">'
    names = [b"%c" % letter for letter in b"xabcdefghijklm"]
    pairs = itertools.pairwise(names)
    bomb = b'<!ENTITY x "xxxxxxxxxx">' + b"".join(b'<!ENTITY %s "%s">' % (b, b"&%s;" % a * 10) for a, b in pairs)
    inside = chance.choice((b"<!ENTITY x " + secret, bomb, b"<!ENTITY % x " + secret + b"%x;"))
    start = text.find(b"<", text.find(b"?>") + 1 if b"?>" in text[:200] else 0)
    start = max(start, 0)
    text = text[:start] + b"<!DOCTYPE a [" + inside + b"]>" + text[start:]
    return _put(text, _spot(list(QUOTED.finditer(text)), chance), chance.choice((b'"&x;"', b'"&m;"')))


BYTES: Sequence[Change] = (cut, flip, without, twice, integer, real, spliced)
OFTEN: Sequence[Change] = (number, word, quoted, element_more, line_moved, reference)
TEXT: Sequence[Change] = (
    *(*OFTEN, *OFTEN, number, everywhere, attribute_gone, attribute_more, element_gone, deep, entity, encoded),
    *(cut, flip, without, twice, spliced),
)


def changed(
    text: bytes, chance: random.Random, others: Sequence[bytes], changes: Sequence[Change]
) -> tuple[bytes, list[str]]:
    """A text with one to six changes, and their names. Texts beyond 4 MB are cut."""
    names = []
    for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 6))):
        change = chance.choice(changes)
        text = change(text, chance, others)[: 4 * 2**20]
        names.append(change.__name__)
    return text, names
