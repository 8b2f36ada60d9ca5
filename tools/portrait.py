"""A picture of a scenario at some times, side by side: docs/images/stack-cylinders.png.

    python tools/portrait.py specs/stack-cylinders.yaml --times 11 279 --out docs/images/stack-cylinders.png

Runs it in the engine that has a renderer which needs no graphics card, and lets that draw.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.control.request import from_request, to_request
from simspec.engines.kit.recorder import Stepper
from simspec.engines.kit.session import Session
from simspec.world.types import World

ENGINE = "pybullet"
WIDTH, HEIGHT = 800, 720
FIELD_OF_VIEW = 34.0
"""degrees."""
LIGHT = (1.0, 1.5, 3.0)


def pictures(world: World, times: Sequence[float], eye: Sequence[float], target: Sequence[float]) -> list[np.ndarray]:
    """An RGB picture (HEIGHT, WIDTH, 3) at each of the times (s, ascending)."""
    import pybullet

    found = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / ENGINE
        write_folder(compile_world(world, [ENGINE])[ENGINE].files, place)
        session = Session(ENGINE, place)
        stepper, done = Stepper(session, from_request(*to_request(world))), 0
        view = pybullet.computeViewMatrix(eye, target, (0.0, 0.0, 1.0))
        lens = pybullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, WIDTH / HEIGHT, 0.05, 10.0)
        for time in times:
            steps = round(time / world.physics.timestep)
            stepper.advance(done, steps - done)
            done = steps
            seen = pybullet.getCameraImage(
                WIDTH, HEIGHT, view, lens, renderer=pybullet.ER_TINY_RENDERER, lightDirection=LIGHT, shadow=1
            )
            found.append(np.reshape(seen[2], (HEIGHT, WIDTH, 4))[:, :, :3].astype(np.uint8))
        session.close()
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module's docstring."""
    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", type=Path)
    parser.add_argument("--times", nargs="+", type=float, required=True, help="s, ascending")
    parser.add_argument("--eye", nargs=3, type=float, default=(2.3, 2.15, 1.5), metavar=("X", "Y", "Z"))
    parser.add_argument("--target", nargs=3, type=float, default=(0.25, 0.55, 0.42), metavar=("X", "Y", "Z"))
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    world = simspec.load(given.spec).resolve()
    physics = dataclasses.replace(world.physics, steps=math.ceil(max(given.times) / world.physics.timestep - 1e-9))
    world = dataclasses.replace(world, physics=physics, expectations=())
    Image.fromarray(np.hstack(pictures(world, given.times, given.eye, given.target))).save(given.out, optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
