"""What a format is: a language that files are written in. It knows no engine; several may read it, each in its dialect."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from simspec.errors import Problem, SpecError, UnsupportedError
from simspec.formats.kit.plain import Plain
from simspec.plugins import Offered, offered
from simspec.support.declarations import Table, check_total
from simspec.world.types import Body, World


class Format:
    """A language of files. Subclasses are in ``formats/<name>/format.py``."""

    NAME: ClassVar[str]
    SUPPORT: ClassVar[Table]
    """What files of the language carry of each feature, whoever reads them. ``via_api`` = it stands beside them, in a file of
    simspec's own. For plain files; dialects have tables of their own."""
    PROFILES: ClassVar[tuple[str, ...]] = ()
    """Names of the ways in which the same plain files can be laid out, the default first."""

    RANGED: ClassVar[tuple[str, ...]] = ()
    """Kinds of joints to which plain files give a range where the world has no limits."""
    DRIVES: ClassVar[bool] = False
    """Whether plain files say a joint's spring and damper and the gains of its controller as one."""

    SINGLE: ClassVar[tuple[str, ...]] = ()
    """Ends of the names of single files that the same plain files can be written as."""

    def single(self, plain: Plain, suffix: str) -> bytes:
        """Plain files as one file of this kind, one of ``SINGLE``."""
        raise NotImplementedError

    def in_profile(self, name: str) -> Format:
        """The format whose plain files are laid out so. Raises SpecError for a name that is not of ``PROFILES``."""
        allowed = ", ".join(self.PROFILES) or f"none: {self.NAME} has one layout"
        raise SpecError([Problem(f"{self.NAME} has no profile {name!r}", allowed=allowed)])

    def parts(self, world: World, files: Mapping[str, str]) -> Mapping[str, tuple[Body, ...]]:
        """Those of the plain files of a world that readers load, each with the bodies that it has."""
        return {}

    def closes_loops(self, world: World) -> bool:
        """Whether plain files have joints that close loops."""
        return False

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if hasattr(cls, "SUPPORT"):
            check_total(f"format {cls.NAME}", cls.SUPPORT)

    def write(self, tree: Any) -> dict[str, str]:
        """The files of ``tree``, the format's own tree of plain values (its module ``tree.py``), as {relative path: text}."""
        raise NotImplementedError

    def read(self, folder: Path) -> Any:
        """The format's own document (its module ``document.py``) of the files in ``folder``, by a parser that is neither the
        writer's nor an engine's. Raises ValueError, which names the place, for what is not of the language."""
        raise NotImplementedError

    def plain(self, world: World) -> Plain:
        """``world`` in plain files for any tool, with all that they do not carry. Raises UnsupportedError where this format
        does not write plain files."""
        raise UnsupportedError(
            [Problem(f"{self.NAME} does not support plain files yet", hint="simspec compile --engine")]
        )


@functools.cache
def _offered() -> Offered:
    return offered("simspec.formats", _sound)


def _sound(name: str, kind: Any) -> Format:
    """The format, if it is one that can be used. Raises TypeError, ValueError."""
    if not (isinstance(kind, type) and issubclass(kind, Format)):
        raise TypeError("it is not a Format")
    if not hasattr(kind, "NAME") or name != kind.NAME:
        raise ValueError(f"its NAME is {getattr(kind, 'NAME', None)!r}")
    return kind()


def formats() -> Mapping[str, Format]:
    """Every installed format by name (entry points ``simspec.formats``)."""
    return _offered().good


def broken_formats() -> Mapping[str, str]:
    """The formats that are offered and cannot be used, with the reason."""
    return _offered().broken
