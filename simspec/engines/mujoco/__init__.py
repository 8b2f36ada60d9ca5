"""MuJoCo: settings and support, simulation, read-back; ``engine.py`` is what the others are used by."""

DEPTHS: dict[str, float] = {"friction_cushion": 1e-4}
"""Settings that are depths of contact, with their defaults (m): known without importing the engine."""
