"""Forces and torques on bodies (:mod:`simspec.world.actions`) at work: as generalised efforts Jᵀ F, the same in every engine.

Runs in the engine's process, with numpy alone. J follows from the poses that the engine itself tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.actions import Force
from simspec.world.canonical import from_plain, to_plain
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import layout_of
from simspec.world.rotations import matrices
from simspec.world.types import Contact, Record, World

Array = NDArray[np.float64]
WHOLE = 1e-9
"""Steps, relative to their number: a time that is that near to the end of a step is the end of it, as far as decimals say."""


class _Mover(NamedTuple):
    """A joint on the way from the world to a body: the row of the body that it moves, its place in v, and what it is."""

    row: int
    place: slice
    kind: str
    axis: Array
    centre: Array
    """Of a free root the point that its position is of, in the body's frame (m)."""


@dataclass(frozen=True)
class _Acting:
    """One force, in steps, and the joints that feel it."""

    row: int
    first: float
    last: float
    force: Array
    torque: Array
    at: Array
    movers: tuple[_Mover, ...]

    def share(self, step: int) -> float:
        """The share of a step during which it acts."""
        return min(1.0, max(0.0, min(step + 1.0, self.last) - max(float(step), self.first)))


class AppliedForces:
    """The forces of a world at work."""

    def __init__(self, world: World):
        self.nv = layout_of(world).nv
        self._acting = [_acting(world, force) for force in world.forces]

    def acts(self, step: int) -> bool:
        """Whether any force acts in a step."""
        return any(acting.share(step) > 0.0 for acting in self._acting)

    def stretches(self, first: int, count: int) -> Iterator[tuple[int, int, bool]]:
        """``count`` steps from ``first`` on in pieces (first step, steps, whether forces act): those without a force together,
        those with one each alone, since its effort follows the body's motion."""
        step, end = first, first + count
        while step < end:
            acts = self.acts(step)
            begins = [int(acting.first) for acting in self._acting if acting.first > step]
            after = step + 1 if acts else max(step + 1, min([end, *begins]))
            yield step, after - step, acts
            step = after

    def effort(self, step: int, poses: Array) -> Array:
        """The effort (nv,) of a step, where bodies are at ``poses`` (bodies, 7) x y z w x y z in the world."""
        effort = np.zeros(self.nv)
        for acting in self._acting:
            share = acting.share(step)
            if not share:
                continue
            force, torque = share * acting.force, share * acting.torque
            (turn,) = matrices(poses[acting.row, None, 3:])
            point = poses[acting.row, :3] + turn @ acting.at
            for mover in acting.movers:
                (own,) = matrices(poses[mover.row, None, 3:])
                if mover.kind == "slide":
                    effort[mover.place] += own @ mover.axis @ force
                    continue
                moment = torque + np.cross(point - poses[mover.row, :3] - own @ mover.centre, force)
                if mover.kind == "free":
                    effort[mover.place] += np.concatenate([force, moment @ own])
                elif mover.kind == "ball":
                    effort[mover.place] += moment @ own
                else:
                    effort[mover.place] += own @ mover.axis @ moment
        return effort


def in_steps(time: float, timestep: float) -> float:
    """A time in steps; a whole number where it is one but for the rounding of decimals."""
    steps = time / timestep
    whole = round(steps)
    return float(whole) if abs(steps - whole) <= WHOLE * max(1.0, steps) else steps


def _acting(world: World, force: Force) -> _Acting:
    places = layout_of(world).velocity
    rows = {body.name: row for row, body in enumerate(world.bodies)}
    movers = []
    row: int | None = rows[force.body]
    while row is not None:
        body = world.bodies[row]
        kind = body.joint.kind
        if kind != "fixed":
            centre = lumped_inertial(world, body).centre_of_mass if kind == "free" else (0.0, 0.0, 0.0)
            axis = body.joint.axis if kind in SCALAR_JOINTS else (0.0, 0.0, 0.0)
            movers.append(_Mover(row, places[row], kind, np.array(axis), np.array(centre)))
        row = None if body.joint.parent is None else rows[body.joint.parent]
    timestep = world.physics.timestep
    last = np.inf if force.until is None else in_steps(force.until, timestep)
    first = in_steps(force.start, timestep)
    push, torque, at = (np.array(values) for values in (force.force, force.torque, force.at))
    return _Acting(rows[force.body], first, last, push, torque, at, tuple(movers))


# --- into the engine's process ------------------------------------------------------------------------------------------


def forces_to_request(world: World) -> dict[str, Any]:
    """Parameters (JSON) that :func:`forces_from_request` reads; empty when the world has no forces."""
    if not world.forces:
        return {}
    bodies = tuple(replace(body, shapes=()) for body in world.bodies)
    bare = World(world.name, bodies, Contact(), world.physics, Record(), forces=world.forces)
    return {"forces": to_plain(bare)}


def forces_from_request(parameters: Mapping[str, Any]) -> AppliedForces | None:
    """The forces that a request asks for; None when it asks for none."""
    content = parameters.get("forces")
    return None if content is None else AppliedForces(from_plain(World, content))


def brought_forward(forces: Sequence[Force], timestep: float, first: int, most: int) -> tuple[Force, ...]:
    """The forces moved by whole steps so that the earliest begins in step ``first``, each ``most`` steps long at most, and none
    begins later than ``most`` steps after the earliest."""
    begins = [in_steps(force.start, timestep) for force in forces]
    moved = []
    for force, begin in zip(forces, begins, strict=True):
        start = first + min(int(begin) - int(min(begins)), most) + begin - int(begin)
        length = np.inf if force.until is None else in_steps(force.until, timestep) - begin
        until = start + min(length, float(most))
        moved.append(replace(force, start=start * timestep, until=until * timestep))
    return tuple(moved)
