"""The contract of a dialect: how a world is written for an engine in the language of its files, and how the files are read
back."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from simspec.dialects.kit.sidecar import SIDECAR, Sidecar, Target, read_sidecar, sidecar_text
from simspec.errors import Problem, UnsupportedError
from simspec.formats.kit.contract import Format, formats
from simspec.plugins import Plugins
from simspec.support.declarations import Table, check_total
from simspec.world.armature import as_inertia
from simspec.world.canonical import sha256
from simspec.world.types import ReadBack, World

# The solver settings that a dialect needs of every engine that it is for.

KINDS: Mapping[type, str] = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}


@dataclass(frozen=True, slots=True)
class NeededSetting:
    """A setting that a dialect reads.

    kind      ``bool``, ``int``, ``float`` (takes whole numbers too) or ``str``
    words     the texts that it may be
    optional  whether a target may be without it
    by_pair   whether each pair of materials may have a value of its own
    """

    kind: type
    words: tuple[str, ...] = ()
    optional: bool = False
    by_pair: bool = False

    def takes(self, value: object) -> bool:
        """Whether ``value`` is one that the dialect understands."""
        if self.kind is float:
            return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        return type(value) is self.kind and (not self.words or value in self.words)

    @property
    def expected(self) -> str:
        """The required kind of a value, in words."""
        return f"one of {', '.join(self.words)}" if self.words else KINDS[self.kind]


def wrong_settings(needed: Mapping[str, NeededSetting], settings: Mapping[str, object]) -> list[str]:
    """The names of settings that are needed and not there, or of another kind."""
    return [
        name
        for name, setting in needed.items()
        if (not setting.takes(settings[name]) if name in settings else not setting.optional)
    ]


def wrong_pair_settings(needed: Mapping[str, NeededSetting], settings: Mapping[str, object]) -> list[str]:
    """The names of settings of a pair of materials that are not read by pair, or of another kind."""
    return [
        name
        for name, value in settings.items()
        if name not in needed or not needed[name].by_pair or not needed[name].takes(value)
    ]


def check_settings(dialect: str, needed: Mapping[str, NeededSetting], target: Target) -> None:
    """Raise UnsupportedError with every setting that ``target`` lacks, or has of another kind than the dialect reads, or for a
    pair of materials where the dialect reads one value for all."""
    problems = [
        Problem(
            f"the dialect {dialect!r} needs this setting, which {target.engine} does not have"
            if name not in target.settings
            else f"the dialect {dialect!r} does not read this value of the setting",
            f"engines.{target.engine}.settings.{name}",
            found=repr(target.settings[name]) if name in target.settings else None,
            allowed=needed[name].expected,
            code="E105",
        )
        for name in wrong_settings(needed, target.settings)
    ]
    by_pair = ", ".join(name for name, setting in needed.items() if setting.by_pair)
    problems += [
        Problem(
            f"the dialect {dialect!r} does not read this setting of a pair of materials",
            f"engines.{target.engine}.pairs.{first}.{second}.{name}",
            found=repr(settings[name]),
            allowed=by_pair or "no settings of pairs",
            code="E105",
        )
        for (first, second), settings in target.pair_settings.items()
        for name in wrong_pair_settings(needed, settings)
    ]
    if problems:
        raise UnsupportedError(problems)


@dataclass(frozen=True, slots=True)
class Lowered:
    """A world in an engine's dialect: the tree that the format writes, and the sidecar for what the files cannot carry."""

    tree: Any
    sidecar: Sidecar
    """Of the dialect's ``SIDECAR``."""


class Dialect:
    """How a world is written for one engine, or for several, in the files of a format.

    Subclasses are in ``dialects/<name>/dialect.py``, or in ``dialects/<name>.py``. ``DEFECTS`` and ``TABLE`` list the changes
    that the self-tests make: of the module itself, or of ``defects.py`` and ``mutations.py`` next to it.
    """

    NAME: ClassVar[str]
    FORMAT: ClassVar[str]
    """The format of the files."""
    SUPPORT: ClassVar[Table]
    """Support of files and sidecar for each feature. ``via_api`` = it goes into the sidecar."""
    SIDECAR: ClassVar[type[Sidecar]]
    """The class of its sidecar."""
    SETTINGS: ClassVar[Mapping[str, NeededSetting]] = {}
    """The solver settings that it reads from a target: every engine that receives worlds in this dialect must have them."""

    def __init_subclass__(cls, abstract: bool = False, **keywords: Any) -> None:
        """Check that the class declares every feature; ``abstract``: a base of several dialects."""
        super().__init_subclass__(**keywords)
        if not abstract:
            check_total(f"dialect {cls.NAME}", cls.SUPPORT)

    def received(self, world: World) -> World:
        """``world`` as files and engines have it: with armature as mass and inertia where that is the same
        (``world/armature.py``). A dialect with fields for armature overrides it."""
        return as_inertia(world)

    def lower(self, world: World, target: Target) -> Lowered:
        """A world (:meth:`received`) as the engine is to read it. Raises UnsupportedError with all that it cannot have."""
        raise NotImplementedError

    def raise_(self, document: Any, sidecar: Any) -> ReadBack:
        """The model that a document of the format and its sidecar mean to the engine, in the world's frames and order.

        ``sidecar`` is of the dialect's ``SIDECAR``. It shares no code with ``lower``, so that one error cannot
        hide another. Sidecar values that belong to the model are read too. Raises ValueError, KeyError for what is damaged.
        """
        raise NotImplementedError

    def check_declared(self, settings: Collection[str]) -> None:
        """Raise ValueError where an engine that receives worlds in this dialect does not declare a setting that it needs."""
        lacking = [name for name, setting in self.SETTINGS.items() if name not in settings and not setting.optional]
        if lacking:
            raise ValueError(f"it lacks the settings {', '.join(lacking)}, which the dialect {self.NAME!r} needs")

    def emit(self, world: World, target: Target) -> dict[str, str]:
        """The files of ``world`` as {relative path: text}, ``sidecar.json`` among them. Raises UnsupportedError, also where the
        target lacks a setting that the dialect needs."""
        check_settings(self.NAME, self.SETTINGS, target)
        lowered = self.lower(self.received(world), target)
        sidecar = dataclasses.replace(lowered.sidecar, world=sha256(world))
        return {**self.format.write(lowered.tree), SIDECAR: sidecar_text(sidecar.plain())}

    def read(self, folder: Path) -> ReadBack:
        """The model that the files in ``folder`` hold (proof level L0). Raises ValueError, KeyError for damaged files."""
        sidecar = self.SIDECAR.of(read_sidecar(folder))
        if sidecar.dialect != self.NAME:
            raise ValueError(f"sidecar.dialect is {sidecar.dialect!r}, should be {self.NAME!r}")
        return self.raise_(self.format.read(folder), sidecar)

    @property
    def format(self) -> Format:
        """The format of the files."""
        return formats()[self.FORMAT]


def _sound(name: str, kind: Any) -> Dialect:
    """The dialect, if it is one that can be used. Raises TypeError, ValueError."""
    if not (isinstance(kind, type) and issubclass(kind, Dialect)):
        raise TypeError("it is not a Dialect")
    missing = [word for word in ("NAME", "FORMAT", "SUPPORT", "SIDECAR") if not hasattr(kind, word)]
    if missing or name != kind.NAME:
        raise ValueError(f"it does not define {', '.join(missing)}" if missing else f"its NAME is {kind.NAME!r}")
    if kind.FORMAT not in formats():
        raise ValueError(f"its files are {kind.FORMAT!r}, which is not a format")
    return kind()


@functools.cache
def dialects() -> Plugins[Dialect]:
    """Every installed dialect by name (entry points ``simspec.dialects``)."""
    return Plugins("simspec.dialects", _sound)
