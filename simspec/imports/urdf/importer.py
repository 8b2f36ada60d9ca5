"""The importer of URDF."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import parse
from simspec.imports.files import Files
from simspec.imports.table import Row
from simspec.imports.urdf.robot import RULES, robot
from simspec.imports.urdf.table import rows
from simspec.language.foreign import Imported, ImportOptions

_ROBOT: Final = re.compile(rb"<robot[\s>/]")
_XACRO: Final = re.compile(rb"<xacro:[A-Za-z]|=\s*[\"'][^\"'<>]*\$(?:\{|\((?:optenv|env|arg|eval|dirname|anon)\b)")
"""What only xacro gives a meaning; ``$(find PACKAGE)`` stands in paths of plain URDF, too."""


class Urdf:
    """Reads URDF by itself: every element and attribute is seen, with its line."""

    NAME = "URDF"
    SUFFIXES = (".urdf",)

    def recognises(self, content: bytes) -> bool:
        """Whether the beginning of a file has the outermost element of URDF."""
        return _ROBOT.search(content) is not None

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
        """The same of a text that is no file, such as what a program has made."""
        self._refuse_xacro(content, files)
        return robot(parse(content, files.shown), files, files.options)

    @staticmethod
    def _refuse_xacro(content: bytes, files: Files) -> None:
        """Raise SpecError where the file is a program that nobody has run."""
        plain = _without_comments(content)
        found = _XACRO.search(plain)
        if found is None:
            return
        line = plain.count(b"\n", 0, found.start()) + 1
        shown = plain[found.start() :].split(b"\n", 1)[0][:60].decode("utf-8", "replace")
        hint = "import the .xacro file that it was made from; or give this one the name FILE.xacro"
        raise SpecError([Problem("unexpanded xacro", location=Location(files.shown, line, 1), found=shown, hint=hint)])


def _without_comments(content: bytes) -> bytes:
    """The text with no comments in it, its lines where they were; a search that goes on where it was, so that no text takes
    more than its length."""
    parts, position = [], 0
    while (start := content.find(b"<!--", position)) >= 0 and (end := content.find(b"-->", start + 4)) >= 0:
        parts += [content[position:start], b"\n" * content.count(b"\n", start, end)]
        position = end + 3
    return b"".join([*parts, content[position:]])
