"""What the contact figures of a proof rest on: how many pass by a declared deviation alone, how wide these are, and which
effects are absent.

A deviation says how far an engine is known to be off in a probe (``Engine.CONTACT_DEVIATIONS``). Where it is so wide that an
engine without the effect would pass, the figure shows nothing of the effect: the effect is then called absent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from simspec.proof.contact.probe import Figure

EFFECTS: Mapping[str, str] = {
    "push": "sliding friction",
    "push-oblong": "sliding friction",
    "stop": "sliding friction",
    "stop-oblong": "sliding friction",
    "stick": "static friction",
    "carry": "friction on moving surfaces",
    "restitution": "restitution",
    "threshold": "restitution threshold",
    "rest": "support at rest",
    "steady": "rest",
    "overlap": "recovery of overlaps",
    "oblique": "friction in impacts",
    "oblique-separation": "restitution of oblique impacts",
    "compliance": "compliance",
    "compliance-shape": "compliance by shape",
    "torsional": "torsional friction",
    "rolling": "rolling friction",
    "rod": "friction of leaning bodies",
    "rod-slips": "friction of leaning bodies",
    "clamp": "friction of clamped bodies",
    "clamp-slips": "friction of clamped bodies",
    "jam": "friction that alone presses a clamp",
    "jam-light": "friction that alone presses a clamp",
    "squeeze": "friction between fingers",
    "squeeze-slips": "friction between fingers",
    "squeeze-turns": "even pressure of faces",
    "pile": "friction in piles",
    "pile-slips": "friction in piles",
    "strike": "impacts on several bodies",
    "strike-energy": "energy of impacts on several bodies",
    "row": "impacts on several bodies",
    "row-energy": "energy of impacts on several bodies",
    "edge": "impacts on several corners",
    "edge-energy": "energy of impacts on several corners",
    "stack": "heavy bodies on light ones",
    "stack-sideways": "heavy bodies on light ones",
    "stack-slides": "friction of heavy bodies on light ones",
    "stack-stays": "friction of heavy bodies on light ones",
    "stack-slides-plane": "friction of heavy bodies on light ones",
    "stack-stays-plane": "friction of heavy bodies on light ones",
    "cross": "boxes whose edges cross",
    "cross-sideways": "boxes whose edges cross",
    "carrier": "friction on accelerating carriers",
    "slide-spin": "friction of sliding with spin",
}
"""By probe the effect that its figures measure; a probe that is not named here has its name."""


@dataclass(frozen=True, slots=True)
class Declared:
    """Of ``figures`` contact figures ``declared`` pass by a declared deviation alone; ``widest``: the one with the largest
    :attr:`Figure.width`; ``absent``: the probes of effects that are absent; ``cached``: figures that come from the cache."""

    figures: int
    declared: int
    widest: Figure | None
    absent: tuple[str, ...]
    cached: int

    @property
    def width(self) -> str:
        """The widest deviation in words: "oblique 99 %"; empty where there is none."""
        return "" if self.widest is None else f"{self.widest.probe} {told_width(self.widest)}"

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that are absent, in words."""
        return tuple(dict.fromkeys(EFFECTS.get(probe, probe) for probe in self.absent))

    @property
    def words(self) -> str:
        """In a line: "28 of 70 contact figures by declared deviation, widest: oblique 99 %; absent: friction in impacts". Empty
        where nothing passes by declared deviation."""
        if self.widest is None:
            return ""
        absent = f"; absent: {', '.join(self.effects)}" if self.absent else ""
        return f"{self.declared} of {self.figures} contact figures by declared deviation, widest: {self.width}{absent}"

    def data(self) -> dict[str, object]:
        """The same as plain data."""
        widest = None
        if self.widest is not None:
            figure = self.widest
            widest = {
                "probe": figure.probe,
                "subject": figure.subject,
                "case": figure.case,
                "quantity": figure.quantity,
                "width": figure.width if math.isfinite(figure.width) else None,
                "of": "expected" if figure.expected else "tolerance",
            }
        return {
            "figures": self.figures,
            "declared": self.declared,
            "widest": widest,
            "absent": list(self.absent),
            "absent_effects": list(self.effects),
            "cached": self.cached,
        }


def declared(figures: Sequence[Figure]) -> Declared:
    """What the contact figures of one engine rest on."""
    by = [figure for figure in figures if figure.declared]
    widest = max(by, key=lambda figure: figure.width, default=None)
    absent = tuple(dict.fromkeys(figure.probe for figure in by if figure.absent))
    return Declared(len(figures), len(by), widest, absent, sum(figure.cached for figure in figures))


def told_width(figure: Figure) -> str:
    """The width of a figure's tolerance: in per cent of the expected value, or as a multiple of the probe's tolerance."""
    if not math.isfinite(figure.width):
        return "of any size"
    value = 100.0 * figure.width if figure.expected else figure.width
    text = f"{value:,.0f}" if value >= 10.0 else f"{value:.2g}"
    return f"{text} %" if figure.expected else f"{text} times its tolerance"
