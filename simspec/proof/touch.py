"""Which bodies touch: pairs are brought together, engine by engine, and the engine's own detection is asked (level L4).

Nothing here knows how an engine filters: states go in, touching pairs come out. Two bodies are brought together by moving a
free root so that one body's shape dips into the other's, or, in one tree or on fixed bases, by searching joint positions.
Pairs that cannot be brought together cannot touch in a run either; they are counted.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.dynamics.states import random_states
from simspec.proof.checks import Check
from simspec.world import frames
from simspec.world.kinematics import CollisionFilter, initial_state, rigid_groups, trees
from simspec.world.types import Body, Shape, World

MAX_STATES = 1500
"""States in which pairs are tried: each costs an engine one collision detection of the whole world."""
SEARCH = 200
"""Joint configurations tried for two bodies whose distance no free root decides."""
FAR = 500.0
"""Metres from the scenario at which pairs meet, so that they meet nothing else."""
DIP = 0.5
"""Share of the smaller body's inner radius by which shapes overlap: far beyond margins, not so deep that normals vanish."""


@dataclass(frozen=True)
class Meetings:
    """States (k, nq), for each the pairs of body indices that overlap in it, and pairs that could not be tried."""

    q: np.ndarray
    pairs: list[list[tuple[int, int]]]
    unreachable: int = 0
    untried: int = 0
    names: tuple[str, ...] = field(default_factory=tuple)


def inner_radius(shape: Shape) -> float:
    """The radius of the largest sphere about the shape's centre inside it (m)."""
    if shape.kind in ("sphere", "capsule"):
        return shape.size[0]
    if shape.kind == "cylinder":
        return min(shape.size[0], shape.size[1] / 2)
    return min(shape.size, default=0.0) / (2 if shape.kind == "box" else 1)


def _thin_direction(shape: Shape) -> np.ndarray:
    """The unit vector in the shape's frame along which its surface is nearest to its centre."""
    if shape.kind == "plane":
        axis = 2
    elif shape.kind == "cylinder":
        axis = 0 if shape.size[0] <= shape.size[1] / 2 else 2
    elif shape.kind in ("box", "ellipsoid"):
        axis = int(np.argmin(shape.size))
    else:
        axis = 0
    return np.eye(3)[axis]


class _Planner:
    def __init__(self, world: World, oracle: Oracle):
        self.world, self.oracle = world, oracle
        self.index = {body.name: number for number, body in enumerate(world.bodies)}
        self.solid = {
            b.name: next(s for s in b.shapes if s.collision) for b in world.bodies if any(s.collision for s in b.shapes)
        }
        self.tree_of: dict[str, str] = {}
        self.free: dict[str, slice] = {}
        for root, bodies in trees(world).items():
            self.tree_of.update((body.name, root) for body in bodies)
            if bodies[0].joint.kind == "free":
                self.free[root] = oracle.layout.position[self.index[root]]
        self.q, _ = initial_state(world)
        self._park()

    def _park(self) -> None:
        """Put every free tree on a place of its own, far from everything."""
        for number, at in enumerate(self.free.values()):
            self.q[at.start : at.start + 3] = (20.0 * number, -FAR, FAR)

    def centre(self, poses: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Centre and rotation matrix in the world of a body's first solid shape."""
        row, shape = poses[self.index[name]], self.solid[name]
        turn = np.array(frames.matrix(tuple(row[3:])))
        return row[:3] + turn @ np.array(shape.pose.position), turn @ np.array(frames.matrix(shape.pose.quaternion))

    def meet(self, q: np.ndarray, mover: str, other: str, at: np.ndarray | None = None) -> np.ndarray:
        """Move the free tree of ``mover`` so that its shape dips into that of ``other`` (whose free tree goes to ``at``)."""
        q = q.copy()
        if at is not None:
            self._shift(q, other, at - self.centre(self.oracle.body_poses(q), other)[0])
        poses = self.oracle.body_poses(q)
        centre, turn = self.centre(poses, other)
        shape = self.solid[other]
        reach = inner_radius(self.solid[mover])
        dip = DIP * min(reach, inner_radius(shape) or reach)
        target = centre + turn @ _thin_direction(shape) * (inner_radius(shape) + reach - dip)
        self._shift(q, mover, target - self.centre(poses, mover)[0])
        return q

    def _shift(self, q: np.ndarray, name: str, by: np.ndarray) -> None:
        at = self.free[self.tree_of[name]]
        q[at.start : at.start + 3] += by

    def search(self, one: str, other: str) -> np.ndarray | None:
        """Joint positions at which the two bodies' shapes overlap; None when none was found."""
        wanted = DIP * (inner_radius(self.solid[one]) + inner_radius(self.solid[other]))
        plane = next((name for name in (one, other) if self.solid[name].kind == "plane"), None)

        def apart(q: np.ndarray) -> float:
            poses = self.oracle.body_poses(q)
            (a, turn_a), (b, turn_b) = self.centre(poses, one), self.centre(poses, other)
            if plane == one:
                return abs(float(turn_a[:, 2] @ (b - a)))
            if plane == other:
                return abs(float(turn_b[:, 2] @ (a - b)))
            return float(np.linalg.norm(a - b))

        generator = np.random.default_rng(self.index[one] * 1009 + self.index[other])
        best, best_q = apart(self.q), self.q
        for q in random_states(self.world, SEARCH // 2, seed=self.index[one] + 7919 * self.index[other])[0]:
            q = self._keep_parked(q)
            if (found := apart(q)) < best:
                best, best_q = found, q
        width = 0.3
        for _ in range(SEARCH):
            if best <= wanted:
                return best_q
            q = self._nudge(best_q, generator, width)
            if (found := apart(q)) < best:
                best, best_q = found, q
            else:
                width = max(width * 0.97, 1e-3)
        return best_q if best <= wanted else None

    def _keep_parked(self, q: np.ndarray) -> np.ndarray:
        q = q.copy()
        for at in self.free.values():
            q[at] = self.q[at]
        return q

    def _nudge(self, q: np.ndarray, generator: np.random.Generator, width: float) -> np.ndarray:
        q = q.copy()
        for body, at in zip(self.world.bodies, self.oracle.layout.position, strict=True):
            joint = body.joint
            if joint.kind in ("hinge", "slide"):
                q[at] += generator.normal() * width
                if joint.position_limits is not None:
                    q[at] = np.clip(q[at], *joint.position_limits)
            elif joint.kind == "ball":
                turned = q[at] + generator.normal(size=4) * width
                q[at] = turned / np.linalg.norm(turned)
        return q


def plan(world: World, oracle: Oracle) -> Meetings:
    """States that bring every pair of solid bodies together, as far as ``MAX_STATES`` go."""
    planner = _Planner(world, oracle)
    groups, names = rigid_groups(world), list(planner.solid)
    alone = [
        name
        for name in names
        if planner.tree_of[name] == name and name in planner.free and _single(world, planner, name)
    ]
    states, pairs = _tournament(planner, alone)
    if len(names) > 1:  # nothing is brought together here: what overlaps by its build alone must not touch
        states.append(planner.q)
        pairs.append([])
    singles, unreachable, untried = set(alone), 0, 0
    special = set(world.contact.excluded_bodies)
    rest = [
        (a, b)
        for a, b in itertools.combinations(names, 2)
        if groups[a] != groups[b] and not (a in singles and b in singles)
    ]
    rest.sort(key=lambda pair: (min(pair), max(pair)) not in special)  # named pairs first, if states run out
    for one, other in rest:
        if len(states) >= MAX_STATES:
            untried += 1
            continue
        q = _bring_together(planner, one, other)
        if q is None:
            unreachable += 1
            continue
        states.append(q)
        pairs.append([(planner.index[one], planner.index[other])])
    shape = (len(states), oracle.nq)
    return Meetings(np.array(states).reshape(shape), pairs, unreachable, untried, tuple(b.name for b in world.bodies))


def _single(world: World, planner: _Planner, root: str) -> bool:
    return sum(planner.tree_of[body.name] == root for body in world.bodies) == 1


def _tournament(planner: _Planner, names: list[str]) -> tuple[list[np.ndarray], list[list[tuple[int, int]]]]:
    """All pairs of single free bodies in rounds of disjoint pairs (the circle method), each pair on a place of its own."""
    ring: list[str | None] = [*names] if len(names) % 2 == 0 else [*names, None]
    states, pairs = [], []
    for turn in range(max(0, min(len(ring) - 1, MAX_STATES))):
        order = [ring[0], *np.roll(np.array(ring[1:], dtype=object), turn)]
        q, met = planner.q, []
        for slot in range(len(order) // 2):
            one, other = order[slot], order[-1 - slot]
            if one is not None and other is not None:
                q = _meet_alone(planner, q, one, other, np.array([20.0 * slot, FAR, FAR]))
                met.append((planner.index[one], planner.index[other]))
        states.append(q)
        pairs.append(met)
    return states, pairs


def _meet_alone(planner: _Planner, q: np.ndarray, mover: str, other: str, at: np.ndarray) -> np.ndarray:
    """As ``meet`` for two single bodies, without a look at the whole world."""
    q = q.copy()
    own, its = planner.free[mover], planner.free[other]
    lever, shape = _lever(planner.world.bodies[planner.index[other]], planner.solid[other], q[its][3:])
    q[its.start : its.start + 3] = at - lever
    turn = np.array(frames.matrix(tuple(q[its][3:]))) @ np.array(frames.matrix(shape.pose.quaternion))
    reach, inner = inner_radius(planner.solid[mover]), inner_radius(shape)
    target = at + turn @ _thin_direction(shape) * (inner + reach - DIP * min(reach, inner))
    lever, _ = _lever(planner.world.bodies[planner.index[mover]], planner.solid[mover], q[own][3:])
    q[own.start : own.start + 3] = target - lever
    return q


def _lever(body: Body, shape: Shape, turn: np.ndarray) -> tuple[np.ndarray, Shape]:
    """From a free body's centre of mass to its shape's centre, in world axes."""
    offset = np.array(shape.pose.position) - np.array(body.inertial.centre_of_mass)
    return np.array(frames.matrix(tuple(turn))) @ offset, shape


def _bring_together(planner: _Planner, one: str, other: str) -> np.ndarray | None:
    trees_differ = planner.tree_of[one] != planner.tree_of[other]
    movers = [
        name for name in (one, other) if planner.tree_of[name] in planner.free and planner.solid[name].kind != "plane"
    ]
    if not trees_differ or not movers:
        return planner.search(one, other)
    mover = movers[0]
    target = other if mover == one else one
    at = np.array([0.0, FAR, FAR]) if planner.tree_of[target] in planner.free else None
    return planner.meet(planner.q, mover, target, at)


def touch_checks(world: World, meetings: Meetings, touching: np.ndarray) -> list[Check]:
    """The collision matrix: for each pair brought together, whether the engine reports it, as the world's filter says; and
    that no forbidden pair touches in any state."""
    rule = CollisionFilter(world)
    names = meetings.names
    met = {  # bodies are brought together by their first solid shapes, which may pass through each other
        body.name: next(shape.material for shape in body.shapes if shape.collision)
        for body in world.bodies
        if any(shape.collision for shape in body.shapes)
    }
    seen = {(int(state), int(a), int(b)) for state, a, b in touching}
    count, wrong = 0, {}
    for state, pairs in enumerate(meetings.pairs):
        count += not pairs  # a state in which nothing was brought together: nothing must touch there
        for a, b in pairs:
            count += 1
            expected = rule.may_touch(names[a], names[b]) and rule.may_materials_touch(met[names[a]], met[names[b]])
            if expected != ((state, min(a, b), max(a, b)) in seen):
                wrong[min(a, b), max(a, b)] = expected
    for _, a, b in sorted(seen):  # what nobody brought together and still touches: parts of one rigid group, say
        if not rule.may_touch(names[a], names[b]):
            wrong.setdefault((a, b), False)
    detail = f"{meetings.unreachable} pairs cannot be brought together" if meetings.unreachable else ""
    if meetings.untried:
        detail += f"{'; ' if detail else ''}{meetings.untried} pairs left untried (at most {MAX_STATES} states)"
    where = ""
    if wrong:
        (a, b), expected = next(iter(wrong.items()))
        where = f"bodies.{names[a]}, bodies.{names[b]}"
        detail = f"{len(wrong)} pairs wrong; this one should {'' if expected else 'not '}touch; {detail}".rstrip("; ")
    return [Check("L4", "collision matrix", count, 0.0, float(len(wrong)), where, detail)]
