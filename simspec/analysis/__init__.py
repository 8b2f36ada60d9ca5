"""Figures of runs: speed, validity, determinism, horizons, conservation, contact, distributions; each once."""
