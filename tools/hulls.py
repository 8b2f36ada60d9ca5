"""Measure where convex hulls touch in each engine and how deep they come to rest, as a table in Markdown.

python tools/hulls.py [--hulls 20] [--engine mujoco ...] [--friction 0.5] [--set drake.contact_approximation=sap]

Hulls of 8 to 40 random points, 0.1 to 0.4 m wide. First touch: in random poses over a box, by bisection of the height, against
the hull's own support function. Rest: let down from 5 mm in a random pose, 2 s at 1 ms.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.proof.checks import extent
from simspec.testing.worlds import accepting
from simspec.world import frames
from simspec.world.hull import centred, corners, mesh_size
from simspec.world.shapes import SHAPES
from simspec.world.types import (
    Body,
    Contact,
    EngineOptions,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Quaternion,
    Shape,
    World,
)

ENGINES = ("mujoco", "pybullet", "drake", "ode")
FALL, STEPS = 0.005, 2000
POSES, HALVINGS = 4, 40


def landing(engine: str, size: tuple[float, ...], turn: Quaternion, friction: float, settings: dict[str, str]) -> World:
    """A hull in this pose above a box whose top is at z = 0."""
    moments = SHAPES["mesh"].moments(size, 1.0)
    height = lowest(size, turn) + FALL
    joint = Joint("free", "free", position=(0.0, 0.0, height, *turn), velocity=(0.0,) * 6)
    floor = Shape("floor_0", "box", (4.0, 4.0, 1.0), Pose((0.0, 0.0, -0.5)), "default")
    bodies = (
        Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), (floor,)),
        Body(
            "hull",
            "hull",
            Inertial(1.0, inertia=(*moments, 0.0, 0.0, 0.0)),
            joint,
            (Shape("hull_0", "mesh", size, Pose(), "default"),),
        ),
    )
    contact = Contact(
        materials=(Material("default", friction),), pairs=(PairContact("default", "default", friction, 0.0),)
    )
    options = EngineOptions(engine, settings=tuple(settings.items()))
    return accepting(World("landing", bodies, contact, Physics((0.0, 0.0, -9.81), 0.001), engines=(options,)), engine)


def lowest(size: tuple[float, ...], turn: Quaternion) -> float:
    """How far (m) the hull reaches below its centre."""
    down = np.array([[0.0, 0.0, -1.0]]) @ np.array(frames.matrix(turn))
    return float(SHAPES["mesh"].support(size, down)[0])


def loaded(world: World, engine: str, folder: Path) -> Engine:
    write_folder(compile_world(world, [engine])[engine].files, folder)
    simulation = find_engine(engine)()
    simulation.load(folder, read_sidecar(folder))
    return simulation


def first_touch(simulation: Engine, size: tuple[float, ...], turn: Quaternion) -> float:
    """How much deeper (m, negative: earlier) the engine finds a touch than the hull's own vertices."""
    low = lowest(size, turn)
    deep, high = -0.02, 0.02
    for _ in range(HALVINGS):
        middle = 0.5 * (deep + high)
        simulation.set_state(np.array([0.0, 0.0, low + middle, *turn]), np.zeros(6))
        deep, high = (middle, high) if len(simulation.detect_units()) else (deep, middle)
    return -0.5 * (deep + high)


def rest(simulation: Engine, world: World, size: tuple[float, ...]) -> tuple[float, float]:
    """How deep (m) it is in the floor at the end, and the largest of its speeds (m/s, rad/s)."""
    start = world.bodies[1].joint
    simulation.set_state(np.array(start.position), np.array(start.velocity))
    simulation.step(STEPS)
    q, v = simulation.get_state()
    w, x, y, z = q[3:7].tolist()
    return lowest(size, frames.normalise((w, x, y, z))) - float(q[2]), float(np.abs(v).max())


def draws(count: int) -> Iterator[tuple[tuple[float, ...], list[Quaternion]]]:
    generator = np.random.default_rng(11)
    for _ in range(count):
        points = generator.normal(size=(int(generator.integers(8, 41)), 3)) * generator.uniform(0.025, 0.1, 3)
        _, vertices = centred(points[corners(points)])
        turns = generator.normal(size=(POSES, 4)).tolist()
        yield mesh_size(vertices), [frames.normalise((w, x, y, z)) for w, x, y, z in turns]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hulls", type=int, default=20)
    parser.add_argument("--engine", action="append")
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--set", action="append", default=[], metavar="ENGINE.SETTING=WORD")
    options = parser.parse_args()
    print("| engine | first touch, of the extent | rests deeper than touch | faster than 1 mm/s at the end | fails |")
    print("|---|---|---|---|---|")
    for engine in options.engine or ENGINES:
        words = (text.partition("=") for text in options.set if text.startswith(f"{engine}."))
        settings = {name.partition(".")[2]: word for name, _, word in words}
        touches, depths, moving, fails = [], [], 0, 0
        with tempfile.TemporaryDirectory() as folder:
            for number, (size, turns) in enumerate(draws(options.hulls)):
                world = landing(engine, size, turns[0], options.friction, settings)
                simulation = loaded(world, engine, Path(folder) / str(number))
                off = max(abs(first_touch(simulation, size, turn)) for turn in turns)
                touches.append(off / extent(size))
                try:
                    depth, speed = rest(simulation, world, size)
                except EngineError:
                    fails += 1
                else:
                    depths.append(max(0.0, abs(depth) - off))
                    moving += speed > 1e-3
                simulation.close()
        deepest = f"{1e6 * max(depths):.2g} µm" if depths else "–"
        print(
            f"| {engine} | {max(touches):.1e} | {deepest} | {moving} of {options.hulls} | {fails} of {options.hulls} |"
        )


if __name__ == "__main__":
    main()
