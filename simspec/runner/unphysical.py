"""Motions that are impossible for a mechanism in any engine: energy from nothing, bodies that leave the world, pass through
immovable bodies, or sink without end.

Engines that are given one law agree on such a motion, so that no comparison of runs shows it. All is computed from the recorded
arrays and the world alone. Each criterion is one that a sound motion does not meet; where it cannot be applied, that is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simspec.files import parts
from simspec.runner import metrics
from simspec.runner.metrics import fallen, passed
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import rigid_groups
from simspec.world.overlap import deep_overlaps
from simspec.world.shapes import SHAPES
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.runner.run import Run

Floats = NDArray[np.float64]

ENERGY, GONE, PASSED, SINKS = "energy", "left", "passed", "sinks"
KINDS = {
    ENERGY: "energy grows though nothing drives the world",
    GONE: "leaves the world",
    PASSED: "passes through what cannot move",
    SINKS: "sinks without end",
}
GROWTH = 0.05
"""Share of the energy of the run so far by which it may grow above its lowest value."""
EXCHANGE = 2.0
"""Timesteps times the power between potential and kinetic energy by which their sum swings: semi-implicit Euler keeps another
energy, that differs by half a timestep of that power."""
SMALL = (1e-3, 1e-2)
"""m, m/s: a height and a speed of all bodies together whose energy is lost in how contact is computed: a tower of ten boxes
that rests is lifted by 0.16 mm in one engine (measured)."""
FAR = 1e4
"""m from where it began, beyond which a body has left the world, where its initial speed and gravity do not lead there."""
REACH = 10.0
"""Times the way of its initial speed and of gravity."""
SUNK = 0.01
"""Share of the inner radius of the thinner shape by which a resting body sinks in the second half of a run."""
STEADY = 0.5
"""Least ratio of the last quarter's sinking to that of the quarter before: a settling body slows down."""
RESTING = 3.0
"""Times the speed of sinking that a body may have at its surface to be one that rests: a body that slides or falls over is
deeper."""
ROW_BYTES = 300
"""Bytes of temporary arrays for each row of energies."""
MOST_BINS = 1000
"""Parts of the second half of a run of which the deepest contact is looked at."""
CONTACT_BYTES = 200
"""Bytes of temporary arrays for each point of contact."""
FEWEST = 16
"""Records without which nothing is said of sinking."""


@dataclass(frozen=True, slots=True)
class UnphysicalFinding:
    """One thing that is not physical. ``body``: "" for the whole world; ``time`` (s): when it first shows; ``text``: the
    description, with its figures."""

    kind: str
    body: str
    time: float
    text: str

    @property
    def short(self) -> str:
        """The same without figures: equal for engines that do the same."""
        return f"{self.body} {KINDS[self.kind]}" if self.body else KINDS[self.kind]


@dataclass(frozen=True, slots=True)
class Unphysical:
    """Findings that are not physical, and by kind the reason why a check was left out."""

    findings: tuple[UnphysicalFinding, ...]
    not_judged: dict[str, str]


def unphysical(run: Run) -> Unphysical:
    """Everything that is found in a run; nothing of one that recorded nothing."""
    if not run.recorded:
        return Unphysical((), dict.fromkeys(KINDS, "nothing was recorded"))
    world = run.world
    gone = [*_gone(run)]
    lost = {finding.body for finding in gone}
    findings = [*gone]
    not_judged: dict[str, str] = {}
    driven = _driven(world)
    if driven:
        not_judged |= {ENERGY: f"the world has {driven}", SINKS: f"the world has {driven}"}
    findings += [
        UnphysicalFinding(
            PASSED, entry.body, entry.time, f"passes through {entry.obstacle}, which cannot move, at {entry.time:.4g} s"
        )
        for entry in passed(run)
        if entry.body not in lost
    ]
    through = {finding.body for finding in findings}
    findings += [
        UnphysicalFinding(
            GONE, entry.body, entry.time, f"is below everything that cannot move from {entry.time:.4g} s on"
        )
        for entry in fallen(run)
        if entry.body not in through
    ]
    if not driven:
        findings += _energy(run)
        if "contact.row" not in run.arrays:
            not_judged[SINKS] = "contacts were not recorded"
        else:
            findings += [
                finding
                for finding in _sinking(run)
                if finding.body not in {found.body for found in findings if found.body}
            ]
    return Unphysical(tuple(findings), not_judged)


def _driven(world: World) -> str:
    """The drive of a world, or another source of energy that is not that of its motion; "" where there is none."""
    joints = [body.joint for body in world.bodies]
    outside = any(
        joint.position_limits is not None
        and not joint.position_limits[0] <= joint.position[0] <= joint.position_limits[1]
        for joint in joints
    )
    fluid = world.physics.fluid
    shapes = [shape for body in world.bodies for shape in body.shapes]
    named = {
        "controllers": bool(world.controllers),
        "forces on bodies": bool(world.forces),
        "kinematic bodies": bool(world.motions),
        "surfaces that move": any(any(shape.surface_velocity) for shape in shapes),
        "wind": fluid is not None and any(fluid.velocity),
        "joints that begin outside their limits": outside,
        "bodies that begin inside each other": bool(deep_overlaps(world)),
    }
    return " and ".join(name for name, acts in named.items() if acts)


def _energy(run: Run) -> Iterator[UnphysicalFinding]:
    """Whether the energy grows above the initial one, or above its lowest value before, by more than ``GROWTH`` and what the
    integrator exchanges.

    The lowest value is that of rows without contact alone: contact takes energy, and gives back what is elastic.
    """
    world, rows = run.world, len(run.time)
    with np.errstate(all="ignore"):
        kinetic, potential = metrics.energy(world, run.arrays)
    masses = metrics.Masses.of(world).mass
    moving = float(masses[metrics.moving_bodies(world)].sum())
    gravity = math.hypot(*world.physics.gravity)
    rest = moving * (gravity * SMALL[0] + 0.5 * SMALL[1] ** 2)
    initial = float(kinetic[0] + potential[0])
    lowest, began = initial, 0
    fast, low, high, power = 0.0, float(potential[0]), float(potential[0]), 0.0
    first: float | None = None
    most, when, since, scale = 0.0, 0, 0, 0.0
    for part in parts(rows, ROW_BYTES, kinetic, potential):
        before = slice(max(0, part.start - 1), part.stop)
        k, p, t = (np.asarray(values[before]) for values in (kinetic, potential, run.time))
        if not (np.isfinite(k).all() and np.isfinite(p).all()):
            end = int(np.argmin(np.isfinite(k) & np.isfinite(p)))
            k, p, t = k[:end], p[:end], t[:end]
        if not len(k):
            break
        total, free = k + p, _untouched(run, before)[: len(k)]
        kept = np.minimum(np.minimum.accumulate(np.where(free, total, np.inf)), lowest)
        base = np.where(free, kept, initial)
        swing = np.maximum(np.maximum.accumulate(p), high) - np.minimum(np.minimum.accumulate(p), low)
        there = np.maximum(np.maximum(np.maximum.accumulate(k), fast), swing)
        rate = np.concatenate([[0.0], np.abs(np.diff(p) / np.diff(t))])
        powers = np.maximum(np.maximum.accumulate(rate), power)
        growth = total - base
        allowed = np.maximum(GROWTH * there, rest) + EXCHANGE * world.physics.timestep * powers
        beyond = np.flatnonzero(growth > allowed)
        if len(beyond) and first is None:
            first = float(t[beyond[0]])
        worst = int(np.argmax(growth))
        lower = np.flatnonzero(free[: worst + 1] & (total[: worst + 1] == base[worst]) & (base[worst] < lowest))
        if growth[worst] > most:
            most, when = float(growth[worst]), before.start + worst
            since = before.start + int(lower[0]) if len(lower) else began if free[worst] else 0
            scale = max(float(kinetic[since]), abs(float(potential[0] - potential[since])), float(kinetic[0]))
        if kept[-1] < lowest:
            lowest, began = float(kept[-1]), before.start + int(np.argmin(np.where(free, total, np.inf)))
        fast, power = max(fast, float(k.max())), float(powers[-1])
        low, high = min(low, float(p.min())), max(high, float(p.max()))
        if len(k) < before.stop - before.start:
            break
    if first is not None:
        share = f", {most / scale:.3g} of what there was" if scale > rest else ""
        text = f"energy grows by {most:.3g} J{share}, from {run.time[since]:.4g} s to {run.time[when]:.4g} s"
        yield UnphysicalFinding(ENERGY, "", first, text)


def _untouched(run: Run, part: slice) -> NDArray[np.bool_]:
    """Whether nothing touches in some rows; where contacts were not recorded and something may touch, nothing is known."""
    count = part.stop - part.start
    if "contact.row" not in run.arrays:
        return np.full(count, not meeting_laws(run.world))
    ends = np.searchsorted(run.arrays["contact.row"], np.arange(part.start, part.stop + 1))
    free: NDArray[np.bool_] = np.diff(ends) == 0
    return free


def _gone(run: Run) -> Iterator[UnphysicalFinding]:
    """Bodies whose state is not finite, and those that are far beyond where their initial motion and gravity lead."""
    world, pose, time = run.world, run.arrays["pose"], run.time
    gravity = math.hypot(*world.physics.gravity)
    driven = bool(world.controllers or world.forces or world.motions)
    speed = np.linalg.norm(run.arrays["velocity"][0, :, :3], axis=-1)
    reach = FAR + REACH * (speed * float(time[-1]) + 0.5 * gravity * float(time[-1]) ** 2)
    start = np.array(pose[0, :, :3])
    moving = metrics.moving_bodies(world)
    found: dict[int, UnphysicalFinding] = {}
    for part in parts(len(time), metrics.TEMPORARY * pose[:1].nbytes, pose):
        places = np.asarray(pose[part])
        with np.errstate(all="ignore"):
            away = np.linalg.norm(places[..., :3] - start, axis=-1)
            lost, far = ~np.isfinite(places).all(axis=2), away > reach
        gone = lost if driven else lost | far
        for body in moving[gone[:, moving].any(axis=0)].tolist():
            row = int(np.argmax(gone[:, body]))
            at, name = float(time[part.start + row]), world.bodies[body].name
            text = f"is {away[row, body]:.3g} m from where it began at {at:.4g} s"
            text = f"is not at a finite place from {at:.4g} s on" if lost[row, body] else text
            found.setdefault(body, UnphysicalFinding(GONE, name, at, text))
    yield from (found[body] for body in sorted(found))


def _sinking(run: Run) -> Iterator[UnphysicalFinding]:
    """Bodies whose deepest contact with what cannot move grows in the second half of a run, and does not slow down."""
    world, rows = run.world, len(run.time)
    if rows < FEWEST:
        return
    groups = rigid_groups(world)
    static = np.array([groups[body.name] == "world" for body in world.bodies])
    inner = np.array([_inner(world, row) for row in range(len(world.bodies))])
    begin = rows // 2
    bins = min(MOST_BINS, rows - begin)
    deepest = np.full((len(world.bodies), bins), -np.inf)
    thin = inner.copy()
    row, body, distance = (run.arrays[f"contact.{name}"] for name in ("row", "body", "distance"))
    for part in parts(len(row), CONTACT_BYTES, row, body, distance):
        at, pair = np.asarray(row[part]).astype(np.int64), np.asarray(body[part]).astype(np.int64)
        local = (static[pair].sum(axis=1) == 1) & (at >= begin)
        at, pair, depth = at[local], pair[local], -np.asarray(distance[part])[local]
        first = static[pair[:, 0]]
        mover, under = np.where(first, pair[:, 1], pair[:, 0]), np.where(first, pair[:, 0], pair[:, 1])
        np.maximum.at(deepest, (mover, (at - begin) * bins // (rows - begin)), depth)
        np.minimum.at(thin, mover, inner[under])
    middle = bins // 2
    for mover in np.flatnonzero(np.isfinite(deepest).all(axis=1)).tolist():  # always in contact
        late = deepest[mover]
        first, last = float(late[middle] - late[0]), float(late[-1] - late[middle])
        if not (first > 0.0 and last >= STEADY * first and first + last > SUNK * thin[mover]):
            continue
        rate = (first + last) / float(run.time[-1] - run.time[begin])
        if _fastest(run, mover) <= RESTING * rate:
            text = f"sinks by {rate:.3g} m/s without end, and is {late[-1]:.3g} m deep at {run.time[-1]:.4g} s"
            yield UnphysicalFinding(SINKS, world.bodies[mover].name, float(run.time[begin]), text)


def _fastest(run: Run, row: int) -> float:
    """The largest speed (m/s) of any point of a body in the second half of a run, from above."""
    shapes = [shape for shape in run.world.bodies[row].shapes if shape.collision]
    reach = max(math.hypot(*shape.pose.position) + SHAPES[shape.kind].outer_radius(shape.size) for shape in shapes)
    fastest, recorded = 0.0, run.arrays["velocity"]
    for part in parts(len(run.time), recorded[:1].nbytes, recorded, first=len(run.time) // 2):
        velocity = np.asarray(recorded[part, row])
        speed = np.linalg.norm(velocity[:, :3], axis=1) + reach * np.linalg.norm(velocity[:, 3:6], axis=1)
        fastest = max(fastest, float(speed.max()))
    return fastest


def _inner(world: World, row: int) -> float:
    """The least inner radius (m) of a body's collision shapes."""
    shapes = [shape for shape in world.bodies[row].shapes if shape.collision]
    return min((SHAPES[shape.kind].inner_radius(shape.size) for shape in shapes), default=math.inf)


def together(found: dict[str, Unphysical]) -> list[str]:
    """One line for each thing that is found, with the engines that show it; figures are those of the first."""
    lines: dict[str, tuple[UnphysicalFinding, list[str]]] = {}
    for engine, entry in found.items():
        for finding in entry.findings:
            lines.setdefault(finding.short, (finding, []))[1].append(engine)
    every = len(found)
    given = []
    for finding, names in lines.values():
        who = f"{finding.body} " if finding.body else ""
        where = "in every engine" if len(names) == every > 1 else f"in {', '.join(names)}"
        why = " though nothing drives the world" if finding.kind == ENERGY else ""
        given.append(f"{who}{finding.text}{why} ({where})")
    return given
