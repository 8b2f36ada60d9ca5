"""Names that mean the same to whoever writes a model for MuJoCo, reads it, or loads it."""

from __future__ import annotations

from typing import Final

KEYFRAME: Final = "initial"
"""The keyframe that holds the world's initial state."""
NO_RATING: Final = -1.0
"""In a joint's user data: no velocity or effort rating."""
NATIVE: Final = "native"
COULOMB: Final = "coulomb"
"""What the setting ``friction`` may be. Under coulomb, friction takes back slip at once, and what that does to the normal
direction is corrected outside, at every step (``engines/mujoco/coulomb.py``): no cushion, and no pairs for friction's sake."""
