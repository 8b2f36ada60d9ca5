"""One check of a proof: what was held against what, how often, how closely, and where it was worst."""

from __future__ import annotations

import math
from dataclasses import dataclass

TEXT_TOLERANCE = 1e-12
"""L0: numbers are printed to round-trip; left is the way from a tensor to principal axes and back, whose largest moment may
be clipped by 2⁻⁴⁰ ≈ 9e-13 (``world/inertia.py``), and frames composed and undone (a few last bits)."""
MODEL_TOLERANCE = 1e-9
"""L1 to L4: engines keep doubles, but diagonalise inertias, shift frames and invert matrices; all stay below 1e-10 when they
are told the same model (measured), while the smallest real error of a model, a digit lost in printing, is 1e-7."""


TOO_CHAOTIC = "its contact-free motion is too chaotic"
"""How the reason begins for which a motion is there and not compared; it stands in the verdict."""
NOTHING = "nothing was compared"
"""Name of the failed check that stands for a level, or a part of one, that the world has and nobody compared."""


@dataclass(frozen=True, slots=True)
class Check:
    """``worst`` is the largest deviation, in units of the quantity's own scale; None when something differs in kind (a
    joint's type, a missing body), which no number can say. ``where`` is its place, ``detail`` what was found there.

    The verdict follows from these figures and is not stored: see :attr:`passed`. Raises ValueError for figures that are none
    (a negative count, a deviation or tolerance below zero or not finite, a deviation of nothing).
    """

    level: str
    name: str
    count: int
    tolerance: float
    worst: float | None
    where: str
    detail: str = ""

    def __post_init__(self) -> None:
        numbers = [self.tolerance] if self.worst is None else [self.tolerance, self.worst]
        if self.count < 0 or not all(math.isfinite(number) and number >= 0.0 for number in numbers):
            raise ValueError(f"{self.level} {self.name}: count {self.count}, worst {self.worst} of {self.tolerance}")
        if not self.count and self.worst is not None:
            raise ValueError(f"{self.level} {self.name}: a deviation of {self.worst}, and nothing compared")

    @property
    def passed(self) -> bool:
        """Whether something was compared, and all of it is within the tolerance."""
        return self.count > 0 and self.worst is not None and self.worst <= self.tolerance


class Tally:
    """Collects deviations into one check for each (level, name)."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], tuple[int, float, float | None, str, str]] = {}

    def add(
        self, level: str, name: str, tolerance: float, deviation: float | None, where: str, detail: str = ""
    ) -> None:
        """Note one deviation; None (or NaN) = different in kind, worse than any number."""
        if deviation is not None and not math.isfinite(deviation):
            deviation, detail = None, detail or f"deviation is {deviation}"
        count, _, worst, place, explained = self._rows.get((level, name), (0, tolerance, 0.0, "", ""))
        if worst is not None and (deviation is None or deviation > worst or not count):
            worst, place, explained = deviation, where, detail
        self._rows[level, name] = (count + 1, tolerance, worst, place, explained)

    def equal(self, level: str, name: str, expected: object, actual: object, where: str) -> bool:
        """Note whether two things are the same."""
        same = expected == actual
        self.add(level, name, 0.0, 0.0 if same else None, where, "" if same else f"{actual}, should be {expected}")
        return same

    def checks(self) -> list[Check]:
        """The checks, in the order in which they were first noted within their levels."""
        return [
            Check(level, name, count, tolerance, worst, where, detail)
            for (level, name), (count, tolerance, worst, where, detail) in sorted(
                self._rows.items(), key=lambda item: item[0][0]
            )
        ]


def failed(level: str, name: str, detail: str) -> Check:
    """A check that could not be made at all, and so has failed."""
    return Check(level, name, 0, 0.0, None, "", detail)
