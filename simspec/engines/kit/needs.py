"""What an engine needs of the machine beside packages of Python, as data: libraries, a compiler, packages of Debian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from simspec.engines.kit.compiled import Compiled, package_version
from simspec.errors import EngineError


class Program(Protocol):
    """A program that is installed by its own makers' means."""

    def version(self) -> str | None:
        """Its version; None where it is not installed, or cannot be used."""
        ...

    def lacking(self) -> EngineError | None:
        """Why it cannot be used; None where it can."""
        ...


@dataclass(frozen=True)
class Needs:
    """What an engine needs of the machine.

    ``library``: what brings the engine where no package of Python does, as pkg-config knows it, with a bound where one is
    needed (``"NAME >= 1.2"``): its version is the engine's. ``parts``: what the engine compiles for itself on first use.
    ``debian``: packages of Debian and Ubuntu that bring the library, what compiles the parts, and the rest, each by name with
    what it is for. ``program``: one that is the engine, and whose version is the engine's. ``elsewhere``: what has to be
    installed and no package brings, in words.
    """

    library: str = ""
    parts: tuple[Compiled, ...] = ()
    debian: tuple[tuple[str, str], ...] = ()
    program: Program | None = None
    elsewhere: str = ""

    def version(self) -> str | None:
        """The version of the library or program; None where there is none, or where what compiles the parts is not there."""
        if self.lacking():
            return None
        if self.program is not None:
            return self.program.version()
        return package_version(self.library) if self.library else None

    def lacking(self) -> tuple[EngineError, ...]:
        """Why parts cannot be compiled, as far as that is known without doing it: compiler, pkg-config, libraries; and why the
        program cannot be used."""
        asked = (*self.parts, *(() if self.program is None else (self.program,)))
        return tuple(error for one in asked if (error := one.lacking()) is not None)

    @property
    def packages(self) -> Mapping[str, str]:
        """The packages of Debian, by name."""
        return dict(self.debian)
