"""Sweeps: the plan of what is run, the store of what came out, and who runs it."""
