"""The shortest question that tells whether an engine works at all: a ball falls for a tenth of a second, in its own process."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from simspec.compiler import compile_world, missing_options, write_folder
from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.scratch import scratch_folder
from simspec.world.types import Body, Contact, EngineOptions, Inertial, Joint, Physics, World

GRAVITY, TIMESTEP, STEPS, HEIGHT = 9.81, 1e-3, 100, 1.0
DEADLINE = 60.0
"""s: a cold disk and a compiler at work on an engine's own part take some; the fall itself milliseconds. What it compiles
for a model comes on top (``Engine.COMPILING``)."""
SPEED = 1e-5
"""How far the speed may be from g t, relative: every integrator that simspec admits gives it exactly, and a hundred sums in
single precision are off by 100 × 6e-8 at most."""
WAY = GRAVITY * TIMESTEP * TIMESTEP * STEPS
"""m, how far the height may be from ½ g t²: twice the error of an integrator of first order."""


@dataclass(frozen=True, slots=True)
class Fall:
    """A fall: the engine's version, s that it took, and how far speed (relative) and height (m) are from the closed form."""

    version: str
    seconds: float
    speed_error: float
    height_error: float


def fall(engine: str, python: str | None = None, deadline: float | None = None) -> Fall:
    """Let a ball fall in ``engine``, within ``deadline`` (s; None: what the engine needs at most). Raises EngineError where
    that fails, or where the ball does not fall as a ball does."""
    ball = Body(
        "ball",
        "ball",
        Inertial(2.0, (0.0, 0.0, 0.0), (0.02, 0.02, 0.02, 0.0, 0.0, 0.0)),
        Joint("free", "free", position=(0.0, 0.0, HEIGHT, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
    )
    world = World("fall", (ball,), Contact(), Physics((0.0, 0.0, -GRAVITY), TIMESTEP, STEPS))
    deadline = DEADLINE + find_engine(engine).COMPILING if deadline is None else deadline
    pythons = {engine: python} if python is not None else {}
    # how a body turns, which an engine may have approximately, is not asked here
    needed = missing_options(world, engine, pythons)
    accept, outside = (tuple(sorted(needed.get(key, ()))) for key in ("accept", "outside"))
    world = replace(world, engines=(EngineOptions(engine_name(engine), accept=accept, outside=outside),))
    began = time.perf_counter()
    with scratch_folder("fall") as folder:
        write_folder(compile_world(world, [engine], pythons=pythons)[engine].files, folder / "files")
        parameters = {"timestep": TIMESTEP, "phases": [[STEPS, STEPS]]}
        drive = Operation("drive", parameters, {"effort": np.zeros((1, 6))}, world)
        reply = call(engine, folder / "files", [drive], python=python, deadline=deadline)
    arrays = reply.answers[0].arrays
    t = STEPS * TIMESTEP
    speed = abs(float(arrays["velocity"][-1, 0, 2]) + GRAVITY * t) / (GRAVITY * t)
    height = abs(float(arrays["pose"][-1, 0, 2]) - (HEIGHT - 0.5 * GRAVITY * t * t))
    if not (speed <= SPEED and height <= WAY):
        raise EngineError(
            engine,
            f"a ball that falls for {t:g} s has a speed that is {speed:.3g} (relative) off g t, and a height that is "
            f"{height:.3g} m off ½ g t²; allowed are {SPEED:g} and {WAY:.3g} m",
        )
    return Fall(reply.versions["engine_version"], time.perf_counter() - began, speed, height)
