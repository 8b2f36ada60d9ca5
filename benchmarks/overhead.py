"""What simspec's runner costs over a bare hand-written loop of the same engine on the same files.

For each engine and scenario, one process alternates between the recorder's stepping (as ``simspec run`` times it) and a
bare loop written against the engine's own API, on the same loaded artifacts and from the same state; the ratio is that of
the two best times of all rounds, which a busy neighbour disturbs least. Target: ≤ 1.02.

    python benchmarks/overhead.py [--rounds 7] [--steps 500]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import simspec
from simspec.compiler import compile_world, write_folder
from simspec.engines.base import engines, find_engine
from simspec.engines.recorder import record
from simspec.formats.base import read_sidecar

SCENARIOS = ("spheres-216", "ur10e")
ROOT = Path(__file__).resolve().parent.parent


def bare_mujoco(engine, steps, every):
    import mujoco

    step, model, data = mujoco.mj_step, engine.model, engine.data
    started = time.perf_counter()
    for _ in range(steps // every):
        step(model, data, every)
    return time.perf_counter() - started


def bare_pybullet(engine, steps, every):
    import pybullet

    step, client = pybullet.stepSimulation, engine.client
    started = time.perf_counter()
    for _ in range(steps):
        step(client)
    return time.perf_counter() - started


def bare_dart(engine, steps, every):
    step = engine.world.step
    started = time.perf_counter()
    for _ in range(steps):
        step()
    return time.perf_counter() - started


BARE = {"mujoco": bare_mujoco, "pybullet": bare_pybullet, "dart": bare_dart}


def measure(name: str, folder: Path, steps: int, every: int, rounds: int) -> tuple[float, float]:
    """Best seconds of (simspec's stepping, the bare loop), alternating in this process."""
    best = [float("inf"), float("inf")]
    operation = {"op": "run", "steps": steps, "every": every, "channels": ["pose", "velocity", "contacts", "energy"]}
    for turn in range(2 * rounds):
        engine = find_engine(name)()
        engine.load(folder, read_sidecar(folder))
        if turn % 2:
            seconds = BARE[name](engine, steps, every)
        else:
            seconds = record(engine, {}, operation)[0]["step_seconds"]
        best[turn % 2] = min(best[turn % 2], seconds)
        engine.close()
    return best[0], best[1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--one", nargs=2, metavar=("SCENARIO", "ENGINE"), help="measure one pair in this process")
    given = parser.parse_args()
    every = 10
    if given.one:
        scenario, name = given.one
        world = simspec.load(ROOT / "specs" / f"{scenario}.yaml").resolve()
        with tempfile.TemporaryDirectory() as folder:
            write_folder(compile_world(world, [name])[name].files, Path(folder) / name)
            ours, bare = measure(name, Path(folder) / name, given.steps, every, given.rounds)
        print(
            f"{scenario:14} {name:9} {1e6 * ours / given.steps:10.1f} {1e6 * bare / given.steps:10.1f} {ours / bare:7.3f}"
        )
        return 0
    print(f"{'scenario':14} {'engine':9} {'simspec µs':>10} {'bare µs':>10} {'ratio':>7}")
    for scenario in SCENARIOS:
        for name in engines():
            command = [
                sys.executable,
                __file__,
                "--one",
                scenario,
                name,
                "--rounds",
                str(given.rounds),
                "--steps",
                str(given.steps),
            ]
            output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            print(output.strip().splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
