"""Long reasons made short: what a table or a comment says, with the whole in the support matrix."""

from __future__ import annotations

import re

LONGEST = 90
"""Characters of a short reason."""
_END = re.compile(r"[;:.](?=\s)|\s\(|, (?:which|where|as|whose)\b")


def brief(reason: str) -> str:
    """The first clause of a reason, of at most ``LONGEST`` characters."""
    line = " ".join(reason.split())
    ends = [found.start() for found in _END.finditer(line) if 20 <= found.start() <= LONGEST]
    if ends:
        return line[: ends[0]]
    if len(line) <= LONGEST:
        return line.rstrip(".")
    return line[:LONGEST].rsplit(" ", 1)[0].rstrip(",;:") + " …"
