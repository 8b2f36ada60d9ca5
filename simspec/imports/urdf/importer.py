"""The importer of URDF."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import outermost, parse, without_comments
from simspec.imports.files import Files
from simspec.imports.table import Row
from simspec.imports.urdf.robot import RULES, robot
from simspec.imports.urdf.table import rows
from simspec.language.foreign import Imported, ImportOptions

ROBOT: Final = b"robot"
_PROGRAM: Final = re.compile(rb"<xacro:[A-Za-z]|=\s*[\"'][^\"'<>]*\$(?:\{|\((?:optenv|env|arg|eval|dirname|anon)\b)")
"""What only xacro gives a meaning; ``$(find PACKAGE)`` stands in paths of plain URDF, too, and so may a namespace that nothing
uses."""


class Urdf:
    """Reads URDF by itself: every element and attribute is seen, with its line."""

    NAME = "URDF"
    SUFFIXES = (".urdf", ".xml")

    def recognises(self, content: bytes) -> bool:
        """Whether a file has the outermost element of URDF, and nothing that only xacro gives a meaning."""
        return outermost(content) == ROBOT and not is_program(content)

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """The robot as a model file. Raises SpecError with every problem."""
        files = Files(path, shown, options)
        return self.parsed(files.content(), files)

    def table(self) -> Iterator[Row]:
        """What every element and attribute becomes."""
        return rows()

    def rules(self) -> Mapping[str, str]:
        """Rules of repair, with what they do."""
        return RULES

    def parsed(self, content: bytes, files: Files) -> Imported:
        """The same of a text that is no file. Raises SpecError, also for a program that nobody has run."""
        plain = without_comments(content)
        found = _PROGRAM.search(plain)
        if found is not None:
            line = plain.count(b"\n", 0, found.start()) + 1
            shown = plain[found.start() :].split(b"\n", 1)[0][:60].decode("utf-8", "replace")
            raise SpecError([Problem("unexpanded xacro", location=Location(files.shown, line, 1), found=shown)])
        return robot(parse(content, files.shown), files, files.options)


def is_program(content: bytes) -> bool:
    """Whether a file, its comments aside, has what is to be expanded by xacro, whatever its name ends in."""
    return _PROGRAM.search(without_comments(content)) is not None
