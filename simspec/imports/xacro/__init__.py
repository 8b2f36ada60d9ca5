"""Limits of an expansion, and the form of its places, for both processes. Imports next to nothing."""

from __future__ import annotations

import struct
from typing import Final

CPU_SECONDS: Final = 5
"""Processor time of one expansion, which the kernel counts; the largest robot of the measured corpora takes 1 s."""
SECONDS: Final = 120.0
"""Wall time, for a process that computes nothing. Processor time is the limit of all others: on a busy machine a robot that
needs 0.5 s of it may wait for 10."""
MEMORY: Final = 768 * 2**20
"""Address space (bytes)."""
LARGEST_TEXT: Final = 10 * 2**20
"""Characters of one file, and of what all expand to."""
MOST_FILES: Final = 1_000
DEEPEST: Final = 3_000
"""Python's calls within each other; a macro that calls itself takes about eight."""
PLACE: Final = "simspec-place"
"""The attribute by which an element remembers file and line, through all copies that macros make of it."""
PLACE_NOW: Final = struct.Struct("=qq")
"""File and line of the element that is being expanded, in memory that both processes see."""
SUFFIXES = (".xacro", ".urdf", ".xml")
"""Ends of the names of its files; stated here so that files are distinguished without the importer."""
