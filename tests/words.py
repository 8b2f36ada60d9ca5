"""Words that the project avoids, found in names and in prose: the table of ``docs/glossary.md`` is the list."""

from __future__ import annotations

import ast
import functools
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.modules import parsed

GLOSSARY = Path(__file__).resolve().parent.parent / "docs" / "glossary.md"
ROW = re.compile(r"^\| `(?P<word>[^`]+)` \| (?P<write>[^|]+) \| (?P<where>names|prose|both) \|", re.MULTILINE)
STARTS = ("what", "whatever", "whose", "who", "whoever", "of which", "that which")
"""Beginnings of sentences whose subject is a clause: the noun stands in their place. Questions may begin with them."""
SENTENCE = re.compile(
    r"(?:^|(?<=[.!:;]\s)|(?<=\n\n))\s*([\"'(*]*)(" + "|".join(STARTS) + r")\b([^.!?\n]*(?:\n(?!\n)[^.!?\n]*)*)([.!?]?)",
    re.I,
)
COMMENT = re.compile(r"#.*")
CLAUSE = re.compile(r"\b(?:" + "|".join(STARTS) + r")\b", re.I)
"""Modules whose names are plain and whose comments have neither these nor avoided words are not split into tokens, which takes
most of the time."""
EXCEPT = {"apart": " from"}
"""Words that are plain before these."""


@dataclass(frozen=True)
class Finding:
    """``word`` at ``line`` (from 1), in a name or in prose."""

    line: int
    word: str
    text: str


@functools.cache
def avoided(where: str) -> tuple[str, ...]:
    """Words that are avoided in ``names`` or in ``prose``."""
    words = [match for match in ROW.finditer(GLOSSARY.read_text(encoding="utf-8")) if match["where"] in (where, "both")]
    assert words, f"{GLOSSARY} has no table of words for {where}"
    return tuple(match["word"] for match in words)


@functools.cache
def _prose_pattern() -> re.Pattern[str]:
    words = (re.escape(word) + (f"(?!{EXCEPT[word]})" if word in EXCEPT else "") for word in avoided("prose"))
    return re.compile(rf"(?<![\w`.-])(?:{'|'.join(words)})(?![\w`-])", re.IGNORECASE)


@functools.cache
def in_name(name: str) -> tuple[str, ...]:
    """Avoided words among the words of an identifier; ``what`` begins no name of a test."""
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]
    found = [word for word in words if word in avoided("names")]
    return (*found, *(("what",) if words[:1] == ["test"] and words[1:2] and words[1] in ("what", "whatever") else ()))


def _may_be_found(comment: str) -> bool:
    return bool(_prose_pattern().search(comment) or CLAUSE.search(comment))


def in_prose(text: str, line: int) -> Iterator[Finding]:
    """Avoided words, and sentences that begin with a clause, of a text that begins at ``line``."""
    for match in _prose_pattern().finditer(text):
        yield Finding(line + text.count("\n", 0, match.start()), match[0].lower(), _around(text, match))
    for match in SENTENCE.finditer(text):
        if match[4] != "?" and " " in match[3].strip():
            yield Finding(line + text.count("\n", 0, match.start(2)), f"{match[2].lower()} …", _around(text, match))


def _around(text: str, match: re.Match[str]) -> str:
    return " ".join(text[max(0, match.start() - 30) : match.end() + 30].split())[:110]


def in_module(path: Path) -> list[Finding]:
    """Findings in names, comments, docstrings and texts of several words of a Python file."""
    source, (names, texts) = path.read_text(encoding="utf-8"), _names_and_texts(parsed(path))
    found: list[Finding] = []
    before = ("", "")
    suspect = any(map(in_name, names)) or any(map(_may_be_found, COMMENT.findall(source)))
    for token in tokenize.generate_tokens(io.StringIO(source).readline) if suspect else ():
        of_library, before = before in (("np", "."), ("st", ".")), (before[1], token.string)
        if token.type == tokenize.NAME and not of_library:
            found += [Finding(token.start[0], word, token.string) for word in in_name(token.string)]
        elif token.type == tokenize.COMMENT:
            found += in_prose(token.string.lstrip("# "), token.start[0])
    for text in texts:
        if " " in text.value.strip():
            found += in_prose(text.value, text.lineno)
    return found


def _names_and_texts(tree: ast.Module) -> tuple[set[str], list[ast.Constant]]:
    """Every name of a module, and its constants that are texts."""
    names: set[str] = set()
    texts: list[ast.Constant] = []
    left: list[object] = [tree]
    while left:
        node = left.pop()
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str):
                texts.append(node)
        elif isinstance(node, ast.AST):
            left += vars(node).values()
        elif isinstance(node, list):
            left += node
        elif isinstance(node, str):
            names.add(node)
    return names, texts


def in_page(path: Path) -> list[Finding]:
    """Findings in the prose of a Markdown page: no code, no table of the glossary."""
    text = re.sub(
        r"```.*?```", lambda match: "\n" * match[0].count("\n"), path.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    text = re.sub(r"`[^`\n]*`", "``", text)
    return list(in_prose(text, 1))


def findings_of(*paths: Path) -> list[str]:
    """``file:line: word: text`` of every finding in files and folders."""
    files = [file for path in paths for file in (sorted(path.rglob("*")) if path.is_dir() else [path])]
    readers = {".py": in_module, ".md": in_page}
    return [
        f"{file}:{finding.line}: {finding.word}: {finding.text}"
        for file in files
        if file.suffix in readers and file != GLOSSARY and file.name not in ("words.py", "test_words.py")
        for finding in readers[file.suffix](file)
    ]


if __name__ == "__main__":
    print("\n".join(findings_of(*map(Path, sys.argv[1:]))))
