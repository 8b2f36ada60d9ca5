"""Hints for words that the language does not have: a known foreign word first, then what is spelt alike.

The order matters: by its letters `revolute` is nearer to `free` than to `hinge`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from simspec.language.hint import Hint
from simspec.language.hint_words import ENTRIES


def _plain(word: str) -> str:
    """As words are compared: `halfSize`, `half-size` and `half_size` are one."""
    return "".join(character for character in word.lower() if character.isalnum())


def _table() -> Mapping[str, tuple[Hint, ...]]:
    found: dict[str, tuple[Hint, ...]] = {}
    for word, hint in ENTRIES:
        found[_plain(word)] = (*found.get(_plain(word), ()), hint)
    return found


HINTS: Mapping[str, tuple[Hint, ...]] = _table()
"""Every known foreign word, without its case, hyphens and underscores."""
LONGEST = max(map(len, HINTS))


def hint_for_key(word: str, model: str) -> str | None:
    """What to write instead of an unknown key of a model of the language (its name, as ``Joint``); None: not a known word.

    What is meant in this model alone comes before what is meant anywhere; hints about values come last.
    """
    known = HINTS.get(_plain(word), ()) if len(word) <= 2 * LONGEST else ()
    own = [one for one in known if model in one.at]
    anywhere = [one for one in known if not one.at and not _of_values(one)]
    # a kind of joint that is written as a key: `revolute: {...}`
    as_key = [one for one in known if not one.at and _of_values(one)]
    found = (own or anywhere or as_key)[:1]
    return f"in simspec: {found[0].text}" if found else None


def hint_for_word(word: str, words: Iterable[str]) -> str | None:
    """What to write instead of a word that is none of ``words``; None: not a known word, or known for something else."""
    known = HINTS.get(_plain(word), ()) if len(word) <= 2 * LONGEST else ()
    allowed = set(words)
    for one in known:
        values = [target.partition("=")[2] for target in one.targets if "=" in target]
        if values and set(values) <= allowed:
            return f"in simspec: {one.text!r}" if one.text in allowed else f"in simspec: {one.text}"
    return None


def _of_values(hint: Hint) -> bool:
    return any("=" in target for target in hint.targets)
