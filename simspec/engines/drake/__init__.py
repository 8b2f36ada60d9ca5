"""Drake: settings and support, building by calls, simulation, read-back; ``engine.py`` is what others use it by."""

DEPTHS: dict[str, float] = {}
"""Settings that are depths of contact, with their defaults (m): known without importing the engine."""
