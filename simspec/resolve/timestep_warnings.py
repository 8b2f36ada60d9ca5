"""Warnings that follow from a world's numbers, alike in every engine: rotations that gain energy at the timestep, and
bodies that pass others between two steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.control.request import curve
from simspec.dynamics.stability import THRESHOLD, gains
from simspec.errors import Problem
from simspec.language.locate import locate
from simspec.language.sources import Source
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import poses, rigid_groups
from simspec.world.rotations import matrices
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Shape, World

# Bodies that move so far in one step that they may pass something without touching it, from initial velocities, gravity and
# the motions of kinematic bodies alone.
#
# Looked at are straight ways with the initial velocity, and ways of free fall, each up to what is in the way first. Contact of
# every engine begins where two shapes overlap at the end of a step. A ball of radius r that goes further in a step than r and
# half of the thickness of a wall is beyond the middle of the wall when contact is first found, or no contact is found.
# Joints, controllers and forces are left out.

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
    """The first obstacle, where the way of a step there is more than the two half thicknesses; else None."""
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
    # a body that begins as fast as that has not become so by falling
    falls = way.falls and steps[0] <= room
    return Passage(way.solid.body.name, other.body.name, speed, room, row * step, falls, way.kinematic)


def _enters(way: _Way, other: _Solid) -> int | None:
    """The first step in which the largest ball inside a shape meets the box about another; None where it never does, or begins
    there: a body that it lies on is not in its way."""
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


WHOLE = 1e-6
"""Steps by which a number of steps may miss a whole one."""
SAFE = 0.98
"""Share of the timestep at which a warning would end that is recommended at most."""
ROUND = (8.0, 5.0, 4.0, 2.5, 2.0, 1.6, 1.25, 1.0)
"""Leading digits of timesteps of which many durations are a whole number."""


def _step(seconds: float, world: World) -> str:
    """A timestep of at most ``seconds`` as a spec has it: round, and one of which the duration is a whole number where there is
    one that is not much smaller."""
    duration = world.physics.steps * world.physics.timestep
    size = 10.0 ** math.floor(math.log10(SAFE * seconds))
    fitting = [digits * scale for scale in (size, size / 10.0) for digits in ROUND if digits * scale <= SAFE * seconds]
    whole = [step for step in fitting if abs(duration / step - round(duration / step)) < WHOLE]
    return f"{(whole or fitting)[0]:.4g} s"


def timestep_warnings(spec: Source, world: World) -> Iterator[tuple[str, Problem]]:
    """All of them, as pairs (kind, problem)."""
    yield from _spinning(spec, world)
    yield from _passing(spec, world)
    yield from _dragged(spec, world)


def _spinning(spec: Source, world: World) -> Iterator[tuple[str, Problem]]:
    joints = {body.name: body.joint for body in world.bodies}
    for gain in gains(world):
        free = joints[gain.body].kind == "free"
        path = f"bodies.{gain.body}." + ("velocity.angular" if free else "joint.velocity")
        if math.isinf(gain.gain):
            more = f"diverges after {gain.time:.3g} s"
        else:
            more = f"gains {gain.gain:.2g} of its energy in {gain.time:.3g} s"
        message = (
            f"free rotation by {gain.turn:.3g} rad in a step: with explicit integration, as in every engine, it {more}"
        )
        allowed = f"a timestep of up to {_step(gain.largest_step, world)}, with which it gains {THRESHOLD:g}"
        hint = "a smaller physics.timestep; or a rotation about a principal axis"
        found = f"{gain.turn / world.physics.timestep:.4g} rad/s, a timestep of {world.physics.timestep:g} s"
        yield "spin", Problem(message, path, locate(spec, path), found, allowed, hint, code="W113")


def _passing(spec: Source, world: World) -> Iterator[tuple[str, Problem]]:
    for passage in passages(world):
        way = passage.speed * world.physics.timestep
        path = f"bodies.{passage.body}." + (
            "kinematic" if passage.kinematic else "pose" if passage.falls else "velocity.linear"
        )
        gets = "falls" if passage.falls else "moves"
        message = (
            f"{gets} {way:.3g} m in a step where {passage.obstacle!r} is in its way (at {passage.time:.3g} s): it may pass "
            f"without contact, since that is more than the half thicknesses of both, {passage.room:.3g} m"
        )
        allowed = f"a timestep of up to {_step(passage.room / passage.speed, world)}"
        found = f"{passage.speed:.4g} m/s, a timestep of {world.physics.timestep:g} s"
        hint = "a smaller physics.timestep; or thicker shapes"
        yield "passing", Problem(message, path, locate(spec, path), found, allowed, hint, code="W114")


def _dragged(spec: Source, world: World) -> Iterator[tuple[str, Problem]]:
    """Single free bodies that the drag of the fluid, which grows with the square of the speed, makes faster from the first step
    on: explicit in time, it turns a speed v into (1 − x) v, and |1 − x| > 1 from x = 2 on."""
    fluid = world.physics.fluid
    if fluid is None or not fluid.density:
        return
    parents = {body.joint.parent for body in world.bodies}
    step = world.physics.timestep
    for body in world.bodies:
        if body.joint.kind != "free" or body.name in parents or body.box is None or not body.inertial.mass:
            continue
        most = step * max(_drag_rates(body, fluid.density, fluid.velocity), default=0.0)
        if most > 2.0:
            path = f"bodies.{body.name}.velocity"
            message = (
                f"the drag of the fluid at {body.name!r} is explicit and unstable at its initial velocity: it makes the "
                f"velocity {most - 1.0:.3g} times as large in a step"
            )
            allowed = f"a timestep of up to {_step(2.0 * step / most, world)}"
            found = f"a timestep of {step:g} s"
            yield (
                "drag",
                Problem(message, path, locate(spec, path), found, allowed, "a smaller physics.timestep", code="W115"),
            )


def _drag_rates(body: Body, density: float, wind: tuple[float, float, float]) -> Iterator[float]:
    """The shares (1/s) of a free body's velocities that quadratic drag takes at the beginning, along and about the axes of its
    box (``world/actions.py``). The moments about these axes are its principal ones."""
    if body.box is None:
        return
    edges, mass = body.box.edges, body.inertial.mass
    frame = matrices(np.array(body.joint.position[3:]))
    axes = frame @ matrices(np.array(body.box.quaternion))
    lever = frame @ np.array(body.inertial.centre_of_mass)
    spin = np.array(body.joint.velocity[3:])
    speed = (np.array(body.joint.velocity[:3]) + np.cross(spin, lever) - np.array(wind)) @ axes
    turn = spin @ axes
    for axis in range(3):
        a, b, c = edges[axis], edges[axis - 1], edges[axis - 2]
        moment = mass * (b * b + c * c) / 12.0
        yield 0.5 * density * b * c * abs(float(speed[axis])) / (mass + body.joint.armature)
        if moment:
            yield density * a * (b**4 + c**4) / 64.0 * abs(float(turn[axis])) / (moment + body.joint.angular_armature)
