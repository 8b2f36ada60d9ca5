"""What follows from a world is worked out once, and kept for as long as the world lives.

A world never changes, and on its way from the spec to the printed table many parts ask for the same: its rigid groups, the laws
of its pairs, its hash. Results are kept by the world as an object, not by what it equals: comparing two worlds costs more than
most of what is kept here.
"""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable, Hashable
from typing import Concatenate, ParamSpec, TypeVar

World = TypeVar("World")
More = ParamSpec("More")
Result = TypeVar("Result")

_KEPT: dict[int, dict[Hashable, object]] = {}
"""By the identity of a living world, what was worked out of it, by function and further arguments."""


def derived(function: Callable[Concatenate[World, More], Result]) -> Callable[Concatenate[World, More], Result]:
    """``function`` of a world and of further hashable arguments by position, called once for each world and arguments.

    What it gives is shared by everybody who asks: it must be immutable (or be treated so), and must not hold the world, which
    would then never end.
    """

    @functools.wraps(function)
    def once(world: World, /, *more: More.args, **named: More.kwargs) -> Result:
        if named:
            raise TypeError(f"{function.__name__} takes its arguments by position")
        kept = _KEPT.get(id(world))
        if kept is None:
            weakref.finalize(world, _KEPT.pop, id(world), None).atexit = False
            kept = _KEPT[id(world)] = {}
        key = (function, *more)
        if key not in kept:
            kept[key] = function(world, *more, **named)
        result: Result = kept[key]  # type: ignore[assignment]
        return result

    return once
