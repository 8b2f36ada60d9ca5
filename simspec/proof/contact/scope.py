"""Which kinds of contact the probes of level L5 measured for a world, and which not, with the reason: what a verdict must
say, since a law that is right between two bodies says little of a stack.

A kind is a group of probes. A world either has such contact, or does not for a reason that follows from the world alone; so
a stored certificate is judged by the same function.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from simspec.proof.contact.compliance import LYING
from simspec.proof.contact.declared import EFFECTS
from simspec.world.contact_pairs import meeting_laws
from simspec.world.reach import Reach, reach
from simspec.world.types import World

MEASURED = "measured"
NO_FIGURE = "not measured: none of its probes gave a figure"
NONE_HERE = "none in this world: "


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of contact: the probes that measure it, by the names of their figures, and why a world has none of it ("" where
    it has some)."""

    probes: tuple[str, ...]
    missing: Callable[[World], str]


def _meets(world: World) -> str:
    return "" if meeting_laws(world) else "no two shapes may touch"


def _several(world: World) -> str:
    there = [reach(world, *pair) for pair in meeting_laws(world)]
    return (
        ""
        if any(dataclasses.replace(one, kinds=(), plane=False) != Reach() for one in there)
        else "each body can touch one flat surface alone"
    )


def _clamps(world: World) -> str:
    there = any(law.friction and reach(world, *pair).jams for pair, law in meeting_laws(world).items())
    return (
        ""
        if there
        else "no body with friction has room for another between two of its shapes, or fits between two walls"
    )


def _pressed(world: World) -> str:
    there = any(law.friction and reach(world, *pair).squeezes for pair, law in meeting_laws(world).items())
    return "" if there else "no body on a joint can press a face, or none with friction"


def _carriers(world: World) -> str:
    there = any(law.friction and reach(world, *pair).carries for pair, law in meeting_laws(world).items())
    return "" if there else "nothing lies on what moves"


def _compliant(world: World) -> str:
    stiff = [pair for pair, law in meeting_laws(world).items() if law.hardness.kind == "stiffness"]
    if not stiff:
        return "no stiffness is stated"
    several = any(set(reach(world, *pair).kinds) & BORNE for pair in stiff)
    return "" if several else "all that is compliant touches in one point"


def _slides(world: World) -> str:
    return "" if any(law.friction for law in meeting_laws(world).values()) else "no pair has friction"


SEVERAL = (
    *("rod", "rod-slips", "clamp", "clamp-slips", "pile", "pile-slips", "strike", "row", "edge", "cross"),
    *("stack", "stack-slides", "stack-stays", "stack-slides-plane", "stack-stays-plane"),
)
"""Probes of several bodies, or of several contacts of one."""
SQUEEZED = ("squeeze", "squeeze-slips", "squeeze-turns")
JAMS = ("jam", "jam-light")
_OTHERS = (
    *SEVERAL,
    *JAMS,
    *SQUEEZED,
    *(f"{name}-energy" for name in SEVERAL),
    "stack-sideways",
    "cross-sideways",
    "carrier",
    "slide-spin",
    "compliance-shape",
)
PAIRS = tuple(probe for probe in EFFECTS if probe not in _OTHERS)
"""Probes of one contact."""
BORNE = {body.kind for body in LYING.values()}
"""Kinds of shapes that lie on several points."""
KINDS: Mapping[str, Kind] = {
    "contact of two bodies": Kind(PAIRS, _meets),
    "contact of several bodies": Kind(SEVERAL, _several),
    "clamps that friction alone presses": Kind(JAMS, _clamps),
    "faces that joints press": Kind(SQUEEZED, _pressed),
    "contact on accelerating carriers": Kind(("carrier",), _carriers),
    "compliance by shape": Kind(("compliance-shape",), _compliant),
    "sliding with spin": Kind(("slide-spin",), _slides),
}
"""By name, in the order of verdicts."""


def scope(world: World, probes: Iterable[str]) -> dict[str, str]:
    """By kind of contact whether it was measured, or why not; ``probes``: the names of the figures that there are. Empty
    where nothing can touch."""
    if not meeting_laws(world):
        return {}
    there = set(probes)
    return {name: _state(kind, world, there) for name, kind in KINDS.items()}


def _state(kind: Kind, world: World, there: set[str]) -> str:
    if why := kind.missing(world):
        return NONE_HERE + why
    return MEASURED if there & set(kind.probes) else NO_FIGURE


def unmeasured(states: Mapping[str, str]) -> dict[str, str]:
    """The kinds that the world has and nobody measured, with the reason."""
    return {
        name: state.removeprefix("not measured: ")
        for name, state in states.items()
        if state != MEASURED and not state.startswith(NONE_HERE)
    }
