"""Pictures that tests make."""

from __future__ import annotations

import struct
import zlib

import numpy as np


def png(rows, depth=8, filters=None, **header) -> bytes:
    """A grey PNG, each line by one of the filters (0 to 4)."""
    values = np.array(rows)
    raw = values.astype(">u2" if depth == 16 else "u1").reshape(len(values), -1).view(np.uint8).reshape(len(values), -1)
    step, packed, above = depth // 8, b"", np.zeros(raw.shape[1], int)
    for index, line in enumerate(raw.astype(int)):
        kind = filters[index % len(filters)] if filters else 0
        left = np.concatenate([np.zeros(step, int), line[:-step]])
        corner = np.concatenate([np.zeros(step, int), above[:-step]])
        guess = left + above - corner
        far = np.abs(np.stack([guess - left, guess - above, guess - corner]))
        paeth = np.choose(far.argmin(axis=0), [left, above, corner])  # of equals the first
        guessed = [np.zeros_like(line), left, above, (left + above) // 2, paeth][kind]
        packed += bytes([kind]) + ((line - guessed) % 256).astype(np.uint8).tobytes()
        above = line
    wide, high = header.get("wide", values.shape[1]), header.get("high", values.shape[0])
    ihdr = struct.pack(">IIBBBBB", wide, high, depth, header.get("colours", 0), 0, 0, header.get("interlaced", 0))
    body = header.get("body", zlib.compress(packed))
    chunks = [(b"IHDR", ihdr), (b"tEXt", b"made by a test"), (b"IDAT", body[:7]), (b"IDAT", body[7:]), (b"IEND", b"")]
    text = b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + text
