"""What an importer made, as the text of a spec: in the canonical layout, with a comment at each repair."""

from __future__ import annotations

import hashlib
import textwrap
from collections.abc import Iterator, Sequence
from typing import Final

from simspec.errors import Problem, SpecError, visible
from simspec.language.document import build, events
from simspec.language.foreign import Imported
from simspec.language.layout import WIDTH, Entry, Node, lines, node_of

MARK: Final = "# Written by simspec import"
"""How a file begins that simspec may write again; then the file that it comes from, and :data:`SUM` of what follows."""
SUM: Final = "; as it was written: "
DIGITS: Final = 16


def spec_text(imported: Imported, source: str) -> str:
    """The spec of an import, from a file called ``source``. Raises SpecError where the text would not read as the same data."""
    root = node_of(imported.data)
    sentences: dict[str, list[str]] = {path: [text] for path, text in imported.comments.items()}
    for repair in imported.repairs:
        sentences.setdefault(repair.path, []).append(f"repaired ({repair.rule}): {repair.what}")
    header: list[str] = []
    for path, said in sentences.items():
        entry = _entry(root, path)
        comment = [line for sentence in said for line in _comment(sentence)]
        if entry is None:
            header += comment
        else:
            entry.above += comment
    body = "\n".join(lines(root, header, [])) + "\n"
    _check(body, imported)
    return f"{MARK} from {visible(source)}{SUM}{_sum(body)}\n{body}"


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


def _entry(root: Node, path: str) -> Entry | None:
    """The entry at a dotted path, or the nearest one around it; None for the whole spec."""
    entry: Entry | None = None
    node = root
    for index, step in enumerate(path.split(".")):
        inside: Sequence[Entry] = node.entries
        if node.kind == "list":
            inside = inside[int(step) : int(step) + 1] if step.isdigit() else []
        else:
            inside = [below for below in inside if below.name == step]
        if not inside or (index > 0 and node.kind == "scalar"):
            break
        entry, node = inside[0], inside[0].node
    return entry


def _check(body: str, imported: Imported) -> None:
    """The promise of a written spec: it reads as the data that was imported."""
    document = build(events(body, "<spec>"), "<spec>")
    if document.problems or document.data != imported.data:
        message = "this import cannot be written as a spec without changing its meaning"
        raise SpecError([*document.problems, Problem(message, hint="report this: it is a bug in simspec")])
