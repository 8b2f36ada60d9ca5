"""The page: one HTML file, whose content security policy lets it load nothing, and run its own program alone."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
from collections.abc import Callable, Sequence
from typing import Any

from markupsafe import Markup

from simspec.errors import Problem, SpecError
from simspec.formats.kit.text import environment
from simspec.report.page.bundle import bundle
from simspec.report.page.packing import Packed
from simspec.report.page.section import Section, section
from simspec.report.stored_study import StoredStudy

TEMPLATE = "page/report.html.j2"
MARK = "<!-- made by simspec -->"
"""What a page begins with, after its doctype."""
MOST_STUDIES = 6
"""Browsers draw in some eight places at most."""
_ESCAPED = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


Part = StoredStudy | Section | Callable[[Packed], Sequence[Section]]
"""A stored study, a part that was made already, or what makes parts whose numbers go into the page's."""


def page(studies: Sequence[Part]) -> str:
    """The report of some studies, or of parts that were made already, as one HTML file. The same studies give the same text.

    Raises SpecError where there are more than ``MOST_STUDIES``.
    """
    if not 0 < len(studies) <= MOST_STUDIES:
        message = f"a page has 1 to {MOST_STUDIES} studies"
        raise SpecError([Problem(message, found=str(len(studies)), hint="write several pages")])
    packed = Packed()
    sections: list[Section] = []
    for stored in studies:
        if isinstance(stored, Section):
            sections.append(stored)
        else:
            sections += [section(stored, packed)] if isinstance(stored, StoredStudy) else stored(packed)
    if sum(part.scene is not None for part in sections) > MOST_STUDIES:
        raise SpecError([Problem(f"a page plays at most {MOST_STUDIES} studies back", hint="write several pages")])
    return _text(sections, packed)


def is_page(content: bytes) -> bool:
    """Whether simspec wrote this page."""
    return MARK.encode() in content[:200]


def _text(sections: Sequence[Section], packed: Packed) -> str:
    made = bundle()
    script, style = _inside("script", made.script), _inside("style", made.style)
    policy = (
        f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}; base-uri 'none'; form-action 'none'"
    )
    scenes = [part.scene for part in sections if part.scene is not None]
    named = [part for part in sections if part.description is not None] or sections
    numbers, places = itertools.count(), itertools.count()
    return str(
        environment()
        .get_template(TEMPLATE)
        .render(
            mark=Markup(MARK),
            policy=policy,
            style=Markup(style),
            script=Markup(script),
            title=" and ".join(dict.fromkeys(part.name for part in named)),
            descriptions=list(dict.fromkeys(part.description for part in named if part.description)),
            parts=[
                (part, next(numbers) if part.scene is not None else None, next(places) if part.charts else None)
                for part in sections
            ],
            scenes=Markup(_json({"scenes": scenes, "charts": [part.charts for part in sections if part.charts]})),
            packed=Markup(_json(packed.entries)),
            licences=made.licences,
        )
    )


def _json(value: Any) -> str:
    """JSON that ends no script element, whatever its strings are."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False).translate(_ESCAPED)


def _inside(element: str, text: str) -> str:
    """A program or style that can stand in its element. Raises ValueError where it would end that."""
    if f"</{element}" in text.lower() or "<!--" in text:
        raise ValueError(f"the bundle contains what ends a {element} element")
    return text


def _hash(text: str) -> str:
    """A source expression of a content security policy for exactly this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
