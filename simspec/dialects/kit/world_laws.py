"""A world as ``world.json`` with a table of laws in the sidecar, for engines that are passed a law at every point of
contact and combine no numbers of shapes (rule ``table``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from simspec.dialects.kit.sidecar import Sidecar
from simspec.dialects.kit.target import Target
from simspec.dialects.kit.world_document import WorldDialect
from simspec.dialects.kit.world_sidecar import WorldSidecar
from simspec.formats.kit.forms import check_distinct, check_known
from simspec.formats.world.format import WORLD
from simspec.formats.world.tree import JsonWorld, ShapeCopy
from simspec.language.vocabulary import HARDNESS_KINDS
from simspec.world.types import PairContact, ReadBack, World

NOTHING = ShapeCopy(0, 0.0, 0.0, 0.0, 0.0)
"""What shapes have for numbers: the table has all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSidecar(WorldSidecar):
    """Settings, where the frames of free roots are, and laws of materials."""

    laws: tuple[PairContact, ...]
    """The law of every two materials that meet, by their sorted names."""

    def check(self) -> None:
        WorldSidecar.check(self)
        check_distinct(((law.first, law.second) for law in self.laws), "sidecar.laws")
        check_known((law.hardness.kind for law in self.laws), HARDNESS_KINDS, "sidecar.laws, kinds of hardness")
        for index, law in enumerate(self.laws):
            at = f"sidecar.laws.{index}"
            if law.first > law.second:
                raise ValueError(f"{at}: {law.first!r} and {law.second!r} are not sorted")
            if not law.collide:
                raise ValueError(f"{at} is of materials that pass through each other")

    def check_document(self, document: JsonWorld) -> None:
        """Raise ValueError where the sidecar is of another world than ``document``, or where shapes have numbers of their own,
        which nothing would go by."""
        WorldSidecar.check_document(self, document)
        told = {(law.first, law.second) for law in self.laws}
        meets = {(one, other) for one, other, _ in document.meets}
        if told != meets or any(layer for *_, layer in document.meets):
            raise ValueError(f"the materials that meet in {WORLD} are not those of sidecar.laws")
        for body in document.bodies:
            for shape in body.shapes:
                if shape.copies and shape.copies != (NOTHING,):
                    raise ValueError(f"the shape {shape.name!r} of {WORLD} has numbers beside those of sidecar.laws")


class LawDialect(WorldDialect, abstract=True):
    """``world.json``, whose shapes have no numbers, and the laws of pairs of materials in the sidecar."""

    SIDECAR: ClassVar[type[Sidecar]] = LawSidecar

    def fields(self, world: World, target: Target, document: JsonWorld) -> Mapping[str, Any]:
        # in a probe of two materials the plan may have more pairs than meet there
        laws = {(law.first, law.second): law for law in world.contact.pairs}
        return {"laws": tuple(laws[one, other] for one, other, _ in document.meets)}

    def raise_(self, document: JsonWorld, sidecar: LawSidecar) -> ReadBack:
        return replace(super().raise_(document, sidecar), laws=sidecar.laws)
