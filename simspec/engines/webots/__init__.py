DEPTHS: dict[str, float] = {}
"""Settings that are depths of contact, with their defaults (m): known without importing the engine."""
