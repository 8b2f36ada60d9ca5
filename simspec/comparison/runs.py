"""Two runs held against each other: where they differ, since when, and whether that means anything."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from simspec.comparison.common import (
    Common,
    FirstContactDifference,
    common_sides,
    first_difference,
    first_touches,
    moving_in_common,
)
from simspec.comparison.floor import FLOOR_FACTOR, Floor, deviations, horizon
from simspec.errors import html_table, length
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.world.canonical import sha256
from simspec.world.rotations import logarithm, relative

TOLERANCE = 1e-3
"""Default tolerance: 1 mm in position and 1 mrad in angle, what a robot cell calls the same place."""


SHOWN_BODIES = 8
"""Bodies that a comparison lists; the others are within what is shown."""

WITHIN, OUT, INCONCLUSIVE = "within", "out", "inconclusive"
"""Verdicts of a comparison."""

PARTS = ("position", "angle")
"""Quantities of a body that have a tolerance."""


@dataclass(frozen=True)
class BodyDiff:
    """How one body differs: largest and root mean square deviation in position (m) and angle (rad), the times (s) of the
    largest, all over the times up to the horizon; and the first time out of tolerance (s), None if
    never. ``floor`` and ``angle_floor`` are the engines' own noise (m, rad) for this body at the horizon; None when it was not
    measured.
    ``inconclusive_from``: the time (s) from which noise hides deviations of the tolerance's size; None if never.
    ``exceeded``: which of ``position`` and ``angle`` were out of tolerance at ``first_out``, and ``position_out`` (m) and
    ``angle_out`` (rad) by how much the body deviated then.
    ``compared``: whether the figures say anything: the initial state alone, alike by construction, does not."""

    body: str
    position_largest: float
    position_rms: float
    angle_largest: float
    angle_rms: float
    time_of_largest: float
    first_out: float | None
    floor: float | None
    cause: str = ""
    inconclusive_from: float | None = None
    angle_floor: float | None = None
    exceeded: tuple[str, ...] = ()
    position_out: float | None = None
    angle_out: float | None = None
    compared: bool = True
    time_of_largest_angle: float = 0.0

    @property
    def verdict(self) -> str:
        """``out`` of tolerance; ``inconclusive``: nothing was compared, or the deviation is not above the engines' noise,
        and the tolerance is below that; else ``within``, up to the horizon."""
        if self.first_out is not None:
            return OUT
        return WITHIN if self.compared and self.inconclusive_from is None else INCONCLUSIVE

    @property
    def within(self) -> bool:
        """Whether the body is known to have stayed within tolerance up to the horizon."""
        return self.verdict == WITHIN


@dataclass(frozen=True)
class JointDiff:
    """How the coordinate of one joint differs: the largest deviation up to the horizon, ``unit`` rad (of a ball joint the angle
    between its orientations) or m, and its time (s). Joints have no tolerance: those of the bodies hold. But whole turns
    between two hinge angles are visible only here."""

    joint: str
    unit: str
    largest: float
    time: float


@dataclass(frozen=True)
class Scalars:
    """A quantity of both runs: name, unit, and its value in each (None where a run did not record it)."""

    name: str
    unit: str
    first: float | None
    second: float | None


@dataclass(frozen=True)
class Diff:
    """The comparison of two runs.

    horizon     time (s) up to which positions are compared: there ``FLOOR_FACTOR`` times the engines' own noise grows past
                the tolerance, and further on two runs of the *same* engine differ without bound. None = to the end: noise
                that stays at a level ends nothing (see :mod:`simspec.comparison.floor`).
    bodies      one entry per moving body that both have, worst in position first
    joints      one entry per hinge, slide and ball joint that both have, worst in rad or m first
    quantities  energy, momentum, contacts, spread: they are compared over the whole time, so also past the horizon
    contact_first_difference, first_contact  the first time (s) at which something touches in one run and not in the other, and
                what; None = never
    notes       what must be known to read it: other worlds, a run that ended early, no noise floor, contacts that are
    matched by
                less than single shapes
    not_compared  why no time after the beginning was compared; empty where some was
    """

    first: str
    second: str
    tolerance: float
    angle_tolerance: float
    horizon: float | None
    compared_until: float
    bodies: tuple[BodyDiff, ...]
    quantities: tuple[Scalars, ...]
    contact_first_difference: float | None
    first_contact: FirstContactDifference | None
    notes: tuple[str, ...] = field(default=())
    not_compared: str = ""
    joints: tuple[JointDiff, ...] = ()

    def __repr__(self) -> str:
        text = f"{self.verdict}, {len(self.bodies)} bodies, until {self.compared_until:.4g} s"
        return f"<Diff {self.first} – {self.second}: {text}>"

    def _repr_html_(self) -> str:
        """For notebooks: the verdict, and the bodies that differ most."""
        head = ("body", "verdict", "largest", "rms", "out of tolerance", "noise")
        rows = [
            (
                body.body,
                body.verdict,
                *(length(value if body.compared else None) for value in (body.position_largest, body.position_rms)),
                "–" if body.first_out is None else f"from {body.first_out:.4g} s ({body.cause}): {out_words(body)}",
                length(body.floor),
            )
            for body in self.bodies[:SHOWN_BODIES]
        ]
        more = len(self.bodies) - len(rows)
        notes = [f"and {more} more bodies, with smaller differences"] if more > 0 else []
        title = f"{self.first} – {self.second}: {self.verdict}, until {self.compared_until:.4g} s"
        notes += [self.not_compared] if self.not_compared else []
        return html_table(title, head, rows, "; ".join([*notes, *self.notes]))

    @property
    def verdict(self) -> str:
        """``out`` when a body is; else ``inconclusive`` when a body is; else ``within``, up to the horizon."""
        verdicts = {body.verdict for body in self.bodies}
        return OUT if OUT in verdicts else INCONCLUSIVE if INCONCLUSIVE in verdicts else WITHIN

    @property
    def within(self) -> bool:
        """Whether every body is known to have stayed within tolerance up to the horizon."""
        return self.verdict == WITHIN

    @property
    def inconclusive_body(self) -> BodyDiff | None:
        """The inconclusive body with the largest noise; None when there is none."""
        inconclusive = [body for body in self.bodies if body.verdict == INCONCLUSIVE]
        return max(inconclusive, key=lambda body: body.floor or 0.0) if inconclusive else None

    @property
    def worst(self) -> BodyDiff | None:
        """The body with the largest position deviation."""
        return self.bodies[0] if self.bodies else None

    @property
    def worst_angle(self) -> BodyDiff | None:
        """The body with the largest angle deviation; a value that is not finite is the largest."""
        return max(
            self.bodies,
            key=lambda body: (body.angle_largest if math.isfinite(body.angle_largest) else math.inf),
            default=None,
        )

    @property
    def worst_joint(self) -> JointDiff | None:
        """The joint whose coordinate deviates most; None without joints."""
        return self.joints[0] if self.joints else None

    @property
    def first_out(self) -> BodyDiff | None:
        """The body that left the tolerance first; None when none did."""
        out = [body for body in self.bodies if body.first_out is not None]
        return min(out, key=lambda body: body.first_out or 0.0) if out else None

    @property
    def position_rms(self) -> float:
        """Root mean square position deviation (m) over bodies and times."""
        return float(np.sqrt(np.mean([body.position_rms**2 for body in self.bodies]))) if self.bodies else 0.0


def diff(
    a: Run,
    b: Run,
    *,
    tolerance: float = TOLERANCE,
    angle_tolerance: float | None = None,
    floor: Floor | Sequence[Floor] | None = None,
) -> Diff:
    """Compare two runs, body by body, at the times that both recorded.

    tolerance        position tolerance (m)
    angle_tolerance  angle tolerance (rad); the same number as ``tolerance`` when None
    floor            the noise floor of one or both engines (``simspec.floor``); without it chaos is indistinguishable from
    disagreement, and a note says so

    A body is out of tolerance at time t when it deviates by more than max(tolerance, FLOOR_FACTOR × floor(t)). Where it never
    is, but deviates by more than the tolerance, or the floor itself is above the tolerance, whether it stayed within cannot be
    distinguished; nor can it where the horizon, or the shorter run, leaves the initial state alone, which is alike by
    construction. Raises SpecError when there is nothing to compare: no common body, or no common time.
    """
    floors = [floor] if isinstance(floor, Floor) else list(floor or ())
    angle_tolerance = tolerance if angle_tolerance is None else angle_tolerance
    notes = [*_notes(a, b, floors), *_unphysical(a, b)]
    if all("contact.row" in run.arrays for run in (a, b)):
        notes.extend(common_sides((a, b)).notes)
    names = moving_in_common(a, b)
    common = Common(a, b, names, floors)
    notes += [common.shared()] if common.shared() else []
    last = horizon(common, FLOOR_FACTOR, tolerance, angle_tolerance) if floors else common.rows
    compared = max(1, last)
    departures = Departures(common, tolerance, angle_tolerance)
    for part in common.blocks(compared):
        departures.add(part)
    touched = first_touches((a, b), names)
    recorded = all("contact.row" in run.arrays for run in (a, b))
    until = departures.time(compared - 1)
    nothing = "" if until > 0.0 else _nothing(common, last)
    bodies = [_body_diff(departures, k, name, touched.get(name), recorded) for k, name in enumerate(names)]
    if nothing:
        bodies = [replace(body, compared=body.first_out is not None) for body in bodies]
    if floors:
        # where nothing was compared, the noise that was the reason
        row = min(last, common.rows - 1) if nothing else compared - 1
        values, turned = common.noise(np.full(len(names), row))
        bodies = [
            replace(
                body, floor=float(values[k]), angle_floor=float(turned[k]), inconclusive_from=departures.first_hidden(k)
            )
            for k, body in enumerate(bodies)
        ]
    # a value that is not finite is the worst
    bodies.sort(key=lambda body: -body.position_largest if np.isfinite(body.position_largest) else -np.inf)
    first = first_difference(common, a, b)
    ends = departures.time(last) if last < common.rows else None
    return Diff(
        a.label,
        b.label,
        tolerance,
        angle_tolerance,
        ends,
        until,
        tuple(bodies),
        tuple(_quantities(a, b, int(common.rows_a[-1]), int(common.rows_b[-1]))),
        None if first is None else first.time,
        first,
        tuple(notes),
        nothing,
        tuple(_joints(common, compared)),
    )


def _joints(common: Common, compared: int) -> list[JointDiff]:
    """The joints that both runs have, by how far they deviate at the first rows."""
    known = common.joints()
    largest, at = np.zeros(len(known)), np.zeros(len(known), dtype=np.int64)
    for part in common.blocks(compared) if known else ():
        for k, joint in enumerate(known):
            values, other = common.coordinates(joint, part)
            if joint.kind == "ball":
                away = np.linalg.norm(logarithm(relative(values, other)), axis=-1)
            else:
                away = np.abs(values - other)[:, 0]
            away = np.where(np.isfinite(away), away, np.inf)
            if away.max(initial=0.0) > largest[k]:
                largest[k], at[k] = away.max(), part.start + int(away.argmax())
    times = common.time(at) if known else at
    found = [
        JointDiff(joint.name, "m" if joint.kind == "slide" else "rad", float(size), float(time))
        for joint, size, time in zip(known, largest, times, strict=True)
    ]
    return sorted(found, key=lambda joint: -joint.largest)


def _nothing(common: Common, horizon_row: int) -> str:
    """Why the initial state alone was compared."""
    if horizon_row >= common.rows:
        return "nothing was compared: the two runs have no recorded time in common but the beginning"
    if not horizon_row:
        return "nothing was compared: the engines' own noise is above the tolerance from the beginning on"
    time = float(common.time(np.array([horizon_row]))[0])
    return (
        f"nothing was compared: the engines' own noise has outgrown the tolerance at {time:.4g} s, the first record after the "
        "beginning (chaos)"
    )


class Departures:
    """How far each body of two runs departs, gathered from one block of rows after the other. Arrays (2, bodies): in position
    (m) and in angle (rad)."""

    def __init__(self, common: Common, tolerance: float, angle_tolerance: float):
        self._common, self._tolerances = common, np.array([tolerance, angle_tolerance])[:, None, None]
        bodies, never = common.bodies, common.rows
        self.rows = 0
        self.squares = np.zeros((2, bodies))
        """Sums of squared deviations."""
        self.largest, self.at = np.zeros((2, bodies)), np.zeros((2, bodies), dtype=np.int64)
        """The largest deviations, and their rows."""
        self.out, self.hidden = np.full(bodies, never), np.full(bodies, never)
        """(bodies,): the first row out of tolerance, and the first at which noise may hide that."""
        self.at_out, self.exceeded = np.zeros((2, bodies)), np.zeros((2, bodies), dtype=bool)
        """Deviations at the first row out of tolerance, and which of these two were out of it."""

    def add(self, part: slice) -> None:
        """Take the next block of rows."""
        both = np.stack(deviations(*self._common.poses(part)))
        noise = np.stack(self._common.noise(np.arange(part.start, part.stop)[:, None]))
        finite = np.isfinite(both)
        # a deviation that is not finite is out of every tolerance
        beyond_both = (both > np.maximum(self._tolerances, FLOOR_FACTOR * noise)) | ~finite
        out = beyond_both.any(axis=0)
        before = self.out.copy()
        # a deviation above the tolerance may be noise, and two runs that meet within less than their noise may do so by chance
        hidden = (np.maximum(both, noise) > self._tolerances).any(axis=0)
        for first, beyond in ((self.out, out), (self.hidden, hidden)):
            np.minimum(first, np.where(beyond.any(axis=0), part.start + beyond.argmax(axis=0), first), out=first)
        for k in np.flatnonzero(self.out < before):
            row = out[:, k].argmax()
            self.at_out[:, k], self.exceeded[:, k] = both[:, row, k], beyond_both[:, row, k]
        order = np.where(finite, both, np.inf)
        place = order.argmax(axis=1)
        # nothing is larger than a deviation that is not finite
        larger = (order.max(axis=1) > self.largest) & np.isfinite(self.largest)
        self.at = np.where(larger, part.start + place, self.at)
        self.largest = np.where(larger, np.take_along_axis(both, place[:, None], axis=1)[:, 0], self.largest)
        self.squares += (both**2).sum(axis=1)
        self.rows += part.stop - part.start

    def time(self, row: int) -> float:
        """The time (s) of a common row."""
        return float(self._common.time(np.array([row]))[0])

    def first_out(self, body: int) -> float | None:
        """The first time (s) out of tolerance; None if never."""
        return self._time_or_never(self.out[body])

    def first_hidden(self, body: int) -> float | None:
        """The first time (s) at which a deviation of the tolerance's size may be noise; None if never."""
        return self._time_or_never(self.hidden[body])

    def _time_or_never(self, row: int) -> float | None:
        return self.time(row) if row < self._common.rows else None


def _unphysical(a: Run, b: Run) -> list[str]:
    """Findings of both runs that no mechanism causes: agreement on them is not evidence."""
    other = {finding.short for finding in b.unphysical.findings}
    alike = [finding.short for finding in a.unphysical.findings if finding.short in other]
    return [f"both runs show a motion that is not physical: {what}" for what in alike]


def _notes(a: Run, b: Run, floors: Sequence[Floor]) -> list[str]:
    notes = []
    if sha256(a.world) != sha256(b.world):
        notes.append("the two runs have different worlds: compare their specs with simspec diff")
    notes.extend(f"{run.label} failed: {run.failed}" for run in (a, b) if run.failed is not None)
    missing = sorted({run.engine for run in (a, b)} - {floor.engine for floor in floors})
    if missing:
        notes.append(
            f"the noise floor of {' and '.join(missing)} was not measured: chaos and disagreement are not distinguished"
        )
    return notes


def _body_diff(departures: Departures, body: int, name: str, touched: float | None, recorded: bool) -> BodyDiff:
    first, cause = departures.first_out(body), ""
    if first is not None:
        # rows before the first one out: a contact recorded there can be what parted the two
        cause = "contact" if touched is not None and touched <= first else "free motion"
        cause = cause if recorded else "contacts not recorded"
    position_rms, angle_rms = np.sqrt(departures.squares[:, body] / departures.rows).tolist()
    return BodyDiff(
        name,
        float(departures.largest[0, body]),
        position_rms,
        float(departures.largest[1, body]),
        angle_rms,
        departures.time(departures.at[0, body]),
        first,
        None,
        cause,
        exceeded=tuple(name for name, out in zip(PARTS, departures.exceeded[:, body], strict=True) if out),
        position_out=None if first is None else float(departures.at_out[0, body]),
        angle_out=None if first is None else float(departures.at_out[1, body]),
        time_of_largest_angle=departures.time(departures.at[1, body]),
    )


def out_words(body: BodyDiff) -> str:
    """Quantities out of tolerance when a body first was, with their values: ``1.2 mm``, ``angle 0.002 rad``, or both."""
    turned = "–" if body.angle_out is None else f"{body.angle_out:.3g} rad"
    values = {"position": length(body.position_out), "angle": f"angle {turned}"}
    return " and ".join(values[name] for name in body.exceeded)


def _quantities(a: Run, b: Run, last_a: int, last_b: int) -> list[Scalars]:
    """Scalars of both runs at the last common time, and the extremes up to it."""
    values = [_values(a, last_a), _values(b, last_b)]
    return [Scalars(name, unit, values[0].get(name), values[1].get(name)) for name, unit in QUANTITIES]


QUANTITIES = (
    ("energy at the start", "J"),
    ("energy at the end", "J"),
    ("linear momentum at the end", "N s"),
    ("angular momentum at the end", "N m s"),
    ("deepest penetration", "m"),
    ("contacts, mean", ""),
    ("contact force, mean", "N"),
    ("speed at the end", "m/s"),
    ("spread at the end", "m"),
    ("largest error of a driven hinge", "rad"),
    ("largest error of a driven slide", "m"),
    ("efforts clipped, most steps of a joint", ""),
)
"""The summary of runs: name and unit."""


@np.errstate(over="ignore")  # a state that grows without bound is finite up to 1e308, its energy is not: inf is shown
def _values(run: Run, last: int) -> dict[str, float]:
    ends = {name: run.arrays[name][[0, last]] for name in ("q", "v", "pose", "velocity")}
    kinetic, potential = metrics.energy(run.world, ends)
    linear, angular = metrics.momentum(run.world, ends)
    quantities = {
        "energy at the start": kinetic[0] + potential[0],
        "energy at the end": kinetic[1] + potential[1],
        "linear momentum at the end": np.linalg.norm(linear[1]),
        "angular momentum at the end": np.linalg.norm(angular[1]),
        "speed at the end": metrics.speeds(run.world, ends)[1].max(),
        "spread at the end": metrics.spread(run.world, ends)[1],
    }
    if "contact.row" in run.arrays:
        quantities["deepest penetration"] = metrics.deepest_penetration(run.world, run.arrays).depth
        quantities["contacts, mean"], quantities["contact force, mean"] = metrics.contact_means(run.arrays, last + 1)
    return {name: float(value) for name, value in quantities.items()} | _control(run)


def _control(run: Run) -> dict[str, float]:
    """How driven joints were followed in the whole run; nothing where none is driven."""
    about = run.provenance.get("control")
    if about is None:
        return {}
    kinds = {body.joint.name: body.joint.kind for body in run.world.bodies}
    clipped = [count for count in about["clipped"] if count is not None]  # of its own controllers only the engine knows
    quantities = {"efforts clipped, most steps of a joint": float(max(clipped))} if clipped else {}
    for kind in SCALAR_JOINTS:
        errors = [
            math.inf if error is None else error
            for name, error in zip(about["joints"], about["error"], strict=True)
            if kinds[name] == kind
        ]
        if errors:
            quantities[f"largest error of a driven {kind}"] = max(errors)
    return quantities


def summary(run: Run) -> dict[str, float]:
    """The quantities of one run (:data:`QUANTITIES`), at its end."""
    return _values(run, len(run.time) - 1) if run.recorded else {}
