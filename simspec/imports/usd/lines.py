"""The lines of prims in a text of USD, by their paths. No values are read; a binary file has no lines."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

DEEPEST: Final = 1000
"""Brackets within each other up to which prims have lines."""
MAGIC: Final = b"#usda"
_TOKEN: Final = re.compile(
    rb"""(?P<skip>"{3}.*?"{3}|'{3}.*?'{3}|\#[^\n]*)"""
    rb"""|(?P<prim>\b(?:def|over|class)\b(?:[ \t]+[A-Za-z_][\w:]*)?[ \t]+"(?P<name>[^"\n]*)")"""
    # possessive: a long text takes no memory for ways back
    rb"""|(?P<string>"(?:[^"\\\n]++|\\.)*+"|'(?:[^'\\\n]++|\\.)*+')"""
    rb"""|(?P<bracket>[{}()\[\]])""",
    re.DOTALL,
)


def lines_of(content: bytes) -> Mapping[str, int]:
    """The line of each prim's declaration in a file, the first where there are several."""
    if not content.startswith(MAGIC):
        return {}
    lines: dict[str, int] = {}
    open_braces: list[str | None] = []
    path, pending, round_brackets = "", None, 0
    line, seen = 1, 0
    for token in _TOKEN.finditer(content):
        line += content.count(b"\n", seen, token.start())
        seen = token.start()
        bracket = token["bracket"]
        if token["name"] is not None and not round_brackets:
            pending = token["name"].decode("utf-8", "replace")
            lines.setdefault(f"{path}/{pending}", line)
        elif bracket in (b"(", b"["):
            round_brackets += 1
        elif bracket in (b")", b"]"):
            round_brackets = max(0, round_brackets - 1)
        elif bracket == b"{" and not round_brackets:
            open_braces.append(pending)
            if len(open_braces) > DEEPEST:
                break  # deeper than any stage that is read: paths would take the square of the text
            if pending is not None:
                path, pending = f"{path}/{pending}", None
        elif bracket == b"}" and not round_brackets and open_braces:
            name = open_braces.pop()
            if name is not None:
                path = path.removesuffix(f"/{name}")
    return lines
