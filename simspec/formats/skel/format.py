"""The format ``skel``."""

from __future__ import annotations

from typing import ClassVar

from simspec.formats.kit.contract import Format


class Skel(Format):
    """Files of the format ``skel``."""

    NAME: ClassVar[str] = "skel"
