"""Pages of the documentation, and their fenced blocks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
        *(page for page in (ROOT / "docs").rglob("*.md") if not {"studies", "errors"} & {*page.parts}),
    ]
)
"""Every page that is written by hand, in whole or in part: tables of published studies are left out, and pages of errors, whose
examples are wrong on purpose (``tests/test_error_pages.py`` runs them)."""
BLOCK = re.compile(r"(?ms)^(?P<indent> *)```(?P<language>[\w-]*)[^\n]*\n(?P<text>.*?)^ *```$")
INLINE = re.compile(r"(?<!`)`(simspec [^`]+)`(?!`)")


@dataclass(frozen=True)
class Block:
    """A fenced block: ``place`` is the page and the line of its first line."""

    place: str
    language: str
    text: str


def blocks(page: Path, *languages: str) -> Iterator[Block]:
    """The blocks of a page that are in one of ``languages``; "" is a block without a language."""
    text = page.read_text(encoding="utf-8")
    for found in BLOCK.finditer(text):
        if found["language"] in languages:
            inner = re.sub(rf"(?m)^{found['indent']}", "", found["text"])
            yield Block(
                f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, found.start('text')) + 1}", found["language"], inner
            )


def all_blocks(*languages: str) -> list[Block]:
    """The blocks of all pages."""
    return [block for page in PAGES for block in blocks(page, *languages)]


def commands(text: str) -> Iterator[str]:
    """Commands of simspec in a shell's block, each on one line, without the comment after two spaces or a ``#``."""
    for line in re.sub(r" *\\\n\s*", " ", text).splitlines():
        command = re.sub(r"^\$ ", "", line)
        if command.startswith("simspec "):
            yield re.split(r"\s{2,}|\s(?:#|\||&&|>|2>|;)", command.strip())[0]
