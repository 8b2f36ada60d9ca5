"""Contact probes of clamps that jam: friction alone presses them onto the post, and slip would need a negative normal force.

With the gain 2 μ d / h of :class:`simspec.proof.contact.leaning.Clamp` above 1, N (h − 2 μ d) = T has no solution for a
moment T > 0: the clamp stands under every moment, at N h = m g d + T. The smaller T, the less of N is left in the frictionless
problem, N = T / h, from which solvers that sweep over contacts begin. At T = 0 standing and falling both solve the
equations, so that nothing is measured there.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.proof.contact.leaning import Case, Clamp
from simspec.proof.contact.probe import GRAVITY, Law, Probe


class Jam(Clamp):
    """A clamp that jams, under the moment of its weight about its own height."""

    NAME = "jam"
    MEANING = "how far a clamp moves that jams, since slip would need a negative normal force"
    HEIGHT = 0.1
    MOMENT = 1.0
    """Over the weight times ``HEIGHT``: without friction the post would bear this many weights on each side."""
    LEAST_FRICTION = 0.04
    """Below it the centre of mass would be more than 2 m off the post."""

    def applies(self, law: Law) -> bool:
        return super().applies(law) and law.reach.jams and law.pair.friction >= self.LEAST_FRICTION

    def cases(self, law: Law) -> list[Case]:
        return [case for case in super().cases(law) if case.stands]

    def distance(self, friction: float, case: Case) -> float:
        """That at which the gain is the case's ratio."""
        return case.ratio * self.HEIGHT / (2.0 * friction)

    def moment(self, law: Law, case: Case) -> float:
        return self.MOMENT * GRAVITY * self.MASS * self.HEIGHT


class LightJam(Jam):
    """The same under a hundredth of the moment."""

    NAME = "jam-light"
    MEANING = "the same where friction makes nearly all of the normal force"
    MOMENT = 0.01


PROBES: Mapping[str, Probe] = {Jam.NAME: Jam(), LightJam.NAME: LightJam()}
"""Of bodies of several shapes, which can clamp another."""
