"""What a placement of a file of another language says to its importer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from simspec.language.foreign import ImportOptions
from simspec.language.shapes import NameOf
from simspec.language.strict import Strict
from simspec.language.words import FileName, Flag, Text, Texts


class Import(Strict):
    """What is said to the importer of a file of another language."""

    packages: dict[NameOf, Annotated[str, FileName()]] = Field(
        {}, description="Folders of packages that the file names, by their names, relative to this file"
    )
    package_path: list[Annotated[str, FileName()]] = Field(
        [], description="Folders in which packages are looked for, relative to this file"
    )
    arguments: dict[NameOf, Annotated[str, Text()]] = Field(
        {}, description="Arguments of a file that is a program (xacro), by name"
    )
    repair: Annotated[list[str], Texts()] = Field(
        [],
        description="Rules by which defects of the file are repaired, `RULE` or `RULE=VALUE`; `all`: every rule that it needs",
    )
    self_collision: Annotated[bool, Flag()] = Field(
        True, description="false: the bodies of the model that the file describes do not touch each other"
    )

    def options(self, folder: Path, project: Path | None) -> ImportOptions:
        """The same as importers take it; ``folder``: that of the file which says so."""
        return ImportOptions(
            self.packages,
            tuple(self.package_path),
            self.arguments,
            tuple(self.repair),
            project,
            folder,
            self.self_collision,
        )
