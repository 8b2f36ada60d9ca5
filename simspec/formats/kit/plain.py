"""Plain files: a world in a format for any tool, and what of it the files do not carry."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from simspec.support.declarations import Level, Table
from simspec.support.needs import needs
from simspec.world.types import World


class Fate(StrEnum):
    """What becomes of something that a spec says and a file of the format does not."""

    LEFT_OUT = "left out"
    """It is not in the files."""
    APPROXIMATED = "approximated"
    """Something else stands in the files, nearly the same."""
    BESIDE = "beside"
    """It stands in a file of simspec's own beside them, which no tool reads."""
    PLACEHOLDER = "placeholder"
    """The format demands a value where the spec has none; one stands there that never acts."""


FATES: Final[Mapping[Level, Fate]] = {
    Level.VIA_API: Fate.BESIDE,
    Level.APPROXIMATE: Fate.APPROXIMATED,
    Level.OUTSIDE: Fate.LEFT_OUT,
    Level.UNSUPPORTED: Fate.LEFT_OUT,
}
"""What becomes of a feature that a format has at this level."""


@dataclass(frozen=True, slots=True)
class Loss:
    """One feature that the files do not carry: its name, what happens to it and how, and the places of the spec that use it."""

    feature: str
    fate: Fate
    how: str
    paths: tuple[str, ...]

    @property
    def of_the_model(self) -> bool:
        """Whether bodies, joints or shapes are not what the spec says; what else is lost belongs to the scene around them."""
        return self.fate in (Fate.LEFT_OUT, Fate.APPROXIMATED) and any(
            path.startswith("bodies.") for path in self.paths
        )


@dataclass(frozen=True, slots=True)
class Plain:
    """The files of a world as {relative path: text}, and all that they do not carry of it."""

    files: Mapping[str, str]
    losses: tuple[Loss, ...]


def losses(world: World, table: Table, more: Iterable[Loss] = ()) -> tuple[Loss, ...]:
    """What a format with this table does not carry of a world, in the order of the features; then ``more``."""
    lost = []
    for need in needs(world, world.contact.pairs):
        support = table[need.feature].in_world(world)
        if support.level is not Level.EXACT:
            lost.append(Loss(need.feature.value, FATES[support.level], support.how, need.paths))
    return (*lost, *more)
