"""Hints for words that the language does not have: a known foreign word first, then what is spelt alike.

The order matters: by its letters `revolute` is nearer to `free` than to `hinge`.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple


class Hint(NamedTuple):
    """The replacement of a word of another language; a row of ``hint_words.txt``, whose head explains the columns."""

    text: str
    targets: tuple[str, ...]
    models: tuple[str, ...]

    @property
    def of_value(self) -> bool:
        """Whether it replaces a value, not a key."""
        return any("=" in target for target in self.targets)


@functools.cache
def entries() -> tuple[tuple[str, Hint], ...]:
    """Every known foreign word as written, with its hint; a word can have several."""
    found = []
    for line in Path(__file__).with_name("hint_words.txt").read_text("utf-8").splitlines():
        if not line.startswith("#"):
            words, text, targets, models = (*line.split(" | "), "", "")[:4]
            hint = Hint(text, tuple(targets.split()), tuple(models.split()))
            found += [(word, hint) for word in words.split()]
    return tuple(found)


def _plain(word: str) -> str:
    """As words are compared: `halfSize`, `half-size` and `half_size` are one."""
    return "".join(character for character in word.lower() if character.isalnum())


@functools.cache
def hints() -> Mapping[str, tuple[Hint, ...]]:
    """Every known foreign word, without its case, hyphens and underscores."""
    table: dict[str, tuple[Hint, ...]] = {}
    for word, hint in entries():
        table[_plain(word)] = (*table.get(_plain(word), ()), hint)
    return table


def _known(word: str) -> tuple[Hint, ...]:
    return hints().get(_plain(word), ()) if len(word) <= 2 * max(map(len, hints())) else ()


def hint_for_key(word: str, model: str) -> str | None:
    """The replacement of an unknown key of a model of the language (its name, as ``Joint``); None for an unknown word.

    A meaning in this model precedes a general one. Hints about values are last: a kind of joint can be written as a key.
    """
    known = _known(word)
    chosen = [hint for hint in known if model in hint.models]
    chosen += sorted((hint for hint in known if not hint.models), key=lambda hint: hint.of_value)
    return f"in simspec: {chosen[0].text}" if chosen else None


def hint_for_word(word: str, words: Iterable[str]) -> str | None:
    """The replacement of a word that is none of ``words``; None for a word that is unknown, or known for another place."""
    allowed = set(words)
    for hint in _known(word):
        values = {target.partition("=")[2] for target in hint.targets if "=" in target}
        if values and values <= allowed:
            return f"in simspec: {hint.text!r}" if hint.text in allowed else f"in simspec: {hint.text}"
    return None
