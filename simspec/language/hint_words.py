"""Words of other languages of models and of plain speech, and what the language says instead.

How they are looked up stands in :mod:`simspec.language.hints`; a test holds every target against the language's schema.
"""

from __future__ import annotations

from simspec.language.hint import Hint
from simspec.language.hint_words_bodies import BODY_WORDS
from simspec.language.hint_words_scenario import SCENARIO_WORDS

ENTRIES: tuple[tuple[str, Hint], ...] = (*BODY_WORDS, *SCENARIO_WORDS)
