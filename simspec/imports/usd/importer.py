"""The importer of USD: stages with the schemas of UsdPhysics."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from simspec.imports.draft import Draft
from simspec.imports.files import Files
from simspec.imports.reference import ElementRow
from simspec.imports.usd import SUFFIXES
from simspec.imports.usd.assembly import UsdAssembly
from simspec.imports.usd.losses import RULES, rows, settle
from simspec.imports.usd.places import ROTATIONS
from simspec.imports.usd.stage import read_stage
from simspec.language.foreign import Imported, ImportOptions

MISSING: Final = "missing-files"


class Usd:
    """Reads ``.usda``, ``.usdc`` and ``.usd``, also those that refer to others, and packages of them (``.usdz``)."""

    NAME: Final = "USD"
    SUFFIXES = SUFFIXES

    def recognises(self, content: bytes) -> bool:
        return re.match(rb"#usda|PXR-USDC|PK\x03\x04", content) is not None

    @staticmethod
    def table() -> list[ElementRow]:
        """What prims and attributes become."""
        return rows()

    @staticmethod
    def rules() -> dict[str, str]:
        """The rules of repair."""
        return dict(RULES)

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """A stage as a spec. Raises SpecError with every problem."""
        files = Files(path, shown, options)
        draft = Draft(files, options, RULES)
        stage = read_stage(files, draft.repairing(MISSING))
        for prim in stage.prims.values():
            prim.forgiving = draft.repairing(ROTATIONS)
        assembly = UsdAssembly(stage, draft)
        assembly.fill()
        for text in stage.missing:
            draft.repaired(MISSING, stage.root, f"{text} is left out: it is not there", ())
        draft.finish()
        settle(stage)
        draft.made.update(draft.meshes)
        return draft.imported(assembly.data, list(stage.root.accounts()))
