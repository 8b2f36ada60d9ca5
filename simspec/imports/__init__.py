"""Importers: robot files of other languages as specs. The contract is ``language/foreign.py``."""
