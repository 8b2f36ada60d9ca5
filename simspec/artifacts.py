"""Compiled files: bytes by relative path, with one hash, wherever they are: in memory, in a folder, in a stored run."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from simspec.outputs.reading import files_below, read_bytes
from simspec.outputs.writing import write_private


class Artifacts(Mapping[str, bytes]):
    """What one engine, or one tool, is given of a world; immutable.

    Names are relative paths with ``/``. ``sha256`` covers names and contents.
    """

    def __init__(self, contents: Mapping[str, str | bytes]):
        """``contents``: texts, which are written as UTF-8, or bytes."""
        self._contents = {
            name: content.encode() if isinstance(content, str) else bytes(content) for name, content in contents.items()
        }

    @classmethod
    def read(cls, folder: Path) -> Artifacts:
        """All files below a folder. Raises SpecError where one is no regular file, or too large."""
        return cls({name: read_bytes(folder / name, root=folder) for name in files_below(folder)})

    def write(self, folder: Path) -> None:
        """Write all files into a folder of the caller's own, in a temporary place: it must not exist yet, or be empty.

        What a user named is written by :mod:`simspec.outputs`. Raises SpecError where a name would leave the folder.
        """
        write_private(self, folder)

    def __getitem__(self, name: str) -> bytes:
        return self._contents[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._contents)

    def __len__(self) -> int:
        return len(self._contents)

    def __repr__(self) -> str:
        return f"<Artifacts: {', '.join(sorted(self))[:100]}>"

    @functools.cached_property
    def sha256(self) -> str:
        """Hexadecimal SHA-256 over names, lengths and contents, in the order of the names."""
        digest = hashlib.sha256()
        for name in sorted(self):
            digest.update(f"{name}\0{len(self[name])}\0".encode())
            digest.update(self[name])
        return digest.hexdigest()

    @functools.cached_property
    def texts(self) -> Mapping[str, str]:
        """The files as texts. Raises UnicodeDecodeError where one is not UTF-8."""
        return {name: content.decode() for name, content in self.items()}
