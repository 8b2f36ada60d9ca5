"""What PyBullet was told while a world was loaded, for what it does not give back.

PyBullet returns few of its settings, and its dump of the world (``bullet_file.py``) lacks some that act: the thresholds of its
solver and of restitution, damping of free flight, velocity clamps, motors, pairs that do not touch. Of these the proof knows
the calls themselves. Steps are not recorded, and what a run does later is not either.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

CHANGING = ("set", "change", "create", "load", "remove", "apply", "enable", "vhacd")
"""Beginnings of the names of PyBullet's functions that change what is simulated; ``reset...`` sets the state, which is read
back."""

Called = tuple[str, tuple[Any, ...], dict[str, Any]]
"""A function's name, its positional arguments, and those by name."""


class Recording:
    """PyBullet's module, with every call of a function that changes something written down."""

    def __init__(self, bullet: Any):
        self._bullet = bullet
        self.calls: list[Called] = []

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._bullet, name)
        return self._recorded(name, found) if name.startswith(CHANGING) else found

    def _recorded(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*positional: Any, **named: Any) -> Any:
            given = {key: value for key, value in named.items() if key != "physicsClientId"}
            self.calls.append((name, positional, given))
            return function(*positional, **named)

        return call
