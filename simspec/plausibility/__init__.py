"""Plausibility of a model: whether its masses, shapes and joints can be those of a real mechanism. No engine is started."""
