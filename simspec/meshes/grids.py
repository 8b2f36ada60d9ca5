"""Files of heights: grey PNG pictures, and numbers as text. Both bounded, neither trusted.

The PNG is decoded here, by zlib and numpy: of the format's many forms this is the one that holds heights, and nothing of it
runs outside of Python (W3C, Portable Network Graphics, third edition: chunks in 5, filters in 9).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simspec import numerals
from simspec.language.heightfield import FEWEST, MOST_HEIGHTS
from simspec.language.units import LARGEST
from simspec.meshes.files import MeshError
from simspec.reading import NotReadableError, read_bytes

LARGEST_FILE = 16 * 2**20
"""Bytes of one file: the most heights, as text of 60 characters each."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY = 0
"""PNG's number of pictures without colours and opacity."""

Array = NDArray[np.float64]


def read_grid(path: Path) -> Array:
    """The numbers (rows, columns) of a file as they stand in it, the first row first: the shades of a picture, or what a text
    says. Raises MeshError."""
    try:
        content = read_bytes(path, LARGEST_FILE, links=True)
    except NotReadableError as error:
        raise MeshError(f"{path.name} cannot be read: {error}") from None
    except OSError as error:
        raise MeshError(f"{path.name} cannot be read: {error.strerror}") from None
    return _png(content) if path.suffix.lower() == ".png" else _text(content)


def _demand(rows: int, columns: int) -> None:
    if rows < FEWEST or columns < FEWEST:
        raise MeshError(f"{rows} rows and {columns} columns, where ground has at least {FEWEST} of each")
    if rows * columns > MOST_HEIGHTS:
        raise MeshError(f"{rows} × {columns} heights, more than the {MOST_HEIGHTS:,} that are read")


# --- text ---------------------------------------------------------------------------------------------------------


def _text(content: bytes) -> Array:
    try:
        lines = content.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise MeshError(f"not ASCII at byte {error.start}") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = line.split(",") if "," in line else numerals.parts_of(line)
        rows.append([_number(word.strip(numerals.SPACE), number) for word in words])
        if len(words) != len(rows[0]):
            raise MeshError(f"{len(words)} numbers in line {number}, where the first row has {len(rows[0])}")
        if len(rows) * len(words) > MOST_HEIGHTS:
            raise MeshError(f"more than the {MOST_HEIGHTS:,} heights that are read")
    _demand(len(rows), len(rows[0]) if rows else 0)
    return np.array(rows)


def _number(word: str, line: int) -> float:
    try:
        value = numerals.number(word)
    except numerals.NumeralError as error:
        raise MeshError(f"{word[:40]!r} in line {line} is no usable number{error.suffix}") from None
    if abs(value) > LARGEST:
        raise MeshError(f"{word[:40]!r} in line {line} is no usable number")
    return value


# --- pictures -----------------------------------------------------------------------------------------------------


def _png(content: bytes) -> Array:
    if not content.startswith(SIGNATURE):
        raise MeshError("no PNG: it does not begin as one")
    header, packed = b"", []
    for name, data in _chunks(content):
        if name == b"IHDR":
            header = header or data
        elif name == b"IDAT":
            packed.append(data)
    if len(header) != 13:
        raise MeshError("damaged: it has no header")
    columns, rows = (int.from_bytes(header[start : start + 4], "big") for start in (0, 4))
    depth, colours, *methods = header[8:]
    if colours != GREY or depth not in (8, 16):
        raise MeshError(f"a picture with {depth} bits and of kind {colours}, where heights are grey with 8 or 16 bits")
    if any(methods):
        raise MeshError("interlaced, or packed in an unknown way, which is not read")
    _demand(rows, columns)
    wide = columns * depth // 8
    lines = _unpacked(b"".join(packed), rows * (1 + wide)).reshape(rows, 1 + wide)
    shades = _unfiltered(lines[:, 0], lines[:, 1:], depth // 8)
    return shades.reshape(rows, wide).view(">u2" if depth == 16 else "u1").astype(np.float64)


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = len(SIGNATURE)
    while True:
        size, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        data, check = content[at + 8 : at + 8 + size], content[at + 8 + size : at + 12 + size]
        if len(check) != 4:
            raise MeshError("damaged: it ends too early")
        if zlib.crc32(name + data) != int.from_bytes(check, "big"):
            raise MeshError("damaged: a checksum is wrong")
        if name == b"IEND":
            return
        yield name, data
        at += 12 + size


def _unpacked(packed: bytes, size: int) -> NDArray[np.uint8]:
    """Exactly ``size`` bytes; no more are unpacked, whatever the file would become."""
    unpacking = zlib.decompressobj()
    try:
        data = unpacking.decompress(packed, size + 1)
    except zlib.error as error:
        raise MeshError(f"damaged: {error}") from None
    if len(data) != size:
        raise MeshError("damaged: its pixels are not as many as it says")
    return np.frombuffer(data, np.uint8)


def _unfiltered(kinds: NDArray[np.uint8], lines: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """The bytes of each line from what is left of them when a guess by its neighbours is taken away; ``step``: bytes of a
    pixel."""
    made = np.zeros(lines.shape, np.uint8)
    above = np.zeros(lines.shape[1], np.uint8)
    for row, (kind, line) in enumerate(zip(kinds.tolist(), lines, strict=True)):
        if kind == 0:
            made[row] = line
        elif kind == 1:
            made[row] = np.cumsum(line.reshape(-1, step), axis=0, dtype=np.uint8).ravel()
        elif kind == 2:
            made[row] = line + above
        elif kind in (3, 4):
            made[row] = _guessed(kind, line.tolist(), above.tolist(), step)
        else:
            raise MeshError(f"damaged: line {row + 1} is filtered in the unknown way {kind}")
        above = made[row]
    return made


def _guessed(kind: int, line: list[int], above: list[int], step: int) -> list[int]:
    """A line by the filters Average (3) and Paeth (4)."""
    done: list[int] = []
    for index, value in enumerate(line):
        left = done[index - step] if index >= step else 0
        up = above[index]
        if kind == 3:
            guess = (left + up) // 2
        else:
            corner = above[index - step] if index >= step else 0
            far = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
            guess = left if far[0] <= far[1] and far[0] <= far[2] else up if far[1] <= far[2] else corner
        done.append((value + guess) & 255)
    return done
