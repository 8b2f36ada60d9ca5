"""Methods of early parts of simspec whose functions are in later parts, imported when they are used: no circle of imports."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from types import MethodType
from typing import Any


class Method:
    """A method whose function is imported when it is first used. ``home``: its module and name; it takes the object first."""

    def __init__(self, home: str):
        self._module, _, self._name = home.partition(":")

    def __get__(self, instance: object, owner: type | None = None) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(import_module(self._module), self._name)
        return function if instance is None else MethodType(function, instance)
