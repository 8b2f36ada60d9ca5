"""Two runs held against each other: where they differ, since when, and whether that means anything."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from simspec.comparison.floor import FLOOR_FACTOR, Floor, deviations
from simspec.comparison.horizon import horizon
from simspec.errors import Problem, SpecError
from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.world.canonical import sha256

TOLERANCE = 1e-3
"""Default tolerance: 1 mm in position and 1 mrad in angle, what a robot cell calls the same place."""


WITHIN, OUT, CANNOT_BE_TOLD = "within", "out", "cannot be told"
"""Verdicts of a comparison."""


@dataclass(frozen=True)
class BodyDiff:
    """How one body differs: largest and root mean square deviation in position (m) and angle (rad), the time (s) of the
    largest position deviation, both over the times up to the horizon; and the first time out of tolerance (s), None if
    never. ``floor`` and ``angle_floor`` are the engines' own noise (m, rad) for this body at the horizon; None when it was not
    measured.
    ``cannot_tell_from``: the time (s) from which that noise hides deviations of the tolerance's size; None if it never does."""

    body: str
    position_largest: float
    position_rms: float
    angle_largest: float
    angle_rms: float
    time_of_largest: float
    first_out: float | None
    floor: float | None
    cause: str = ""
    cannot_tell_from: float | None = None
    angle_floor: float | None = None

    @property
    def verdict(self) -> str:
        """``out`` of tolerance; ``cannot be told``: what it deviates is not above the engines' noise, and the tolerance is
        below that; else ``within``, up to the horizon."""
        if self.first_out is not None:
            return OUT
        return WITHIN if self.cannot_tell_from is None else CANNOT_BE_TOLD

    @property
    def within(self) -> bool:
        """Whether the body is known to have stayed within tolerance up to the horizon."""
        return self.verdict == WITHIN


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
                that stays at a level ends nothing (see :mod:`simspec.comparison.horizon`).
    bodies      one entry per moving body that both have, worst first
    quantities  energy, momentum, contacts, spread: they are compared over the whole time, so also past the horizon
    notes       what must be known to read it: other worlds, a run that ended early, no noise floor
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
    notes: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        told = f"{self.verdict}, {len(self.bodies)} bodies, until {self.compared_until:.4g} s"
        return f"<Diff {self.first} – {self.second}: {told}>"

    @property
    def verdict(self) -> str:
        """``out`` when a body is; else ``cannot be told`` when it cannot of a body; else ``within``, up to the horizon."""
        found = {body.verdict for body in self.bodies}
        return OUT if OUT in found else CANNOT_BE_TOLD if CANNOT_BE_TOLD in found else WITHIN

    @property
    def within(self) -> bool:
        """Whether every body is known to have stayed within tolerance up to the horizon."""
        return self.verdict == WITHIN

    @property
    def untold(self) -> BodyDiff | None:
        """Of the bodies of which it cannot be told, the one with the largest noise; None when there is none."""
        found = [body for body in self.bodies if body.verdict == CANNOT_BE_TOLD]
        return max(found, key=lambda body: body.floor or 0.0) if found else None

    @property
    def worst(self) -> BodyDiff | None:
        """The body with the largest position deviation."""
        return self.bodies[0] if self.bodies else None

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
    floor            the noise floor of one or both engines (``simspec.floor``); without it chaos cannot be told from
                     disagreement, and a note says so

    A body is out of tolerance at time t when it deviates by more than max(tolerance, FLOOR_FACTOR × floor(t)). Where it never
    is, but deviates by more than the tolerance, or the floor itself is above the tolerance, whether it stayed within cannot be
    told.
    Raises SpecError when there is nothing to compare: no common body, or no common time.
    """
    floors = [floor] if isinstance(floor, Floor) else list(floor or ())
    angle_tolerance = tolerance if angle_tolerance is None else angle_tolerance
    notes = _notes(a, b, floors)
    for run in (a, b):
        if not run.recorded:
            raise SpecError([Problem(f"{run.label} recorded nothing to compare: {run.failed}")])
    rows_a, rows_b = _common_rows(a, b)
    moving = {a.world.bodies[k].name for k in metrics.moving_bodies(a.world)}
    moving &= {b.world.bodies[k].name for k in metrics.moving_bodies(b.world)}
    names = [body.name for body in a.world.bodies if body.name in moving]
    if not names:
        raise SpecError([Problem(f"{a.label} and {b.label} have no moving body in common")])
    time = a.time[rows_a]
    position, angle = deviations(_poses(a, rows_a, names), _poses(b, rows_b, names))
    noise = [_floor_at(one, a if one.engine == a.engine else b, time, names) for one in floors]
    own_position = np.max([pair[0] for pair in noise], axis=0) if noise else np.zeros_like(position)
    own_angle = np.max([pair[1] for pair in noise], axis=0) if noise else np.zeros_like(angle)
    last = horizon(
        FLOOR_FACTOR * own_position,
        FLOOR_FACTOR * own_angle,
        time,
        max(_size(run, rows, names) for run, rows in ((a, rows_a), (b, rows_b))),
        tolerance,
        angle_tolerance,
    )
    out = (position > np.maximum(tolerance, FLOOR_FACTOR * own_position)) | (
        angle > np.maximum(angle_tolerance, FLOOR_FACTOR * own_angle)
    )
    # what deviates more than the tolerance may be noise; and that two runs meet within less than their noise is luck
    hidden = (np.maximum(position, own_position) > tolerance) | (np.maximum(angle, own_angle) > angle_tolerance)
    # what is not finite is out of every tolerance
    out |= ~(np.isfinite(position) & np.isfinite(angle))
    touched = _touches(a, b, rows_a, rows_b, names)
    recorded = all("contact.row" in run.arrays for run in (a, b))
    compared = slice(0, max(1, last))
    bodies = [
        _body_diff(
            name,
            time[compared],
            position[compared, k],
            angle[compared, k],
            out[compared, k],
            touched.get(name),
            recorded,
        )
        for k, name in enumerate(names)
    ]
    if noise:
        ends, turned = own_position[compared][-1], own_angle[compared][-1]
        since = [time[compared][int(row.argmax())] if row.any() else None for row in hidden[compared].T]
        bodies = [
            replace(
                body,
                floor=float(ends[k]),
                angle_floor=float(turned[k]),
                cannot_tell_from=None if since[k] is None else float(since[k]),
            )
            for k, body in enumerate(bodies)
        ]
    # what is not finite is the worst of all
    bodies.sort(key=lambda body: -body.position_largest if np.isfinite(body.position_largest) else -np.inf)
    return Diff(
        a.label,
        b.label,
        tolerance,
        angle_tolerance,
        float(time[last]) if last < len(time) else None,
        float(time[compared][-1]),
        tuple(bodies),
        tuple(_quantities(a, b, rows_a, rows_b)),
        _contact_first_difference(a, b, rows_a, rows_b),
        tuple(notes),
    )


def _notes(a: Run, b: Run, floors: Sequence[Floor]) -> list[str]:
    notes = []
    if sha256(a.world) != sha256(b.world):
        notes.append("the two runs are of different worlds: simspec diff of their specs shows what changed")
    notes.extend(f"{run.label} failed: {run.failed}" for run in (a, b) if run.failed is not None)
    missing = sorted({run.engine for run in (a, b)} - {floor.engine for floor in floors})
    if missing:
        notes.append(
            f"the noise floor of {' and '.join(missing)} was not measured: chaos cannot be told from disagreement"
        )
    return notes


def _common_rows(a: Run, b: Run) -> tuple[np.ndarray, np.ndarray]:
    """The rows of both runs at equal times (to half of the smaller timestep)."""
    near = 0.5 * min(a.world.physics.timestep, b.world.physics.timestep)
    at = np.clip(np.searchsorted(b.time, a.time - near), 0, len(b.time) - 1)
    same = np.abs(b.time[at] - a.time) <= near
    if not same.any():
        raise SpecError([Problem(f"{a.label} and {b.label} recorded no common time")])
    return np.flatnonzero(same), at[same]


def _poses(run: Run, rows: np.ndarray, names: Sequence[str]) -> np.ndarray:
    return run.arrays["pose"][np.ix_(rows, [run.index[name] for name in names])]


def _size(run: Run, rows: np.ndarray, names: Sequence[str]) -> float:
    """How large the scene is (m): the diagonal of the box about all the places of the bodies in a run, and the size of the
    largest body."""
    places = _poses(run, rows, names)[..., :3].reshape(-1, 3)
    places = places[np.isfinite(places).all(axis=1)]
    masses = [run.world.bodies[run.index[name]].inertial for name in names]
    # of a body alone that stays where it is: its radius of gyration, about half of its own size
    radii = [math.sqrt(sum(one.inertia[:3]) / (2.0 * one.mass)) for one in masses if one.mass > 0.0]
    reach = float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
    return reach + 2.0 * max(radii, default=0.0)


def _floor_at(floor: Floor, run: Run, time: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """The floor at other times (its last value before each) and for these bodies."""
    rows = np.clip(np.searchsorted(floor.time, time + 0.5 * run.world.physics.timestep) - 1, 0, None)
    columns = [run.index[name] for name in names]
    return floor.position[np.ix_(rows, columns)], floor.angle[np.ix_(rows, columns)]


def _body_diff(
    name: str,
    time: np.ndarray,
    position: np.ndarray,
    angle: np.ndarray,
    out: np.ndarray,
    touched: float | None,
    recorded: bool,
) -> BodyDiff:
    worst = int(np.where(np.isfinite(position), position, np.inf).argmax())
    first = int(out.argmax()) if out.any() else None
    cause = ""
    if first is not None:
        # rows before the first one out: a contact recorded there can be what parted the two
        cause = "contact" if touched is not None and touched <= time[first] else "free motion"
        cause = cause if recorded else "contacts not recorded"
    return BodyDiff(
        name,
        float(position[worst]),
        float(np.sqrt(np.mean(position**2))),
        float(angle.max()),
        float(np.sqrt(np.mean(angle**2))),
        float(time[worst]),
        float(time[first]) if first is not None else None,
        None,
        cause,
    )


def _touches(a: Run, b: Run, rows_a: np.ndarray, rows_b: np.ndarray, names: Sequence[str]) -> dict[str, float]:
    """For every body the first time (s) at which either run recorded a contact of it, or of a body of its tree."""
    found: dict[str, float] = {}
    for run in (a, b):
        if "contact.row" not in run.arrays or not len(run.arrays["contact.row"]):
            continue
        times = run.time[run.arrays["contact.row"].astype(np.int64)]
        models = [body.model for body in run.world.bodies]
        first: dict[str, float] = {}
        for pair, time in zip(run.arrays["contact.body"].astype(np.int64), times, strict=True):
            for index in pair:
                first[models[index]] = min(first.get(models[index], np.inf), float(time))
        for body in run.world.bodies:
            if body.model in first:
                found[body.name] = min(found.get(body.name, np.inf), first[body.model])
    return {name: found[name] for name in names if name in found}


def _contact_first_difference(a: Run, b: Run, rows_a: np.ndarray, rows_b: np.ndarray) -> float | None:
    """The first common time (s) at which other pairs of bodies touch in one run than in the other."""
    if "contact.row" not in a.arrays or "contact.row" not in b.arrays:
        return None
    sets = [_pairs_by_row(run) for run in (a, b)]
    for one, other in zip(rows_a, rows_b, strict=True):
        if sets[0].get(int(one), set()) != sets[1].get(int(other), set()):
            return float(a.time[one])
    return None


def _pairs_by_row(run: Run) -> dict[int, set[tuple[str, str]]]:
    names = [body.name for body in run.world.bodies]
    found: dict[int, set[tuple[str, str]]] = {}
    for row, (i, j) in zip(run.arrays["contact.row"], run.arrays["contact.body"].astype(np.int64), strict=True):
        pair = (names[i], names[j]) if names[i] <= names[j] else (names[j], names[i])
        found.setdefault(int(row), set()).add(pair)
    return found


def _quantities(a: Run, b: Run, rows_a: np.ndarray, rows_b: np.ndarray) -> list[Scalars]:
    """Scalars of both runs at the last common time, and the extremes up to it."""
    values = [_values(run, int(rows[-1])) for run, rows in ((a, rows_a), (b, rows_b))]
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
"""What runs are summarised by: name and unit."""


def _values(run: Run, last: int) -> dict[str, float]:
    ends = {name: run.arrays[name][[0, last]] for name in ("q", "v", "pose", "velocity")}
    kinetic, potential = metrics.energy(run.world, ends)
    linear, angular = metrics.momentum(run.world, ends)
    found = {
        "energy at the start": kinetic[0] + potential[0],
        "energy at the end": kinetic[1] + potential[1],
        "linear momentum at the end": np.linalg.norm(linear[1]),
        "angular momentum at the end": np.linalg.norm(angular[1]),
        "speed at the end": metrics.speeds(run.world, ends)[1].max(),
        "spread at the end": metrics.spread(run.world, ends)[1],
    }
    if "contact.row" in run.arrays:
        found["deepest penetration"] = metrics.deepest_penetration(run.world, run.arrays).depth
        found["contacts, mean"] = metrics.contact_counts(run.arrays)[: last + 1].mean()
        found["contact force, mean"] = metrics.contact_force(run.arrays)[: last + 1].mean()
    return {name: float(value) for name, value in found.items()} | _control(run)


def _control(run: Run) -> dict[str, float]:
    """How driven joints were followed in the whole run; nothing where none is driven."""
    about = run.provenance.get("control")
    if about is None:
        return {}
    kinds = {body.joint.name: body.joint.kind for body in run.world.bodies}
    clipped = [count for count in about["clipped"] if count is not None]  # of its own controllers only the engine knows
    found = {"efforts clipped, most steps of a joint": float(max(clipped))} if clipped else {}
    for kind in ("hinge", "slide"):
        errors = [
            math.inf if error is None else error
            for name, error in zip(about["joints"], about["error"], strict=True)
            if kinds[name] == kind
        ]
        if errors:
            found[f"largest error of a driven {kind}"] = max(errors)
    return found


def summary(run: Run) -> dict[str, float]:
    """The quantities of one run (:data:`QUANTITIES`), at its end."""
    return _values(run, len(run.time) - 1) if run.recorded else {}
