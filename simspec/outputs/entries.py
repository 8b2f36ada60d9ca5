"""Entries that are kept in the user's cache folder: each a file of its own, whole or not at all, and all together of bounded
size. What an entry says, and whether it is to be believed, is its user's matter.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from simspec.errors import SpecError
from simspec.outputs.cache import cache_folder, written_by_others
from simspec.outputs.reading import read_bytes
from simspec.outputs.staging import locked
from simspec.outputs.writing import write_file

NAME: Final = re.compile(r"[0-9a-f]{64}\.json")
"""Names of entries: a SHA-256."""
LEFT: Final = 0.75
"""Share of the bound that is left when the oldest entries leave, so that this is not done for each new one."""


@dataclass(frozen=True)
class Entries:
    """The entries in the folder ``simspec/NAME`` of the user's cache folder (XDG_CACHE_HOME or ~/.cache).

    ``head``: how every entry begins; what begins otherwise is not simspec's, and is left alone. ``largest``: bytes of one that
    is read. ``bound``: bytes of all; beyond it those leave that were not read or written for the longest time.
    """

    name: str
    head: bytes
    largest: int
    bound: int

    def folder(self) -> Path | None:
        """Where entries are kept; None where the user has no cache folder."""
        return cache_folder(self.name)

    def refused(self) -> str | None:
        """Why the folder is not used, though the user has one: others may have written it; None where it is."""
        place = self.folder()
        why = None if place is None else written_by_others(place)
        return None if why is None else f"the cache {place} is not used: {why}"

    def read(self, key: str) -> bytes | None:
        """The entry of a key; None where there is none that can be read, or where others may have written it."""
        place = self.folder()
        if place is None or self.refused():
            return None
        path = place / f"{key}.json"
        try:
            content = read_bytes(path, self.largest, place)
        except (OSError, SpecError):
            return None
        with contextlib.suppress(OSError):  # a folder that is only read: its entries leave by when they were written
            os.utime(path, follow_symlinks=False)
        return content

    def write(self, key: str, content: str) -> bool:
        """Keep an entry; False where that is not possible, which costs time only. Every sixteenth key looks after the bound."""
        place = self.folder()
        if place is None or self.refused():
            return False
        try:
            # not synced: what a power cut leaves half is no entry
            write_file(place / f"{key}.json", content, self._is_own, lasting=False)
            if key.startswith("0"):
                self._shrink(place)
        except (OSError, SpecError):
            return False
        return True

    def _is_own(self, content: bytes) -> bool:
        return content.startswith(self.head) or self.head.startswith(content)

    def _shrink(self, place: Path) -> None:
        """Delete the oldest entries, where all together are too large."""
        found: list[tuple[int, int, str]] = []
        with os.scandir(place) as inside:
            for entry in inside:
                status = entry.stat(follow_symlinks=False)
                if NAME.fullmatch(entry.name) and stat.S_ISREG(status.st_mode):
                    found.append((status.st_mtime_ns, status.st_size, entry.name))
        total = sum(size for _, size, _ in found)
        if total <= self.bound:
            return
        with locked(place):
            for _, size, name in sorted(found):
                if total <= LEFT * self.bound:
                    return
                path = place / name
                try:
                    if self._is_own(read_bytes(path, self.largest, place)[: len(self.head)]):
                        path.unlink()
                except (FileNotFoundError, SpecError):
                    continue  # another process was faster, or it is not simspec's
                total -= size
