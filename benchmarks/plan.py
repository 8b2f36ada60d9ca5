"""What planning a sweep costs: CPU time to make all cells with their keys, and peak memory, for 10,000 to a million runs.

Each row is measured in a process of its own, so that peak memory is that row's; ``before`` is the memory of a process that has
loaded the spec and made no cell. The shapes are a grid of two ranges, samples of two values, and perturbations of one world,
each in three engines. Bounded memory means: the difference does not grow with the number of runs.

    python benchmarks/plan.py
"""

from __future__ import annotations

import math
import resource
import subprocess
import sys
import time

SIZES = (10_000, 100_000, 1_000_000)
SHAPES = ("grid", "samples", "perturbed")
ENGINES = ("dart", "mujoco", "pybullet")


def sweep(shape: str, worlds: int) -> dict:
    if shape == "grid":
        side = math.isqrt(worlds)
        mass = {"from": 1, "to": 2, "count": side}
        return {"over": {"bodies.upper.mass": mass, "bodies.lower.mass": {**mass, "count": -(-worlds // side)}}}
    if shape == "samples":
        values = {"bodies.upper.mass": {"uniform": [1, 2]}, "bodies.lower.mass": {"normal": [1, 0.01]}}
        return {"samples": {"count": worlds, "seed": 1, "values": values}}
    return {"perturb": {"amount": 1e-9, "seeds": worlds - 1}}


def one(shape: str, runs: int) -> str:
    import simspec
    from simspec.experiments.plan import plan_sweep

    plain = simspec.load(simspec.find_spec("double-pendulum")).source.document.data
    spec = simspec.Spec.from_data({**plain, "sweep": sweep(shape, -(-runs // len(ENGINES)))})
    versions = {name: {"simspec": "0", "engine_version": "0"} for name in ENGINES}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    started = time.process_time()
    plan = plan_sweep(spec, engines=ENGINES, versions=versions)
    count = 0
    for cell in plan:
        count += len(cell.key) == 64
    seconds = time.process_time() - started
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    assert count == len(plan) >= runs
    return f"{shape:10} {count:9,} {seconds:8.2f} {1e6 * seconds / count:8.2f} {before:8.0f} {after:8.0f}"


def main() -> int:
    if len(sys.argv) == 3:
        print(one(sys.argv[1], int(sys.argv[2])))
        return 0
    print(f"{'':10} {'runs':>9} {'CPU s':>8} {'µs/run':>8} {'before':>8} {'peak MB':>8}")
    for shape in SHAPES:
        for runs in SIZES:
            command = [sys.executable, __file__, shape, str(runs)]
            result = subprocess.run(command, check=True, capture_output=True, text=True)
            print(result.stdout.rstrip().splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
