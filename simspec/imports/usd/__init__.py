SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
"""Ends of the names of its files; stated here so that files are distinguished without the importer."""
