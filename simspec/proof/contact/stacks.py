"""Contact probes of bodies on each other: stacks, stacks that slide, and boxes whose edges cross.

stack         Heavy cubes on light ones. A solver that takes contacts one after the other needs the more sweeps the larger the
              ratio of masses is, and what it has not solved is left as overlap. The truth is that nothing moves.
stack-slides  A cube lies on a slab that lies on the floor. With one speed, friction stops both at the same rate: the slab bears
              friction from above and from below, of which a share that follows from the ratio of masses is left to stop it, so
              that an error of friction counts as many times for the slab as the cube is heavier. A cube that slides over the
              slab pushes it with less than the floor can hold, and the slab stays.
cross         Boxes that lie on each other with edges that cross, and few corners or none over the other's face. The contact is
              bounded by points where edges cross, which are no corners of either box. An engine that looks for corners alone
              finds one point there or none, on which the upper box turns and sinks. The truth is that nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from simspec.proof.contact.friction import SETTLE
from simspec.proof.contact.leaning import SLIP_TOLERANCE, STANDING_STEPS, STANDING_TIME, TOUCH, standing_way
from simspec.proof.contact.normal import DROP_RESTITUTION, REST_DEPTH, hop
from simspec.proof.contact.probe import (
    GRAVITY,
    Phase,
    Probe,
    ProbeFigure,
    ProbeLaw,
    ProbeTrial,
    TrialMotion,
    deviation,
    furthest,
)
from simspec.proof.contact.worlds import box, floor, plane
from simspec.world import frames
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Joint, Pose, Vector3

EDGE, LIGHTEST = 0.1, 1.0
"""Edge (m) of all cubes, and the mass (kg) of the lowest."""
TIME, STEPS = 0.8, 400
"""The longer of the two (s, steps): a body that sinks for ever is an order of magnitude beyond the tolerance by then (measured:
the slowest that is called wrong sinks or slides 0.2 mm/s)."""
SIDEWAYS = 1e-4
"""m: friction holds a stack, so that it moves sideways no further than it may sink."""
ADRIFT = 0.01 * EDGE
"""m: how far cubes without friction may have moved sideways where their depth is measured. Nothing holds them there: the
unevenness that a solver leaves in the pressure over a face separates them ever faster, until the upper falls off (measured
in an engine after 0.1 to 0.8 s at a ratio of 300), which says nothing of how far it sinks in."""
SAMPLES = 200
"""States of a stack without friction."""
STACK_SPACING = 1.0
"""m between stacks."""


class Stack(Probe):
    """How far cubes sink into lighter ones below them, or move sideways, at the scenario's ratios of masses."""

    NAME = "stack"
    SIDEWAYS = "stack-sideways"

    def applies(self, law: ProbeLaw) -> bool:
        return law.is_rigid and law.reach.ratio > 0.0 and law.pair.restitution <= DROP_RESTITUTION

    def stacks(self, law: ProbeLaw) -> dict[str, tuple[float, ...]]:
        """Masses (kg) from the lowest up, by name: two layers at the whole ratio, and three that share it."""
        ratio = law.reach.ratio
        found: dict[str, tuple[float, ...]] = {"two": (LIGHTEST, ratio * LIGHTEST)}
        if law.reach.layers > 2:
            found["three"] = (LIGHTEST, math.sqrt(ratio) * LIGHTEST, ratio * LIGHTEST)
        return found

    def _bodies(self, law: ProbeLaw) -> Iterator[Body]:
        for number, (name, masses) in enumerate(self.stacks(law).items()):
            for layer, mass in enumerate(masses):
                at = (STACK_SPACING * number, 0.0, EDGE * (layer + 0.5))
                material = law.pair.first if layer % 2 else law.pair.second
                yield box(law, f"{name}_{layer}", (EDGE,) * 3, mass, at, material=material, group=f"{name}_{layer}")

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        meets = [
            (f"{name}_{layer}", f"{name}_{layer + 1}")
            for name, masses in self.stacks(law).items()
            for layer in range(len(masses) - 1)
        ]
        steps = law.steps(TIME, STEPS)
        every = steps if law.pair.friction else steps // SAMPLES
        return [ProbeTrial((floor(law), *self._bodies(law)), (Phase(steps, every),), tuple(meets))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        texts = (" on ".join(f"{mass:.4g}" for mass in reversed(masses)) for masses in self.stacks(law).values())
        return [figure for text in texts for figure in _resting(self, law, f"{text} kg", self.SIDEWAYS)]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        motion, readings = motions[0], []
        for name, masses in self.stacks(law).items():
            paths = [motion.pose[f"{name}_{layer}"][:, :3] for layer in range(len(masses))]
            at = -1 if law.pair.friction else _before_adrift(paths)
            moved = [path[at] - path[0] for path in paths]
            # the depth of each contact, not of the sum of those below it
            depths = [float(lower[2] - upper[2]) for lower, upper in zip([np.zeros(3), *moved], moved, strict=False)]
            readings.append(max(depths, key=deviation))
            if law.pair.friction:
                readings.append(max((float(np.hypot(*move[:2])) for move in moved), key=deviation))
        return readings


def _before_adrift(paths: Sequence[np.ndarray]) -> int:
    """The last state before any of the cubes is :data:`ADRIFT`; the first after the initial one at least. The very last one
    where any state is not finite."""
    ways = np.max([np.hypot(*(path[:, :2] - path[0, :2]).T) for path in paths], axis=0)
    beyond = np.flatnonzero(ways > ADRIFT)
    return max(1, int(beyond[0]) - 1) if len(beyond) and np.isfinite(ways).all() else -1


def _resting(probe: Probe, law: ProbeLaw, case: str, sideways: str) -> Iterator[ProbeFigure]:
    """The figures of bodies that lie on each other: depth, and with friction the way sideways. Without support everything falls
    as long as the trial lasts; sideways nothing moves without a cause."""
    hops = hop(law) * law.timestep
    fallen = 0.5 * GRAVITY * (law.steps(TIME, STEPS) * law.timestep) ** 2
    yield probe.figure(law, case, "depth", "m", 0.0, REST_DEPTH + hops, without=fallen)
    if law.pair.friction:
        yield probe.figure(law, case, "way", "m", 0.0, SIDEWAYS + hops, probe=sideways)


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
SLAB_SPACING = 4.0
ON_PLANE = "-plane"
"""Ends the names of figures on a plane; the others are on a box."""
SLIDING, STANDING = "sliding", "standing"
"""Names of the slabs, by how they begin; of each, and of its cube, the collision groups are their names."""


class SlidingStack(Probe):
    """How far a cube and a slab slide together, and a cube over a slab that stays, at the scenario's ratio of masses."""

    NAME = "stack-slides"
    STAYS = "stack-stays"

    def applies(self, law: ProbeLaw) -> bool:
        return (
            law.is_rigid
            and 0.0 < law.pair.friction < TIPS
            and law.reach.ratio > 0.0
            and law.reach.corners
            and law.pair.restitution <= DROP_RESTITUTION
            and not law.pair.rolling_friction
        )

    def steps(self, law: ProbeLaw) -> int:
        """Steps in which what slides comes to rest."""
        return law.steps(math.sqrt(2.0 * WAY / (law.pair.friction * GRAVITY)), LEAST_STEPS)

    def speed(self, law: ProbeLaw) -> float:
        """m/s: at the start."""
        return self.steps(law) * law.pair.friction * GRAVITY * law.timestep

    def way(self, law: ProbeLaw) -> float:
        """m: until rest, by semi-implicit Euler, the method of all engines."""
        steps = self.steps(law)
        return law.pair.friction * GRAVITY * law.timestep**2 * steps * (steps - 1) / 2.0

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        """On a box, the slab first; where the world has a plane, on a plane too, the cube first: solvers that sweep over
        contacts have them in another order then."""
        on_box = self._trial(law, floor(law))
        if not law.reach.plane:
            return [on_box]
        on_plane = self._trial(law, plane(law))
        return [on_box, replace(on_plane, bodies=tuple(reversed(on_plane.bodies)))]

    def _trial(self, law: ProbeLaw, ground: Body) -> ProbeTrial:
        bodies, meets = [ground], []
        for number, (name, speed) in enumerate(((SLIDING, self.speed(law)), (STANDING, 0.0))):
            y, cube, heavy = SLAB_SPACING * number, f"{name}_cube", law.reach.ratio * LIGHT
            above = (-WAY / 2.0, y, SLAB[2] + CUBE[2] / 2.0)
            slab, first = ((along, 0.0, 0.0, 0.0, 0.0, 0.0) for along in (speed, self.speed(law)))
            bodies.append(box(law, name, SLAB, LIGHT, (0.0, y, SLAB[2] / 2.0), slab, group=name))
            bodies.append(box(law, cube, CUBE, heavy, above, first, material=law.pair.first, group=cube))
            meets.append((name, cube))
        return ProbeTrial(tuple(bodies), (Phase(self.steps(law)),), tuple(meets))

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        return [figure for ground in (("", ON_PLANE) if law.reach.plane else ("",)) for figure in self._on(law, ground)]

    def _on(self, law: ProbeLaw, ground: str) -> tuple[ProbeFigure, ProbeFigure, ProbeFigure]:
        way, ratio, steps = self.way(law), law.reach.ratio, self.steps(law)
        slides = ("way", "m", way, SLIP_TOLERANCE * way)
        free: dict[str, Any] = {"probe": self.NAME + ground, "without": self.speed(law) * steps * law.timestep}
        over = f"{ratio:.4g} kg over {LIGHT:g} kg"
        stays = {"probe": self.STAYS + ground, "without": way}
        return (
            self.figure(law, f"{ratio:.4g} kg with {LIGHT:g} kg", *slides, **free),
            self.figure(law, over, *slides, **free),
            self.figure(law, over, "way", "m", 0.0, standing_way(law, steps), **stays),
        )

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float | Mapping[str, Any]]:
        readings: list[float | Mapping[str, Any]] = []
        for motion in motions:
            ways = {name: float(pose[-1, 0] - pose[0, 0]) for name, pose in motion.pose.items()}
            slab = motion.pose[STANDING][:, :2]
            together = {"the slab": ways[SLIDING], "the cube": ways[f"{SLIDING}_cube"]}
            worst = furthest(together, self.way(law))
            readings += [
                {"measured": together[worst], "worst": worst},
                ways[f"{STANDING}_cube"],
                float(np.hypot(*(slab - slab[0]).T).max()),
            ]
        return readings


SQUARE: Vector3 = (0.2, 0.2, 0.1)
BEAM: Vector3 = (0.1, 0.3, 0.1)
"""Edges (m)."""
CROSS_MASS = 1.0
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
    """How far boxes sink, or move sideways, that lie on others so that edges cross."""

    NAME = "cross"
    SIDEWAYS = "cross-sideways"

    def applies(self, law: ProbeLaw) -> bool:
        return law.is_rigid and law.reach.crosses and law.pair.restitution <= DROP_RESTITUTION

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        """One world for each case: solvers of dense equations fail to converge with all cases in one."""
        return [self._trial(law, *case) for case in CASES.values()]

    def _trial(self, law: ProbeLaw, below: Vector3, above: Vector3, turn: float, moved: float) -> ProbeTrial:
        at = (0.0, moved, below[2] + above[2] / 2.0)
        turned = frames.from_axis_angle((0.0, 0.0, 1.0), math.radians(turn))
        lower = box(law, LOWER, below, CROSS_MASS, (0.0, 0.0, below[2] / 2.0), group=LOWER)
        upper = box(law, UPPER, above, CROSS_MASS, at, turn=turned, material=law.pair.first, group=UPPER)
        steps = law.steps(TIME, STEPS)
        return ProbeTrial((floor(law), lower, upper), (Phase(steps, steps),), ((LOWER, UPPER),))

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        return [figure for text in CASES for figure in _resting(self, law, text, self.SIDEWAYS)]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        readings = []
        for motion in motions:
            lower, upper = (motion.pose[name][-1, :3] - motion.pose[name][0, :3] for name in (LOWER, UPPER))
            readings.append(float(lower[2] - upper[2]))
            if law.pair.friction:
                readings.append(float(np.hypot(*upper[:2])))
        return readings


# Contact probes of bodies that friction carries: on slabs that accelerate, and between fingers.
#
# carrier  A box lies on a slab that speeds up, or on one that turns, at half the acceleration that friction allows: it stays
#          where it lies. A law of friction that takes slip back at a rate instead of within the step lets it drift, at its
#          acceleration over that rate, whatever the timestep.
# squeeze  Boxes between two fingers on slides, one held and one slipping. Each finger presses with a force P, so that friction
#          carries 2 μ P of the box's weight. How P spreads over the corners of a face is left open by rigid contact, since the
#          slides bear every moment: the centres of pressure of both faces can lie anywhere opposite to each other. Spread
#          evenly, as box and fingers are symmetrical, friction has no moment about the fingers' line and the box falls
#          straight with g − 2 μ P / m. Spread unevenly it turns the box, although every point has the same law of friction.

SHARE = 0.5
"""Acceleration of a carrier over the largest that friction transmits."""
CARRIED_TIME, CARRIED_STEPS = 0.3, 40
"""The longer of the two (s, steps)."""
CARRIER_SLAB, SLAB_MASS = (3.0, 3.0, 0.4), 1000.0
"""Of carriers (m, kg): so heavy that what they carry tilts them by less than 1e-4 rad."""
LOAD_EDGE, MASS = 0.2, 1.0
"""Of what is carried (m, kg): flat, half as high."""
OUT = 1.0
"""m from a turning carrier's axis."""
CARRIER_SPACING = 10.0


class Carrier(Probe):
    """How far boxes slip on carriers that accelerate at half the limit of friction, along a line and turning."""

    NAME = "carrier"
    CASES = ("speeds up", "turns")

    def applies(self, law: ProbeLaw) -> bool:
        return law.is_rigid and law.pair.friction > 0.0 and law.reach.carries

    def _acceleration(self, law: ProbeLaw) -> float:
        return SHARE * law.pair.friction * GRAVITY

    def _bodies(self, law: ProbeLaw) -> Iterator[Body]:
        turn = math.sqrt(self._acceleration(law) / OUT)
        height = CARRIER_SLAB[2] / 2.0 + LOAD_EDGE / 4.0
        states = {
            "speeds up": ((0.0,) * 6, (0.0,) * 6, 0.0),
            "turns": ((0.0, 0.0, 0.0, 0.0, 0.0, turn), (0.0, turn * OUT, 0.0, 0.0, 0.0, turn), OUT),
        }
        for number, case in enumerate(self.CASES):
            carrier, carried, out = states[case]
            x = CARRIER_SPACING * number
            slab, load = f"slab_{number}", f"load_{number}"
            yield box(law, slab, CARRIER_SLAB, SLAB_MASS, (x, 0.0, 0.0), carrier, material=law.pair.first, group=slab)
            yield box(
                law, load, (LOAD_EDGE, LOAD_EDGE, LOAD_EDGE / 2.0), MASS, (x + out, 0.0, height), carried, group=load
            )

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        settle, steps = law.steps(SETTLE, 10), law.steps(CARRIED_TIME, CARRIED_STEPS)
        weight = (SLAB_MASS + MASS) * GRAVITY
        actual = (0.0, 0.0, weight, 0.0, 0.0, 0.0)
        pushed = ((SLAB_MASS + MASS) * self._acceleration(law), 0.0, weight, 0.0, 0.0, 0.0)
        phases = (
            Phase(settle, settle, {"slab_0": actual, "slab_1": actual}),
            Phase(steps, steps, {"slab_0": pushed, "slab_1": actual}),
        )
        meets = tuple((f"load_{number}", f"slab_{number}") for number in range(len(self.CASES)))
        return [ProbeTrial(tuple(self._bodies(law)), phases, meets)]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Without friction the box stays where it is in the world, or goes on along its tangent."""
        steps, acceleration = law.steps(CARRIED_TIME, CARRIED_STEPS), self._acceleration(law)
        time, value = steps * law.timestep, standing_way(law, steps)
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

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        slips = []
        for number in range(len(self.CASES)):
            places = [_seen(motions[0], f"slab_{number}", f"load_{number}", at) for at in (-2, -1)]
            slips.append(float(np.linalg.norm(places[1] - places[0])))
        return slips


def _seen(motion: TrialMotion, carrier: str, carried: str, at: int) -> np.ndarray:
    """Where a body's frame is in another's (3,), in m."""
    below, above = motion.pose[carrier][at], motion.pose[carried][at]
    found: np.ndarray = np.array(frames.matrix(tuple(below[3:].tolist()))).T @ (above[:3] - below[:3])
    return found


EDGES: Vector3 = (0.1, 0.06, 0.06)
FINGER: Vector3 = (0.02, 0.06, 0.8)
"""Edges (m) of the boxes and of the fingers, in whose faces the boxes' lie all the way down."""
BOX_MASS, FINGER_MASS = 0.5, 0.3
HOLDS, SLIPS = 1.5, 0.8
"""Share of the weight that friction can carry."""
FALL = 0.1
"""m: how far the slipping box falls before it is measured."""
TURN = 0.01
"""The turn that a box may make, as 2 |sin(angle / 2)|: 0.4 mm at its corners. Solvers that spread pressure evenly leave 1e-8 in
the median of all frictions and timesteps, and up to 8e-3 (measured)."""
BOX_SPACING = 2.0
"""m between boxes."""
FINGERS, BOX = "fingers", "boxes"
"""Collision groups."""


class Squeeze(Probe):
    """How far boxes between two fingers on slides move and turn, one held by friction and one slipping."""

    NAME = "squeeze"
    SLIDES, TURNS = "squeeze-slips", "squeeze-turns"

    def applies(self, law: ProbeLaw) -> bool:
        return (
            law.is_rigid
            and law.pair.friction > 0.0
            and law.reach.squeezes
            and not law.pair.torsional_friction
            and not law.pair.rolling_friction
        )

    def force(self, law: ProbeLaw, share: float) -> float:
        """N: of each finger, whose friction on both sides carries this share of the box's weight."""
        return share * BOX_MASS * GRAVITY / (2.0 * law.pair.friction)

    def steps(self, law: ProbeLaw) -> int:
        """The step at which the slipping box has fallen by ``FALL``."""
        fall = (1.0 - SLIPS) * GRAVITY
        return law.steps(math.sqrt(2.0 * FALL / fall))

    def all_steps(self, law: ProbeLaw) -> int:
        """As many, and enough to see what is held stand."""
        return max(self.steps(law), law.steps(STANDING_TIME, STANDING_STEPS))

    def fallen(self, law: ProbeLaw, acceleration: float) -> float:
        """m: after :meth:`steps` of semi-implicit Euler, the method of all engines."""
        steps = self.steps(law)
        return acceleration * law.timestep**2 * steps * (steps + 1) / 2.0

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        bodies: list[Body] = []
        effort: dict[str, tuple[float, ...]] = {}
        for number, share in enumerate((HOLDS, SLIPS)):
            bodies += self._squeezed(law, number)
            force = self.force(law, share)
            effort |= {f"left_{number}": (force,), f"right_{number}": (-force,)}
        steps = self.all_steps(law)
        return [ProbeTrial(tuple(bodies), (Phase(steps, effort=effort),), ((BOX, FINGERS),))]  # type: ignore[arg-type]

    def _squeezed(self, law: ProbeLaw, number: int) -> Iterator[Body]:
        y = BOX_SPACING * number
        out = (EDGES[0] + FINGER[0]) / 2.0 - TOUCH
        yield box(law, f"box_{number}", EDGES, BOX_MASS, (0.0, y, 0.0), group=BOX)
        yield _finger(law, f"left_{number}", (-out, y, 0.0))
        yield _finger(law, f"right_{number}", (out, y, 0.0))

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        steps = self.all_steps(law)
        whole = 0.5 * GRAVITY * (steps * law.timestep) ** 2
        way, free = (self.fallen(law, acceleration) for acceleration in ((1.0 - SLIPS) * GRAVITY, GRAVITY))
        text, slips = (f"at {share:g} × the friction that holds" for share in (HOLDS, SLIPS))
        slides = {"probe": self.SLIDES, "without": free}
        return [
            self.figure(law, text, "way", "m", 0.0, standing_way(law, steps), without=whole),
            self.figure(law, slips, "way", "m", way, SLIP_TOLERANCE * way, **slides),
            self.figure(law, slips, "turn", "rad", 0.0, TURN, probe=self.TURNS),
        ]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        values, slipping = motions[0].pose["box_0"], motions[0].pose["box_1"][: self.steps(law) + 1]
        return [
            float(np.linalg.norm(values[:, :3] - values[0, :3], axis=1).max()),
            float(slipping[0, 2] - slipping[-1, 2]),
            float(rotation_error(slipping[-1, 3:], slipping[0, 3:])),
        ]


def _finger(law: ProbeLaw, name: str, at: Vector3) -> Body:
    """A box on a slide along x."""
    joint = Joint(f"{name}_joint", "slide", origin=Pose(at), axis=(1.0, 0.0, 0.0), position=(0.0,), velocity=(0.0,))
    return replace(box(law, name, FINGER, FINGER_MASS, at, material=law.pair.first, group=FINGERS), joint=joint)
