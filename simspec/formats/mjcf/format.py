"""The format ``mjcf``."""

from __future__ import annotations

from typing import ClassVar

from simspec.formats.kit.contract import Format


class Mjcf(Format):
    """Files of the format ``mjcf``."""

    NAME: ClassVar[str] = "mjcf"
