"""Whether joints' own damping and springs, those along sums of joint positions, and the viscosity of a fluid are stable at a
world's timestep, told before anything runs.

All are explicit in time in every engine. About a posture, M v' = M v − dt (K q + D v), q' = q + dt v', with M at that posture
and K, D the diagonals of stiffness and damping, k c cᵀ, d c cᵀ of each sum c, and what is linear in velocity of a fluid's
forces. By Jury's criterion no deviation x grows while xᵀ(4 M − 2 dt D − dt² K) x > 0: one joint alone is stable while
2 d dt + k dt² < 4 m, m its generalised inertia, 1 / (M⁻¹)ᵢᵢ. Changes of gravity, the
Coriolis force and drag with the state are left out.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from simspec.dynamics.oracle import model_key
from simspec.dynamics.oracle_tree import Tree
from simspec.dynamics.states import random_states
from simspec.world.kinematics import initial_state, layout_of, sprung_trees, within
from simspec.world.passive_forces import JointSums
from simspec.world.types import World

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
class Instability:
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


def unstable(world: World) -> list[Instability]:
    """Joints that diverge, one entry for each tree that has some; trees that are alike are looked at once. Raises
    SingularError."""
    known: dict[object, tuple[tuple[int, ...], int | None, Instability] | None] = {}
    instabilities = []
    for bodies in sprung_trees(world):
        part = within(world, bodies)
        sprung = any(body.joint.damping or body.joint.angular_damping or body.joint.spring_stiffness for body in bodies)
        viscous = world.physics.fluid is not None and world.physics.fluid.viscosity > 0.0
        if not sprung and not viscous and not any(one.damping or one.stiffness for one in part.sums):
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


def _unstable(world: World) -> tuple[tuple[int, ...], int | None, Instability] | None:
    """The rows of the bodies to blame, the sum that is more to blame (None: none is), and the instability without their names;
    None where the tree is stable."""
    tree, step = Tree(world), world.physics.timestep
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
    k, own = np.diag(stiffness[acting]) + more_k, np.diag(damping[acting]) + more_d
    dampings = [own + matrix[np.ix_(acting, acting)] for matrix in resisted]
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
    fluid = step * float(motion @ (d - own) @ motion) / values[-1] > (sprung + 2.0 * damped) / 4.0
    found = Instability((), step, largest, growth, initially, bool(2.0 * damped >= sprung), fluid=fluid)
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
