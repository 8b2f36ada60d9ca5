"""What a run shows that no mechanism does, whatever engine made it: energy from nothing, bodies that leave the world, pass
through what cannot move, or sink without end.

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

from simspec.mapped import parts
from simspec.runner import metrics
from simspec.runner.passed import fallen, passed
from simspec.world.kinematics import rigid_groups
from simspec.world.meeting import meeting_laws
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
"""Least ratio of the last quarter's sinking to that of the quarter before: what settles slows down."""
RESTING = 3.0
"""Times the speed of sinking that a body may have at its surface to be one that rests: what slides or falls over is deeper."""
MOST_BINS = 1000
"""Parts of the second half of a run of which the deepest contact is looked at."""
CONTACT_BYTES = 200
"""Bytes of temporary arrays for each point of contact."""
FEWEST = 16
"""Records without which nothing is said of sinking."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is not physical. ``body``: "" for the whole world; ``time`` (s): when it first shows; ``text``: what, with
    its figures."""

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
    """What a run shows that is not physical, and by kind why something was not looked for."""

    findings: tuple[Finding, ...]
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
        Finding(PASSED, one.body, one.time, f"passes through {one.obstacle}, which cannot move, at {one.time:.4g} s")
        for one in passed(run)
        if one.body not in lost
    ]
    through = {finding.body for finding in findings}
    findings += [
        Finding(GONE, one.body, one.time, f"is below everything that cannot move from {one.time:.4g} s on")
        for one in fallen(run)
        if one.body not in through
    ]
    if not driven:
        findings += _energy(run)
        if "contact.row" not in run.arrays:
            not_judged[SINKS] = "contacts were not recorded"
        else:
            findings += [
                one for one in _sinking(run) if one.body not in {found.body for found in findings if found.body}
            ]
    return Unphysical(tuple(findings), not_judged)


def _driven(world: World) -> str:
    """What drives a world, or gives its bodies energy that is not that of their motion; "" where nothing does."""
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


def _energy(run: Run) -> Iterator[Finding]:
    """Whether the energy grows above the initial one, or above its lowest value before, by more than ``GROWTH`` and what the
    integrator exchanges.

    The lowest value is that of rows without contact alone: contact takes energy, and gives back what is elastic.
    """
    world, time = run.world, run.time
    with np.errstate(all="ignore"):
        kinetic, potential = metrics.energy(world, run.arrays)
    finite = np.isfinite(kinetic) & np.isfinite(potential)
    rows = len(time) if finite.all() else int(np.argmin(finite))
    if rows < 2:
        return
    kinetic, potential, time = kinetic[:rows], potential[:rows], time[:rows]
    total = kinetic + potential
    masses = metrics.Masses.of(world).mass
    moving = float(masses[metrics.moving_bodies(world)].sum())
    gravity = math.hypot(*world.physics.gravity)
    rest = moving * (gravity * SMALL[0] + 0.5 * SMALL[1] ** 2)
    power = np.concatenate([[0.0], np.maximum.accumulate(np.abs(np.diff(potential) / np.diff(time)))])
    free = _untouched(run)[:rows]
    before = np.where(free, np.minimum.accumulate(np.where(free, total, np.inf)), total[0])
    before = np.minimum(before, total[0])
    growth = total - before
    swing = np.maximum.accumulate(potential) - np.minimum.accumulate(potential)
    there = np.maximum(np.maximum.accumulate(kinetic), swing)
    allowed = np.maximum(GROWTH * there, rest) + EXCHANGE * world.physics.timestep * power
    beyond = np.flatnonzero(growth > allowed)
    if not len(beyond):
        return
    worst = int(np.argmax(growth))
    began = int(np.flatnonzero(total[: worst + 1] == before[worst])[0])
    scale = metrics.energy_scale(kinetic[: began + 1], potential[: began + 1])
    share = f", {growth[worst] / scale:.3g} of what there was" if scale > rest else ""
    text = f"energy grows by {growth[worst]:.3g} J{share}, from {time[began]:.4g} s to {time[worst]:.4g} s"
    yield Finding(ENERGY, "", float(time[int(beyond[0])]), text)


def _untouched(run: Run) -> NDArray[np.bool_]:
    """Whether nothing touches in a row (rows,); where contacts were not recorded and something may touch, nothing is known."""
    if "contact.row" in run.arrays:
        free: NDArray[np.bool_] = metrics.contact_counts(run.arrays) == 0
        return free
    return np.full(len(run.time), not meeting_laws(run.world))


def _gone(run: Run) -> Iterator[Finding]:
    """Bodies whose state is not finite, and those that are far beyond where their initial motion and gravity lead."""
    world, pose, time = run.world, run.arrays["pose"], run.time
    gravity = math.hypot(*world.physics.gravity)
    driven = bool(world.controllers or world.forces or world.motions)
    speed = np.linalg.norm(run.arrays["velocity"][0, :, :3], axis=-1)
    reach = FAR + REACH * (speed * float(time[-1]) + 0.5 * gravity * float(time[-1]) ** 2)
    start = np.array(pose[0, :, :3])
    moving = metrics.moving_bodies(world)
    found: dict[int, Finding] = {}
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
            found.setdefault(body, Finding(GONE, name, at, text))
    yield from (found[body] for body in sorted(found))


def _sinking(run: Run) -> Iterator[Finding]:
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
        own = (static[pair].sum(axis=1) == 1) & (at >= begin)
        at, pair, depth = at[own], pair[own], -np.asarray(distance[part])[own]
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
            yield Finding(SINKS, world.bodies[mover].name, float(run.time[begin]), text)


def _fastest(run: Run, row: int) -> float:
    """The largest speed (m/s) of any point of a body in the second half of a run, from above."""
    shapes = [shape for shape in run.world.bodies[row].shapes if shape.collision]
    reach = max(math.hypot(*one.pose.position) + SHAPES[one.kind].outer_radius(one.size) for one in shapes)
    velocity = np.asarray(run.arrays["velocity"][len(run.time) // 2 :, row])
    speed = np.linalg.norm(velocity[:, :3], axis=1) + reach * np.linalg.norm(velocity[:, 3:6], axis=1)
    return float(speed.max())


def _inner(world: World, row: int) -> float:
    """The least inner radius (m) of a body's collision shapes."""
    shapes = [shape for shape in world.bodies[row].shapes if shape.collision]
    return min((SHAPES[shape.kind].inner_radius(shape.size) for shape in shapes), default=math.inf)


def together(found: dict[str, Unphysical]) -> list[str]:
    """One line for each thing that is found, with the engines that show it; figures are those of the first."""
    lines: dict[str, tuple[Finding, list[str]]] = {}
    for engine, one in found.items():
        for finding in one.findings:
            lines.setdefault(finding.short, (finding, []))[1].append(engine)
    every = len(found)
    told = []
    for finding, names in lines.values():
        who = f"{finding.body} " if finding.body else ""
        where = "in every engine" if len(names) == every > 1 else f"in {', '.join(names)}"
        why = " though nothing drives the world" if finding.kind == ENERGY else ""
        told.append(f"{who}{finding.text}{why} ({where})")
    return told
