"""Contact probe of faces that bodies on joints press together: boxes between two fingers on slides, one held and one slipping.

Each finger presses with a force P, so that friction carries 2 μ P of the box's weight. How P spreads over the corners of a face
is left open by rigid contact, since the slides bear every moment: the centres of pressure of both faces can lie anywhere
opposite to each other. Spread evenly, as both the box and the fingers are symmetrical, friction has no moment about the
fingers' line and the box falls straight with g − 2 μ P / m. Spread unevenly it turns the box, the same law of friction at
every point notwithstanding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from simspec.proof.contact.bodies import box
from simspec.proof.contact.impact import subject
from simspec.proof.contact.leaning import (
    HELD_SPEED,
    HELD_STEPS,
    HELD_TIME,
    HELD_WAY,
    SLIP_TOLERANCE,
    TOUCH,
)
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Joint, Pose, Vector3

EDGES: Vector3 = (0.1, 0.06, 0.06)
FINGER: Vector3 = (0.02, 0.06, 0.8)
"""Edges (m) of the boxes and of the fingers, in whose faces the boxes' lie all the way down."""
MASS, FINGER_MASS = 0.5, 0.3
HELD, SLIPS = 1.5, 0.8
"""Share of the weight that friction can carry."""
FALL = 0.1
"""m: how far the slipping box falls before it is measured."""
TURN = 0.01
"""What a box may turn, as 2 |sin(angle / 2)|: 0.4 mm at its corners. Solvers that spread pressure evenly leave 1e-8 in the
median of all frictions and timesteps, and up to 8e-3 (measured)."""
SPACING = 2.0
FINGERS, BOX = "fingers", "boxes"
"""Collision groups."""


class Squeeze(Probe):
    """Two boxes, each between two fingers."""

    NAME = "squeeze"
    SLIDES, TURNS = "squeeze-slips", "squeeze-turns"
    MEANING = "how far boxes between two fingers on slides move and turn, one held by friction and one slipping"

    def applies(self, law: Law) -> bool:
        return (
            law.pair.collide
            and law.pair.friction > 0.0
            and law.pair.hardness.kind == "common"
            and law.reach.squeezes
            and not law.pair.torsional_friction
            and not law.pair.rolling_friction
        )

    def force(self, law: Law, share: float) -> float:
        """N: of each finger, whose friction on both sides carries this share of the box's weight."""
        return share * MASS * GRAVITY / (2.0 * law.pair.friction)

    def steps(self, law: Law) -> int:
        """The step at which the slipping box has fallen by ``FALL``."""
        fall = (1.0 - SLIPS) * GRAVITY
        return max(1, math.ceil(math.sqrt(2.0 * FALL / fall) / law.timestep))

    def all_steps(self, law: Law) -> int:
        """As many, and enough to see what is held stand."""
        return max(self.steps(law), HELD_STEPS, math.ceil(HELD_TIME / law.timestep))

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
        y = SPACING * number
        out = (EDGES[0] + FINGER[0]) / 2.0 - TOUCH
        yield box(law, f"box_{number}", EDGES, MASS, (0.0, y, 0.0), group=BOX)
        yield _finger(law, f"left_{number}", (-out, y, 0.0))
        yield _finger(law, f"right_{number}", (out, y, 0.0))

    def wanted(self, law: Law) -> Sequence[Figure]:
        about = subject(law)
        steps = self.all_steps(law)
        stood = HELD_WAY + HELD_SPEED * steps * law.timestep
        whole = 0.5 * GRAVITY * (steps * law.timestep) ** 2
        way = self.fallen(law, (1.0 - SLIPS) * GRAVITY)
        free = self.fallen(law, GRAVITY)
        share = f"at {SLIPS:g} × the friction that holds"
        return [
            Figure(
                self.NAME, about, f"at {HELD:g} × the friction that holds", "way", "m", 0.0, None, stood, without=whole
            ),
            Figure(self.SLIDES, about, share, "way", "m", way, None, SLIP_TOLERANCE * way, without=free),
            Figure(self.TURNS, about, share, "turn", "rad", 0.0, None, TURN),
        ]

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        held, slipping = motions[0].pose["box_0"], motions[0].pose["box_1"][: self.steps(law) + 1]
        values = (
            float(np.linalg.norm(held[:, :3] - held[0, :3], axis=1).max()),
            float(slipping[0, 2] - slipping[-1, 2]),
            float(rotation_error(slipping[-1, 3:], slipping[0, 3:])),
        )
        return [replace(figure, measured=value) for figure, value in zip(self.wanted(law), values, strict=True)]


def _finger(law: Law, name: str, at: Vector3) -> Body:
    """A box on a slide along x."""
    joint = Joint(f"{name}_joint", "slide", origin=Pose(at), axis=(1.0, 0.0, 0.0), position=(0.0,), velocity=(0.0,))
    return replace(box(law, name, FINGER, FINGER_MASS, at, material=law.pair.first, group=FINGERS), joint=joint)


PROBES: Mapping[str, Probe] = {Squeeze.NAME: Squeeze()}
"""Of bodies with faces that others on joints can press."""
