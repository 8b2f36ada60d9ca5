"""The solver settings that a dialect needs of every engine that it is for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from simspec.dialects.kit.target import Target
from simspec.errors import Problem, UnsupportedError

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
    def told(self) -> str:
        """What a value must be, in words."""
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
            allowed=needed[name].told,
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
        )
        for (first, second), settings in target.pair_settings.items()
        for name in wrong_pair_settings(needed, settings)
    ]
    if problems:
        raise UnsupportedError(problems)
