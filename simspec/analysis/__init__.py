"""Figures of runs, each computed in one place: pure functions of arrays, runs and noise floors. No engine is started.

``docs/reference/analysis.md`` gives the meaning, the formula and the source of each.
"""
