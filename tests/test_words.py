"""The vocabulary of the project: plain technical English in names, docstrings, comments, messages and pages."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import words
from tests.modules import MODULES, TEST_MODULES

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LEFT: dict[str, int] = json.loads((ROOT / "tests" / "words_left.json").read_text(encoding="utf-8"))
"""Findings that are left, by package, folder or page: numbers that only become smaller, until the file is empty."""


def _place(path: Path) -> str:
    """The package of simspec, the package of tests, or ``docs``."""
    parts = path.relative_to(ROOT).parts
    if len(parts) <= 2 or parts[0] == "docs":
        return parts[0]
    return "/".join(parts[:2])


def findings() -> dict[str, list[str]]:
    """``file:line: word: text`` of every finding, by place."""
    found: dict[str, list[str]] = {}
    for path in (*MODULES, *TEST_MODULES, *PAGES):
        if path.name in ("glossary.md", "words.py", "test_words.py"):
            continue
        rows = words.in_module(path) if path.suffix == ".py" else words.in_page(path)
        name = path.relative_to(ROOT)
        found.setdefault(_place(path), []).extend(f"{name}:{row.line}: {row.word}: {row.text}" for row in rows)
    return found


def test_words_of_the_glossary_are_used():
    assert not {place: rows[:20] for place, rows in findings().items() if len(rows) > LEFT.get(place, 0)}


@pytest.mark.parametrize(
    "text",
    [
        "What weighs less is refused.",
        "It is refused. Whose mass is zero is not.",
        "the engine is told a mass",
        "bodies beside it",
        "held apart by a gap",
        "a speed that is no number",
    ],
)
def test_avoided_words_in_prose_are_found(text):
    assert list(words.in_prose(text, 1))


@pytest.mark.parametrize(
    "text", ["What is proven?", "all apart from one", "It is `told` here", "who-is-who", "told_units"]
)
def test_plain_prose_has_no_findings(text):
    assert not list(words.in_prose(text.replace("`told`", "``"), 1))


@pytest.mark.parametrize("name", ["told", "_held_at", "HeldValue", "ASKED", "own_mass", "test_what_is_read"])
def test_avoided_words_in_names_are_found(name):
    assert words.in_name(name)


@pytest.mark.parametrize("name", ["untold", "holder", "downwards", "phone", "test_mass"])
def test_other_names_have_no_findings(name):
    assert not words.in_name(name)
