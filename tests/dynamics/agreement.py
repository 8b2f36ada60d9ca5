"""By how much the oracle and the second one differ, in what, over seeded states; random trees of every joint kind."""

from __future__ import annotations

import dataclasses
import random

import numpy as np

from simspec.dynamics.oracle import Oracle, random_states
from simspec.world.actions import Force
from simspec.world.constraints import ROWS
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import Physics, World
from tests import worlds
from tests.dynamics.simbody import Simbody
from tests.dynamics.simbody_model import turned

QUANTITIES = {
    "poses": "positions (m) and elements of rotations of all bodies",
    "velocities": "of all bodies, of the largest",
    "mass matrix": "each element, of the root of the two on the diagonal",
    "bias force": "of the largest element, or of the kinetic energy where that is more (one hinge has none)",
    "gravity force": "the same",
    "forces on bodies": "as efforts (Jᵀ F), of the largest element",
    "kinetic energy": "of itself",
    "potential energy": "of the largest seen, or of the kinetic energy where that is more",
    "acceleration": "under random efforts, of the largest element",
    "constraints": "φ, and J of joints, points and turns, where there are any",
    "motion": "q and v after some steps under a random effort, of the largest in each",
}
"""The compared quantities, and the scales of their differences."""


def _share(found: np.ndarray, expected: np.ndarray, least: float = 0.0) -> float:
    """The largest difference, of the largest expected."""
    scale = max(float(np.abs(expected).max(initial=0.0)), least)
    difference = float(np.abs(found - expected).max(initial=0.0))
    return difference / scale if scale else difference


def deviations(world: World, states: int = 3, steps: int = 0, given: World | None = None) -> dict[str, float]:
    """The largest difference in each quantity between the oracle and Simbody, at the initial state of a world and at
    ``states`` seeded ones, settled on its constraints, and between motions of ``steps``. Quantities that were not compared
    are left out: of bodies that cannot move, all but the poses. ``told``: another world for Simbody, by which a test sees
    what is found."""
    oracle, other = Oracle(world), Simbody(given or world)
    seeded = random_states(world, states)
    start = initial_state(world)
    pairs = [start, *((oracle.settled(q, start[0]), v) for q, v in zip(*seeded, strict=True))]
    generator = np.random.default_rng(5)
    worst: dict[str, float] = {}

    def note(name: str, share: float) -> None:
        worst[name] = max(worst.get(name, 0.0), share if np.isfinite(share) else np.inf)

    heights = [oracle.energy(q, v)[1] for q, v in pairs]
    places = layout_of(world)
    for q, v in pairs:
        poses = oracle.body_poses(q)
        for row, (position, matrix) in zip(poses, other.body_poses(q), strict=True):
            note("poses", float(np.abs(row[:3] - position).max()) / max(1.0, float(np.abs(position).max())))
            note("poses", float(np.abs(turned(row[3:]).as_matrix() - matrix).max()))
        if not oracle.nv:
            continue
        note("velocities", _share(oracle.body_velocities(q, v), other.body_velocities(q, v)))
        expected = other.mass_matrix(q)
        roots = np.sqrt(np.diag(expected))
        note("mass matrix", float(np.abs((oracle.mass_matrix(q) - expected) / np.outer(roots, roots)).max()))
        kinetic, potential = other.energy(q, v)
        for name, speeds in (("bias force", v), ("gravity force", np.zeros(oracle.nv))):
            note(name, _share(oracle.bias_force(q, speeds), other.bias_force(q, speeds), kinetic))
        for body in world.bodies:
            force = Force(body.name, *(tuple(generator.uniform(-1.0, 1.0, 3)) for _ in range(3)))
            note("forces on bodies", _share(oracle.effort_of(q, force), other.effort_of(q, force), 1.0))
        if world.constraints:
            jacobian, violation = oracle_constraints(oracle, q)
            note("constraints", float(np.abs(jacobian - other.jacobian(q)).max()))
            note("constraints", float(np.abs(violation - other.violation(q)).max()))
        found = oracle.energy(q, v)
        note("kinetic energy", abs(found[0] - kinetic) / kinetic if kinetic else abs(found[0]))
        scale = max(*(abs(height) for height in heights), kinetic)
        note("potential energy", abs(found[1] - potential) / scale if scale else abs(found[1] - potential))
        effort = roots * generator.uniform(-1.0, 1.0, oracle.nv)
        note("acceleration", _share(oracle.acceleration(q, v, effort), other.acceleration(q, v, effort)))
    if steps and oracle.nv:
        q, v = pairs[-1]
        effort = generator.uniform(-1.0, 1.0, oracle.nv) * np.diag(oracle.mass_matrix(q))
        states_q, states_v = oracle.motion(q, v, effort, steps, steps)
        found_q, found_v = other.motion(q, v, effort, steps)
        for body, at in zip(world.bodies, places.position, strict=True):  # a quaternion and its negative turn alike
            if body.joint.kind in ("ball", "free"):
                turn = slice(at.stop - 4, at.stop)
                found_q[turn] *= np.sign(found_q[turn] @ states_q[-1][turn])
        note("motion", _share(states_q[-1], found_q, 1.0))
        note("motion", _share(states_v[-1], found_v, 1.0))
    return worst


def oracle_constraints(oracle: Oracle, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J and φ of the oracle, whose parts have each the constraints of their own trees, in the world's order of constraints."""
    rows: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for tree, _, at_q, at_v in oracle._parts:
        if tree.violation is None:
            continue
        jacobian = np.zeros((tree.violation.count, oracle.nv))
        jacobian[:, at_v] = tree.jacobian(q[at_q])
        violation, start = tree.violation.of(q[at_q], tree.body_poses(q[at_q])), 0
        for constraint in tree.violation.constraints:
            part = slice(start, start := start + ROWS[constraint.kind])
            rows[constraint.name] = jacobian[part], violation[part]
    names = [constraint.name for constraint in oracle.world.constraints]
    return np.concatenate([rows[name][0] for name in names]), np.concatenate([rows[name][1] for name in names])


KINDS = ("fixed", "hinge", "slide", "ball", "hinge")
"""Joints below a root; the root may be free as well."""


def random_tree(seed: int) -> World:
    """One to three trees of up to eight bodies, in any order that has parents first, with joints of every kind, full
    tensors, skew axes and gravity, damping, springs, armature and partial weights in some."""
    generator = random.Random(f"simspec second oracle {seed}")
    bodies: list = []
    for number in range(generator.randint(1, 3)):
        count = generator.randint(1, 8)
        kinds = [generator.choice((*KINDS, "free", "free")), *(generator.choice(KINDS) for _ in range(count - 1))]
        parents = [-1, *(generator.randrange(index) for index in range(1, count))]
        bodies.append(list(worlds.tree(kinds, generator.randrange(10**6), parents, prefix=f"t{number}-")))
    given = []
    while any(bodies):
        given.append(generator.choice([tree for tree in bodies if tree]).pop(0))
    resists, heavy, lifted = (generator.random() < share for share in (0.5, 0.4, 0.3))
    for index, body in enumerate(given):
        joint = body.joint
        if resists and joint.kind != "fixed":
            joint = dataclasses.replace(joint, damping=generator.uniform(0.0, 0.5))
            if joint.kind == "free":
                joint = dataclasses.replace(joint, angular_damping=generator.uniform(0.0, 0.5))
            else:
                rest = generator.uniform(-0.3, 0.3) if joint.kind != "ball" else 0.0
                joint = dataclasses.replace(joint, spring_stiffness=generator.uniform(0.0, 9.0), spring_rest=rest)
        if heavy and joint.kind != "fixed" and generator.random() < 0.6:
            joint = dataclasses.replace(joint, armature=generator.uniform(0.0, 0.3))
            if joint.kind == "free":
                joint = dataclasses.replace(joint, angular_armature=generator.uniform(0.0, 0.3))
        scale = generator.uniform(-0.5, 1.5) if lifted and generator.random() < 0.5 else 1.0
        given[index] = dataclasses.replace(body, joint=joint, gravity_scale=scale)
    gravity = tuple(generator.uniform(-10.0, 10.0) for _ in range(3))
    return worlds.world(tuple(given), f"random-{seed}", physics=Physics(gravity, 0.001, 1000))
