"""Pairs of shapes for which ODE has one point of contact where they touch along a line or on a face.

*Measured*, ODE 0.16.2. Cylinders meet cylinders and capsules by libccd's portal refinement, which ends at 1 µm. 60 random
poses and sizes (0.003 to 3 m) of each pair, at each of four overlaps, against the least sum of the two support widths over all
directions: an overlap of less than 1 µm can be missed (of those of 1e-5 of the size a third was), one more was not; no gap is
taken for a touch. Depths are off by 1 µm at most at overlaps of 1e-4 of the size, by 20 % (median 0.4 %) at 1e-3; normals by
0.015 and 0.2 rad (median 6e-4). Cylinders that stand on each other have eight points, exact, at all depths and at tilts of
1 mrad. Of parallel cylinders side by side the normal is 6 mrad off. Settling: bodies of 0.1 by 0.2 m, let down on what cannot
move, at 1 ms, looked at for 4 s.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.support.declarations import Level, Refinement
from simspec.world.meeting import meeting_kinds
from simspec.world.types import World

_PORTAL = (
    "by libccd, to 1 µm in depth (overlaps below that can be missed), with normals off by up to 0.015 rad where the overlap is "
    "1e-4 of the size and 0.2 rad at 1e-3"
)
_LINE = "along a line or on a face in one point, on which they rock: what is let down so sinks in by 1 mm"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("capsule", "cylinder"): f"{_PORTAL}; {_LINE}, a flat end on a capsule by 18 mm",
    ("cylinder", "cylinder"): f"exact, in eight points, where one stands on the other; otherwise {_PORTAL}; {_LINE}",
}
"""Of cylinders, and what is lost."""
OVERLOOKED: Mapping[tuple[str, str], str] = {
    (
        "box",
        "cylinder",
    ): "of 100 random overlaps of a tenth to a half of the smaller one's inner radius it overlooks 4 (of 144 "
    "six, in six draws of sizes; of spheres, capsules and other cylinders with cylinders none)",
}
"""Pairs of which ODE's own code misses some overlaps, as the same code in another engine does."""
BOX_AND_CAPSULE = f"box and capsule touch {_LINE}, a box on a capsule by 26 mm"


def _refinement(pairs: Mapping[tuple[str, str], str]) -> Refinement:
    told = "; ".join(f"{one} and {other} touch {how}" for (one, other), how in pairs.items())
    others = " and ".join(f"{one}s" for one, _ in pairs)
    return Refinement(Level.APPROXIMATE, told, short=f"cylinders touch {others} in one point, also along a line")


def cylinders(world: World) -> Refinement | None:
    """What is approximate of cylinders in a world; None where nothing is."""
    met = {pair: how for pair, how in APPROXIMATE.items() if pair in meeting_kinds(world)}
    return _refinement(met) if met else None


def capsules(world: World) -> Refinement | None:
    """What there is to say of capsules in a world: points and depths are exact, but a line or a face has one of them."""
    return Refinement(note=BOX_AND_CAPSULE) if ("box", "capsule") in meeting_kinds(world) else None


CASES = (_refinement(APPROXIMATE),)
"""Of cylinders, where all of these pairs may meet, for tables."""
