"""Conserved quantities of a run: energy where nothing acts, and momentum of each free tree of bodies where nothing but
gravity does.

Contact, controllers, forces on bodies, damping, friction and stops may change them, and their times are left out. Contact may
take energy away, and may not add any: a gain over a time of contact is reported separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.distributions import Pair, demand_contacts, durations, pair_numbers
from simspec.comparison.common import CONTACT_BYTES, common_sides, named_pair
from simspec.errors import Problem, SpecError
from simspec.files import parts
from simspec.runner import metrics
from simspec.runner.metrics import Penetration, deepest_penetration
from simspec.runner.run import Run
from simspec.world.constraints import JointSums
from simspec.world.contact_pairs import solid_shapes
from simspec.world.kinematics import layout_of
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, World

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Drift:
    """The largest change over a time in which there should be none: its size (J, N s, N m s), the same over ``scale``, from
    when to when (s), and whose it is (a tree's root, or "" for the whole world)."""

    size: float
    relative: float
    begin: float
    end: float
    whose: str = ""


@dataclass(frozen=True)
class Conservation:
    """The conserved quantities of a run. None: at every time something acted on them; ``notes`` say why.

    energy      the largest change of the total energy while nothing acts, relative to the run's energy scale
    integrator  ½ M g² dt T of that time T (J): the loss of semi-implicit Euler, the integrator of every engine here, in
                free fall by itself
    gained      the largest gain of energy over a time of contact; a loss there is no fault
    linear      the largest change of a free tree's linear momentum, less M g t
    angular     the same of its angular momentum about its own centre of mass, on which gravity has no torque
    """

    energy: Drift | None
    integrator: float
    gained: Drift | None
    linear: Drift | None
    angular: Drift | None
    notes: tuple[str, ...]


def conservation(run: Run) -> Conservation:
    """The conserved quantities of a run. Raises SpecError where contacts were not recorded."""
    demand_contacts(run)
    world, notes = run.world, []
    if world.record.every_steps > 1 or (len(run.time) > 1 and run.time[1] > 1.5 * world.physics.timestep):
        notes.append("not every step is recorded: a contact between two records is not seen")
    touching = _touching(run)
    kinetic, potential = metrics.energy(world, run.arrays)
    total, scale = kinetic + potential, metrics.energy_scale(kinetic, potential)
    always = _always_acting(world)
    energy = gained = None
    integrator = 0.0
    contact = touching.any(axis=1)
    if always:
        notes.append(f"energy may change at any time: the world has {' and '.join(always)}")
    else:
        free = ~_between(contact | _stopped(run))
        energy = _largest(total[:, None], free[:, None], run.time, scale, [""])
        if energy is not None:
            mass = sum(world.bodies[index].inertial.mass for index in metrics.moving_bodies(world))
            pull = float(np.dot(world.physics.gravity, world.physics.gravity))
            integrator = 0.5 * mass * pull * world.physics.timestep * (energy.end - energy.begin)
        gained = _gained(total, free, run.time, scale)
    linear, angular = _momentum(run, touching)
    if energy is None and not always:
        notes.append("something touches or is stopped all the time: energy may change at any time")
    if linear is None:
        notes.append("no free tree of bodies is ever untouched: momentum may change at any time")
    return Conservation(energy, integrator, gained, linear, angular, tuple(notes))


def _between(rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """For each interval between two rows whether it holds at either end, (rows − 1, …)."""
    result: NDArray[np.bool_] = rows[:-1] | rows[1:]
    return result


def _touching(run: Run) -> NDArray[np.bool_]:
    """Whether each body touches something at each row (rows, bodies)."""
    row, pair = run.arrays["contact.row"], run.arrays["contact.body"]
    touching = np.zeros((len(run.time), len(run.world.bodies)), dtype=bool)
    for part in parts(len(row), 64, row, pair):
        touching[row[part].astype(np.int64)[:, None], pair[part].astype(np.int64)] = True
    return touching


def _always_acting(world: World) -> list[str]:
    joints = [body.joint for body in world.bodies]
    named = {
        "controllers": bool(world.controllers),
        "forces on bodies": bool(world.forces),
        "kinematic bodies": bool(world.motions),
        "damping": any(joint.damping or joint.angular_damping for joint in joints)
        or any(sum_.damping for sum_ in world.sums),
        "dry friction": any(joint.dry_friction for joint in joints),
        "constraints": bool(world.constraints),
        "a fluid": world.physics.fluid is not None,
    }
    return [name for name, acts in named.items() if acts]


def _stopped(run: Run) -> NDArray[np.bool_]:
    """Whether some joint, or a sum of joint positions, is at a limit, (rows,)."""
    stopped = np.zeros(len(run.time), dtype=bool)
    for body, place in zip(run.world.bodies, layout_of(run.world).position, strict=True):
        if body.joint.position_limits is not None:
            lower, upper = body.joint.position_limits
            q = run.arrays["q"][:, place][:, 0]
            stopped |= (q <= lower) | (q >= upper)
    along = JointSums(run.world.bodies, run.world.sums)
    for sum_, length in zip(along.sums, along.lengths(run.arrays["q"]).T, strict=True):
        if sum_.position_limits is not None:
            lower, upper = sum_.position_limits
            stopped |= (length <= lower) | (length >= upper)
    return stopped


def _largest(values: Numbers, free: NDArray[np.bool_], time: Numbers, scale: float, names: list[str]) -> Drift | None:
    """The largest change of a column of ``values`` (rows, columns) or (rows, columns, 3) since the beginning of a stretch of
    ``free`` intervals (rows − 1, columns); None where no interval is free. NaN is the largest."""
    worst: Drift | None = None
    for column, name in enumerate(names):
        free_here = free[:, column]
        start = np.zeros(len(time), dtype=np.int64)
        # the row at which the stretch of each row began; its own, where the interval before it is not free
        begun = np.where(np.concatenate([[False], free_here]), 0, np.arange(len(time)))
        start = np.maximum.accumulate(begun)
        change = values[:, column] - values[start, column]
        size = np.abs(change) if change.ndim == 1 else np.linalg.norm(change, axis=-1)
        size = np.where(np.isnan(size), np.inf, size)
        row = int(size.argmax())
        if free_here.any() and (worst is None or size[row] > worst.size):
            row = row if size[row] > 0.0 else int(np.flatnonzero(free_here)[-1]) + 1
            relative = float(size[row]) / scale if scale else (0.0 if size[row] == 0.0 else float("inf"))
            worst = Drift(float(size[row]), relative, float(time[start[row]]), float(time[row]), name)
    return worst


def _gained(total: Numbers, free: NDArray[np.bool_], time: Numbers, scale: float) -> Drift | None:
    """The largest gain of energy from before a stretch of contact to after it; None where there was none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], free, [True]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    if not len(begins):
        return None
    gains = total[ends] - total[begins]
    at = int(np.where(np.isnan(gains), np.inf, gains).argmax())
    gain = max(0.0, float(gains[at]))
    return Drift(gain, gain / scale if scale else 0.0, float(time[begins[at]]), float(time[ends[at]]))


def free_trees(world: World) -> dict[str, list[int]]:
    """The bodies of each tree whose root is free, and on which nothing but gravity and contact acts from outside, by its
    root's name."""
    above = {body.name: body.joint.parent for body in world.bodies}
    trees: dict[str, list[int]] = {}
    for index, body in enumerate(world.bodies):
        root = body.name
        while (parent := above[root]) is not None:
            root = parent
        trees.setdefault(root, []).append(index)
    joints = {body.name: body.joint for body in world.bodies}
    pushed = {force.body for force in world.forces} | {motion.body for motion in world.motions}
    return {
        name: rows
        for name, rows in trees.items()
        if joints[name].kind == "free"
        and world.physics.fluid is None
        and not (joints[name].damping or joints[name].angular_damping)
        and not (joints[name].armature or joints[name].angular_armature)
        and not any(world.bodies[row].name in pushed for row in rows)
        and len({world.bodies[row].gravity_scale for row in rows}) == 1  # else weights turn the tree about its centre
    }


def _momentum(run: Run, touching: NDArray[np.bool_]) -> tuple[Drift | None, Drift | None]:
    world = run.world
    trees = free_trees(world)
    if not trees or world.constraints:
        return None, None
    linear, angular = (np.zeros((len(run.time), len(trees), 3)) for _ in range(2))
    gravity, masses = np.array(world.physics.gravity), metrics.Masses.of(world).mass
    weights = masses * np.array([body.gravity_scale for body in world.bodies])
    scales = np.zeros(2)
    for part, block in metrics.by_blocks(run.arrays):
        moved = metrics.motion(world, block)
        scales = np.maximum(scales, metrics.momentum_scale(world, block))
        for column, rows in enumerate(trees.values()):
            mass = masses[rows][:, None]
            push = mass * moved.velocity[:, rows]
            whole = mass.sum()
            centre = (mass * moved.centre[:, rows]).sum(axis=1) / whole
            linear[part, column] = push.sum(axis=1) - float(weights[rows].sum()) * gravity * run.time[part, None]
            lever = moved.centre[:, rows] - centre[:, None]
            spin = moved.spin[:, rows]
            angular[part, column] = (np.cross(lever, push) + spin).sum(axis=1)
    touched = np.stack([touching[:, rows].any(axis=1) for rows in trees.values()], axis=1)
    free, names = ~_between(touched), list(trees)
    found = [
        _largest(values, free, run.time, float(scale), names)
        for values, scale in zip((linear, angular), scales, strict=True)
    ]
    return found[0], found[1]


# Displacement of free bodies from their initial poses (towers, piles, boxes on a slope): sideways, and down along
# gravity; without gravity every direction is sideways.

LEFT = 1.0
"""Of its size that a body is moved sideways by when it has left its place: the centre is then beyond the edge of an equal body
below. Size: the radius of the largest sphere inside its largest shape, half the width of a cube."""


@dataclass(frozen=True)
class BodyDisplacement:
    """How far the free bodies with collision shapes are moved.

    sideways  the largest distance (m) across gravity of any body from where it began, over all records
    down      how far (m) along gravity the body that is lowest relative to its beginning is at the end; 0 where none is lower
    whose     the body that is moved sideways furthest
    left      when (s) a body had first left its place; None: none did
    bodies    how many bodies these are
    """

    sideways: float
    down: float
    whose: str
    left: float | None
    bodies: int


def displacement(run: Run) -> BodyDisplacement:
    """How far the free bodies of a run are moved. Raises SpecError for a run without records, and where no free body has a
    collision shape. A place that is not a number is infinitely far away."""
    places = {index: body for index, body in enumerate(run.world.bodies) if body.joint.kind == "free" and _size(body)}
    if not places:
        raise SpecError([Problem(f"{run.world.name}: no free body has a collision shape", code="R106")])
    if "pose" not in run.arrays or not len(run.time):
        raise SpecError([Problem(f"{run.world.name} in {run.engine}: poses were not recorded", code="R107")])
    gravity = np.asarray(run.world.physics.gravity, dtype=float)
    size = float(np.linalg.norm(gravity))
    along = gravity / size if size else np.zeros(3)
    furthest, lowest, whose = -1.0, 0.0, ""
    first = len(run.time)
    for index, body in places.items():
        moved = np.asarray(run.arrays["pose"][:, index, :3]) - np.asarray(run.arrays["pose"][0, index, :3])
        down = moved @ along
        sideways = np.linalg.norm(moved - down[:, None] * along, axis=1)
        down, sideways = (np.where(np.isfinite(entry), entry, np.inf) for entry in (down, sideways))
        if sideways.max() > furthest:
            furthest, whose = float(sideways.max()), body.name
        lowest = max(lowest, float(down[-1]))
        away = sideways > LEFT * _size(body)
        first = min(first, int(np.argmax(away)) if away.any() else first)
    left = float(run.time[first]) if first < len(run.time) else None
    return BodyDisplacement(furthest, lowest, whose, left, len(places))


def _size(body: Body) -> float:
    """The size (m) of a body's largest collision shape; 0 where it has none."""
    shapes = solid_shapes(body)
    return max((SHAPES[shape.kind].inner_radius(shape.size) for shape in shapes), default=0.0)


# Penetration: depth of overlaps over time and by pair, and their duration.


@dataclass(frozen=True)
class OverlapDepths:
    """Overlaps of a run.

    deepest  the deepest of all: depth (m), time (s), bodies (:func:`simspec.runner.metrics.deepest_penetration`)
    depth    (rows,) the deepest overlap of each recorded row, m; 0 where nothing overlaps
    pairs    the deepest overlap (m) of each pair that overlapped, of shapes where the run records them
    mean     the mean depth (m) over the time in which something overlaps; 0 where nothing ever does
    """

    deepest: Penetration
    depth: NDArray[np.float64]
    pairs: dict[Pair, float]
    mean: float
    _lasting: NDArray[np.float64]

    def share_deeper(self, depth: float) -> float:
        """The share of the recorded time in which something overlaps by more than ``depth`` (m)."""
        total = float(self._lasting.sum())
        return float(self._lasting[self.depth > depth].sum()) / total if total else 0.0


def penetration(run: Run) -> OverlapDepths:
    """The overlaps of a run. Raises SpecError where contacts were not recorded. A distance that is not a number is infinitely
    deep: it hides any other."""
    demand_contacts(run)
    row, distance = run.arrays["contact.row"], run.arrays["contact.distance"]
    depth = np.zeros(len(run.time))
    pairs: dict[int, float] = {}
    sides = common_sides([run])
    for part in parts(len(row), CONTACT_BYTES, row, distance, run.arrays[sides.arrays[0]]):
        overlap = -distance[part]
        overlap = np.where(np.isnan(overlap), np.inf, overlap)
        np.maximum.at(depth, row[part].astype(np.int64), overlap)
        kinds, place = np.unique(pair_numbers(run, part, sides), return_inverse=True)
        largest = np.zeros(len(kinds))
        np.maximum.at(largest, place, overlap)
        for kind, value in zip(kinds.tolist(), largest.tolist(), strict=True):
            if value > 0.0:
                pairs[kind] = max(pairs.get(kind, 0.0), value)
    lasting = durations(run)
    overlapping = lasting * (depth > 0.0)
    inside = overlapping > 0.0
    mean = float((depth[inside] * overlapping[inside]).sum() / overlapping.sum()) if inside.any() else 0.0
    named = {named_pair(sides.names, kind): value for kind, value in pairs.items()}
    return OverlapDepths(deepest_penetration(run.world, run.arrays), depth, named, mean, lasting)
