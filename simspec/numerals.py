"""The reader of numbers in the texts of files, command lines and variables, in every language; numbers for reading.

A number has the digits 0 to 9, a point, an exponent and a sign, between spaces of ASCII. Other texts that Python reads are
numbers in no language that simspec reads: digits of other scripts (Arabic, full-width), underscores (``1_000``), other kinds of
spaces. ``inf`` and ``nan`` are refused where a finite number is meant. Each refusal says which of these it is.
"""

from __future__ import annotations

import math
import re
from typing import Final

SPACE: Final = " \t\n\r\f\v"
"""Characters that may stand around and between numbers."""
NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
WHOLE: Final = re.compile(r"[+-]?[0-9]+")
MOST_DIGITS: Final = 30
"""Of a whole number; larger ones count nothing."""
_INFINITE = re.compile(r"[+-]?inf(?:inity)?", re.IGNORECASE)
_NAN = re.compile(r"[+-]?nan", re.IGNORECASE)
_FOREIGN = re.compile(r"[\s\d.+\-eE]+")
"""Digits, of any script."""
_UNUSUAL = re.compile(r"[^\t-\r -~]|_")
"""Characters that no list of numbers contains; a list without them is read fast."""


class NumeralError(ValueError):
    """A text that is not the numbers that are meant. ``python_alone``: which of the numerals it has that Python reads and no
    language does; empty for other texts."""

    def __init__(self, why: str, python_alone: str = ""):
        self.python_alone = python_alone
        super().__init__(python_alone or why)

    @property
    def suffix(self) -> str:
        """``python_alone`` behind a sentence of another's."""
        return f": {self.python_alone}" if self.python_alone else ""


def refusal(text: str) -> NumeralError:
    """The error of a text that is no finite number."""
    bare = text.strip(SPACE)
    if any(character.isspace() and character not in SPACE for character in bare):
        return NumeralError("", "it has a space other than the ordinary one, such as a no-break space")
    if any(character.isdecimal() and not character.isascii() for character in bare):
        return NumeralError("", "it has digits other than 0 to 9")
    if "_" in bare and NUMBER.fullmatch(bare.replace("_", "")):
        return NumeralError("", "it has an underscore between digits")
    if _INFINITE.fullmatch(bare) or _NAN.fullmatch(bare):
        return NumeralError("not finite")
    return NumeralError(
        "too large a number" if NUMBER.fullmatch(bare) else "not a number" if bare else "there are no digits"
    )


def like_a_number(text: str) -> str | None:
    """Why a text that a program would take for a number is none (:attr:`NumeralError.python_alone`); None for other texts."""
    return None if text.isascii() or not _FOREIGN.fullmatch(text) else refusal(text).python_alone or None


def number(text: str, *, infinite: bool = False) -> float:
    """The finite number that a text is, with ``infinite`` also ``inf``. Raises NumeralError."""
    bare = text.strip(SPACE)
    if NUMBER.fullmatch(bare) or (infinite and _INFINITE.fullmatch(bare)):
        value = float(bare)
        if math.isfinite(value) or infinite:
            return value
    raise refusal(text)


def numbers(text: str, count: int | None = None) -> tuple[float, ...]:
    """The finite numbers in a text, by spaces; ``count``: how many there must be. Raises NumeralError."""
    if _UNUSUAL.search(text):
        raise refusal(next((part for part in parts_of(text) if not NUMBER.fullmatch(part)), text))
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        raise NumeralError("not numbers") from None
    if not all(map(math.isfinite, values)):
        raise NumeralError("not finite")
    if count is not None and len(values) != count:
        raise NumeralError(f"{len(values)} numbers, should be {count}")
    return values


def whole(text: str) -> int:
    """The whole number that a text is. Raises NumeralError."""
    bare = text.strip(SPACE)
    if WHOLE.fullmatch(bare) and len(bare) <= MOST_DIGITS:
        return int(bare)
    raise NumeralError("not a whole number", refusal(text).python_alone)


def parts_of(text: str) -> list[str]:
    """The parts of a text between spaces of ASCII."""
    return [part for part in re.split(f"[{SPACE}]+", text) if part]


def rounded(value: float, digits: int) -> str:
    """A finite number with ``digits`` significant digits, without an exponent between 1e-4 and 1e15: ``1,840``, ``0.52``."""
    figure = float(f"{value:.{digits}g}")
    if figure and not 1e-4 <= abs(figure) < 1e15:
        return f"{figure:.{digits}g}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(figure))), 0) if figure else 0
    text = f"{figure:,.{decimals}f}"
    return text.rstrip("0").rstrip(".") if decimals else text
