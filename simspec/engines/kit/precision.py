"""The numbers that an engine computes with: data, which engines declare (``Engine.PRECISION``) and proofs go by."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

DOUBLE: Final = "double"
SINGLE: Final = "single"
ROUNDING: Final[Mapping[str, float]] = {DOUBLE: 2.0**-53, SINGLE: 2.0**-24}
"""By precision how far a number may be off from what it stands for, relative: half the spacing of its digits."""
