"""Contact probe of boxes that lie on each other with edges that cross, and few corners or none over the other's face.

The contact is bounded by points where edges cross, which are no corners of either box. An engine that looks for corners alone
has one point there or none, on which the upper box turns and sinks. The truth is that nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from simspec.proof.contact.bodies import box, floor
from simspec.proof.contact.impact import DROP_RESTITUTION
from simspec.proof.contact.probe import Figure, Law, Motion, Phase, Probe, Trial
from simspec.proof.contact.stacking import resting, steps_of
from simspec.world import frames
from simspec.world.types import Vector3

SQUARE: Vector3 = (0.2, 0.2, 0.1)
BEAM: Vector3 = (0.1, 0.3, 0.1)
"""Edges (m)."""
MASS = 1.0
LOWER, UPPER = "lower", "upper"
"""Names of the boxes, and their collision groups."""
CASES: Mapping[str, tuple[Vector3, Vector3, float, float]] = {
    "a beam across a beam": (BEAM, BEAM, 90.0, 0.0),
    "a square across a square": (SQUARE, SQUARE, 45.0, 0.0),
    "a beam over an edge": (SQUARE, BEAM, 0.0, 0.08),
}
"""Edges of the lower box and of the upper one, the upper one's turn about the vertical (degrees), and how far (m) it is moved
along y, so that its centre of mass stays over the lower one."""


class Cross(Probe):
    """Boxes on boxes, turned or moved so that edges cross."""

    NAME = "cross"
    SIDEWAYS = "cross-sideways"
    MEANING = "how far boxes sink, or move sideways, that lie on others where edges cross"

    def applies(self, law: Law) -> bool:
        return (
            law.pair.collide
            and law.pair.hardness.kind == "common"
            and law.reach.crosses
            and law.pair.restitution <= DROP_RESTITUTION
        )

    def trials(self, law: Law) -> Sequence[Trial]:
        """One world for each case: solvers of dense equations fail to converge with all cases in one."""
        return [self._trial(law, *case) for case in CASES.values()]

    def _trial(self, law: Law, below: Vector3, above: Vector3, turn: float, moved: float) -> Trial:
        at = (0.0, moved, below[2] + above[2] / 2.0)
        turned = frames.from_axis_angle((0.0, 0.0, 1.0), math.radians(turn))
        lower = box(law, LOWER, below, MASS, (0.0, 0.0, below[2] / 2.0), group=LOWER)
        upper = box(law, UPPER, above, MASS, at, turn=turned, material=law.pair.first, group=UPPER)
        steps = steps_of(law)
        return Trial((floor(law), lower, upper), (Phase(steps, steps),), ((LOWER, UPPER),))

    def wanted(self, law: Law) -> Sequence[Figure]:
        return [figure for text in CASES for figure in resting(law, self.NAME, self.SIDEWAYS, text)]

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        values = []
        for motion in motions:
            lower, upper = (motion.pose[name][-1, :3] - motion.pose[name][0, :3] for name in (LOWER, UPPER))
            values.append(float(lower[2] - upper[2]))
            if law.pair.friction:
                values.append(float(np.hypot(*upper[:2])))
        return [replace(figure, measured=value) for figure, value in zip(self.wanted(law), values, strict=True)]


PROBES: Mapping[str, Probe] = {Cross.NAME: Cross()}
