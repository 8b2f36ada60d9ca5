"""Newton: reduced-coordinate trees and contact, by its solver Steel, in single precision on the processor."""

DEPTHS: dict[str, float] = {}
"""Settings that are depths of contact, with their defaults (m): known without importing the engine."""
