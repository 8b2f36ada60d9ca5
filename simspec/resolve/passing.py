"""Bodies that move so far in one step that they may pass something without touching it, from initial velocities, gravity and
the motions of kinematic bodies alone.

Looked at are straight ways with the initial velocity, and ways of free fall, each up to what is in the way first. Contact of
every engine begins where two shapes overlap at the end of a step. A ball of radius r that goes further in a step than r and
half of the thickness of a wall is beyond the middle of the wall when contact is first found, or no contact is found.
Joints, controllers and forces are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.control.motions import curve
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import poses, rigid_groups
from simspec.world.rotations import matrices
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Shape, World

MOST_STEPS = 20_000
"""Steps of a way that are looked at."""
MOST_MOVERS, MOST_OBSTACLES = 100, 2_000
"""Shapes whose ways are looked at, the fastest first, and shapes that each is held against, the thinnest first."""
FLAT = "plane"

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Passage:
    """``body`` moves at ``speed`` (m/s) where ``obstacle`` is in its way, at ``time`` (s).

    room       the half thicknesses of the two shapes together (m)
    falls      whether it gets that fast by falling
    kinematic  whether by its motion
    """

    body: str
    obstacle: str
    speed: float
    room: float
    time: float
    falls: bool
    kinematic: bool


@dataclass(frozen=True)
class _Solid:
    body: Body
    shape: Shape
    centre: Floats
    axes: Floats
    """Columns: the shape's axes in the world."""
    inner: float

    def half(self) -> Floats:
        """Half sizes (3,) of the box about the shape, in its axes."""
        directions = np.concatenate([np.eye(3), -np.eye(3)])
        reach = SHAPES[self.shape.kind].support(self.shape.size, directions)
        half: Floats = np.maximum(reach[:3], reach[3:])
        return half


@dataclass(frozen=True)
class _Way:
    """A shape's places (n, 3), step by step."""

    solid: _Solid
    places: Floats
    falls: bool
    kinematic: bool


def passages(world: World) -> list[Passage]:
    """At most one for each body, in the order of the bodies."""
    if not world.physics.steps:
        return []
    solids = _solids(world)
    if len(solids) < 2:
        return []
    thinnest = min(solid.inner for solid in solids)
    ways = [way for way in _ways(world, solids) if _longest(way) > way.solid.inner + thinnest]
    ways.sort(key=lambda way: -_longest(way))
    obstacles = sorted(solids, key=lambda solid: solid.inner)[:MOST_OBSTACLES]
    found: dict[str, Passage] = {}
    for way in ways[:MOST_MOVERS]:
        name = way.solid.body.name
        if name not in found and (passage := _first(world, way, obstacles)) is not None:
            found[name] = passage
    return [found[body.name] for body in world.bodies if body.name in found]


def _solids(world: World) -> list[_Solid]:
    places = poses(world)
    found = []
    for body in world.bodies:
        for shape in body.shapes:
            if shape.collision:
                at = frames.compose(places[body.name], shape.pose)
                inner = SHAPES[shape.kind].inner_radius(shape.size)
                axes = np.array(frames.matrix(at.quaternion))
                found.append(_Solid(body, shape, np.array(at.position), axes, inner))
    return found


def _ways(world: World, solids: list[_Solid]) -> Iterator[_Way]:
    groups = rigid_groups(world)
    roots = {body.name: body for body in world.bodies if body.joint.kind == "free"}
    curves = {motion.body: curve(motion) for motion in world.motions}
    steps = min(world.physics.steps, MOST_STEPS)
    time = world.physics.timestep * np.arange(steps + 1)
    gravity = np.array(world.physics.gravity)
    for solid in solids:
        root = roots.get(groups[solid.body.name])
        if root is None:
            continue
        if root.name in curves:
            places, turns = curves[root.name].at(time)
            lever = matrices(np.array(root.joint.position[3:])).T @ (solid.centre - np.array(root.joint.position[:3]))
            yield _Way(solid, places + matrices(turns) @ lever, False, True)
            continue
        lever = solid.centre - np.array(root.joint.position[:3])
        speed = np.array(root.joint.velocity[:3]) + np.cross(root.joint.velocity[3:], lever)
        straight = solid.centre + np.outer(time, speed)
        if speed.any():
            yield _Way(solid, straight, False, False)
        pull = root.gravity_scale * gravity
        if pull.any():
            yield _Way(solid, straight + np.outer(0.5 * time * (time + world.physics.timestep), pull), True, False)


def _longest(way: _Way) -> float:
    return float(np.linalg.norm(np.diff(way.places, axis=0), axis=1).max(initial=0.0))


def _first(world: World, way: _Way, obstacles: list[_Solid]) -> Passage | None:
    """What is in the way first, where the way of a step there is more than the two half thicknesses; else None."""
    allowed = CollisionFilter(world)
    steps = np.linalg.norm(np.diff(way.places, axis=0), axis=1)
    best: tuple[int, float, _Solid] | None = None
    for other in obstacles:
        if other.body.name == way.solid.body.name or not allowed.may_touch(other.body.name, way.solid.body.name):
            continue
        if not allowed.may_materials_touch(other.shape.material, way.solid.shape.material):
            continue
        row = _enters(way, other)
        if row is not None and (best is None or (row, other.inner) < best[:2]):
            best = (row, other.inner, other)
    if best is None:
        return None
    row, _, other = best
    room = way.solid.inner + other.inner
    if steps[row] <= room:
        return None
    step = world.physics.timestep
    speed = float(steps[row] / step)
    # what begins as fast as that has not become so by falling
    falls = way.falls and steps[0] <= room
    return Passage(way.solid.body.name, other.body.name, speed, room, row * step, falls, way.kinematic)


def _enters(way: _Way, other: _Solid) -> int | None:
    """The first step in which the largest ball inside a shape meets the box about another; None where it never does, or begins
    there: what it lies on is not in its way."""
    local = (way.places - other.centre) @ other.axes
    begin, end = local[:-1], local[1:]
    if other.shape.kind == FLAT:
        met = end[:, 2] <= way.solid.inner
        begins = begin[0, 2] <= way.solid.inner
    else:
        half = other.half() + way.solid.inner
        begins = bool((np.abs(begin[0]) <= half).all())
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / (end - begin)
            near, far = (-half - begin) * inverse, (half - begin) * inverse
        inside = np.abs(begin) <= half
        low = np.where(np.isfinite(inverse), np.minimum(near, far), np.where(inside, -np.inf, np.inf))
        high = np.where(np.isfinite(inverse), np.maximum(near, far), np.where(inside, np.inf, -np.inf))
        enter, leave = low.max(axis=1), high.min(axis=1)
        met = (enter <= leave) & (leave >= 0.0) & (enter <= 1.0)
    if not met.any() or (begins and not way.falls):
        return None
    return int(np.argmax(met))
