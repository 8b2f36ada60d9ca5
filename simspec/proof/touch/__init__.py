"""Which shapes touch (level L4): every pair of solid shapes is brought together with real geometry, engine by engine, and the
engine's own detection must report them as the rules say.

Nothing here knows how an engine filters: states go in, touching shapes come out. ``geometry`` has signed distances (coal),
``place`` brings a free tree to another one's shape, ``search`` looks for joint positions at which two shapes overlap, ``plan``
makes states of all that, and ``judge`` holds what an engine reports against the world's rules.
"""
