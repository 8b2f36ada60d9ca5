"""Defects planted into a table of laws (``world_laws.py``), for the dialects of all engines that have one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, STEP, Plant, sidecar

ADDED_LAW = '{"first": "nothing", "second": "nothing", "friction": 0.5, "restitution": 0}'
"""A law of what is not there, which a complete self-test adds."""


def _law(names: set[str], change: Callable[[dict[str, Any]], None]) -> Plant:
    """A defect in the law of two materials."""

    def edit(content: dict[str, Any]) -> None:
        change(next(law for law in content["laws"] if {law["first"], law["second"]} == names))

    return sidecar(edit)


def _first(change: Callable[[dict[str, Any]], None]) -> Plant:
    """A defect in the first law."""
    return sidecar(lambda content: change(content["laws"][0]))


def _number(name: str, by: float = 0.0, times: float = 1.0) -> Callable[[dict[str, Any]], None]:
    return lambda law: law.update({name: law[name] * times + by})


def _exchanged(content: dict[str, Any]) -> None:
    """Ice and rubber, and rubber with itself, have each other's law."""
    one = next(law for law in content["laws"] if {law["first"], law["second"]} == {"ice", "rubber"})
    other = next(law for law in content["laws"] if law["first"] != law["second"] and law is not one)
    names = ("first", "second")
    for key in {*one, *other} - set(names):
        one[key], other[key] = other[key], one[key]


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "friction": _first(_number("friction", by=-STEP)),
    "restitution": _first(_number("restitution", by=-STEP)),
    "pair value": _law({"ice", "rubber"}, _number("friction", times=0.5)),
    "torsional friction": _first(_number("torsional_friction", times=0.5)),
    "rolling friction": _first(_number("rolling_friction", times=0.5)),
    "copy filter": sidecar(_exchanged),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
}
"""What holds for all of them; ``GROUND``, margins, hardness and armature are each engine's own."""
