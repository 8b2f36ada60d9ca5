"""A hint: what to write instead of a word of another language of models."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Hint:
    """What to write instead of a word.

    text     the hint itself
    targets  what it names, as MODEL.FIELD or MODEL.FIELD=WORD of the language; none: the language has nothing like it yet
    at       the models in which the word means this; none: anywhere
    """

    text: str
    targets: tuple[str, ...] = ()
    at: tuple[str, ...] = ()


def same_hint(words: str, text: str, *targets: str, at: str = "") -> list[tuple[str, Hint]]:
    """One hint for several words."""
    return [(word, Hint(text, targets, tuple(at.split()))) for word in words.split()]


NOT_YET = "not supported yet"
