"""Which of PhysX's actors and links represents each body of a ``world.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from simspec.engines.kit.building import STATIC, Walk
from simspec.formats.world import FixedJoint, FreeJoint, JsonBody
from simspec.world import frames
from simspec.world.types import Pose


class Home(NamedTuple):
    """The ``row`` of the body whose actor or link a body is a part of (its own unless it is massless and fixed), and its
    ``pose`` in that body's frame."""

    row: int
    pose: Pose


@dataclass(frozen=True)
class Homes:
    """``of``: by row; ``single``: rows of free bodies that carry nothing but massless fixed bodies, which are dynamic actors;
    ``trees``: rows of the links of each articulation, every parent before its children."""

    of: tuple[Home, ...]
    single: tuple[int, ...]
    trees: tuple[tuple[int, ...], ...]

    @classmethod
    def in_walk(cls, walk: Walk) -> Homes:
        """The homes of the bodies of a document."""
        top: list[int] = []
        moving: dict[int, list[int]] = {}
        for placed in walk.bodies:
            above = placed.parent
            top.append(placed.row if above == STATIC or not walk.bodies[above].moves else top[above])
            if placed.moves:
                moving.setdefault(top[-1], []).append(placed.row)
        alone = {row for row, rows in moving.items() if _is_alone([walk.bodies[other].body for other in rows])}
        of: list[Home] = []
        for placed in walk.bodies:
            body, joint = placed.body, placed.body.joint
            part = isinstance(joint, FixedJoint) and placed.moves and not body.mass
            if part and isinstance(joint, FixedJoint):
                above_home = of[placed.parent]
                of.append(Home(above_home.row, frames.compose(above_home.pose, joint.origin)))
            else:
                of.append(Home(placed.row, Pose()))
        links = {row: tuple(other for other in rows if of[other].row == other) for row, rows in moving.items()}
        return cls(tuple(of), tuple(sorted(alone)), tuple(rows for row, rows in links.items() if row not in alone))


def _is_alone(bodies: Sequence[JsonBody]) -> bool:
    """Whether bodies, the topmost first, are a free body that carries nothing but massless fixed bodies."""
    first, *others = bodies
    return isinstance(first.joint, FreeJoint) and not any(
        body.mass or not isinstance(body.joint, FixedJoint) for body in others
    )
