"""``simspec help``: the page of a code of an error or a warning, of a word of ``accept``, of a rule of plausibility or of
repair."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator

from simspec.codes import CODES
from simspec.commands.options import print_json
from simspec.commands.scenario_options import HelpOptions
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.language.strict import near
from simspec.report.error_pages import FOLDER, GENERATED, page_files, page_of
from simspec.report.screen import console, say

CODE = re.compile("[A-Z][0-9]+")
COMMENT = re.compile(r"<!--.*?-->\n*", re.DOTALL)
REPAIRS = "docs/guide/import-repairs.md"
"""The page of the rules of repair."""
MOST_NAMED = 6
"""Words that a hint names."""


def help_about(options: HelpOptions) -> int:
    """Print the pages of the words. Raises SpecError for a word that has none."""
    files = page_files()
    pages = {word: page_of(word) or _repair(word) for word in options.words}
    unknown = [word for word, page in pages.items() if page is None]
    if unknown:
        raise SpecError(
            Problem(
                f"{word!r} has no page",
                found=word,
                allowed="a code of a message (S101), a word of accept (material.restitution), a rule of plausibility "
                "or of --repair",
                hint=_nearest(word, files),
                code="C103",
            )
            for word in unknown
        )
    if options.as_json:
        print_json({"pages": pages})
        return EXIT_OK
    for number, (word, page) in enumerate(pages.items()):
        if number:
            say("")
        for line in wrapped(page or "", console().width):
            say(line)
        name = files.get(word.upper()) or files.get(word.lower())
        say(f"page: {f'{FOLDER}/{name}' if name else REPAIRS}")
    return EXIT_OK


def _repair(word: str) -> str | None:
    """The meaning of a rule of repair in each language that has it, as a page; None where no importer has it."""
    from simspec.language.foreign import importers

    meanings: dict[str, list[str]] = {}
    for name, importer in importers().items():
        if (meaning := importer.rules().get(word.lower()) if hasattr(importer, "rules") else None) is not None:
            meanings.setdefault(meaning, []).append(name)
    if not meanings:
        return None
    lines = [f"- {', '.join(names)}: {meaning}" for meaning, names in meanings.items()]
    way = f"`--repair {word.lower()}`, or `import: {{repair: [{word.lower()}]}}` in a scenario, applies it."
    return "\n".join([f"# {word.lower()}: a rule of repair of robot files", "", *lines, "", way, ""])


def wrapped(page: str, width: int) -> Iterator[str]:
    """The lines of a page for a terminal: paragraphs are wrapped between words, blocks and tables keep their lines, comments
    are left out."""
    paragraph: list[str] = []
    block = False
    for line in [*COMMENT.sub("", page).replace(f"{GENERATED}\n\n", "").strip().split("\n"), ""]:
        block = block != line.startswith("```")
        text = not block and line and not line.startswith(("```", "|", "#"))
        if paragraph and (not text or line.startswith("- ")):
            indent = "  " * paragraph[0].startswith("- ")
            yield from textwrap.wrap(
                " ".join(paragraph), width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
            )
            paragraph = []
        if text:
            paragraph.append(line)
        else:
            yield line


def _nearest(word: str, known: Iterable[str]) -> str | None:
    """A hint: the codes and words that begin with a word, or the nearest."""
    same = [name for name in known if word and name.lower().startswith(word.lower())]
    if same:
        return f"did you mean {', '.join(same[:MOST_NAMED])}{', ...' if len(same) > MOST_NAMED else ''}?"
    return near(word.upper(), CODES) if CODE.fullmatch(word.upper()) else near(word.lower(), known)
