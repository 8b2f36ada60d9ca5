"""Numbers that are written as no reader should take them, and that some take: commas between them, more than are asked for, or
something behind the last digit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Final

from simspec.imports.draft import Draft
from simspec.imports.elements import Element
from simspec.numerals import NUMBER, SPACE, parts_of

DAMAGED: Final = "damaged-numbers"
RULES: Final = {
    DAMAGED: "commas between numbers are spaces, of too many numbers the first count, a point behind a number does not"
}
COUNTS: Final[Mapping[str, Mapping[str, int]]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "box": {"size": 3},
    "mesh": {"scale": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""How many numbers an attribute has, by elements."""
SEPARATOR: Final = re.compile(rf"[{SPACE},;]+")
BEHIND: Final = re.compile(r"\.?[fF]?")
"""What may follow a number's digits: a second point, the mark of single precision."""


HOLDERS: Final = ("inertial", "visual", "collision", "geometry", "joint")
"""What such elements are read in."""


def mend(root: Element, draft: Draft) -> None:
    """Where numbers of links and joints are damaged, report it, or by the rule write them as they are meant."""
    for part in root.look("link", "joint"):
        for element in part.within():
            if element.parent is not None and element.parent.tag in HOLDERS:
                _mend(element, draft)


def _mend(element: Element, draft: Draft) -> None:
    for name, count in COUNTS.get(element.tag, {}).items():
        text = element.attributes.get(name)
        if text is None or _is_whole(text, count):
            continue
        meant = _meant(text, count)
        if meant is None:
            continue  # reported where it is read
        said = f"{name} of <{element.tag}>"
        if draft.repairing(DAMAGED):
            draft.repaired(DAMAGED, element, f"{said} {text[:80]!r} became {meant!r}", ("model", "bodies"))
        else:
            what = "a finite number" if count == 1 else f"{count} finite numbers"
            draft.defect(element, f"{said} should be {what}", DAMAGED, RULES[DAMAGED], found=text[:80])
        element.attributes[name] = meant


def _is_whole(text: str, count: int) -> bool:
    parts = parts_of(text)
    return len(parts) == count and all(NUMBER.fullmatch(part) for part in parts)


def _meant(text: str, count: int) -> str | None:
    """The numbers that are meant; None where these cannot be told."""
    parts = [part for part in SEPARATOR.split(text) if part]
    meant: list[str] = []
    for part in parts:
        found = NUMBER.match(part)
        if found is None or not BEHIND.fullmatch(part, found.end()) or not math.isfinite(float(found.group())):
            return None
        meant.append(found.group())
    exact = "," in text or ";" in text  # a comma may be that of a decimal fraction: one number too many
    return " ".join(meant[:count]) if len(meant) == count or (len(meant) > count > 1 and not exact) else None
