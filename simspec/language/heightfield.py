"""Uneven ground: heights over a grid of points, from the spec itself or from a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from simspec.language.document import INVALID
from simspec.language.quantities import Number, Vector
from simspec.language.reader import Reader
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, replace_loc, show
from simspec.language.words import FileName

SUFFIXES = (".png", ".csv", ".txt")
"""Ends of names of files that are read, in small letters."""
MOST_HEIGHTS = 2**18
"""Heights of one field, 512 × 512: each takes 20 bytes in a world's file, and two triangles in an engine."""
FEWEST = 2
"""Rows, and columns, of the smallest field: one cell."""


@dataclass(frozen=True)
class HeightRows(Reader):
    """Rows of heights, all equally long."""

    def read(self, value: Any) -> tuple[tuple[float, ...], ...]:
        if hasattr(value, "tolist"):  # an array of numpy
            value = value.tolist()
        if not isinstance(value, (list, tuple)) or len(value) < FEWEST:
            found = f"{len(value)} rows" if isinstance(value, (list, tuple)) else show(value)
            raise fault(f"expected {self.describe()}", found, "[[…, …], [0.1, 0.2]]")
        wide = len(value[0]) if isinstance(value[0], (list, tuple)) else 0
        if len(value) * max(wide, 1) > MOST_HEIGHTS:
            raise fault("too many heights", f"{len(value)} × {wide}", f"up to {MOST_HEIGHTS}", "fewer rows and columns")
        number = Number("length")
        faults: list[Fault] = []
        rows: list[tuple[float, ...]] = []
        for index, row in enumerate(value):
            if row is INVALID:
                faults.append(Fault((index,), "", reported=True))
                continue
            if not isinstance(row, (list, tuple)) or len(row) < FEWEST or len(row) != wide:
                found = f"{len(row)} heights" if isinstance(row, (list, tuple)) else show(row)
                allowed = f"{max(wide, FEWEST)}, as in the first row" if wide >= FEWEST else f"at least {FEWEST}"
                faults.append(Fault((index,), "rows are equally long lists of heights", found, allowed))
                continue
            try:
                rows.append(Vector(number, len(row)).read(row))
            except Faults as error:
                faults.extend(replace_loc(error.faults, (index,)))
        if faults:
            raise Faults(faults)
        return tuple(rows)

    def unit(self) -> str:
        return Number("length").unit()

    def describe(self) -> str:
        return f"a list of at least {FEWEST} rows of heights"

    def schema(self) -> dict[str, Any]:
        row = {"type": "array", "items": Number("length").schema(), "minItems": FEWEST}
        return {"type": "array", "items": row, "minItems": FEWEST}


class Heightfield(Strict):
    """Ground of uneven height: the x-y rectangle `size` about the origin of the shape's frame, with heights over a grid of
    points. Each cell of the grid is two triangles, which meet along the diagonal from its corner at the least x and y to that
    at the greatest. What is below them is solid, down to `base` below the lowest point. Only on bodies that cannot move."""

    ONE_OF: ClassVar[tuple[str, ...]] = ("rows", "file")

    rows: Maybe[Annotated[tuple[tuple[float, ...], ...], HeightRows()]] = Field(
        ABSENT,
        description="The heights as on a map: the first row is at the greatest y, the first of a row at the least x",
    )
    file: Maybe[Annotated[str, FileName()]] = Field(
        ABSENT,
        description="Path of a file with the same, relative to this file: a grey PNG (8 or 16 bits), or numbers as text "
        "(CSV, TXT), one row a line",
    )
    size: Annotated[tuple[float, float], Vector(Number("length", 0, above=True), 2)] = Field(
        ..., description="Full lengths along x and y, between the outermost points"
    )
    heights: Maybe[Annotated[tuple[float, float], Vector(Number("length"), 2)]] = Field(
        ABSENT,
        description="Heights of the least and of the greatest of all numbers, with the others in proportion; default: the "
        "numbers are heights in m. A PNG needs it",
    )
    base: Annotated[float, Number("length", 0, above=True)] = Field(
        1.0, description="How far below the lowest point it is solid"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        text = data.get("file")
        if isinstance(text, str) and text.strip():
            if not text.lower().endswith(SUFFIXES):
                yield Fault(("file",), "not a file of heights that is read", show(text), " ".join(SUFFIXES))
            elif text.lower().endswith(".png") and "heights" not in data:
                hint = "heights: [0, 0.5], those of the darkest and of the lightest pixel"
                yield Fault((), "the shades of a PNG are no lengths: heights is missing", None, None, hint)
        heights = data.get("heights")
        if isinstance(heights, (list, tuple)) and len(heights) == 2:
            try:
                low, high = Vector(Number("length"), 2).read(heights)
            except Faults:
                return  # reported where it is read
            if low > high:
                yield Fault(("heights",), "the first is that of the least number", show(heights), "[lowest, highest]")
