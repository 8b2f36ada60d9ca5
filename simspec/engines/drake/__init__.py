"""Drake: settings and support, building by calls, simulation, read-back; ``engine.py`` is what others use it by."""
