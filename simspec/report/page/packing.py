"""Numbers as text of a page: rounded to 16 bits where they are for the eye, gzip, base64. ``page/src/packing.ts`` reads them.

Trajectories are packed as differences in time, all low bytes before all high bytes: what changes slowly is then mostly zeros.
"""

from __future__ import annotations

import base64
import gzip

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
Codes = NDArray[np.int16]

LARGEST_CODE = 32767
"""Numbers between two bounds are coded as −32767 to 32767."""


class Packed:
    """The packed numbers of a page, by name."""

    def __init__(self) -> None:
        self.entries: dict[str, str] = {}

    def add(self, content: bytes) -> str:
        """Pack some bytes; the name that they have in the page."""
        name = f"d{len(self.entries)}"
        # without a time of packing: the same runs give the same page
        self.entries[name] = base64.b64encode(gzip.compress(content, 9, mtime=0)).decode("ascii")
        return name

    def floats(self, values: Numbers) -> str:
        """Numbers in single precision; what is not finite stays what it is."""
        with np.errstate(over="ignore"):
            return self.add(values.astype("<f4").tobytes())

    def codes(self, codes: Codes) -> str:
        """16-bit numbers, low bytes first."""
        return self.add(_planes(codes))

    def series(self, codes: Codes) -> str:
        """Trajectories (series, frames), each as its first number and the differences after it (modulo 2¹⁶)."""
        return self.add(_planes(np.diff(codes, axis=1, prepend=np.zeros((len(codes), 1), np.int16))))


def _planes(codes: Codes) -> bytes:
    pairs = np.ascontiguousarray(codes, dtype="<i2").view(np.uint8).reshape(-1, 2)
    return pairs[:, 0].tobytes() + pairs[:, 1].tobytes()


def coded(values: Numbers, low: Numbers, high: Numbers) -> Codes:
    """Codes of finite ``values`` between ``low`` and ``high`` (which broadcast); what is beyond is at the bound."""
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.round(share * (2 * LARGEST_CODE) - LARGEST_CODE).astype(np.int16)


def decoded(codes: Codes, low: Numbers, high: Numbers) -> Numbers:
    """What codes stand for; within half a step of :func:`resolution`."""
    result: Numbers = (codes.astype(np.float64) + LARGEST_CODE) / (2 * LARGEST_CODE) * (high - low) + low
    return result


def resolution(low: Numbers, high: Numbers) -> float:
    """The largest step between two codes."""
    return float((high - low).max() / (2 * LARGEST_CODE))


def turns(quaternions: Numbers) -> Codes:
    """Codes of unit quaternions (frames, bodies, 4), each of the sign that is nearest to the one before it."""
    same = np.einsum("tbi,tbi->tb", quaternions[1:], quaternions[:-1]) >= 0.0
    sign = np.cumprod(np.where(same, 1.0, -1.0), axis=0)
    followed = quaternions.copy()
    followed[1:] *= sign[..., None]
    return np.round(np.clip(followed, -1.0, 1.0) * LARGEST_CODE).astype(np.int16)
