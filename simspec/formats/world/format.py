"""The format ``world``."""

from __future__ import annotations

from typing import ClassVar

from simspec.formats.kit.contract import Format


class WorldJson(Format):
    """Files of the format ``world``."""

    NAME: ClassVar[str] = "world"
