"""What follows from a world's numbers and is wrong in every engine alike: rotations that gain energy at the timestep, and
bodies that pass others between two steps."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from simspec.dynamics.spinning import THRESHOLD, gains
from simspec.errors import Problem
from simspec.language.locate import locate
from simspec.language.sources import Source
from simspec.resolve.passing import passages
from simspec.world.rotations import matrices
from simspec.world.types import Body, World

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
        yield "spin", Problem(message, path, locate(spec, path), found, allowed, hint)


def _passing(spec: Source, world: World) -> Iterator[tuple[str, Problem]]:
    for one in passages(world):
        way = one.speed * world.physics.timestep
        path = f"bodies.{one.body}." + ("kinematic" if one.kinematic else "pose" if one.falls else "velocity.linear")
        gets = "falls" if one.falls else "moves"
        message = (
            f"{gets} {way:.3g} m in a step where {one.obstacle!r} is in its way (at {one.time:.3g} s): it may pass without "
            f"contact, since that is more than the half thicknesses of both, {one.room:.3g} m"
        )
        allowed = f"a timestep of up to {_step(one.room / one.speed, world)}"
        found = f"{one.speed:.4g} m/s, a timestep of {world.physics.timestep:g} s"
        hint = "a smaller physics.timestep; or thicker shapes"
        yield "passing", Problem(message, path, locate(spec, path), found, allowed, hint)


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
            yield "drag", Problem(message, path, locate(spec, path), found, allowed, "a smaller physics.timestep")


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
