SUFFIXES = (".xml", ".mjcf")
"""Ends of the names of its files; stated here so that files are told apart without the importer."""
