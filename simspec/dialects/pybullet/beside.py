"""Bodies that are nothing but frames, held beside PyBullet in trees for which it has no room."""

from __future__ import annotations

from typing import Final

from simspec.support.declarations import Level, Refinement, Support, never
from simspec.support.needs import LARGE_TREE
from simspec.world.bare import bare_frames
from simspec.world.derived import derived
from simspec.world.kinematics import trees
from simspec.world.types import World

MOST_LINKS: Final = LARGE_TREE
"""Links beside the base of one tree; copies of shapes count."""
NO_LINKS: Final = f"PyBullet supports at most {MOST_LINKS} links besides the base in one tree"
BESIDE = Refinement(
    Level.OUTSIDE,
    f"{NO_LINKS}: of larger ones the bodies that are nothing but frames (fixed to others, without mass and shapes) are held "
    "beside PyBullet, and where they are is computed from the bodies that carry them",
    short="frames of trees of more than 127 bodies are computed from the bodies that carry them",
)


@derived
def held_beside(world: World) -> frozenset[str]:
    """The names of the bodies that PyBullet is not told: all frames of the trees that are too large for it."""
    large = {body.name for bodies in trees(world).values() if len(bodies) > MOST_LINKS for body in bodies}
    return bare_frames(world) & large


def _room(world: World) -> Refinement | None:
    beside = held_beside(world)
    most = max((sum(body.name not in beside for body in bodies) for bodies in trees(world).values()), default=0)
    return BESIDE if most <= MOST_LINKS else None


def _tree_size() -> Support:
    support = never(NO_LINKS)
    return Support(support.level, support.how, refine=_room, cases=(BESIDE,), absence=support.absence)


TREE_SIZE: Final = _tree_size()
