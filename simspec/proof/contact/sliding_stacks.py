"""Contact probe of heavy bodies that slide with light ones, or over them.

A cube lies on a slab that lies on the floor. With one speed, both are stopped by friction at the same rate: the slab bears
friction from above and from below, of which a share that follows from the ratio of masses is left to stop it, so that an error
of friction counts as many times for the slab as the cube is heavier. A cube that slides over the slab pushes it with less than
the floor can hold, and the slab stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from simspec.proof.contact.bodies import box, floor, plane
from simspec.proof.contact.impact import DROP_RESTITUTION, subject
from simspec.proof.contact.leaning import HELD_SPEED, HELD_WAY, SLIP_TOLERANCE
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world.types import Body, Vector3

SLAB: Vector3 = (0.6, 0.6, 0.05)
CUBE: Vector3 = (0.2, 0.2, 0.1)
"""Edges (m): flat, so that neither tips below ``TIPS``."""
TIPS = 2.0
"""Friction at which the cube tips over its edge."""
LIGHT = 1.0
"""kg: mass of the slab."""
WAY = 0.1
"""m: about how far bodies slide; the cube stays over the middle of the slab."""
LEAST_STEPS = 10
SPACING = 4.0
ON_PLANE = "-plane"
"""Ends the names of figures on a plane; the others are on a box."""
SLIDING, STANDING = "sliding", "standing"
"""Names of the slabs, by how they begin; of each, and of its cube, the collision groups are their names."""


class SlidingStack(Probe):
    """A cube and a slab that slide together, and a cube that slides over a slab that stands."""

    NAME = "stack-slides"
    STAYS = "stack-stays"
    MEANING = (
        "how far heavy bodies slide with lighter ones below them, and over them, at the scenario's ratio of masses"
    )

    def applies(self, law: Law) -> bool:
        return (
            law.pair.collide
            and 0.0 < law.pair.friction < TIPS
            and law.pair.hardness.kind == "common"
            and law.reach.ratio > 0.0
            and law.reach.corners
            and law.pair.restitution <= DROP_RESTITUTION
            and not law.pair.rolling_friction
        )

    def steps(self, law: Law) -> int:
        """Steps in which what slides comes to rest."""
        return max(LEAST_STEPS, math.ceil(math.sqrt(2.0 * WAY / (law.pair.friction * GRAVITY)) / law.timestep))

    def speed(self, law: Law) -> float:
        """m/s: at the start."""
        return self.steps(law) * law.pair.friction * GRAVITY * law.timestep

    def way(self, law: Law) -> float:
        """m: until rest, by semi-implicit Euler, the method of all engines."""
        steps = self.steps(law)
        return law.pair.friction * GRAVITY * law.timestep**2 * steps * (steps - 1) / 2.0

    def trials(self, law: Law) -> Sequence[Trial]:
        """On a box, the slab first; where the world has a plane, on a plane too, the cube first: solvers that sweep over
        contacts have them in another order then."""
        on_box = self._trial(law, floor(law))
        if not law.reach.plane:
            return [on_box]
        on_plane = self._trial(law, plane(law))
        return [on_box, replace(on_plane, bodies=tuple(reversed(on_plane.bodies)))]

    def _trial(self, law: Law, ground: Body) -> Trial:
        bodies, meets = [ground], []
        for number, (name, speed) in enumerate(((SLIDING, self.speed(law)), (STANDING, 0.0))):
            y, cube, heavy = SPACING * number, f"{name}_cube", law.reach.ratio * LIGHT
            above = (-WAY / 2.0, y, SLAB[2] + CUBE[2] / 2.0)
            bodies += [
                self._box(law, name, SLAB, LIGHT, (0.0, y, SLAB[2] / 2.0), speed, law.pair.second),
                self._box(law, cube, CUBE, heavy, above, self.speed(law), law.pair.first),
            ]
            meets.append((name, cube))
        return Trial(tuple(bodies), (Phase(self.steps(law)),), tuple(meets))

    def _box(self, law: Law, name: str, size: Vector3, mass: float, at: Vector3, speed: float, material: str) -> Body:
        return box(law, name, size, mass, at, (speed, 0.0, 0.0, 0.0, 0.0, 0.0), material=material, group=name)

    def wanted(self, law: Law) -> Sequence[Figure]:
        return [figure for ground in self._grounds(law) for figure in self._on(law, ground)]

    def _grounds(self, law: Law) -> tuple[str, ...]:
        """What names of figures end with, by trial."""
        return ("", ON_PLANE) if law.reach.plane else ("",)

    def _on(self, law: Law, ground: str) -> tuple[Figure, Figure, Figure]:
        way, about, ratio = self.way(law), subject(law), law.reach.ratio
        free = self.speed(law) * self.steps(law) * law.timestep
        slides = ("way", "m", way, None, SLIP_TOLERANCE * way)
        stays = HELD_WAY + HELD_SPEED * self.steps(law) * law.timestep
        over = f"{ratio:.4g} kg over {LIGHT:g} kg"
        return (
            Figure(self.NAME + ground, about, f"{ratio:.4g} kg with {LIGHT:g} kg", *slides, without=free),
            Figure(self.NAME + ground, about, over, *slides, without=free),
            Figure(self.STAYS + ground, about, over, "way", "m", 0.0, None, stays, without=way),
        )

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        found: list[Figure] = []
        for ground, motion in zip(self._grounds(law), motions, strict=True):
            ways = {name: float(pose[-1, 0] - pose[0, 0]) for name, pose in motion.pose.items()}
            slab = motion.pose[STANDING][:, :2]
            together, over, stays = self._on(law, ground)
            off = {
                "the slab": ways[SLIDING] - together.expected,
                "the cube": ways[f"{SLIDING}_cube"] - together.expected,
            }
            worst = max(off, key=lambda name: math.inf if math.isnan(off[name]) else abs(off[name]))
            found += [
                replace(together, measured=together.expected + off[worst], worst=worst),
                replace(over, measured=ways[f"{STANDING}_cube"]),
                replace(stays, measured=float(np.hypot(*(slab - slab[0]).T).max())),
            ]
        return found


PROBES: Mapping[str, Probe] = {SlidingStack.NAME: SlidingStack()}
