"""Summary quantities of a run: energy, momentum, penetration, contacts, speed, spread; and bodies that passed through others.

Computed from the recorded poses and velocities and the *world's* masses, in one place for all engines, so that a
difference between engines cannot come from a difference in how something was computed. Arrays have one row per recorded
time; poses (rows, bodies, 7) x y z w x y z, velocities (rows, bodies, 6) linear of the body frame's origin, then angular,
both in world axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simspec.files import parts, release, zeros
from simspec.world import frames
from simspec.world.constraints import JointSums
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import layout_of, poses, rigid_groups
from simspec.world.rotations import logarithm, matrices
from simspec.world.shapes import SHAPES
from simspec.world.types import Inertial, Shape, World

if TYPE_CHECKING:
    from simspec.runner.run import Run


Arrays = Mapping[str, np.ndarray]


def moving_bodies(world: World) -> np.ndarray:
    """Indices of the bodies that can move (not fixed to the world through fixed joints only)."""
    groups = rigid_groups(world)
    return np.array([k for k, body in enumerate(world.bodies) if groups[body.name] != "world"], dtype=np.int64)


@dataclass(frozen=True)
class Masses:
    """The world's mass properties as arrays: mass (n,), centre (n, 3) and inertia (n, 3, 3) in the body frames. Kinematic
    bodies have none: their energy and momentum are not counted."""

    mass: np.ndarray
    centre: np.ndarray
    inertia: np.ndarray

    @classmethod
    def of(cls, world: World) -> Masses:
        bodies = {motion.body for motion in world.motions}
        inertials = [Inertial(0.0) if body.name in bodies else body.inertial for body in world.bodies]
        rows = [inertial.inertia for inertial in inertials]
        tensors = [[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] for xx, yy, zz, xy, xz, yz in rows]
        return cls(
            np.array([inertial.mass for inertial in inertials]),
            np.array([inertial.centre_of_mass for inertial in inertials]).reshape(-1, 3),
            np.array(tensors).reshape(-1, 3, 3),
        )


@dataclass(frozen=True)
class MassMotion:
    """Centres of mass (rows, n, 3), their velocities, angular velocities, and spins R I Rᵀ ω (rows, n, 3)."""

    masses: Masses
    centre: np.ndarray
    velocity: np.ndarray
    angular: np.ndarray
    spin: np.ndarray


def motion(world: World, arrays: Arrays) -> MassMotion:
    """How the bodies' masses move in a run."""
    masses = Masses.of(world)
    pose, velocity = arrays["pose"], arrays["velocity"]
    turn = matrices(pose[..., 3:7])
    lever = np.einsum("tnij,nj->tni", turn, masses.centre)
    angular = velocity[..., 3:6]
    local = np.einsum("tnji,tnj->tni", turn, angular)
    spin = np.einsum("tnij,njk,tnk->tni", turn, masses.inertia, local)
    return MassMotion(masses, pose[..., :3] + lever, velocity[..., :3] + np.cross(angular, lever), angular, spin)


TEMPORARY = 24
"""Bytes of temporary arrays to each byte of poses, in :func:`motion` and what is made of it."""


def by_blocks(arrays: Arrays, first: int = 0) -> Iterator[tuple[slice, Arrays]]:
    """Blocks of rows of q, v, pose and velocity, from row ``first`` on: of a long recording, more does not fit into memory.

    The functions of this module give the same for each row of a block as for that row of the whole.
    """
    needed = {name: arrays[name] for name in ("q", "v", "pose", "velocity") if name in arrays}
    rows, size = len(arrays["pose"]), TEMPORARY * arrays["pose"][:1].nbytes
    for part in parts(rows, size, *needed.values(), first=first):
        yield part, {name: np.asarray(values[part]) for name, values in needed.items()}


def _each(
    world: World, arrays: Arrays, make: Callable[[World, Arrays], tuple[np.ndarray, ...]]
) -> tuple[np.ndarray, ...]:
    """The values of ``make`` for each row, made block by block."""
    results: tuple[np.ndarray, ...] = ()
    for part, block in by_blocks(arrays):
        made = make(world, block)
        if part.stop - part.start == len(arrays["pose"]):
            return made
        if not results:
            results = tuple(zeros((len(arrays["pose"]), *values.shape[1:])) for values in made)
        for result, values in zip(results, made, strict=True):
            result[part] = values
            release(result)
    return results


def energy(world: World, arrays: Arrays) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and potential energy (rows,), J.

    Kinetic: ½ m |v|² + ½ ω·(R I Rᵀ ω) of every body, and ½ A q̇² of every armature. Potential: −s m g·c, s `gravity_scale`
    (zero at the world's origin), ½ k (q − rest)² of every spring, those along sums too, ½ k |log R|² of every ball spring
    (zero at rest).
    """
    kinetic, potential = _each(world, arrays, _energy)
    return kinetic, potential


def _energy(world: World, arrays: Arrays) -> tuple[np.ndarray, np.ndarray]:
    moved = motion(world, arrays)
    mass = moved.masses.mass
    kinetic = 0.5 * np.einsum("n,tni,tni->t", mass, moved.velocity, moved.velocity)
    kinetic += 0.5 * np.einsum("tni,tni->t", moved.angular, moved.spin)
    weights = mass * np.array([body.gravity_scale for body in world.bodies])
    potential = -np.einsum("n,tni,i->t", weights, moved.centre, np.array(world.physics.gravity))
    where = layout_of(world)
    for body, position, speed in zip(world.bodies, where.position, where.velocity, strict=True):
        joint = body.joint
        if joint.armature or joint.angular_armature:
            each = np.full(speed.stop - speed.start, joint.armature)
            each[3:] = joint.angular_armature  # of a free joint; others have three coordinates at most
            kinetic += 0.5 * arrays["v"][:, speed] ** 2 @ each
        if joint.spring_stiffness:
            q = arrays["q"][:, position]
            bent = logarithm(q) if joint.kind == "ball" else q - joint.spring_rest
            potential += 0.5 * joint.spring_stiffness * np.einsum("ti,ti->t", bent, bent)
    along = JointSums(world.bodies, world.sums)
    stretch = along.lengths(arrays["q"]) - along.rest
    potential += 0.5 * (stretch * stretch) @ along.stiffness
    return kinetic, potential


def energy_scale(kinetic: np.ndarray, potential: np.ndarray) -> float:
    """The energy (J) that tolerances are relative to: the largest kinetic energy of the run, or how far the potential
    energy swings, whichever is larger. (The potential alone has no natural zero, so its size means nothing.)"""
    return float(max(kinetic.max(), np.ptp(potential)))


def momentum(world: World, arrays: Arrays) -> tuple[np.ndarray, np.ndarray]:
    """Linear momentum (rows, 3), N s, and angular momentum about the world's origin (rows, 3), N m s."""
    linear, angular = _each(world, arrays, _momentum)
    return linear, angular


def _momentum(world: World, arrays: Arrays) -> tuple[np.ndarray, np.ndarray]:
    moved = motion(world, arrays)
    push = moved.masses.mass[:, None] * moved.velocity
    return push.sum(axis=1), (np.cross(moved.centre, push) + moved.spin).sum(axis=1)


def momentum_scale(world: World, arrays: Arrays) -> tuple[float, float]:
    """The scales of momentum tolerances: the largest sums over the bodies of |m v|, and of |c × m v| + |R I Rᵀ ω|
    (so that opposite motions do not make the scale vanish)."""
    linear, angular = _each(world, arrays, _momentum_scales)
    return float(linear.max()), float(angular.max())


def _momentum_scales(world: World, arrays: Arrays) -> tuple[np.ndarray, np.ndarray]:
    moved = motion(world, arrays)
    push = moved.masses.mass[:, None] * moved.velocity
    turn = np.linalg.norm(np.cross(moved.centre, push), axis=-1) + np.linalg.norm(moved.spin, axis=-1)
    return np.linalg.norm(push, axis=-1).sum(axis=1), turn.sum(axis=1)


@dataclass(frozen=True)
class Penetration:
    """The deepest overlap of a run (m, 0 when nothing overlapped), when (s), and between which bodies."""

    depth: float
    time: float
    bodies: tuple[str, str] | None


def deepest_penetration(world: World, arrays: Arrays) -> Penetration:
    """The deepest overlap among the recorded contacts."""
    distance = arrays["contact.distance"]
    deepest, worst = 0.0, -1
    for part in parts(len(distance), 8, distance):
        if part.stop > part.start:
            place = part.start + int(distance[part].argmin())
            if not distance[place] >= deepest:  # NaN is the deepest of all
                deepest, worst = float(distance[place]), place
        if math.isnan(deepest):
            break
    if worst < 0:
        return Penetration(0.0, 0.0, None)
    first, second = (world.bodies[int(index)].name for index in arrays["contact.body"][worst])
    return Penetration(-deepest, float(arrays["time"][arrays["contact.row"][worst]]), (first, second))


def contact_counts(arrays: Arrays) -> np.ndarray:
    """Number of contact points (rows,) at every recorded time."""
    return np.bincount(arrays["contact.row"].astype(np.int64), minlength=len(arrays["time"]))


def contact_means(arrays: Arrays, rows: int) -> tuple[float, float]:
    """Number of contact points, and sum of their normal forces (N), both the mean over the first ``rows`` recorded times."""
    force = arrays["contact.normal_force"]
    count = int(np.searchsorted(arrays["contact.row"], rows))
    total = sum(float(force[part].sum()) for part in parts(count, 8, force))
    return count / rows, total / rows


def contact_force(arrays: Arrays) -> np.ndarray:
    """Sum of the normal forces (rows,), N, at every recorded time."""
    rows = arrays["contact.row"].astype(np.int64)
    return np.bincount(rows, weights=arrays["contact.normal_force"], minlength=len(arrays["time"]))


def speeds(world: World, arrays: Arrays) -> np.ndarray:
    """Speed of every body's centre of mass (rows, bodies), m/s."""
    return _each(world, arrays, lambda local, some: (np.linalg.norm(motion(local, some).velocity, axis=-1),))[0]


def spread(world: World, arrays: Arrays) -> np.ndarray:
    """Root mean square distance (rows,), m, of the moving bodies' centres of mass from their common mean."""
    return _each(world, arrays, lambda local, some: (_spread(local, some),))[0]


def _spread(world: World, arrays: Arrays) -> np.ndarray:
    centres = motion(world, arrays).centre[:, moving_bodies(world)]
    if not centres.shape[1]:
        return np.zeros(len(centres))
    away = centres - centres.mean(axis=1, keepdims=True)
    result: np.ndarray = np.sqrt((away**2).sum(axis=-1).mean(axis=1))
    return result


# Bodies that are, in a run's records, on the other side of something that cannot move, or inside of it, or below all of it.
# Tested are the centres of collision shapes. A centre that is below the surface of a plane, or inside a box, overlaps it by
# more than the shape's inner radius. A line between two records that crosses a box shows a passage only where the body is too
# slow for a way around: twice the distance of the crossing from the nearest edge is longer than its speed allows in that time.

Floats = NDArray[np.float64]
FASTER = 1.5
"""Times the larger of the recorded speeds at both ends that a body may have had between them."""
MOST_PAIRS = 20_000
"""Pairs of a moving shape and one that cannot move that are looked at, in the order of the bodies."""


@dataclass(frozen=True, slots=True)
class Passed:
    """A body, what it passed, and when (s)."""

    body: str
    obstacle: str
    time: float


@dataclass(frozen=True)
class _Static:
    body: str
    shape: Shape
    centre: Floats
    axes: Floats


def _statics(run: Run) -> list[_Static]:
    world = run.world
    groups, places = rigid_groups(world), poses(world)
    found = []
    for body in world.bodies:
        if groups[body.name] != "world":
            continue
        for shape in body.shapes:
            if shape.collision:
                at = frames.compose(places[body.name], shape.pose)
                found.append(_Static(body.name, shape, np.array(at.position), np.array(frames.matrix(at.quaternion))))
    return found


def _movers(run: Run) -> Iterator[tuple[int, Shape]]:
    """The collision shapes of bodies that move by themselves, each with the row of its body."""
    groups = rigid_groups(run.world)
    prescribed = {motion.body for motion in run.world.motions}
    for row, body in enumerate(run.world.bodies):
        if groups[body.name] == "world" or groups[body.name] in prescribed:
            continue
        for shape in body.shapes:
            if shape.collision:
                yield row, shape


def passed(run: Run) -> list[Passed]:
    """The first passage of each body through something that cannot move and that it may touch, in the order of the bodies."""
    world, statics = run.world, _statics(run)
    allowed = CollisionFilter(world)
    looked: list[tuple[int, Shape, _Static]] = []
    for row, shape in _movers(run):
        name = world.bodies[row].name
        for other in statics:
            if allowed.may_touch(name, other.body) and allowed.may_materials_touch(
                shape.material, other.shape.material
            ):
                looked.append((row, shape, other))
    looked = looked[:MOST_PAIRS]
    found: dict[int, Passed] = {}
    inside: set[int] = set()
    for part in _blocks(run):
        arrays = {name: np.asarray(run.arrays[name][part]) for name in ("pose", "velocity")}
        for index, (row, shape, other) in enumerate(looked):
            if row in found or index in inside:
                continue
            centres = _centres(arrays["pose"][:, row], shape)
            speeds = _speeds(arrays["velocity"][:, row], arrays["pose"][:, row], centres)
            at = _through(centres, speeds, np.asarray(run.time[part]), other)
            if at is None:
                continue
            if not at and not part.start:
                inside.add(index)  # it begins there
            else:
                found[row] = Passed(world.bodies[row].name, other.body, float(run.time[part.start + at]))
    return [found[row] for row in sorted(found)]


def _blocks(run: Run) -> Iterator[slice]:
    """Blocks of rows, each with the last row of the one before."""
    pose = run.arrays["pose"]
    for part in parts(len(run.time), TEMPORARY * pose[:1].nbytes, pose):
        yield slice(max(0, part.start - 1), part.stop)


def _centres(pose: Floats, shape: Shape) -> Floats:
    if not any(shape.pose.position):
        return pose[:, :3]
    with np.errstate(all="ignore"):
        centres: Floats = pose[:, :3] + matrices(pose[:, 3:7]) @ np.array(shape.pose.position)
    return centres


def _speeds(velocity: Floats, pose: Floats, centres: Floats) -> Floats:
    lever = np.linalg.norm(centres - pose[:, :3], axis=1)
    speeds: Floats = np.linalg.norm(velocity[:, :3], axis=1) + np.linalg.norm(velocity[:, 3:6], axis=1) * lever
    return speeds


def _through(centres: Floats, speeds: Floats, time: Floats, other: _Static) -> int | None:
    """The first row in which a centre is beyond or inside an obstacle, or has crossed it since the row before; None where it
    never is."""
    local = (centres - other.centre) @ other.axes
    kind = other.shape.kind
    if kind == "plane":
        return _first(local[:, 2] < 0.0)
    if kind == "heightfield":
        return None  # its surface is not convex; a body below all of it has left the world
    inside: NDArray[np.bool_]
    if kind == "box":
        half = np.array(other.shape.size) / 2.0
        inside = np.all(np.abs(local) < half, axis=1)
        crossing = _crosses_box(local, half, speeds, time)
    else:
        inner = SHAPES[kind].inner_radius(other.shape.size)
        away = np.linalg.norm(local, axis=1)
        inside = away < inner
        crossing = _crosses_ball(local, inner, speeds, time)
    inside[1:] |= crossing
    return _first(inside)


def _first(rows: NDArray[np.bool_]) -> int | None:
    return int(np.argmax(rows)) if rows.any() else None


def _room(speeds: Floats, time: Floats) -> Floats:
    """How far (rows − 1,) a body may have gone between two records."""
    room: Floats = FASTER * np.maximum(speeds[:-1], speeds[1:]) * np.diff(time)
    return room


def _crosses_box(local: Floats, half: Floats, speeds: Floats, time: Floats) -> NDArray[np.bool_]:
    """Whether the line between two records leads through a box from one face to the opposite one, and no way around is short
    enough."""
    begin, end = local[:-1], local[1:]
    crossed = np.zeros(len(begin), dtype=bool)
    room = _room(speeds, time)
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        a, b = begin[:, axis], end[:, axis]
        beyond = (np.minimum(a, b) <= -half[axis]) & (np.maximum(a, b) >= half[axis])
        if not beyond.any():
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (-half[axis] - a) / (b - a), (half[axis] - a) / (b - a)
        edge = np.full(len(begin), np.inf)
        for share in (enter, leave):
            place = begin + np.where(beyond, share, 0.0)[:, None] * (end - begin)
            edge = np.minimum(edge, (half[others] - np.abs(place[:, others])).min(axis=1))
        crossed |= beyond & (2.0 * edge > room)
    return crossed


def _crosses_ball(local: Floats, radius: float, speeds: Floats, time: Floats) -> NDArray[np.bool_]:
    """The same of the largest ball inside a shape."""
    begin, step = local[:-1], np.diff(local, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -(begin * step).sum(axis=1) / (step * step).sum(axis=1)
    between = (share > 0.0) & (share < 1.0)
    nearest = begin + np.where(between, share, 0.0)[:, None] * step
    crossed: NDArray[np.bool_] = between & (2.0 * (radius - np.linalg.norm(nearest, axis=1)) > _room(speeds, time))
    return crossed


def fallen(run: Run) -> list[Passed]:
    """Free bodies that began above the lowest point of all that cannot move and that they may touch, and end below it, by more
    than they reach. Where some of that has no end, as a plane, nothing is below it."""
    world = run.world
    gravity = np.array(world.physics.gravity)
    pull = float(np.linalg.norm(gravity))
    statics = _statics(run)
    if not pull or not statics:
        return []
    up = -gravity / pull
    allowed, groups = CollisionFilter(world), rigid_groups(world)
    lowest = {id(static): _lowest(static, up) for static in statics}
    found = []
    for row, body in enumerate(world.bodies):
        reach = [math.hypot(*s.pose.position) + SHAPES[s.kind].outer_radius(s.size) for s in body.shapes if s.collision]
        if body.joint.kind != "free" or groups[body.name] != body.name or not reach:
            continue
        ends = [lowest[id(static)] for static in statics if allowed.may_touch(body.name, static.body)]
        if not ends or any(math.isinf(end) for end in ends):
            continue
        pose, last = run.arrays["pose"], 0
        if pose[0, row, :3] @ up <= min(ends) or not pose[-1, row, :3] @ up < min(ends) - max(reach):
            continue
        for part in _blocks(run):
            above = np.flatnonzero(~(np.asarray(pose[part, row, :3]) @ up < min(ends) - max(reach)))
            last = part.start + int(above[-1]) if len(above) else last
        found.append(Passed(body.name, "", float(run.time[last + 1])))
    return found


def _lowest(entry: _Static, up: Floats) -> float:
    """The lowest height (m) of a shape along ``up``; −∞ where it has no end."""
    kind = SHAPES[entry.shape.kind]
    if kind.endless:
        return -math.inf
    reach = float(kind.support(entry.shape.size, (-up @ entry.axes)[None])[0])
    return float(entry.centre @ up) - reach
