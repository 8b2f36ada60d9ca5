"""The memory that holds contacts, constraints and the solver of one state (``size memory``), where the default is too large.

The language's default grows with the square of the velocities, whatever may touch: 40 (n + 500)² bytes, which are 1.8 GB for
1,000 free bodies, and more than many machines have for 4,000. Up to ``MOST_BY_DEFAULT`` velocities that default is kept.
Beyond, the size is a bound on what the parts of a step need. It is reserved, and taken from the machine as far as it is used.
What does not fit is an error of the run.

Figures marked *measured* are of version 4.0.1 of the language's reference program (docs/scale.md).
"""

from __future__ import annotations

from typing import Final

from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import VELOCITY_SIZE, World

MIB: Final = 2**20
MOST_BY_DEFAULT: Final = 2500
"""Velocities; the default for them is 380 MB."""
BASE: Final = 64 * MIB
"""For what does not grow with the contacts: the default of an empty model is 13 MB."""
NEIGHBOURS: Final = 8
"""Contacts of a moving shape, each counted at one of the two: balls that do not overlap, of whatever sizes, have less than 7.5
on average (Kuperberg and Schramm 1994, Average kissing numbers for non-congruent sphere packings)."""
POINTS: Final = {"sphere": 1, "capsule": 2}
"""Points of a contact, by the kind of shape; of other kinds ``MOST_POINTS``."""
MOST_POINTS: Final = 8
"""Of two boxes."""
GROUND_POINTS: Final = 50
"""Of a shape on a height field (``mjMAXCONPAIR`` of the reference program)."""
POINT_BYTES: Final = 700
"""Of a contact (mjContact, 600 bytes in version 4, and its places in lists)."""
ROW_BYTES: Final = 300
"""Of a constraint row beside its Jacobian: 14 numbers and their copies for the solver."""
ENTRY_BYTES: Final = 48
"""Of a number of the Jacobian: value and column (12), in the Jacobian, its transpose, and the solver's copies of both."""
PAIR_BYTES: Final = 4
"""Of each two bodies, for the search of what may touch: 4.1 MB for 1,000 balls, 67 MB for 4,096 (measured)."""
FACTOR_ENTRY: Final = 12
"""Bytes of a number of the factor of Newton's Hessian; a full one has n²/2."""
PILE_BYTES: Final = 2000
"""Newton's factor of a pile, over (velocities / 6) ** (5/3): each body of a pile of n, numbered in layers, couples with those
within a layer, n ** (2/3) of them. 1,000 measured, in piles of 216 and 1,000 balls; numbered at random 1,900."""

MOST_FACTOR: Final = 4 * 2**30
"""Bytes that are reserved for that factor at most: a machine refuses to reserve more than it has. A pile of 10,000 balls would
take 4.6 GB; what is larger is solved by other solvers (``solver: cg``), or takes a size of its own (``arena``)."""


def arena_megabytes(world: World, newton: bool = True) -> int | None:
    """MiB of the arena of a world; None where the default is kept. ``newton``: whether the solver is Newton's."""
    moving = [body for body in world.bodies if body.joint.kind != "fixed"]
    velocities = sum(VELOCITY_SIZE[body.joint.kind] for body in moving)
    if velocities <= MOST_BY_DEFAULT:
        return None
    path = _longest_path(world)
    points = _points(world)
    laws = meeting_laws(world).values()
    rows = max((_rows(law.friction, law.torsional_friction, law.rolling_friction) for law in laws), default=0)
    size = BASE + points * (POINT_BYTES + rows * (ROW_BYTES + 2 * path * ENTRY_BYTES))
    others = (
        2 * velocities + 6 * len(world.constraints) + 2 * len(world.sums)
    )  # limits and dry friction of joints, equalities
    size += others * (ROW_BYTES + 2 * path * ENTRY_BYTES)
    size += PAIR_BYTES * (1 + len(world.bodies)) ** 2
    if newton:
        full = FACTOR_ENTRY * velocities * (velocities + 1) / 2
        size += int(min(full, PILE_BYTES * (velocities / 6) ** (5 / 3), MOST_FACTOR))
    return -(-size // MIB)


def _rows(sliding: float, torsional: float, rolling: float) -> int:
    """The most rows of a point, of either cone: a pyramid has two for each direction of friction."""
    if rolling:
        return 10
    if torsional:
        return 6
    return 4 if sliding else 1


def _points(world: World) -> int:
    """A bound on the points of contact."""
    groups = rigid_groups(world)
    ground = any(shape.kind == "heightfield" for body in world.bodies for shape in solid_shapes(body))
    return sum(
        NEIGHBOURS * POINTS.get(shape.kind, MOST_POINTS) + (GROUND_POINTS if ground else 0)
        for body in world.bodies
        if groups[body.name] != "world"
        for shape in solid_shapes(body)
    )


def _longest_path(world: World) -> int:
    """The most velocities on the way from the world to a body; bodies stand behind their parents."""
    found: dict[str, int] = {}
    for body in world.bodies:
        above = 0 if body.joint.parent is None else found[body.joint.parent]
        found[body.name] = above + VELOCITY_SIZE[body.joint.kind]
    return max(found.values(), default=0)
