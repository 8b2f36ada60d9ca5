"""The format ``usd``: one file with the schemas of UsdPhysics, ``world.usda``, or under a name that is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Final

from simspec.formats.kit.contract import Format
from simspec.formats.kit.plain import Plain, losses
from simspec.formats.usd.binary import BINARY, PACKAGE, TEXT, encoded
from simspec.formats.usd.plain import stage_of
from simspec.formats.usd.support import SUPPORT, more_losses
from simspec.formats.usd.text import text
from simspec.formats.usd.tree import Stage
from simspec.support.declarations import Table
from simspec.world import types
from simspec.world.types import World

WORLD: Final = "world.usda"


class Usd(Format):
    """USD with UsdPhysics, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "usd"
    SUPPORT: ClassVar[Table] = SUPPORT
    DRIVES: ClassVar[bool] = True
    PROFILES: ClassVar[tuple[str, ...]] = ("flat", "nested")
    SINGLE: ClassVar[tuple[str, ...]] = (TEXT, BINARY, PACKAGE)

    def write(self, tree: Stage) -> dict[str, str]:
        """``world.usda``. Raises ValueError for numbers that are not finite, or too large for single precision."""
        return {WORLD: text(tree)}

    def __init__(self, profile: str = PROFILES[0]):
        self.profile = profile
        """flat: bodies stand beside each other; nested: within their parents."""

    def in_profile(self, name: str) -> Format:
        """The format in this layout. Raises SpecError for a name that is not of ``PROFILES``."""
        return Usd(name) if name in self.PROFILES else super().in_profile(name)

    def plain(self, world: World) -> Plain:
        """``world.usda``."""
        tree = stage_of(world, nested=self.profile == "nested")
        return Plain(self.write(tree), losses(world, SUPPORT, more_losses(world)))

    def parts(self, world: types.World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """``world.usda``."""
        return {WORLD: world.bodies}

    def single(self, plain: Plain, suffix: str) -> bytes:
        """The stage as text, as a binary file, or as a package. Raises SpecError where usd-core is needed and not installed."""
        return encoded(plain.files[WORLD], suffix)

    def read(self, folder: Path) -> str:
        """The text of ``world.usda`` in ``folder``: its meaning is the importer's matter. Raises FileNotFoundError, and
        ValueError, which names the file, where it is no text of USD."""
        content = (folder / WORLD).read_text(encoding="utf-8")
        if not content.startswith("#usda "):
            raise ValueError(f"{WORLD}:1: a text of USD begins with #usda")
        return content
