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
    """

    kind: type
    words: tuple[str, ...] = ()
    optional: bool = False

    def takes(self, value: object) -> bool:
        """Whether ``value`` is one that the dialect understands."""
        if self.kind is float:
            return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        return type(value) is self.kind and (not self.words or value in self.words)

    @property
    def told(self) -> str:
        """What a value must be, in words."""
        return f"one of {', '.join(self.words)}" if self.words else KINDS[self.kind]


def check_settings(dialect: str, needed: Mapping[str, NeededSetting], target: Target) -> None:
    """Raise UnsupportedError with every setting that ``target`` lacks, or has of another kind than the dialect reads."""
    problems = []
    for name, setting in needed.items():
        if name not in target.settings and not setting.optional:
            problems.append(
                Problem(
                    f"the dialect {dialect!r} needs this setting, which {target.engine} does not have",
                    f"engines.{target.engine}.settings.{name}",
                    allowed=setting.told,
                )
            )
        elif name in target.settings and not setting.takes(target.settings[name]):
            problems.append(
                Problem(
                    f"the dialect {dialect!r} does not read this value of the setting",
                    f"engines.{target.engine}.settings.{name}",
                    found=repr(target.settings[name]),
                    allowed=setting.told,
                )
            )
    if problems:
        raise UnsupportedError(problems)
