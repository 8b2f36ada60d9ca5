"""Executors of the runs of a sweep: ``local.py`` has the contract of every executor, and the one for this machine."""
