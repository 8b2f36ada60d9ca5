"""Engines, a package each; ``kit`` is what they share."""
