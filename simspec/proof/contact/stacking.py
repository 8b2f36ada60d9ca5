"""Contact probe of heavy bodies on light ones: stacks of cubes whose masses differ as the scenario's do.

A solver that takes contacts one after the other needs the more sweeps the larger the ratio of masses is, and what it has not
solved is left as overlap. The truth is that nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from simspec.proof.contact.bodies import box, floor
from simspec.proof.contact.impact import DROP_RESTITUTION, REST_DEPTH, hop, subject
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world.types import Body

EDGE, LIGHTEST = 0.1, 1.0
"""Edge (m) of all cubes, and the mass (kg) of the lowest."""
TIME, STEPS = 0.8, 400
"""The longer of the two (s, steps): what sinks for ever is an order of magnitude beyond the tolerance by then (measured: the
slowest that is called wrong sinks or slides 0.2 mm/s)."""
SIDEWAYS = 1e-4
"""m: friction holds a stack, so that it moves sideways no further than it may sink."""
ADRIFT = 0.01 * EDGE
"""m: how far cubes without friction may have moved sideways where their depth is measured. Nothing holds them there: the
unevenness that a solver leaves in the pressure over a face drives them apart ever faster, until the upper falls off (measured
in an engine after 0.1 to 0.8 s at a ratio of 300), which says nothing of how far it sinks in."""
SAMPLES = 200
"""States of a stack without friction."""
SPACING = 1.0


class Stack(Probe):
    """Cubes on each other, the heavy above the light."""

    NAME = "stack"
    SIDEWAYS = "stack-sideways"
    MEANING = (
        "how far cubes sink into lighter ones below them, or move sideways, at the scenario's own ratios of masses"
    )

    def applies(self, law: Law) -> bool:
        return (
            law.pair.collide
            and law.pair.hardness.kind == "common"
            and law.reach.ratio > 0.0
            and law.pair.restitution <= DROP_RESTITUTION
        )

    def stacks(self, law: Law) -> dict[str, tuple[float, ...]]:
        """Masses (kg) from the lowest up, by name: two layers at the whole ratio, and three that share it."""
        ratio = law.reach.ratio
        found: dict[str, tuple[float, ...]] = {"two": (LIGHTEST, ratio * LIGHTEST)}
        if law.reach.layers > 2:
            found["three"] = (LIGHTEST, math.sqrt(ratio) * LIGHTEST, ratio * LIGHTEST)
        return found

    def _bodies(self, law: Law) -> Iterator[Body]:
        for number, (name, masses) in enumerate(self.stacks(law).items()):
            for layer, mass in enumerate(masses):
                at = (SPACING * number, 0.0, EDGE * (layer + 0.5))
                material = law.pair.first if layer % 2 else law.pair.second
                yield box(law, f"{name}_{layer}", (EDGE,) * 3, mass, at, material=material, group=f"{name}_{layer}")

    def trials(self, law: Law) -> Sequence[Trial]:
        meets = [
            (f"{name}_{layer}", f"{name}_{layer + 1}")
            for name, masses in self.stacks(law).items()
            for layer in range(len(masses) - 1)
        ]
        steps = steps_of(law)
        every = steps if law.pair.friction else steps // SAMPLES
        return [Trial((floor(law), *self._bodies(law)), (Phase(steps, every),), tuple(meets))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        texts = (
            f"{' on '.join(f'{mass:.4g}' for mass in reversed(masses))} kg" for masses in self.stacks(law).values()
        )
        return [figure for text in texts for figure in resting(law, self.NAME, self.SIDEWAYS, text)]

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        motion = motions[0]
        values = []
        for name, masses in self.stacks(law).items():
            paths = [motion.pose[f"{name}_{layer}"][:, :3] for layer in range(len(masses))]
            at = -1 if law.pair.friction else _before_adrift(paths)
            moved = [path[at] - path[0] for path in paths]
            # the depth of each contact, not of the sum of those below it
            depths = [float(lower[2] - upper[2]) for lower, upper in zip([np.zeros(3), *moved], moved, strict=False)]
            values.append(max(depths, key=_size))
            if law.pair.friction:
                values.append(max((float(np.hypot(*move[:2])) for move in moved), key=_size))
        return [replace(figure, measured=value) for figure, value in zip(self.wanted(law), values, strict=True)]


def _before_adrift(paths: Sequence[np.ndarray]) -> int:
    """The last state before any of the cubes is :data:`ADRIFT`; the first after the initial one at least. The very last one
    where any state is not finite."""
    ways = np.max([np.hypot(*(path[:, :2] - path[0, :2]).T) for path in paths], axis=0)
    beyond = np.flatnonzero(ways > ADRIFT)
    return max(1, int(beyond[0]) - 1) if len(beyond) and np.isfinite(ways).all() else -1


def steps_of(law: Law) -> int:
    """Steps of a trial in which nothing may move."""
    return max(STEPS, math.ceil(TIME / law.timestep))


def resting(law: Law, name: str, sideways: str, case: str) -> Iterator[Figure]:
    """The figures of bodies that lie on each other: depth, and with friction the way sideways. Without support everything falls
    as long as the trial lasts; sideways nothing moves without a cause."""
    hops = hop(law) * law.timestep
    fallen = 0.5 * GRAVITY * (steps_of(law) * law.timestep) ** 2
    yield Figure(name, subject(law), case, "depth", "m", 0.0, None, REST_DEPTH + hops, without=fallen)
    if law.pair.friction:
        yield Figure(sideways, subject(law), case, "way", "m", 0.0, None, SIDEWAYS + hops)


def _size(value: float) -> float:
    return math.inf if math.isnan(value) else abs(value)


PROBES: Mapping[str, Probe] = {Stack.NAME: Stack()}
