"""What an engine needs of the machine beside packages of Python, as data: libraries, a compiler, packages of Debian."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simspec.engines.kit.compiled import Compiled, package_version
from simspec.errors import EngineError


@dataclass(frozen=True)
class Needs:
    """What an engine needs of the machine.

    ``library``: what brings the engine where no package of Python does, as pkg-config knows it, with a bound where one is
    needed (``"NAME >= 1.2"``): its version is the engine's. ``parts``: what the engine compiles for itself on first use.
    ``debian``: packages of Debian and Ubuntu that bring the library, what compiles the parts, and the rest, each by name with
    what it is for.

    ``look``: finds a program that no package brings, and gives its version, None where there is none, and what is missing or
    wrong of it; ``elsewhere``: the words that say how to get it.
    """

    library: str = ""
    parts: tuple[Compiled, ...] = ()
    debian: tuple[tuple[str, str], ...] = ()
    elsewhere: str = ""
    look: Callable[[], tuple[str | None, tuple[EngineError, ...]]] | None = None

    def version(self) -> str | None:
        """The version of the library or the program; None where there is none, or where something of it, or what compiles the
        parts, is not there."""
        return self.found() if not self.lacking() else None

    def found(self) -> str | None:
        """The same, whatever else is missing."""
        if self.look is not None:
            return self.look()[0]
        return package_version(self.library) if self.library else None

    def lacking(self) -> tuple[EngineError, ...]:
        """Why parts cannot be compiled, as far as that is known without doing it (compiler, pkg-config, libraries), and what is
        missing or wrong of the program."""
        parts = tuple(error for part in self.parts if (error := part.lacking()) is not None)
        return parts if self.look is None else (*parts, *self.look()[1])

    @property
    def packages(self) -> Mapping[str, str]:
        """The packages of Debian, by name."""
        return dict(self.debian)
