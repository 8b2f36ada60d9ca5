"""Contact probes of bodies that friction carries: on slabs that accelerate, and between fingers.

carrier  A box lies on a slab that speeds up, or on one that turns, at half the acceleration that friction allows: it stays
         where it lies. A law of friction that takes slip back at a rate instead of within the step lets it drift, at its
         acceleration over that rate, whatever the timestep.
squeeze  Boxes between two fingers on slides, one held and one slipping. Each finger presses with a force P, so that friction
         carries 2 μ P of the box's weight. How P spreads over the corners of a face is left open by rigid contact, since the
         slides bear every moment: the centres of pressure of both faces can lie anywhere opposite to each other. Spread evenly,
         as both the box and the fingers are symmetrical, friction has no moment about the fingers' line and the box falls
         straight with g − 2 μ P / m. Spread unevenly it turns the box, although every point has the same law of friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from simspec.proof.contact.friction import SETTLE
from simspec.proof.contact.leaning import HELD_STEPS, HELD_TIME, SLIP_TOLERANCE, TOUCH, held_way
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.proof.contact.worlds import box
from simspec.world import frames
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Joint, Pose, Vector3

SHARE = 0.5
"""Acceleration of a carrier over the largest that friction transmits."""
CARRIED_TIME, CARRIED_STEPS = 0.3, 40
"""The longer of the two (s, steps)."""
SLAB, SLAB_MASS = (3.0, 3.0, 0.4), 1000.0
"""Of carriers (m, kg): so heavy that what they carry tilts them by less than 1e-4 rad."""
EDGE, MASS = 0.2, 1.0
"""Of what is carried (m, kg): flat, half as high."""
OUT = 1.0
"""m from a turning carrier's axis."""
SLAB_SPACING = 10.0


class Carrier(Probe):
    """How far boxes slip on carriers that accelerate at half the limit of friction, along a line and turning."""

    NAME = "carrier"
    CASES = ("speeds up", "turns")

    def applies(self, law: Law) -> bool:
        return law.is_rigid and law.pair.friction > 0.0 and law.reach.carries

    def _acceleration(self, law: Law) -> float:
        return SHARE * law.pair.friction * GRAVITY

    def _bodies(self, law: Law) -> Iterator[Body]:
        turn = math.sqrt(self._acceleration(law) / OUT)
        height = SLAB[2] / 2.0 + EDGE / 4.0
        states = {
            "speeds up": ((0.0,) * 6, (0.0,) * 6, 0.0),
            "turns": ((0.0, 0.0, 0.0, 0.0, 0.0, turn), (0.0, turn * OUT, 0.0, 0.0, 0.0, turn), OUT),
        }
        for number, case in enumerate(self.CASES):
            carrier, carried, out = states[case]
            x = SLAB_SPACING * number
            slab, load = f"slab_{number}", f"load_{number}"
            yield box(law, slab, SLAB, SLAB_MASS, (x, 0.0, 0.0), carrier, material=law.pair.first, group=slab)
            yield box(law, load, (EDGE, EDGE, EDGE / 2.0), MASS, (x + out, 0.0, height), carried, group=load)

    def trials(self, law: Law) -> Sequence[Trial]:
        settle, steps = law.steps(SETTLE, 10), law.steps(CARRIED_TIME, CARRIED_STEPS)
        weight = (SLAB_MASS + MASS) * GRAVITY
        actual = (0.0, 0.0, weight, 0.0, 0.0, 0.0)
        pushed = ((SLAB_MASS + MASS) * self._acceleration(law), 0.0, weight, 0.0, 0.0, 0.0)
        phases = (
            Phase(settle, settle, {"slab_0": actual, "slab_1": actual}),
            Phase(steps, steps, {"slab_0": pushed, "slab_1": actual}),
        )
        meets = tuple((f"load_{number}", f"slab_{number}") for number in range(len(self.CASES)))
        return [Trial(tuple(self._bodies(law)), phases, meets)]

    def wanted(self, law: Law) -> Sequence[Figure]:
        """Without friction the box stays where it is in the world, or goes on along its tangent."""
        steps, acceleration = law.steps(CARRIED_TIME, CARRIED_STEPS), self._acceleration(law)
        time, value = steps * law.timestep, held_way(law, steps)
        turn = math.sqrt(acceleration / OUT)
        # a point that turns goes along the tangent for a step: it moves outwards by ω² r dt/2 in a second, or not at all
        # where friction is a spring to where the body lies
        outwards = acceleration * law.timestep / 2.0 * time
        straight = OUT * complex(1.0, turn * time) * complex(math.cos(turn * time), -math.sin(turn * time))
        speeds_up, turns = ((f"a carrier that {case}", "slip", "m") for case in self.CASES)
        return [
            self.figure(law, *speeds_up, 0.0, value, without=0.5 * acceleration * time**2),
            self.figure(law, *turns, outwards, outwards + value, without=abs(straight - OUT)),
        ]

    def readings(self, law: Law, motions: Sequence[Motion]) -> Sequence[float]:
        slips = []
        for number in range(len(self.CASES)):
            places = [_seen(motions[0], f"slab_{number}", f"load_{number}", at) for at in (-2, -1)]
            slips.append(float(np.linalg.norm(places[1] - places[0])))
        return slips


def _seen(motion: Motion, carrier: str, carried: str, at: int) -> np.ndarray:
    """Where a body's frame is in another's (3,), in m."""
    below, above = motion.pose[carrier][at], motion.pose[carried][at]
    found: np.ndarray = np.array(frames.matrix(tuple(below[3:].tolist()))).T @ (above[:3] - below[:3])
    return found


EDGES: Vector3 = (0.1, 0.06, 0.06)
FINGER: Vector3 = (0.02, 0.06, 0.8)
"""Edges (m) of the boxes and of the fingers, in whose faces the boxes' lie all the way down."""
BOX_MASS, FINGER_MASS = 0.5, 0.3
HELD, SLIPS = 1.5, 0.8
"""Share of the weight that friction can carry."""
FALL = 0.1
"""m: how far the slipping box falls before it is measured."""
TURN = 0.01
"""What a box may turn, as 2 |sin(angle / 2)|: 0.4 mm at its corners. Solvers that spread pressure evenly leave 1e-8 in the
median of all frictions and timesteps, and up to 8e-3 (measured)."""
BOX_SPACING = 2.0
"""m between boxes."""
FINGERS, BOX = "fingers", "boxes"
"""Collision groups."""


class Squeeze(Probe):
    """How far boxes between two fingers on slides move and turn, one held by friction and one slipping."""

    NAME = "squeeze"
    SLIDES, TURNS = "squeeze-slips", "squeeze-turns"

    def applies(self, law: Law) -> bool:
        return (
            law.is_rigid
            and law.pair.friction > 0.0
            and law.reach.squeezes
            and not law.pair.torsional_friction
            and not law.pair.rolling_friction
        )

    def force(self, law: Law, share: float) -> float:
        """N: of each finger, whose friction on both sides carries this share of the box's weight."""
        return share * BOX_MASS * GRAVITY / (2.0 * law.pair.friction)

    def steps(self, law: Law) -> int:
        """The step at which the slipping box has fallen by ``FALL``."""
        fall = (1.0 - SLIPS) * GRAVITY
        return law.steps(math.sqrt(2.0 * FALL / fall))

    def all_steps(self, law: Law) -> int:
        """As many, and enough to see what is held stand."""
        return max(self.steps(law), law.steps(HELD_TIME, HELD_STEPS))

    def fallen(self, law: Law, acceleration: float) -> float:
        """m: after :meth:`steps` of semi-implicit Euler, the method of all engines."""
        steps = self.steps(law)
        return acceleration * law.timestep**2 * steps * (steps + 1) / 2.0

    def trials(self, law: Law) -> Sequence[Trial]:
        bodies: list[Body] = []
        effort: dict[str, tuple[float, ...]] = {}
        for number, share in enumerate((HELD, SLIPS)):
            bodies += self._squeezed(law, number)
            force = self.force(law, share)
            effort |= {f"left_{number}": (force,), f"right_{number}": (-force,)}
        steps = self.all_steps(law)
        return [Trial(tuple(bodies), (Phase(steps, effort=effort),), ((BOX, FINGERS),))]  # type: ignore[arg-type]

    def _squeezed(self, law: Law, number: int) -> Iterator[Body]:
        y = BOX_SPACING * number
        out = (EDGES[0] + FINGER[0]) / 2.0 - TOUCH
        yield box(law, f"box_{number}", EDGES, BOX_MASS, (0.0, y, 0.0), group=BOX)
        yield _finger(law, f"left_{number}", (-out, y, 0.0))
        yield _finger(law, f"right_{number}", (out, y, 0.0))

    def wanted(self, law: Law) -> Sequence[Figure]:
        steps = self.all_steps(law)
        whole = 0.5 * GRAVITY * (steps * law.timestep) ** 2
        way, free = (self.fallen(law, acceleration) for acceleration in ((1.0 - SLIPS) * GRAVITY, GRAVITY))
        text, slips = (f"at {share:g} × the friction that holds" for share in (HELD, SLIPS))
        slides = {"probe": self.SLIDES, "without": free}
        return [
            self.figure(law, text, "way", "m", 0.0, held_way(law, steps), without=whole),
            self.figure(law, slips, "way", "m", way, SLIP_TOLERANCE * way, **slides),
            self.figure(law, slips, "turn", "rad", 0.0, TURN, probe=self.TURNS),
        ]

    def readings(self, law: Law, motions: Sequence[Motion]) -> Sequence[float]:
        values, slipping = motions[0].pose["box_0"], motions[0].pose["box_1"][: self.steps(law) + 1]
        return [
            float(np.linalg.norm(values[:, :3] - values[0, :3], axis=1).max()),
            float(slipping[0, 2] - slipping[-1, 2]),
            float(rotation_error(slipping[-1, 3:], slipping[0, 3:])),
        ]


def _finger(law: Law, name: str, at: Vector3) -> Body:
    """A box on a slide along x."""
    joint = Joint(f"{name}_joint", "slide", origin=Pose(at), axis=(1.0, 0.0, 0.0), position=(0.0,), velocity=(0.0,))
    return replace(box(law, name, FINGER, FINGER_MASS, at, material=law.pair.first, group=FINGERS), joint=joint)
