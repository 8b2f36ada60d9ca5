"""Links between the pages lead somewhere: to a file, and to a heading or a named place in it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"(?m)^#{1,6} +(.*?) *$")
NAMED = re.compile(r'<a id="([^"]+)"></a>')
FENCED = re.compile(r"(?ms)^```.*?^```")


def anchors(page: Path) -> set[str]:
    """The places of a page, as GitHub and its like name them."""
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    headings = (re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in HEADING.findall(text))
    return {*headings, *NAMED.findall(text)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_of_a_page_leads_somewhere(page):
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    broken = []
    for link in LINK.findall(text):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, place = link.partition("#")
        target = page if not path else (page.parent / path).resolve()
        if not target.exists() or (place and place not in anchors(target)):
            broken.append(link)
    assert not broken


def test_a_missing_place_is_seen():
    assert "what-friction-coulomb-costs" in anchors(ROOT / "docs" / "records" / "contact.md")
    assert "no-such-place" not in anchors(ROOT / "docs" / "records" / "contact.md")
