"""Read a ``.bullet`` file: Bullet's own dump of its memory, which describes its structures itself.

A file is a header and blocks. A block is a code, a length, the address that it had in memory, the number of its structure and
how many of them it holds. The last block, ``DNA1``, lists the structures: names of members, names and lengths of types.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.world.types import EngineValue

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
        self._number_of = {kind: number for number, (kind, _) in enumerate(self._members)}
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
                plain = self.of(self._number_of[member])[1] if member in self._number_of else None
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
            found.update({f"{short}.{key}" if key != "floats" else short: actual for key, actual in inner.items()})
        elif dtype.shape:
            found[short] = tuple(value.reshape(-1).tolist())
        else:
            found[short] = value.item()
    return found


# PyBullet's own dump of the world that it holds (a ``.bullet`` file), and the colliders of links in it.

COLLIDER: Mapping[str, str] = {
    "contactProcessingThreshold": "",
    "anisotropicFriction": "",
    "hitFraction": "",
    "ccdSweptSphereRadius": "",
    "ccdMotionThreshold": "",
    "hasAnisotropicFriction": "",
    "collisionFlags": "",
    "internalType": "",
    "checkCollideWith": "",
    "collisionFilterGroup": "in `apart.LINK`",
    "collisionFilterMask": "in `apart.LINK`",
    "friction": "a surface of the read-back, from getDynamicsInfo",
    "rollingFriction": "a surface of the read-back, from getDynamicsInfo",
    "restitution": "a surface of the read-back, from getDynamicsInfo",
    "contactStiffness": "a surface of the read-back, from getDynamicsInfo",
    "contactDamping": "a surface of the read-back, from getDynamicsInfo",
    "worldTransform": "state, compared by poses",
    "interpolationWorldTransform": "state of the last step",
    "interpolationLinearVelocity": "state of the last step",
    "interpolationAngularVelocity": "state of the last step",
    "deactivationTime": "state",
    "activationState1": "state; whether a body may sleep is in the calls",
    "islandTag1": "state",
    "companionId": "state",
    "uniqueId": "a label",
}
"""Members of a collider in the dump: "" = in the inventory, else why not."""
STATE = frozenset(name for name, why in COLLIDER.items() if why.startswith("state"))


def dump(bullet: Any) -> list[Block]:
    """The blocks of the dump of a client. Raises EngineError where it cannot be read."""
    with scratch_folder("bullet") as folder:
        path = folder / "world.bullet"
        bullet.saveBullet(str(path))
        try:
            return read_blocks(path.read_bytes())
        except (OSError, ValueError) as error:
            raise EngineError("pybullet", f"its dump of the world cannot be read: {error}") from error


def colliders(trees: Sequence[int], blocks: list[Block]) -> Iterator[tuple[tuple[int, int], int, dict[str, Any]]]:
    """Every collider of the dump: the id of its tree and its link, the address of its shape, and its members; ``trees``:
    the ids of all trees, in the order in which they were loaded."""
    bodies = [block.address for block in blocks if block.code == "MBDY"]
    if len(bodies) != len(trees):
        raise EngineError("pybullet", f"holds {len(bodies)} bodies of links, {len(trees)} were loaded")
    tree_of = dict(zip(bodies, trees, strict=True))
    for block in blocks:
        if block.code == "MBLC":
            for row in block.rows:
                uid = tree_of.get(int(row["m_multiBody"]))
                if uid is None:
                    raise EngineError("pybullet", "holds a collider of no body")
                actual = row["m_colObjData"]
                yield (uid, int(row["m_link"])), int(actual["m_collisionShape"]), plain(actual, STATE)


WORLD: Mapping[str, str] = {
    "solverInfo.timeStep": "of the last step; the timestep is a field of the read-back",
    "gravity": "a field of the read-back",
}
"""Members of the world in the dump that are not in the inventory, with the reason."""
ROUND_TYPES = {8, 10}
"""Bullet's numbers of spheres and capsules, whose margin is their radius."""
UNCOUNTED = {"SHAP", "ARAY", "CONT", "CHAR", "MBDY", "MBLC"}
"""Blocks of the dump that are not counted: parts of others, contacts of the moment, and what has entries of its own."""


def world_values(blocks: Iterable[Block]) -> dict[str, EngineValue]:
    """The solver's numbers, and how many things there are of each kind."""
    found: dict[str, EngineValue] = {}
    for block in blocks:
        if block.code == "DWLD":
            for name, value in plain(block.rows[0]).items():
                if name not in WORLD:
                    found[f"world.{name}"] = value
        if block.code not in UNCOUNTED:
            found[f"count.{block.code}"] = int(found.get(f"count.{block.code}", 0)) + len(block.rows)  # type: ignore[arg-type]
    return found


class Margins:
    """The margins (m) that Bullet adds around the shapes of a link, of those that it rounds by none of their own."""

    def __init__(self, blocks: Iterable[Block]):
        self._at = {block.address: block.rows for block in blocks if block.code in ("SHAP", "ARAY")}

    def of(self, address: int) -> tuple[float, ...]:
        """Of the shape at an address, or of all the parts of a compound one, in their order."""
        rows = self._at.get(address)
        if rows is None:
            return ()
        names = rows.dtype.names or ()
        if "m_childShapePtr" in names:
            parts = self._at.get(int(rows[0]["m_childShapePtr"]), ())
            return tuple(margin for part in parts for margin in self.of(int(part["m_childShape"])))
        row = rows[0]["m_convexInternalShapeData"] if "m_convexInternalShapeData" in names else rows[0]
        if "m_collisionMargin" not in (row.dtype.names or ()):
            return ()
        kind = int(row["m_collisionShapeData"]["m_shapeType"])
        return () if kind in ROUND_TYPES else (float(row["m_collisionMargin"]),)
