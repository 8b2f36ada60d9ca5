"""Additions of the documentation's site to MkDocs: see ``mkdocs.yml`` and ``make site``.

Pages link to files of the repository outside of ``docs``: these files are published under ``source/``. The Markdown of each
page stands next to its HTML, tutorials as notebooks, too, and ``llms.txt`` lists all pages.
"""

from __future__ import annotations

import posixpath
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

sys.path.insert(0, str(Path(__file__).parent))
import notebooks

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Pages of the repository's first folder, and their places in the site: the front page stands for the README."""
LINK = re.compile(r"(\]\()([^)\s#:]+)((?:#[^)\s]*)?\))")
FENCED = re.compile(r"(?ms)^( *```.*?^ *```)")
ABILITY = re.compile(r"(?m)^> ((?:After|With) this page you can (?:[^\n]+\n> )*[^\n]+)$")
"""The sentence at the head of each page that says what its reader can do at its end."""

_texts: dict[str, str] = {}
_sections: list[Any] = []


def _named(entry: Any) -> set[str]:
    if isinstance(entry, str):
        return {entry}
    return {name for part in (entry.values() if isinstance(entry, dict) else entry) for name in _named(part)}


def expanded(entry: Any, named: set[str]) -> Any:
    """An entry of the navigation: ``FOLDER/*`` is replaced by the pages of that folder that no entry names."""
    if isinstance(entry, str):
        if not entry.endswith("/*"):
            return entry
        found = (page.relative_to(DOCS).as_posix() for page in DOCS.glob(f"{entry}.md"))
        return sorted(
            (name for name in found if name not in named), key=lambda name: (Path(name).stem != "index", name)
        )
    if isinstance(entry, dict):
        return {title: expanded(part, named) for title, part in entry.items()}
    parts: list[Any] = []
    for part in entry:
        new = expanded(part, named)
        if isinstance(part, str) and isinstance(new, list):
            parts += new
        elif not isinstance(new, dict) or all(new.values()):  # a section without pages is left out
            parts.append(new)
    return parts


def on_config(config: Any) -> Any:
    """Write out the navigation."""
    config["nav"] = expanded(config["nav"], _named(config["nav"]))
    return config


def target(link: str, page: str) -> str | None:
    """The place in the site of a link that leads out of ``docs``; None where it does not. ``page`` is relative to the site."""
    base = "" if page in PAGES.values() and page != "index.md" else f"docs/{posixpath.dirname(page)}"
    path = posixpath.normpath(posixpath.join(base, link))
    if path.startswith("docs/"):
        return None if base else path.removeprefix("docs/")
    return PAGES.get(path, f"source/{path}")


def relinked(text: str, page: str) -> str:
    """The Markdown of a page with links that lead out of ``docs`` turned to the site's copies."""

    def turned(found: re.Match[str]) -> str:
        place = target(found[2], page)
        if place is None:
            return found[0]
        return found[1] + posixpath.relpath(place, posixpath.dirname(page) or ".") + found[3]

    parts = FENCED.split(text)
    return "".join(part if part.lstrip().startswith("```") else LINK.sub(turned, part) for part in parts)


def on_files(files: Files, config: Any) -> Files:
    """Add the repository's own pages, the files outside of ``docs`` that pages link to, and notebooks."""
    for source, place in PAGES.items():
        if place != "index.md":
            files.append(File.generated(config, place, abs_src_path=str(ROOT / source)))
    linked: set[str] = set()
    for file in files.documentation_pages():
        text = FENCED.sub("", file.content_string)
        linked |= {place for found in LINK.finditer(text) if (place := target(found[2], file.src_uri))}
        if file.src_uri.startswith("tutorials/"):
            content = notebooks.notebook(file.content_string)
            files.append(File.generated(config, file.src_uri.removesuffix(".md") + ".ipynb", content=content))
    for place in sorted(name for name in linked if name.startswith("source/")):
        path = ROOT / place.removeprefix("source/")
        if path.is_file():  # MkDocs reports the link of any other
            copy = File.generated(config, place, abs_src_path=str(path), inclusion=InclusionLevel.NOT_IN_NAV)
            files.append(copy)
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links that lead out of ``docs``, and take the page's description from its first sentence."""
    name = page.file.src_uri
    text = relinked(markdown, name)
    if said := ABILITY.search(text):
        page.meta["description"] = re.sub(r"\n> ", " ", said[1])
        if name.startswith("tutorials/"):
            there = Path(name).with_suffix(".ipynb").name
            text = f"{text[: said.end()]} [Open it as a notebook]({there}).{text[said.end() :]}"
    _texts[name] = text
    return text


def on_nav(nav: Any, **_: Any) -> None:
    """Keep the order of the pages for ``llms.txt``."""
    _sections[:] = nav.items


def _lines(item: Any) -> list[str]:
    if item.children:
        return [line for child in item.children for line in _lines(child)]
    description = item.meta.get("description", "")
    return [f"- [{item.title}]({item.file.src_uri})" + (f": {description}" if description else "")]


def overview(name: str, summary: str) -> str:
    """The text of ``llms.txt``: title, summary, and each page by section, with its description."""
    parts = [f"# {name}", f"> {summary}"]
    single = [line for item in _sections if not item.children for line in _lines(item)]
    parts.append("\n".join(["## Start", "", *single]))
    for item in (item for item in _sections if item.children):
        parts.append("\n".join([f"## {item.title}", "", *_lines(item)]))
    return "\n\n".join(parts) + "\n"


def on_post_build(config: Any) -> None:
    """Write the Markdown of each page and the list of pages."""
    place = Path(config["site_dir"])
    for name, text in _texts.items():
        (place / name).write_text(text, encoding="utf-8")
    listed = overview(config["site_name"], config["site_description"])
    (place / "llms.txt").write_text(listed, encoding="utf-8")
