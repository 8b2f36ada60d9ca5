"""States in which every pair of solid shapes overlaps that can be brought together, as far as a bound of effort goes."""

from __future__ import annotations

import functools
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.proof.touch.free import FreePairs
from simspec.proof.touch.geometry import Solid, overlap
from simspec.proof.touch.mechanisms import JointPairs
from simspec.proof.touch.scene import Pair, Scene, States
from simspec.world.canonical import derived
from simspec.world.kinematics import trees
from simspec.world.types import World


@dataclass(frozen=True)
class Meetings:
    """What an engine is asked, and what of it.

    q        states (k, nq)
    tried    (n, 4): state, two shapes' numbers (the smaller first) that overlap clearly in it, and whether no other shapes of
             the same bodies and materials do
    rigid    how many pairs are parts of one rigid body and do not overlap
    apart    pairs that the joints cannot bring together, as far as was found
    untried  how many pairs were left out, since more states would have gone beyond the bounds of effort; ``left``: some of them
    """

    q: np.ndarray
    tried: np.ndarray
    solids: tuple[Solid, ...] = ()
    rigid: int = 0
    apart: tuple[Pair, ...] = ()
    untried: int = 0
    left: tuple[Pair, ...] = ()

    @property
    def pairs(self) -> int:
        """How many pairs of solid shapes of two bodies there are."""
        per_body = Counter(solid.body for solid in self.solids)
        return math.comb(len(self.solids), 2) - sum(math.comb(count, 2) for count in per_body.values())


def nothing(oracle: Oracle) -> Meetings:
    """No states at all."""
    return Meetings(np.zeros((0, oracle.nq)), np.zeros((0, 4), np.int64))


@functools.lru_cache(maxsize=8)
def nothing_to_try(world: World) -> str:
    """Why no two solid shapes of a world can be brought together; "" where some can."""
    solid = [body for body in world.bodies if any(shape.collision for shape in body.shapes)]
    if len(solid) < 2:
        return "there are no two bodies with collision shapes"
    carrying = {root: bodies[0].joint.kind for root, bodies in trees(world).items() if any(b in solid for b in bodies)}
    if len(carrying) > 1 and "free" in carrying.values():
        return ""
    planned = meetings_of(world)
    return (
        "" if len(planned.tried) else f"the joints bring no two of {planned.pairs} pairs of collision shapes together"
    )


@derived
def meetings_of(world: World) -> Meetings:
    """The plan of a world, made once: a proof probes engines with it, and says by it what a world does not have. Its arrays are
    shared: they are not to be changed."""
    return plan(world, oracle_of(world))


@derived
def oracle_of(world: World) -> Oracle:
    """The oracle of a world, made once for all that a proof asks of it."""
    return Oracle(world)


def plan(world: World, oracle: Oracle) -> Meetings:
    """States that bring the pairs of solid shapes of ``world`` together."""
    scene, states = Scene(world, oracle), States()
    if len(scene.solids) < 2:
        return Meetings(np.zeros((0, oracle.nq)), np.zeros((0, 4), np.int64), scene.solids)
    rigid = _as_built(scene, states)
    free, joints = FreePairs(scene), JointPairs(scene)
    free.bring_together(states)
    joints.bring_together(states)
    return Meetings(
        np.array(states.q).reshape(len(states.q), oracle.nq),
        np.array(states.tried, dtype=np.int64).reshape(-1, 4),
        scene.solids,
        rigid,
        tuple(joints.apart),
        free.untried + joints.untried,
        (*free.left, *joints.left),
    )


def _as_built(scene: Scene, states: States) -> int:
    """One state in which nothing is brought together: what overlaps by its build alone must not touch.

    Returns how many pairs of one rigid body do not overlap.
    """
    state = states.add(scene.parked)
    members: dict[str, list[int]] = {}
    for number, group in enumerate(scene.group):
        members.setdefault(group, []).append(number)
    outer = np.array([solid.outer for solid in scene.solids])
    body = np.array([solid.body for solid in scene.solids])
    centres = scene.at[:, :3, 3]
    apart = 0
    for numbers in members.values():
        own_numbers = np.array(numbers)
        for place, i in enumerate(numbers[:-1]):
            others = own_numbers[place + 1 :]
            others = others[body[others] != body[i]]
            near = others[np.linalg.norm(centres[others] - centres[i], axis=1) < outer[others] + outer[i]]
            met = [j for j in near.tolist() if overlap(scene.solids[i], scene.at[i], scene.solids[j], scene.at[j])]
            states.tried.extend((state, i, j, True) for j in met)
            apart += len(others) - len(met)
    return apart
