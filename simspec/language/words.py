"""The types that fields have: names, words of a closed list, flags, texts, solver settings; and hints for unknown words."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from simspec.errors import UNSEEN_CHARACTERS
from simspec.language.quantities import Reader
from simspec.language.strict import fault, near, show

# Hints: a known foreign word first, then what is spelt alike: by its letters `revolute` is nearer to `free` than to `hinge`.


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


NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")
NAME_RULE = "letters, digits, _ and -, beginning with a letter or _"
LONGEST_NAME = 200
LONGEST_TEXT = 1000
"""Characters of a path, a description, the name of a feature: messages and files of results quote them."""


@dataclass(frozen=True)
class Name(Reader):
    """A name. With ``path``, names of models and bodies (or what ``of`` says) in them joined by ``/``."""

    path: bool = False
    of: str = "body"

    def read(self, value: Any) -> str:
        if not isinstance(value, str):
            hint = f'put it in quotes, beginning with a letter: "n{value}"' if type(value) in (int, float) else None
            raise fault("expected a name", show(value), NAME_RULE, hint, code="S301")
        parts = value.split("/") if self.path else [value]
        if all(NAME.fullmatch(part) for part in parts) and len(value) <= LONGEST_NAME and len(parts) <= 2:
            return value
        if len(value) > LONGEST_NAME:
            raise fault("too long a name", show(value), f"{LONGEST_NAME} characters", code="S109")
        raise fault("not a valid name", show(value), NAME_RULE, f"did you mean {clean_name(value)!r}?", code="S301")

    def describe(self) -> str:
        return f"a {self.of}'s full name" if self.path else "a name"

    def schema(self) -> dict[str, Any]:
        part = NAME.pattern
        return {"type": "string", "pattern": f"^{part}(/{part})?$" if self.path else f"^{part}$"}


def clean_name(text: str) -> str:
    """The nearest text that may be a name."""
    import unicodedata

    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    clean = re.sub(r"[^A-Za-z0-9_-]+", "_", plain).strip("_-")
    return clean if NAME.fullmatch(clean) else f"n_{clean}".rstrip("_")


@dataclass(frozen=True)
class Word(Reader):
    """One of a closed list of words."""

    words: tuple[str, ...]

    def read(self, value: Any) -> str:
        if isinstance(value, str) and value in self.words:
            return value
        hint = (hint_for_word(value, self.words) or near(value, self.words)) if isinstance(value, str) else None
        raise fault("not an allowed word", show(value), ", ".join(self.words), hint, code="S111")

    def describe(self) -> str:
        return " \\| ".join(f"`{word}`" for word in self.words)

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.words)}


@dataclass(frozen=True)
class Flag(Reader):
    """true or false."""

    WORDS = "true or false"
    SCHEMA: ClassVar = {"type": "boolean"}

    def read(self, value: Any) -> bool:
        if type(value) is not bool:
            raise fault("expected true or false", show(value), "true, false", code="S104")
        return value


@dataclass(frozen=True)
class Text(Reader):
    """Free text."""

    WORDS = "a text"
    SCHEMA: ClassVar = {"type": "string"}

    def read(self, value: Any) -> str:
        if not isinstance(value, str):
            raise fault("expected a text", show(value), "a text; in quotes where it looks like a number", code="S104")
        if len(value) > LONGEST_TEXT:
            raise fault("too long a text", show(value), f"{LONGEST_TEXT} characters", code="S109")
        return value


@dataclass(frozen=True)
class Texts(Reader):
    """A list of texts; a single one stands for a list of it."""

    WORDS = "a text, or a list of texts"
    SCHEMA: ClassVar = {"anyOf": [Text().schema(), {"type": "array", "items": Text().schema()}]}

    def read(self, value: Any) -> list[str]:
        if isinstance(value, (list, tuple)):
            return [Text().read(item) for item in value]
        return [Text().read(value)]


@dataclass(frozen=True)
class FileName(Text):
    """The path of a file, as it is written."""

    def read(self, value: Any) -> str:
        path = super().read(value)
        if unseen := UNSEEN_CHARACTERS.search(path):
            raise fault(
                "paths cannot contain such characters", f"U+{ord(unseen.group()):04X} in {show(value)}", code="S301"
            )
        return path


@dataclass(frozen=True)
class SettingValue(Reader):
    """A solver setting: a number, a word, true or false. Engines know their own; nothing is converted."""

    WORDS = "a number, a word, true or false"
    SCHEMA: ClassVar = {"type": ["boolean", "number", "string"]}

    def read(self, value: Any) -> bool | int | float | str:
        if isinstance(value, float) and value - value != 0.0:
            raise fault("not a finite number", show(value), code="S203")
        if not isinstance(value, (bool, int, float, str)):
            raise fault("expected a number, a word, true or false", show(value), code="S104")
        if isinstance(value, int) and abs(value) >= 2**63:
            raise fault("too large a number", show(value), code="S202")
        return value
