"""Names of bodies in MJCF."""

from __future__ import annotations

from typing import Final

_RESERVED: Final = {"world": "world."}
"""The static root is called ``world``; a body of that name gets one that no spec can give."""


def file_name(name: str) -> str:
    """The name of a body in the file."""
    return _RESERVED.get(name, name)


def world_name(name: str) -> str:
    """The inverse of :func:`file_name`."""
    return {there: here for here, there in _RESERVED.items()}.get(name, name)
