"""Whether joints' own damping and springs, those along sums of joint positions, and the viscosity of a fluid are stable at a
world's timestep, predicted before a run.

All are explicit in time in every engine. About a posture, M v' = M v − dt (K q + D v), q' = q + dt v', with M at that posture
and K, D the diagonals of stiffness and damping, k c cᵀ, d c cᵀ of each sum c, and what is linear in velocity of a fluid's
forces. By Jury's criterion no deviation x grows while xᵀ(4 M − 2 dt D − dt² K) x > 0: one joint alone is stable while
2 d dt + k dt² < 4 m, m its generalised inertia, 1 / (M⁻¹)ᵢᵢ. Changes of gravity, the
Coriolis force and drag with the state are left out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from simspec.dynamics.oracle import model_key, random_states
from simspec.dynamics.oracle_tree import OracleTree
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world.constraints import JointSums
from simspec.world.kinematics import initial_state, layout_of, sprung_trees, trees, within
from simspec.world.rotations import matrices
from simspec.world.types import Body, Physics, World

POSTURES, FEW, LARGE = 8, 1, 200
"""Seeded postures within the limits that are looked at besides the initial one (M of an arm that folds changes severalfold),
and how many of trees with more coordinates than that."""
SLACK = 1e-9
"""Share of the bound that round-off may take; at the bound itself a deviation neither grows nor fades."""
RESOLUTION = 1e-4
"""Relative: the largest stable step is named to three digits."""
SHARE = 0.1
"""Part in the fastest growing motion from which on a joint is named, where several diverge only together."""
BOUND = 4.0


@dataclasses.dataclass(frozen=True)
class JointInstability:
    """Bodies whose joints' damping or springs diverge, the strongest first: at the world's timestep (s) the fastest growing
    deviation grows by ``growth`` in a step; up to ``largest_stable_step`` (s) none does. ``initially``: at the initial posture
    already, or only at others within the limits. ``damping``: whether damping is more of the cause than springs. ``along``: the
    name of the sum of joint positions that is more of it than the joints' own; "": none is. ``fluid``: whether the fluid is."""

    bodies: tuple[str, ...]
    timestep: float
    largest_stable_step: float
    growth: float
    initially: bool
    damping: bool
    along: str = ""
    fluid: bool = False

    def __str__(self) -> str:
        what = "damping" if self.damping else "spring"
        more = len(self.bodies) - 1
        who = f"the joint of {self.bodies[0]!r}" + (
            f" (and {more} more joint{'s' if more > 1 else ''})" if more else ""
        )
        if self.along:
            who = f"the sum {self.along!r} of joint positions"
        if self.fluid:
            what, who = "viscosity", f"{self.bodies[0]!r} in the fluid"
        where = "" if self.initially else ", at some postures within its limits"
        growth = f"deviations grow by a factor of {self.growth:.4g} in every step"
        return f"explicit {what} at {who} is unstable at this timestep{where}: {growth}"


class SingularError(ArithmeticError):
    """Masses and moments of a tree that double precision cannot hold side by side. ``root``: the body at its root."""

    def __init__(self, root: str):
        super().__init__(root)
        self.root = root


def unstable(world: World) -> list[JointInstability]:
    """Joints that diverge, one entry for each tree that has some; trees that are alike are looked at once. Raises
    SingularError."""
    known: dict[object, tuple[tuple[int, ...], int | None, JointInstability] | None] = {}
    instabilities = []
    for bodies in sprung_trees(world):
        part = within(world, bodies)
        sprung = any(body.joint.damping or body.joint.angular_damping or body.joint.spring_stiffness for body in bodies)
        viscous = world.physics.fluid is not None and world.physics.fluid.viscosity > 0.0
        if not sprung and not viscous and not any(sum_.damping or sum_.stiffness for sum_ in part.sums):
            continue
        positions = tuple(body.joint.position for body in bodies if body.joint.kind != "free")
        key = model_key(bodies, (), part.sums), positions
        if key not in known:
            try:
                known[key] = _unstable(part)
            except np.linalg.LinAlgError:
                raise SingularError(bodies[0].name) from None
        if (entry := known[key]) is not None:
            rows, summed, instability = entry
            names = tuple(bodies[row].name for row in rows)
            along = "" if summed is None else part.sums[summed].name
            instabilities.append(dataclasses.replace(instability, bodies=names, along=along))
    return instabilities


def _unstable(world: World) -> tuple[tuple[int, ...], int | None, JointInstability] | None:
    """The rows of the bodies to blame, the sum that is more to blame (None: none is), and the instability without their names;
    None where the tree is stable."""
    tree, step = OracleTree(world), world.physics.timestep
    owner = np.array([row for row, body in enumerate(world.bodies) for _ in body.joint.velocity], dtype=int)
    stiffness, damping = np.zeros(tree.nv), np.zeros(tree.nv)
    for body, part in zip(world.bodies, layout_of(world).velocity, strict=True):
        stiffness[part], damping[part] = body.joint.spring_stiffness, body.joint.damping
        if body.joint.kind == "free":
            damping[part.start + 3 : part.stop] = body.joint.angular_damping
    along = JointSums(world.bodies, world.sums)
    postures = (initial_state(world)[0], *random_states(world, POSTURES if tree.nv <= LARGE else FEW)[0])
    resisted = [tree.viscous(posture) for posture in postures]
    acting = np.flatnonzero(
        stiffness
        + damping
        + np.abs(along.weights[along.stiffness + along.damping > 0.0]).sum(axis=0)
        + sum(np.diag(matrix) for matrix in resisted)
    )
    if not len(acting):
        return None
    more_k, more_d = (matrix[np.ix_(acting, acting)] for matrix in along.matrices())
    k, local = np.diag(stiffness[acting]) + more_k, np.diag(damping[acting]) + more_d
    dampings = [local + matrix[np.ix_(acting, acting)] for matrix in resisted]
    mobilities = [np.linalg.inv(tree.mass_matrix(posture))[np.ix_(acting, acting)] for posture in postures]
    sizes = [_size(inverse_mass, k, d, step) for inverse_mass, d in zip(mobilities, dampings, strict=True)]
    worst = int(np.argmax(sizes))
    if sizes[worst] < BOUND * (1.0 - SLACK):
        return None
    mobility, d = mobilities[worst], dampings[worst]
    largest = step
    for inverse_mass, damped_by, size in zip(mobilities, dampings, sizes, strict=True):
        if size >= BOUND * (1.0 - SLACK):
            largest = min(largest, _largest(inverse_mass, k, damped_by, step))
    acts = step**2 * k + 2.0 * step * d
    root = _root(acts)
    values, vectors = np.linalg.eigh(root.T @ mobility @ root)
    mode = vectors[:, -1]
    motion = mobility @ (root @ mode)
    sprung = step**2 * float(motion @ k @ motion) / values[-1]
    damped = step * float(motion @ d @ motion) / values[-1]
    growth = float(np.abs(np.roots([1.0, sprung + damped - 2.0, 1.0 - damped])).max())
    alone = np.diag(acts) * np.diag(mobility)
    parts = alone if (alone >= BOUND * (1.0 - SLACK)).any() else (root @ mode) ** 2 / np.diag(acts)
    least = BOUND * (1.0 - SLACK) if parts is alone else SHARE
    strongest = [int(owner[acting[at]]) for at in np.argsort(-parts) if parts[at] >= least]
    initially = sizes[0] >= BOUND * (1.0 - SLACK)
    rows = tuple(dict.fromkeys(strongest))
    blame = (step**2 * along.stiffness + 2.0 * step * along.damping) * (along.weights[:, acting] @ motion) ** 2
    summed = int(np.argmax(blame)) if len(blame) and blame.sum() > values[-1] / 2.0 else None
    fluid = step * float(motion @ (d - local) @ motion) / values[-1] > (sprung + 2.0 * damped) / 4.0
    found = JointInstability((), step, largest, growth, initially, bool(2.0 * damped >= sprung), fluid=fluid)
    return rows, None if fluid else summed, found


def _size(mobility: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, step: float) -> float:
    """The largest eigenvalue of M⁻¹ (dt² K + 2 dt D): at least ``BOUND`` where something grows."""
    root = _root(step**2 * stiffness + 2.0 * step * damping)
    return float(np.linalg.eigvalsh(root.T @ mobility @ root)[-1])


def _root(acts: np.ndarray) -> np.ndarray:
    """R (n, n) with R Rᵀ = ``acts``, which is positive semidefinite: the root of a diagonal, where it is one."""
    diagonal = np.diag(acts)
    if not (acts - np.diag(diagonal)).any():
        return np.diag(np.sqrt(diagonal))
    values, vectors = np.linalg.eigh(acts)
    root: np.ndarray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _largest(mobility: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, unstable_step: float) -> float:
    """The largest step at which nothing grows, from below, to ``RESOLUTION``: the size grows with the step."""
    stable, too_large = 0.0, unstable_step
    while too_large - stable > RESOLUTION * too_large:
        middle = (stable + too_large) / 2.0 if stable else too_large / 2.0
        if _size(mobility, stiffness, damping, middle) < BOUND * (1.0 - SLACK):
            stable = middle
        else:
            too_large = middle
    return stable


# How much energy explicit integration adds to bodies that turn freely, from a world's initial velocities alone.
#
# Every engine is given one law: ω' = ω − dt I⁻¹ (ω × I ω), in the body's axes. Since ω · (ω × I ω) = 0, a step adds
# ½ dt² (ω × I ω)ᵀ I⁻¹ (ω × I ω) to the energy E. This is zero where ω is along a principal axis or the moments are equal; else
# dE/dt = r E with r proportional to E, so that E(t) = E₀ / (1 − r₀ t), which ends at t = 1 / r₀.

THRESHOLD = 0.02
"""Share of its energy that a rotation may gain in the time of a run: it is then 1 % too fast."""
MOST_STEPS = 20_000
"""Steps that are followed; the rest follows from the law above."""
MOST_WORK = 4_000_000
"""Bodies × steps."""
DIVERGED = 100.0
"""Times its energy, from which on a rotation has diverged."""
SLOW = 1e-3
"""ω² dt T of a mechanism below which it is not followed: where moments differ by a factor of two it gains a quarter of that."""

Floats = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Gain:
    """The energy that integration adds to the rotation of the tree of ``body``.

    turn          angle of a step (rad)
    gain          share of its kinetic energy that it gains in ``time`` (s); infinite where it diverges after that time
    largest_step  timestep (s) with which it gains ``THRESHOLD``
    """

    body: str
    turn: float
    gain: float
    time: float
    largest_step: float


def gains(world: World) -> list[Gain]:
    """The rotations that gain more than ``THRESHOLD`` of their energy in the world's duration if nothing stops them, in the
    order of the bodies. Bodies that are alike are followed once."""
    if not world.physics.steps:
        return []
    prescribed = {motion.body for motion in world.motions}
    alone: list[Body] = []
    found: list[Gain] = []
    for bodies in trees(world).values():
        if prescribed & {body.name for body in bodies}:
            continue
        turning = [body for body in bodies if body.joint.kind in QUATERNION_JOINTS and any(body.joint.velocity[-3:])]
        if not turning:
            continue
        if len(bodies) == 1 and bodies[0].joint.kind == "free":
            alone.append(bodies[0])
        else:
            found += _of_mechanism(world, bodies, turning)
    found += _of_bodies(alone, world.physics)
    rank = {body.name: row for row, body in enumerate(world.bodies)}
    return sorted(found, key=lambda gain: rank[gain.body])


def _of_bodies(bodies: Sequence[Body], physics: Physics) -> Iterator[Gain]:
    """The gains of single free bodies, followed side by side."""
    groups: dict[tuple[object, ...], list[Body]] = {}
    for body in bodies:
        joint = body.joint
        key = (
            body.inertial.inertia,
            joint.position[3:],
            joint.velocity[3:],
            joint.angular_damping,
            joint.angular_armature,
        )
        groups.setdefault(key, []).append(body)
    first = [group[0] for group in groups.values()]
    if not first:
        return
    tensors = np.array([_tensor(body) for body in first])
    turn = matrices(np.array([body.joint.position[3:] for body in first]))
    speed = np.einsum("nji,nj->ni", turn, np.array([body.joint.velocity[3:] for body in first]))
    damping = np.array([body.joint.angular_damping for body in first])
    moments = np.linalg.eigvalsh(tensors)
    with np.errstate(divide="ignore", invalid="ignore"):
        energy = 0.5 * np.einsum("ni,nij,nj->n", speed, tensors, speed)
        # |ω × I ω| ≤ |ω|² (I₃ − I₁) / 2, and |ω|² ≤ 2 E / I₁ all the way
        most = 2.0 * energy / moments[:, 0] * ((moments[:, 2] - moments[:, 0]) / moments[:, 0]) ** 2 / 4.0
    duration = physics.steps * physics.timestep
    follow = (moments[:, 0] > 0.0) & (most * physics.timestep * duration > THRESHOLD)
    if not follow.any():
        return
    rows = np.flatnonzero(follow)
    steps = min(physics.steps, MOST_STEPS, max(1, MOST_WORK // len(rows)))
    reached = _followed(tensors[rows], speed[rows], damping[rows], physics.timestep, steps)
    keys = list(groups.values())
    for row, (share, done) in zip(rows.tolist(), reached, strict=True):
        fast = float(np.linalg.norm(speed[row]))
        for body in keys[row]:
            yield from _gain(body.name, fast, share, done, physics)


def _tensor(body: Body) -> Floats:
    xx, yy, zz, xy, xz, yz = body.inertial.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + body.joint.angular_armature * np.eye(3)


def _followed(tensors: Floats, speed: Floats, damping: Floats, step: float, steps: int) -> list[tuple[float, int]]:
    """By body the largest share by which its energy was above the first, and after how many steps it was."""
    inverse = np.linalg.inv(tensors)
    start = np.einsum("ni,nij,nj->n", speed, tensors, speed)
    most, when = np.zeros(len(speed)), np.zeros(len(speed), dtype=int)
    for done in range(1, steps + 1):
        spin = np.einsum("nij,nj->ni", tensors, speed)
        slowing = np.cross(speed, spin) + damping[:, None] * speed
        speed = speed - step * np.einsum("nij,nj->ni", inverse, slowing)
        share = np.einsum("ni,nij,nj->n", speed, tensors, speed) / start - 1.0
        going = most < DIVERGED
        larger = going & ~(share <= most)
        most, when = np.where(larger, np.nan_to_num(share, nan=DIVERGED), most), np.where(larger, done, when)
        speed = np.where(going[:, None], speed, 0.0)
        if not going.any():
            break
    return list(zip(most.tolist(), when.tolist(), strict=True))


def _gain(body: str, speed: float, share: float, done: int, physics: Physics) -> Iterator[Gain]:
    """The energy that a rotation gains in the whole run, whose energy was ``share`` above the first after ``done`` steps."""
    if not done or share <= 0.0:
        return
    step, duration = physics.timestep, physics.steps * physics.timestep
    rate = (1.0 - 1.0 / (1.0 + share)) / (done * step)
    left = 1.0 - rate * duration
    gain, time = (1.0 / left - 1.0, duration) if left > 1.0 / DIVERGED else (math.inf, 1.0 / rate)
    if gain > THRESHOLD:
        # r₀ is proportional to the timestep: 1 / (1 − r₀ T) = 1 + THRESHOLD
        yield Gain(body, speed * step, gain, time, step * THRESHOLD / (1.0 + THRESHOLD) / (rate * duration))


def _of_mechanism(world: World, bodies: tuple[Body, ...], turning: Sequence[Body]) -> Iterator[Gain]:
    """The gain of a tree that does not turn as a single free body does, without gravity."""
    physics = world.physics
    fast = max(turning, key=lambda body: math.hypot(*body.joint.velocity[-3:]))
    speed = math.hypot(*fast.joint.velocity[-3:])
    if speed**2 * physics.timestep * physics.timestep * physics.steps <= SLOW:
        return
    part = dataclasses.replace(within(world, bodies), forces=(), motions=(), controllers=(), trajectory=None)
    part = dataclasses.replace(part, physics=dataclasses.replace(physics, gravity=(0.0, 0.0, 0.0), fluid=None))
    steps = max(1, min(physics.steps, MOST_STEPS // 10))
    every = max(1, steps // 100)
    if len(bodies) == 1 and fast.joint.kind == "ball" and not fast.joint.spring_stiffness and not part.constraints:
        shares = _about_pivot(fast, physics.timestep, steps, every)
    else:
        try:
            from simspec.dynamics.oracle import Oracle
        except ModuleNotFoundError:  # Pinocchio, which knows the mass matrix
            return
        oracle = Oracle(part)
        q, v = initial_state(part)
        start = sum(oracle.energy(q, v))
        with np.errstate(invalid="ignore", over="ignore"):
            states, speeds = oracle.motion(q, v, None, steps, every)
            kinetic = oracle.energy(q, v)[0]
            energies = np.array([sum(oracle.energy(*entry)) for entry in zip(states, speeds, strict=True)])
        shares = (energies - start) / kinetic
    beyond = ~(shares < DIVERGED)
    row = int(np.argmax(beyond)) if beyond.any() else int(np.argmax(shares))
    share = DIVERGED if beyond[row] else float(shares[row])
    yield from _gain(fast.name, speed, share, min(row * every, steps), physics)


def _about_pivot(body: Body, step: float, steps: int, every: int) -> Floats:
    """The share by which the energy of a body on a ball joint is above the first, every ``every`` steps and after the last."""
    joint, mass, (x, y, z) = body.joint, body.inertial.mass, body.inertial.centre_of_mass
    xx, yy, zz, xy, xz, yz = body.inertial.inertia
    xx, yy, zz = (
        moment + mass * square + joint.armature
        for moment, square in ((xx, y * y + z * z), (yy, x * x + z * z), (zz, x * x + y * y))
    )
    xy, xz, yz = xy - mass * x * y, xz - mass * x * z, yz - mass * y * z
    inverse = np.linalg.inv([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    (a, b, c), damping = joint.velocity, joint.damping
    energies = []
    for done in range(steps + 1):
        p, q, r = xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c
        if done % every == 0 or done == steps:
            energies.append(a * p + b * q + c * r)
            if not energies[-1] < DIVERGED * DIVERGED * energies[0]:
                break
        effort = b * r - c * q + damping * a, c * p - a * r + damping * b, a * q - b * p + damping * c
        a, b, c = (
            speed - step * (row[0] * effort[0] + row[1] * effort[1] + row[2] * effort[2])
            for speed, row in zip((a, b, c), inverse, strict=True)
        )
    return np.array(energies) / energies[0] - 1.0
