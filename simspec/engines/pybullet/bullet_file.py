"""Read a ``.bullet`` file: Bullet's own dump of its memory, which describes its structures itself.

A file is a header and blocks. A block is a code, a length, the address that it had in memory, the number of its structure and
how many of them it holds. The last block, ``DNA1``, lists the structures: names of members, names and lengths of types.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

HEADER = re.compile(rb"BULLET[fd]([-_])v\d{3}")
"""Precision, ``-`` for 64-bit addresses, and the version. Little-endian where ``v`` is small."""

NUMBERS = {
    "char": "i1",
    "uchar": "u1",
    "short": "<i2",
    "ushort": "<u2",
    "int": "<i4",
    "long": "<i4",
    "ulong": "<u4",
    "float": "<f4",
    "double": "<f8",
}
"""NumPy's type for each plain one."""

MEMBER = re.compile(r"(\**)(\(\*)?(\w+)\)?(?:\(\))?((?:\[\d+\])*)")
"""Stars of a pointer, a pointer to a function, the name, and the lengths of its dimensions."""


@dataclass(frozen=True, slots=True)
class Block:
    """One block: its code, the address that it had, the name of its structure, and an array of those."""

    code: str
    address: int
    kind: str
    rows: np.ndarray


def read_blocks(content: bytes) -> list[Block]:
    """All blocks of a file whose structures are described, in their order. Raises ValueError for what is no such file."""
    found = HEADER.match(content)
    if found is None or found.group(1) != b"-":
        raise ValueError(f"no 64-bit .bullet file: it begins with {content[:12]!r}")
    raw = list(_raw_blocks(content, found.end()))
    if not raw or raw[-1][0] != "DNA1":
        raise ValueError("a .bullet file without a description of its structures")
    structures = _Structures(raw[-1][4])
    blocks = []
    for code, address, number, count, data in raw[:-1]:
        kind, dtype = structures.of(number)
        if dtype is not None and count * dtype.itemsize == len(data):
            blocks.append(Block(code, address, kind, np.frombuffer(data, dtype, count)))
    return blocks


def _raw_blocks(content: bytes, at: int) -> Any:
    while at + 24 <= len(content):
        code = content[at : at + 4].rstrip(b"\0").decode("ascii", "replace")
        length, address, number, count = struct.unpack_from("<iQii", content, at + 4)
        if length < 0 or at + 24 + length > len(content):
            raise ValueError("a .bullet file that ends within a block")
        yield code, address, number, count, content[at + 24 : at + 24 + length]
        at += 24 + length


class _Structures:
    """The description of structures: by their number the name and NumPy's type, None where it has members of no known type."""

    def __init__(self, dna: bytes):
        reader = _Words(dna)
        reader.expect(b"SDNA")
        reader.expect(b"NAME")
        names = reader.texts()
        reader.expect(b"TYPE")
        self._types = reader.texts()
        reader.expect(b"TLEN")
        self._lengths = reader.shorts(len(self._types))
        reader.expect(b"STRC")
        self._members: list[tuple[int, list[tuple[int, str]]]] = []
        for _ in range(reader.count()):
            kind, size = reader.shorts(2)
            pairs = reader.shorts(2 * size)
            self._members.append((kind, [(pairs[2 * k], names[pairs[2 * k + 1]]) for k in range(size)]))
        self._own = {kind: number for number, (kind, _) in enumerate(self._members)}
        self._known: dict[int, np.dtype | None] = {}

    def of(self, number: int) -> tuple[str, np.dtype | None]:
        if not 0 <= number < len(self._members):
            raise ValueError(f"a .bullet file with a structure of number {number}, which it does not describe")
        kind, members = self._members[number]
        if number not in self._known:
            self._known[number] = self._dtype(kind, members)
        return self._types[kind], self._known[number]

    def _dtype(self, kind: int, members: Sequence[tuple[int, str]]) -> np.dtype | None:
        fields: list[Any] = []
        for member, text in members:
            found = MEMBER.fullmatch(text)
            if found is None:
                return None
            stars, function, name, dimensions = found.groups()
            shape = tuple(int(size) for size in re.findall(r"\d+", dimensions))
            plain: Any = "<u8" if stars or function else NUMBERS.get(self._types[member])
            if plain is None:
                plain = self.of(self._own[member])[1] if member in self._own else None
            if plain is None:
                return None
            fields.append((name, plain, shape) if shape else (name, plain))
        dtype = np.dtype(fields)
        return dtype if dtype.itemsize == self._lengths[kind] else None


class _Words:
    """Reads the description, whose parts begin at multiples of four bytes."""

    def __init__(self, data: bytes):
        self._data, self._at = data, 0

    def expect(self, word: bytes) -> None:
        self._at += -self._at % 4
        if self._data[self._at : self._at + 4] != word:
            raise ValueError(f"the description in a .bullet file has no {word.decode()}")
        self._at += 4

    def count(self) -> int:
        (number,) = struct.unpack_from("<i", self._data, self._at)
        self._at += 4
        return int(number)

    def texts(self) -> list[str]:
        found = []
        for _ in range(self.count()):
            end = self._data.index(b"\0", self._at)
            found.append(self._data[self._at : end].decode("ascii", "replace"))
            self._at = end + 1
        return found

    def shorts(self, count: int) -> tuple[int, ...]:
        found = struct.unpack_from(f"<{count}h", self._data, self._at)
        self._at += 2 * count
        return found


def plain(row: Any, skip: frozenset[str] = frozenset()) -> dict[str, Any]:
    """The members of one structure by name, structures within it with dotted names; without those named in ``skip``, without
    padding, and without addresses, which mean nothing outside."""
    found: dict[str, Any] = {}
    fields: Mapping[str, Any] = row.dtype.fields
    for name, (dtype, *_) in fields.items():
        short = name.removeprefix("m_")
        if short in skip or short.startswith("padding") or dtype.base == np.dtype("<u8"):
            continue
        value = row[name]
        if dtype.names is not None:
            inner = plain(value, skip)
            found.update({f"{short}.{key}" if key != "floats" else short: held for key, held in inner.items()})
        elif dtype.shape:
            found[short] = tuple(value.reshape(-1).tolist())
        else:
            found[short] = value.item()
    return found
