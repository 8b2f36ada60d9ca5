"""PyBullet: settings and support, simulation, read-back; ``engine.py`` is what the others are used by."""

DEPTHS: dict[str, float] = {"contact_slop": 0.0, "collision_margin": 0.0}
"""Settings that are depths of contact, with their defaults (m): known without importing the engine."""
