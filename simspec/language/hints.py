"""Hints for words that the language does not have: a known foreign word first, then what is spelt alike.

The order matters: by its letters `revolute` is nearer to `free` than to `hinge`.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simspec.language.hint import Hint


def _plain(word: str) -> str:
    """As words are compared: `halfSize`, `half-size` and `half_size` are one."""
    return "".join(character for character in word.lower() if character.isalnum())


@functools.cache
def hints() -> Mapping[str, tuple[Hint, ...]]:
    """Every known foreign word, without its case, hyphens and underscores."""
    from simspec.language.hint_words import ENTRIES

    table: dict[str, tuple[Hint, ...]] = {}
    for word, hint in ENTRIES:
        table[_plain(word)] = (*table.get(_plain(word), ()), hint)
    return table


def _known(word: str) -> tuple[Hint, ...]:
    return hints().get(_plain(word), ()) if len(word) <= 2 * max(map(len, hints())) else ()


def hint_for_key(word: str, model: str) -> str | None:
    """What to write instead of an unknown key of a model of the language (its name, as ``Joint``); None: not a known word.

    What is meant in this model alone comes before what is meant anywhere; hints about values come last.
    """
    known = _known(word)
    own = [hint for hint in known if model in hint.at]
    anywhere = [hint for hint in known if not hint.at and not _of_values(hint)]
    # a kind of joint that is written as a key: `revolute: {...}`
    as_key = [hint for hint in known if not hint.at and _of_values(hint)]
    chosen = (own or anywhere or as_key)[:1]
    return f"in simspec: {chosen[0].text}" if chosen else None


def hint_for_word(word: str, words: Iterable[str]) -> str | None:
    """What to write instead of a word that is none of ``words``; None: not a known word, or known for something else."""
    known = _known(word)
    allowed = set(words)
    for hint in known:
        values = [target.partition("=")[2] for target in hint.targets if "=" in target]
        if values and set(values) <= allowed:
            return f"in simspec: {hint.text!r}" if hint.text in allowed else f"in simspec: {hint.text}"
    return None


def _of_values(hint: Hint) -> bool:
    return any("=" in target for target in hint.targets)
