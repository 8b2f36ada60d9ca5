"""Methods of integration other than semi-implicit Euler, as engines declare them (``Engine.method``)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from simspec.support.classes import AS_ARMATURE
from simspec.support.declarations import Level, Refinement, Support, exact, unsupported_if
from simspec.world.types import World


@dataclass(frozen=True, slots=True)
class IntegrationMethod:
    """The method by which an engine integrates a world.

    name       as in a sentence: ``"implicitfast"``
    order      p: the deviation from the exact motion decreases as dtᵖ; at least 1
    how        what differs from semi-implicit Euler, as a sentence
    requested  whether a setting of the spec selects it
    """

    name: str
    order: int
    how: str
    requested: bool = False

    def __post_init__(self) -> None:
        if self.order < 1:
            raise ValueError(f"{self.name}: a method of order {self.order} does not converge")

    @property
    def ordinal(self) -> str:
        """The order in words: ``first``."""
        return ORDINALS.get(self.order, f"{self.order}th")


ORDINALS = {1: "first", 2: "second", 3: "third", 4: "fourth", 5: "fifth"}
MethodOf = Callable[[World], IntegrationMethod | None]
"""The method in a world; None: semi-implicit Euler."""


def integration(method_of: MethodOf, *known: IntegrationMethod) -> Support:
    """Of ``physics.integrator``: exact, or in worlds with another method approximate; accepted by name, unless the spec selects
    the method by a setting, or the usual method of each engine. ``known``: the methods that occur, for tables."""

    def refine(world: World) -> Refinement | None:
        method = method_of(world)
        if method is None:
            return None
        return _refinement(method, method.requested or world.physics.integrator != "common")

    names = ", ".join(dict.fromkeys(method.name for method in known))
    how = f"semi-implicit Euler. Other methods are proven in the limit of small timesteps: {names}"
    return exact(how, refine, tuple(_refinement(method) for method in known))


def implicit_damping(method_in_words: Callable[[World], str], how: str = AS_ARMATURE) -> Support:
    """Of ``physics.damping: implicit``: exact, or in worlds that an engine integrates by a method of its own (the setting, as
    in a sentence; "": it does not) not supported."""

    def refine(world: World) -> Refinement | None:
        named = method_in_words(world)
        return unsupported_if(f"{named} has damping of its own, to which dt × damping would add") if named else None

    return exact(how, refine=refine)


def _refinement(method: IntegrationMethod, requested: bool = False) -> Refinement:
    short = f"{method.name}, a method of {method.ordinal} order, replaces semi-implicit Euler"
    return Refinement(Level.APPROXIMATE, method.how, short, requested=requested)
