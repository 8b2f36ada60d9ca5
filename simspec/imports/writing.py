"""What an importer made, as the text of a spec: in the canonical layout, with a comment at each repair."""

from __future__ import annotations

import copy
import hashlib
import os
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from simspec.errors import Location, Problem, SpecError, visible
from simspec.language.document import MOST_EVENTS, build, event_count, events
from simspec.language.foreign import Imported
from simspec.language.layout import WIDTH, Entry, Node, lines, node_of
from simspec.language.mesh import named_files
from simspec.language.packages import Package

MARK: Final = "# Written by simspec import"
"""How a file begins that simspec may write again; then the file that it comes from, and :data:`SUM` of what follows."""
SUM: Final = "; as it was written: "
DIGITS: Final = 16


def spec_text(imported: Imported, source: str, files: Mapping[str, str] | None = None) -> str:
    """The spec of an import, from a file called ``source``. ``files``: what the spec calls the files that the data
    names, by the texts there. Raises SpecError where the text would not read as the same data."""
    if (problem := too_long(imported, source)) is not None:
        raise SpecError([problem])
    data = _renamed(imported.data, files or {})
    root = node_of(data)
    index: Index = {}
    sentences: dict[str, list[str]] = {path: [text] for path, text in imported.comments.items()}
    for repair in imported.repairs:
        sentences.setdefault(repair.path, []).append(f"repaired ({repair.rule}): {repair.what}")
    header: list[str] = []
    for path, said in sentences.items():
        entry = _entry(root, path, index)
        comment = [line for sentence in said for line in _comment(sentence)]
        if entry is None:
            header += comment
        else:
            entry.above += comment
    body = "\n".join(lines(root, header, [])) + "\n"
    _check(body, data)
    return f"{MARK} from {visible(source)}{SUM}{_sum(body)}\n{body}"


def too_long(imported: Imported, shown: str) -> Problem | None:
    """The problem of an import that is more than one file of the language may hold; asked before the work of resolving and
    writing it. ``shown``: what messages call the file."""
    count = event_count(imported.data)
    if count <= MOST_EVENTS:
        return None
    place = imported.places.get((), Location(shown, 1, 1))
    hint = "a scenario may take the file as it is: models: {NAME: {use: FILE}}"
    message = "as a spec, this file has more keys and values than one file may have"
    return Problem(message, location=place, found=f"{count:,}", allowed=f"{MOST_EVENTS:,}", hint=hint)


def is_unchanged(content: bytes) -> bool:
    """Whether a file is what :func:`spec_text` made, and nobody has changed it since."""
    first, _, body = content.partition(b"\n")
    head, found, digits = first.decode("utf-8", "replace").rpartition(SUM)
    return bool(found) and head.startswith(MARK) and digits == hashlib.sha256(body).hexdigest()[:DIGITS]


def _sum(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:DIGITS]


def _comment(sentence: str) -> Iterator[str]:
    for line in textwrap.wrap(visible(sentence), WIDTH - 20, break_on_hyphens=False):
        yield f"# {line}"


Index = dict[int, dict[str, Entry]]
"""The entries of a node by name, by the ``id`` of the node: a file of many bodies has as many comments."""


def _entry(root: Node, path: str, index: Index) -> Entry | None:
    """The entry at a dotted path, or the nearest one around it; None for the whole spec."""
    entry: Entry | None = None
    node = root
    for depth, step in enumerate(path.split(".")):
        if depth > 0 and node.kind == "scalar":
            break
        if node.kind == "list":
            below = (
                node.entries[int(step)] if step.isascii() and step.isdigit() and int(step) < len(node.entries) else None
            )
        else:
            if id(node) not in index:
                index[id(node)] = {one.name: one for one in reversed(node.entries) if one.name is not None}
            below = index[id(node)].get(step)
        if below is None:
            break
        entry, node = below, below.node
    return entry


def _renamed(data: dict[str, Any], files: Mapping[str, str]) -> dict[str, Any]:
    """The data with other names of files; what was given stays as it is."""
    changed = copy.deepcopy(data)
    for path, text in named_files(data):
        holder: Any = changed
        for step in path[:-1]:
            holder = holder[step]
        holder[path[-1]] = files.get(text, text)
    return changed


def from_folder(imported: Imported, folder: Path, package: Package | None = None) -> dict[str, str]:
    """What a spec in ``folder`` calls the files that the data names: their names in the ``package`` that they are in, else
    their paths from there."""
    here = folder.resolve()
    return {
        text: (package and package.named(path)) or Path(os.path.relpath(path, here)).as_posix()
        for text, path in imported.files.items()
    }


def copies(imported: Imported, into: Path, folder: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """Names in the folder ``into`` for the files that the data names, each with the file; and what a spec in ``folder`` calls
    them. What a glTF file needs beside itself would be missing there, so that such a file stays where it is."""
    sources: dict[str, Path] = {}
    called = from_folder(imported, folder)
    place = Path(os.path.relpath(into.resolve(), folder.resolve()))
    names: dict[Path, str] = {}
    for text, path in imported.files.items():
        if path.suffix.lower() == ".gltf":
            continue
        if path not in names:
            name, number = path.name, 1
            while name in sources:
                number += 1
                name = f"{path.stem}_{number}{path.suffix}"
            names[path], sources[name] = name, path
        called[text] = (place / names[path]).as_posix()
    return sources, called


def _check(body: str, data: dict[str, Any]) -> None:
    """The promise of a written spec: it reads as the data that was imported."""
    document = build(events(body, "<spec>"), "<spec>")
    if document.problems or document.data != data:
        message = "this import cannot be written as a spec without changing its meaning"
        raise SpecError([*document.problems, Problem(message, hint="report this: it is a bug in simspec")])
