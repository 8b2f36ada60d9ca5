"""MuJoCo Warp: MuJoCo written for graphics processors, in single precision, given MuJoCo's files."""

DEPTHS: dict[str, float] = {"friction_cushion": 1e-4}
"""Settings that are depths of contact, with their defaults (m): known without importing the engine."""
