"""Contact probes (proof level L5): small worlds of two materials that are driven, and their figures.

A probe is written once for all engines. It lays out bodies of the two materials, says how they are driven
(:meth:`Probe.trials`), states every figure with its analytic value (:meth:`Probe.wanted`) and reads the measured values off the
motion (:meth:`Probe.readings`). It does not know the engine; declared deviations are added afterwards
(``Engine.CONTACT_DEVIATIONS``).

Friction follows the one-step law. In a step in which the normal impulse is J, the friction impulse is the projection of the
momentum that the body would have without friction onto the cone's section of size μ J. So a push F from rest meets the
projection of F onto the section of size μ N, and a body that slides freely follows v' = v − proj(v), with the section of size
μ g dt, and x' = x + v' dt. Under the elliptic cone a body at speed v comes to rest after v²/2μg − v dt/2.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from simspec.engines.kit.capabilities import Deviation
from simspec.world.reach import MaterialReach
from simspec.world.types import LEFT_OUT, Body, PairContact, Vector3

GRAVITY = 9.81
"""Of all probes, downwards (m/s²), whatever the scenario's is: a contact law does not depend on it."""
TRACE = 0.1
"""Share of an effect that counts as none of it: a tolerance that passes an engine with less is no test of the effect."""
FLOOR = "floor"
"""Name of the fixed body that probes stand on: a box whose upper face is at z = 0, of the pair's *first* material."""


NO_BELT = (0.0, 0.0, 0.0)
"""m/s: of surfaces that do not move."""


@dataclass(frozen=True, slots=True)
class ProbeLaw:
    """The law to be measured: that of two materials, the cone it is under, and the timestep (s) of the scenario."""

    pair: PairContact
    friction_cone: str
    timestep: float
    belt: Vector3 = field(default=NO_BELT, metadata=LEFT_OUT)
    """The velocity (m/s) of a surface of the two that moves, in its shape's axes; zero where none does."""
    belt_written: Vector3 | None = field(default=None, metadata=LEFT_OUT)
    """The same as the files have it; None: as it is."""
    reach: MaterialReach = field(default=MaterialReach(), metadata=LEFT_OUT)
    """The kinds of contact that bodies of the two materials can have in the scenario."""

    @property
    def subject(self) -> str:
        """The two materials."""
        return f"{self.pair.first}, {self.pair.second}"

    @property
    def is_rigid(self) -> bool:
        """Whether the materials collide with the common hardness."""
        return self.pair.collide and self.pair.hardness.kind == "common"

    def steps(self, seconds: float, least: int = 1) -> int:
        """Steps that last this long, and at least so many."""
        return max(least, math.ceil(seconds / self.timestep))


@dataclass(frozen=True, slots=True)
class Phase:
    """``steps`` steps under constant efforts, seen every ``every`` steps; ``effort`` holds, by body, a force (N) at the
    centre of mass in world axes, and a torque (N m) in the body's axes; it turns with the body."""

    steps: int
    every: int = 1
    effort: Mapping[str, tuple[float, float, float, float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ProbeTrial:
    """One probe world: its bodies in their initial state, and how they are driven.

    Moving bodies meet the floor alone, but for bodies of the collision groups of ``meets``: those meet each other alone.
    """

    bodies: tuple[Body, ...]
    phases: tuple[Phase, ...]
    meets: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class TrialMotion:
    """The motion of a trial, by body: states at the times (n,), in s, the initial state first.

    ``pose`` (n, 7) x y z w x y z of the body frame; ``velocity`` (n, 6) linear of the body frame's origin, then angular,
    both in world axes.
    """

    time: np.ndarray
    pose: Mapping[str, np.ndarray]
    velocity: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class ProbeFigure:
    """One measured figure.

    probe      name of the probe (``push``, ``stop``, ``stick``, ``restitution``, ...)
    subject    what was probed: two materials ("rubber, steel"), or a shape
    case       the case of the probe, the same in every engine ("24 directions")
    quantity   what the numbers are ("friction", "distance", "ratio", "depth", ...)
    unit       their unit, "" for ratios
    expected   the analytic value
    measured   what the engine did; None where it gave no number
    tolerance  how far ``measured`` may be from ``expected``, absolute, in ``unit``
    deviation  of an engine that declares one for this probe: its reason; the tolerance is then the declared size
    points     for plots: rows of numbers, all of one length
    worst      which of the case's parts came out worst, in words ("45°")
    angle      the direction (rad) that came out worst, of probes that go in several
    note       what must be known of the figure ("2 more shapes not probed")
    without    what an engine without the effect would show here: no friction, no bounce, no recovery; None where it would show
               what is expected, or where the figure measures no effect
    promised   of a figure that passes by a declared deviation alone: the probe's tolerance, which ``tolerance`` replaces
    cached     whether it was measured before and comes from the user's cache; not part of a certificate's file
    """

    probe: str
    subject: str
    case: str
    quantity: str
    unit: str
    expected: float
    measured: float | None
    tolerance: float
    deviation: str = ""
    points: tuple[tuple[float, ...], ...] = ()
    worst: str = ""
    angle: float | None = None
    note: str = ""
    without: float | None = field(default=None, metadata=LEFT_OUT)
    promised: float | None = field(default=None, metadata=LEFT_OUT)
    cached: bool = field(default=False, compare=False, metadata=LEFT_OUT)

    @property
    def declared(self) -> bool:
        """Whether it passes by a declared deviation of the engine alone."""
        return bool(self.deviation) and self.passed

    @property
    def absent(self) -> bool:
        """Whether the declared deviation is so wide that an engine with less than ``TRACE`` of the effect would pass."""
        if not self.deviation or self.without is None:
            return False
        return (1.0 - TRACE) * abs(self.without - self.expected) <= self.tolerance

    @property
    def width(self) -> float:
        """How wide the tolerance is: as a share of the expected value; where that is zero, in units of the tolerance without
        the deviation. Infinite where that is zero too."""
        unit = abs(self.expected) or self.promised or 0.0
        return self.tolerance / unit if unit else math.inf

    @property
    def label(self) -> str:
        """Case, worst part and note in words: for texts, which are not read back."""
        return "; ".join(filter(None, (self.case + (f", worst at {self.worst}" if self.worst else ""), self.note)))

    @property
    def passed(self) -> bool:
        """Whether the measured value is within the tolerance; never without one."""
        return self.measured is not None and abs(self.measured - self.expected) <= self.tolerance


class Probe:
    """One kind of measurement on two materials. Subclasses have no state; their docstrings name measurement and reference."""

    NAME: str

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Every figure that this law must have, without what an engine did (``measured`` is None): name, case, quantity,
        expected value, tolerance, and ``without``. Of figures whose case or expected value depends on what came out worst, one
        of them (see :meth:`reference`). Figures take ``without`` from here, and stored certificates are judged by it; the
        figures of a probe that does not say this are judged by their own numbers."""
        return ()

    def reference(self, law: ProbeLaw, figure: ProbeFigure) -> ProbeFigure | None:
        """The reference of a measured ``figure``; None where the law has no such figure."""
        named = (figure.probe, figure.case, figure.quantity)
        return next((each for each in wanted(self, law) if (each.probe, each.case, each.quantity) == named), None)

    def slack(self, law: ProbeLaw) -> float:
        """By what share of it the expected value of a measured figure may differ from :meth:`reference`'s, since it follows
        from the motion itself (the speed with which a body arrives)."""
        return 0.0

    def applies(self, law: ProbeLaw) -> bool:
        """Whether this probe can measure anything under this law."""
        raise NotImplementedError

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        """The worlds to run; the same for every engine."""
        raise NotImplementedError

    def readings(
        self, law: ProbeLaw, motions: Sequence[TrialMotion]
    ) -> Sequence[float | Mapping[str, Any] | ProbeFigure]:
        """For each figure of :meth:`wanted` the measured value, or fields to replace (``measured``, ``worst``, ...), or the
        whole figure; ``motions``: one for each trial, in order."""
        raise NotImplementedError

    def figures(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[ProbeFigure]:
        """The figures that the motions give under ``law``."""
        pairs = zip(self.wanted(law), self.readings(law, motions), strict=True)
        return [
            reading
            if isinstance(reading, ProbeFigure)
            else replace(figure, **(reading if isinstance(reading, Mapping) else {"measured": reading}))
            for figure, reading in pairs
        ]

    def figure(
        self, law: ProbeLaw, case: str, quantity: str, unit: str, expected: float, tolerance: float, **others: Any
    ) -> ProbeFigure:
        """A figure that is not measured yet, of this probe's name unless ``probe`` is given among ``others``."""
        name = others.pop("probe", self.NAME)
        return ProbeFigure(name, law.subject, case, quantity, unit, expected, None, tolerance, **others)


@lru_cache(maxsize=256)
def wanted(probe: Probe, law: ProbeLaw) -> tuple[ProbeFigure, ...]:
    """:meth:`Probe.wanted`, kept: a certificate has hundreds of figures of a law, and some follow from stepped equations."""
    return tuple(probe.wanted(law))


# --- helpers for figures -------------------------------------------------------------------------------------------

Key = TypeVar("Key")


def deviation(value: float, expected: float = 0.0) -> float:
    """The distance between two values, infinite for NaN."""
    return math.inf if math.isnan(value) else abs(value - expected)


def furthest(values: Mapping[Key, float], expected: float = 0.0) -> Key:
    """The key of the value furthest from ``expected``; NaN is furthest."""
    return max(values, key=lambda key: deviation(values[key], expected))


def signed_size(measured: np.ndarray, expected: np.ndarray) -> float:
    """The error of a vector as an error of its size: |expected| plus the distance, minus it where ``measured`` is shorter."""
    size, off = float(np.linalg.norm(expected)), float(np.linalg.norm(measured - expected))
    return size + off if np.linalg.norm(measured) >= size else size - off


def direction(degrees: float) -> np.ndarray:
    """The unit vector (2,) at this angle from the x axis."""
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


# --- the one-step law of friction ----------------------------------------------------------------------------------


def project(vector: np.ndarray, size: float, friction_cone: str) -> np.ndarray:
    """The point nearest to ``vector`` (2,) in the section of the cone of this ``size``: a disc of that radius, the diamond
    |x| + |y| ≤ size, or the square |x|, |y| ≤ size. Raises KeyError for an unknown cone."""
    x, y = vector
    return np.array(nearest(float(x), float(y), size, friction_cone))


def nearest(x: float, y: float, size: float, friction_cone: str) -> tuple[float, float]:
    """As :func:`project`, of two numbers, which is ten times as quick."""
    return _SECTIONS[friction_cone](x, y, size)


def _disc(x: float, y: float, size: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    return (x, y) if length <= size else (x * (size / length), y * (size / length))


def _square(x: float, y: float, size: float) -> tuple[float, float]:
    return min(max(x, -size), size), min(max(y, -size), size)


def _diamond(x: float, y: float, size: float) -> tuple[float, float]:
    """Onto the l1 ball: take the same amount off both coordinates' magnitudes, until they sum to ``size``."""
    off = (abs(x) + abs(y) - size) / 2.0
    if off <= 0.0:
        return x, y
    if off > min(abs(x), abs(y)):  # one coordinate is used up: the nearest point is a corner
        return (math.copysign(size, x), 0.0) if abs(x) > abs(y) else (0.0, math.copysign(size, y))
    return math.copysign(abs(x) - off, x), math.copysign(abs(y) - off, y)


_SECTIONS = {"elliptic": _disc, "pyramid-inscribed": _diamond, "pyramid-circumscribed": _square}


def outline(size: float, friction_cone: str, points: int = 181) -> np.ndarray:
    """The boundary of the section, for plots: (points, 2)."""
    angles = np.linspace(0.0, 2.0 * np.pi, points)
    return np.array(
        [size * at / cone_norm(at, friction_cone) for at in np.column_stack([np.cos(angles), np.sin(angles)])]
    )


def cone_norm(vector: np.ndarray, friction_cone: str) -> float:
    """The size of the cone's section on whose boundary the ``vector`` (2,) is."""
    if friction_cone == "elliptic":
        return float(np.linalg.norm(vector))
    return float(np.abs(vector).sum() if friction_cone == "pyramid-inscribed" else np.abs(vector).max())


def slide(velocity: np.ndarray, law: ProbeLaw, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (steps + 1, 2) of a body that slides freely from the origin; both are read-only."""
    x, y = (float(part) for part in velocity)
    return _slid(x, y, law.pair.friction * GRAVITY * law.timestep, law.timestep, law.friction_cone, steps)


@lru_cache(maxsize=2048)
def _slid(
    x: float, y: float, size: float, timestep: float, friction_cone: str, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Cached, since the figures of a certificate need thousands of slides, most of them the same."""
    places, speeds = [(0.0, 0.0)], [(x, y)]
    along = across = 0.0
    for _ in range(steps):
        less, sideways = nearest(x, y, size, friction_cone)
        x, y = x - less, y - sideways
        along, across = along + timestep * x, across + timestep * y
        speeds.append((x, y))
        places.append((along, across))
    position, speed = np.array(places), np.array(speeds)
    position.flags.writeable = speed.flags.writeable = False
    return position, speed


def widened(
    figure: ProbeFigure,
    law: ProbeLaw,
    declared: Iterable[Deviation],
    settings: Mapping[str, Any],
    version: str | None = None,
) -> ProbeFigure:
    """The figure with the tolerance of the widest of some deviations that count for it, where it does not pass by itself."""
    sizes = [
        ((deviation.size * abs(figure.expected) if deviation.relative else deviation.size), deviation)
        for deviation in declared
        if deviation.probe == figure.probe
        and deviation.counts_for(law.pair, law.friction_cone, law.timestep, settings, law.reach.ratio, version)
    ]
    wider = [entry for entry in sizes if entry[0] > figure.tolerance]
    if not wider or figure.passed:
        return figure
    tolerance, deviation = max(wider, key=lambda entry: entry[0])
    return replace(figure, tolerance=tolerance, deviation=deviation.why, promised=figure.tolerance)
