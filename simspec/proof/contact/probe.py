"""What a contact probe is (proof level L5): a small world of its own, driven for a while, and what it shows.

A probe is written once for all engines. It knows two materials and their law, lays out bodies of these materials, says how
they are driven, and turns the motion that comes back into figures, each beside its analytic value. It never learns which
engine it ran in; an engine's declared deviations are added afterwards, by data (``Engine.CONTACT_DEVIATIONS``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from simspec.world.reach import Reach
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
class Law:
    """What is to be measured: the law of two materials, the cone it is under, and the timestep (s) of the scenario."""

    pair: PairContact
    friction_cone: str
    timestep: float
    belt: Vector3 = field(default=NO_BELT, metadata=LEFT_OUT)
    """The velocity (m/s) of a surface of the two that moves, in its shape's axes; zero where none does."""
    belt_told: Vector3 | None = field(default=None, metadata=LEFT_OUT)
    """The same as the files have it; None: as it is."""
    reach: Reach = field(default=Reach(), metadata=LEFT_OUT)
    """What bodies of the two materials can do together in the scenario."""


@dataclass(frozen=True, slots=True)
class Phase:
    """``steps`` steps under constant efforts, seen every ``every`` steps; ``effort`` holds, by body, a force (N) at the
    centre of mass in world axes, and a torque (N m) in the body's axes; it turns with the body."""

    steps: int
    every: int = 1
    effort: Mapping[str, tuple[float, float, float, float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Trial:
    """One probe world: its bodies in their initial state, and how they are driven.

    What moves meets the floor alone, but for bodies of the collision groups of ``meets``: those meet each other alone.
    """

    bodies: tuple[Body, ...]
    phases: tuple[Phase, ...]
    meets: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Motion:
    """What came back of a trial, by body: states at the times (n,), in s, the initial state first.

    ``pose`` (n, 7) x y z w x y z of the body frame; ``velocity`` (n, 6) linear of the body frame's origin, then angular,
    both in world axes.
    """

    time: np.ndarray
    pose: Mapping[str, np.ndarray]
    velocity: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    probe      name of the probe (``push``, ``stop``, ``stick``, ``restitution``, ...)
    subject    what was probed: two materials ("rubber, steel"), or a shape
    case       what was asked, the same in every engine ("24 directions")
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
        """Case, worst part and note in words: for texts, which nobody reads back."""
        return "; ".join(filter(None, (self.case + (f", worst at {self.worst}" if self.worst else ""), self.note)))

    @property
    def passed(self) -> bool:
        """Whether the measured value is within the tolerance; never without one."""
        return self.measured is not None and abs(self.measured - self.expected) <= self.tolerance


class Probe:
    """One kind of measurement on two materials. Subclasses have no state."""

    NAME: str
    MEANING: str
    """One line: what is measured, and against what."""

    def wanted(self, law: Law) -> Sequence[Figure]:
        """Every figure that this law must have, without what an engine did (``measured`` is None): name, case, quantity,
        expected value, tolerance, and ``without``. Of figures whose case or expected value depends on what came out worst, one
        of them (see :meth:`reference`). Figures take ``without`` from here, and stored certificates are judged by it; the
        figures of a probe that does not say this are judged by their own numbers."""
        return ()

    def reference(self, law: Law, figure: Figure) -> Figure | None:
        """What a measured ``figure`` must be held against; None where the law has no such figure."""
        named = (figure.probe, figure.case, figure.quantity)
        return next((one for one in wanted(self, law) if (one.probe, one.case, one.quantity) == named), None)

    def slack(self, law: Law) -> float:
        """By what share of it the expected value of a measured figure may differ from :meth:`reference`'s, since it follows
        from the motion itself (the speed with which a body arrives)."""
        return 0.0

    def applies(self, law: Law) -> bool:
        """Whether this law has anything for this probe to measure."""
        raise NotImplementedError

    def trials(self, law: Law) -> Sequence[Trial]:
        """The worlds to run; the same for every engine."""
        raise NotImplementedError

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        """What the motions (one for each trial, in order) show, against what ``law`` says."""
        raise NotImplementedError


@lru_cache(maxsize=256)
def wanted(probe: Probe, law: Law) -> tuple[Figure, ...]:
    """:meth:`Probe.wanted`, kept: a certificate has hundreds of figures of a law, and some follow from stepped equations."""
    return tuple(probe.wanted(law))
