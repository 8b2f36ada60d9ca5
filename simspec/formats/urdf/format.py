"""The format ``urdf``."""

from __future__ import annotations

from typing import ClassVar

from simspec.formats.kit.contract import Format


class Urdf(Format):
    """Files of the format ``urdf``."""

    NAME: ClassVar[str] = "urdf"
