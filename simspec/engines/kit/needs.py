"""What an engine needs of the machine beside packages of Python, as data: libraries, a compiler, packages of Debian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from simspec.engines.kit.compiled import Compiled, CompileError, package_version


@dataclass(frozen=True)
class Needs:
    """What an engine needs of the machine.

    ``library``: what brings the engine where no package of Python does, as pkg-config knows it, with a bound where one is
    needed (``"NAME >= 1.2"``): its version is the engine's. ``parts``: what the engine compiles for itself on first use.
    ``debian``: packages of Debian and Ubuntu that bring the library, what compiles the parts, and the rest, each by name with
    what it is for.
    """

    library: str = ""
    parts: tuple[Compiled, ...] = ()
    debian: tuple[tuple[str, str], ...] = ()

    def version(self) -> str | None:
        """The version of the library; None where there is none, or where what compiles the parts is not there."""
        return package_version(self.library) if self.library and not self.lacking() else None

    def lacking(self) -> tuple[CompileError, ...]:
        """Why parts cannot be compiled, as far as that is known without doing it: compiler, pkg-config, libraries."""
        return tuple(error for part in self.parts if (error := part.lacking()) is not None)

    @property
    def packages(self) -> Mapping[str, str]:
        """The packages of Debian, by name."""
        return dict(self.debian)
