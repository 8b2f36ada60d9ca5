"""Files of triangles before they are parsed: their bytes, and those of the files that they cannot do without."""

from __future__ import annotations

import hashlib
import re
import urllib.parse
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simspec import numerals
from simspec.errors import UNSEEN_CHARACTERS
from simspec.reading import NotReadableError, parse_json, read_bytes

LARGEST_FILE = 64 * 2**20
"""Bytes of one file: 200,000 triangles as text have 50 million in the most spacious of the languages."""
MOST_BUFFERS = 16
"""Files that one glTF file may need beside itself."""
GLB = b"glTF"


class MeshError(ValueError):
    """A file of triangles that is not read, or of which no solid can be made. The message does not name the file."""


@dataclass(frozen=True)
class MeshFile:
    """A file with its content; ``beside``: the buffers of a glTF, by the text that names them."""

    path: Path
    content: bytes
    beside: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def suffix(self) -> str:
        """The end of its name, in small letters."""
        return self.path.suffix.lower()

    def digest(self) -> str:
        """SHA-256 of all of it."""
        digest = hashlib.sha256(f"{self.suffix} {len(self.content)}\0".encode() + self.content)
        for name, content in sorted(self.beside.items()):
            digest.update(f"{len(name)} {name} {len(content)}\0".encode() + content)
        return digest.hexdigest()


_NUMBERS: Mapping[str, re.Pattern[bytes]] = {
    ".obj": re.compile(rb"^[ \t]*(?:v[tnp]?|f)[ \t]([^\n#]*)", re.MULTILINE),
    ".stl": re.compile(rb"^[ \t]*(?:vertex|facet[ \t]+normal)[ \t]([^\n]*)", re.MULTILINE | re.IGNORECASE),
    ".ply": re.compile(rb"\Aply\s[^\0]*?^format[ \t]+ascii[^\0]*?^end_header[ \t\r]*\n(.*)", re.MULTILINE | re.DOTALL),
    ".dae": re.compile(
        rb"<(?:float_array|int_array|p|v|h|vcount|matrix|translate|rotate|scale|skew|lookat)\b[^>]*>([^<]*)<"
    ),
}
"""Where the numbers of a text are, by the end of its name."""
_UNUSUAL = re.compile(rb"[^\t-\r -~]|[_&]")


def _demand_numerals(suffix: str, content: bytes) -> None:
    """Raise MeshError where numbers of a text have digits other than 0 to 9, underscores or other spaces, which some readers
    take and others do not (:mod:`simspec.numerals`)."""
    if suffix not in _NUMBERS or (content.isascii() and b"_" not in content and b"&" not in content):
        return
    if suffix == ".stl" and not (content[:5].lower() == b"solid" and b"endfacet" in content.lower()):
        return  # binary
    for found in _NUMBERS[suffix].finditer(content):
        if wrong := _UNUSUAL.search(found[1]):
            line = 1 + content.count(b"\n", 0, found.start(1) + wrong.start())
            text = found[1][max(0, wrong.start() - 20) :].strip()[:40].decode("utf-8", "replace")
            why = numerals.refusal(text).python_alone or "a character that is part of no number"
            raise MeshError(f"line {line}: {text!r} should be numbers: {why}")


def open_mesh(path: Path) -> MeshFile:
    """A file with the buffers that it needs, which must lie in its folder or below. Raises MeshError."""
    content = _bytes(path, LARGEST_FILE)
    _demand_numerals(path.suffix.lower(), content)
    if path.suffix.lower() not in (".gltf", ".glb"):
        return MeshFile(path, content)
    beside: dict[str, bytes] = {}
    left = LARGEST_FILE - len(content)
    for name in _needed(content):
        target = _beside(path, name)
        if not target.is_relative_to(path.parent):
            raise MeshError(f"it needs {name[:80]!r}, which leaves its folder")
        beside[name] = _bytes(target, left)
        left -= len(beside[name])
    return MeshFile(path, content, beside)


def _bytes(path: Path, most: int) -> bytes:
    try:
        return read_bytes(path, max(most, 0), links=True)
    except NotReadableError as error:
        raise MeshError(f"{path.name} cannot be read: {error}") from None
    except OSError as error:
        raise MeshError(f"{path.name} cannot be read: {error.strerror}") from None


def _beside(path: Path, name: str) -> Path:
    try:
        return (path.parent / urllib.parse.unquote(name)).resolve()
    except (OSError, RuntimeError, ValueError):  # links that lead to themselves, a NUL
        raise MeshError(f"it needs {name[:80]!r}, which does not exist") from None


def _needed(content: bytes) -> list[str]:
    buffers = gltf_header(content).get("buffers", [])
    if not isinstance(buffers, list) or not all(isinstance(buffer, dict) for buffer in buffers):
        raise MeshError("damaged: its buffers are no list of objects")
    named = [buffer["uri"] for buffer in buffers if "uri" in buffer]
    if not all(isinstance(name, str) for name in named):
        raise MeshError("damaged: the place of a buffer is no text")
    outside = list(dict.fromkeys(name for name in named if not name.startswith("data:")))
    if len(outside) > MOST_BUFFERS:
        raise MeshError(f"it needs {len(outside)} files beside itself, more than {MOST_BUFFERS}")
    for name in outside:
        if "://" in name or UNSEEN_CHARACTERS.search(name) or len(name) > 1000:
            raise MeshError(f"it needs {name[:80]!r}, which is no path of a file")
    return outside


def gltf_header(content: bytes) -> dict[str, Any]:
    """The JSON of a glTF or GLB file. Raises MeshError for what is damaged."""
    text = content
    if content[:4] == GLB:
        if len(content) < 20 or int.from_bytes(content[8:12], "little") != len(content):
            raise MeshError("damaged: its length is not what it says")
        size = int.from_bytes(content[12:16], "little")
        if content[16:20] != b"JSON" or 20 + size > len(content):
            raise MeshError("damaged: it does not begin with JSON")
        text = content[20 : 20 + size]
    try:
        header = parse_json(text)
    except NotReadableError as error:
        raise MeshError(f"damaged: {error}") from None
    if not isinstance(header, dict):
        raise MeshError("damaged: its JSON is no object")
    return header
