"""MuJoCo: settings and support, simulation, read-back; ``engine.py`` is what the others are used by."""
