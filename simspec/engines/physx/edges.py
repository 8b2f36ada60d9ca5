"""What PhysX has of boxes and hulls that meet by their edges: a corner in a face is exact, an edge across an edge is not.

*Measured*, SAPIEN 3.0.3 with PhysX 5.3.1: six random pairs of sizes, 60 random poses each, 10 µm to 2 mm deep, against coal.

- Boxes with boxes: where a corner is in a face (half of the poses) depths are right to 8e-8 m and normals to 1e-6 rad; where
  edges cross, normals are off in 99 of 100, by 0.27 rad (median) to 1.5 rad, and depths by up to 2.1 mm; none is missed.
- Hulls of up to 20 corners with boxes and each other: normals are off by more than 0.01 rad in half, up to 0.7 rad, depths by
  up to 0.22 mm, and 7 of 720 are missed, the deepest 0.28 mm.
- Balls and capsules with hulls: normals are right to 4e-4 rad, depths are off by 1 µm to 0.1 mm in 2 of 100, one of 720 is
  missed.
- All with planes, and balls and capsules with boxes and each other: right to 7e-7 m and 3e-6 rad, none missed.

With ``enable_pcm`` normals of edges are as wrong (0.9 rad), and contacts of earlier steps are kept.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.engines.kit.refinements import approximate_pairs, met_pairs
from simspec.engines.physx.hulls import hulls_held
from simspec.support.declarations import Refinement
from simspec.world.types import World

_CROSSED = "a corner in a face is exact, and so is what stands or slides on faces; where two edges cross the normal is"
_OF_HULLS = _CROSSED + " up to 0.7 rad off, the depth up to {} mm, and one of {} overlaps is missed"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("box", "box"): f"{_CROSSED} 0.27 rad off (median; 1.5 rad at most), the depth up to 2.1 mm",
    ("box", "mesh"): _OF_HULLS.format(0.22, 90),
    ("mesh", "mesh"): _OF_HULLS.format(0.12, 120),
    ("mesh", "sphere"): "depths are up to 0.1 mm off in 3 of 100 overlaps",
    ("capsule", "mesh"): "depths are up to 0.03 mm off in 2 of 100 overlaps",
}
"""Of pairs of kinds, what is lost."""
SHORT = "where edges cross the normal of contact is 0.3 to 1.5 rad off"
SHORT_HULLS = "where edges of hulls cross the normal of contact is up to 0.7 rad off"
SHORT_ROUND = "depths of balls and capsules on hulls are up to 0.1 mm off"


def _refinement(met: Mapping[tuple[str, str], str]) -> Refinement:
    if ("box", "box") in met:
        return approximate_pairs(met, SHORT)
    return approximate_pairs(met, SHORT_HULLS if any(set(pair) <= {"box", "mesh"} for pair in met) else SHORT_ROUND)


def _of(kind: str) -> Mapping[tuple[str, str], str]:
    """The pairs that are told of boxes, and of hulls."""
    return {pair: how for pair, how in APPROXIMATE.items() if ("mesh" in pair) == (kind == "mesh")}


def boxes(world: World) -> Refinement | None:
    """Boxes that may meet boxes; with hulls they are told of the hulls."""
    met = met_pairs(world, _of("box"))
    return _refinement(met) if met else None


def meshes(world: World) -> Refinement | None:
    """Not hulls that PhysX would not hold; approximate are those that may meet more than planes."""
    if refused := hulls_held(world):
        return refused
    met = met_pairs(world, _of("mesh"))
    return _refinement(met) if met else None


BOXES, MESHES = (_refinement(_of(kind)) for kind in ("box", "mesh"))
"""Where all of these pairs may meet, for tables."""
