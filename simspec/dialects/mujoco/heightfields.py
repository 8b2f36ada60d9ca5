"""From a height field of an MJCF document back to that of a world; shares no code with what writes it."""

from __future__ import annotations

from typing import Final

from simspec.formats.mjcf.document import Item

ATTRIBUTES: Final = {"name", "nrow", "ncol", "size", "elevation"}
MOST_POINTS: Final = 1_000_000
"""Points of one height field that are read."""


def height_field(item: Item) -> tuple[str, tuple[float, ...]]:
    """The name and the size (``world/heightfield.py``) of a height field. Raises ValueError where its elevations are not what
    every reader leaves as it is: shares from 0 to 1, or 0 throughout."""
    if item.values.keys() != ATTRIBUTES or item.element.children:
        raise item.refused(f"is not read, but with {', '.join(sorted(ATTRIBUTES))} and nothing else")
    rows, columns = (item.number(name) for name in ("nrow", "ncol"))
    if not all(2.0 <= count <= MOST_POINTS and count == int(count) for count in (rows, columns)):
        raise item.refused(f"{rows:g} rows and {columns:g} columns")
    if rows * columns > MOST_POINTS:
        raise item.refused(f"{rows:g} × {columns:g} points, more than the {MOST_POINTS:,} that are read")
    half_x, half_y, top, base = item.numbers("size", 4)
    shares = item.numbers("elevation", int(rows * columns))
    if min(shares) != 0.0 or max(shares) not in (0.0, 1.0):
        raise item.refused(f"its elevations are from {min(shares):g} to {max(shares):g}, should be from 0 to 1")
    wide = int(columns)
    northward = [shares[wide * row : wide * (row + 1)] for row in reversed(range(int(rows)))]
    heights = (top * share for row in northward for share in row)
    return item.text("name"), (rows, columns, 2.0 * half_x, 2.0 * half_y, base, *heights)
