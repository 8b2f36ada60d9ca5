"""The site of the documentation: every link leads to a page and a place in it, nothing is fetched from another host, and each
page has its Markdown and its line in the list of pages."""

from __future__ import annotations

import json
import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.docs.blocks import ROOT

html = pytest.importorskip("lxml.html", reason="lxml is not installed (extra test)")
pytest.importorskip("material", reason="the generator of the site is not installed (extra docs)")
ABILITY = re.compile(r"(?m)^> (After|With) this page you can ")
WITHOUT = ("index.md", "contributing.md", "changelog.md", "tour.md")
"""Pages whose title says what they are for."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built strictly: MkDocs ends with an exception where it warns."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    place = tmp_path_factory.mktemp("site")
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(place), strict=True)
    config.plugins.run_event("startup", command="build", dirty=False)
    build(config)
    return place


@pytest.fixture(scope="module")
def pages(site):
    """Of each page of the site: links, sources of pictures, scripts and styles, and places."""
    found = {}
    for path in site.rglob("*.html"):
        if "studies" in path.parts and path.name == "report.html":
            continue  # a page of a published study, which its own tests check
        tree = html.fromstring(path.read_bytes())

        def texts(*queries: str, tree=tree) -> list[str]:
            # lxml's strings keep the whole tree of their page
            return [str(text) for query in queries for text in tree.xpath(query)]

        fetched = texts("//script/@src", "//img/@src", "//link/@href", "//video/@src")
        found[path] = (texts("//a/@href"), fetched, set(texts("//@id", "//a/@name")))
    return found


def broken(pages, path: Path, link: str) -> bool:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return False
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if target.is_dir():
        target /= "index.html"
    if not target.is_file():
        return True
    return bool(parts.fragment and target in pages and unquote(parts.fragment) not in pages[target][2])


def test_every_link_leads_to_a_place(pages):
    assert len(pages) > 80
    wrong = [
        f"{path.name}: {link}"
        for path, (links, fetched, _) in pages.items()
        if path.name != "404.html"  # its links are those of the site's root
        for link in {*links, *fetched}
        if broken(pages, path, link)
    ]
    assert not wrong
    first = next(path for path in pages if path.name == "install.html")
    assert broken(pages, first, "nowhere.html")
    assert broken(pages, first, "install.html#nowhere")


def test_nothing_is_fetched_from_another_host(pages):
    for path, (_, fetched, _) in pages.items():
        assert not [link for link in fetched if urlsplit(link).netloc], path


def test_each_page_has_its_markdown_and_a_line_in_the_list(site, pages):
    listed = (site / "llms.txt").read_text(encoding="utf-8")
    assert listed.startswith("# simspec\n\n> ")
    for path in (path for path in pages if path.name != "404.html"):
        markdown = path.with_suffix(".md")
        assert markdown.read_text(encoding="utf-8").startswith("# "), path
        assert f"]({markdown.relative_to(site).as_posix()})" in listed, path


def test_each_page_says_what_its_reader_can_do(site, pages):
    without = []
    for path in sorted(site.rglob("*.md")):
        name = path.relative_to(site).as_posix()
        if not name.startswith(("source/", "records/studies/", "errors/")) and name not in WITHOUT:
            without += [] if ABILITY.search(path.read_text(encoding="utf-8")) else [name]
    assert not without


def test_tutorials_are_notebooks(site):
    for page in (ROOT / "docs" / "tutorials").glob("*.md"):
        if page.name == "index.md":
            continue
        made = json.loads((site / "tutorials" / f"{page.stem}.ipynb").read_text(encoding="utf-8"))
        cells = [cell for cell in made["cells"] if cell["cell_type"] == "code"]
        assert any(cell["outputs"] for cell in cells), page
        text = page.read_text(encoding="utf-8")
        shell = [cell for cell in cells if "".join(cell["source"]).startswith("%%bash\n")]
        assert (len(shell), len(cells) - len(shell)) == (text.count("```bash\n"), text.count("```python\n")), page
